"""Friction as a table over velocity, as a drive holds it: points, straight lines between them, no memory.

    T(v) = sign(v)·(s·F(|v|) + b·|v|),   F(v) = F_c + (F_s − F_c) e^−(v/v_s)²           (3.5)

from the first point on; below it a straight line from the origin. Points are spread evenly over the logarithm of
velocity, from a knee to the axis's top speed, and rounded to the drive's steps. Viscous friction b is what it is. The
knee and the share s are free: a jump at every reversal is more than an axis can follow that gives way elastically, so
they are chosen by the predicted tracking error (`reduction`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from autotune.control.feedforward import LugreParameters, stribeck_level
from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.core.friction_table import (
    LARGEST_TORQUE,
    LARGEST_VELOCITY,
    PREFIX,
    TORQUE,
    TORQUE_STEP,
    VELOCITY,
    VELOCITY_STEP,
)
from autotune.core.ripple_parameters import numbered

_DRIVES = "feedforward."
WIDEST_KNEE = 0.25
"""Of the top speed: beyond the knee there have to be points for the rest of the curve."""


@dataclass(frozen=True, slots=True)
class TableBlock:
    """What a drive can hold: so many points, the largest values, and one step of each (0: none); SI."""

    points: int
    largest_velocity: float
    largest_torque: float
    velocity_step: float = 0.0
    torque_step: float = 0.0

    @classmethod
    def of(cls, held: Mapping[str, float]) -> TableBlock | None:
        """From the drive's parameters; None where it holds no such table."""
        points = numbered(VELOCITY, held)
        if not points:
            return None
        return cls(
            points,
            held[LARGEST_VELOCITY],
            held[LARGEST_TORQUE],
            held.get(VELOCITY_STEP, 0.0),
            held.get(TORQUE_STEP, 0.0),
        )

    def refuses(self, full: LugreParameters, top: float) -> str:
        """Why friction up to the speed `top` does not go into it; "" where it does."""
        most = float(np.max(_friction(full, np.linspace(0.0, self._top(top), 200), 1.0)))
        if most > self.largest_torque:
            return (
                f"friction of {most:.3g} overflows the drive's table over velocity, which takes "
                f"{self.largest_torque:.3g} at most"
            )
        if most < 20.0 * self.torque_step:
            return f"friction of {most:.2g} is nothing in the drive's table, which has steps of {self.torque_step:.2g}"
        return ""

    def _top(self, top: float) -> float:
        return min(top, self.largest_velocity)

    def filled(self, full: LugreParameters, knee: float, share: float, top: float) -> dict[str, float]:
        """The points, named without `feedforward.`.

        Args:
            full: what friction is.
            knee: velocity of the first point.
            share: of the friction level, 0 to 1.
            top: fastest motion of the axis; a slower drive's table ends before.

        Raises:
            ConfigurationError: the drive's steps are too coarse for points that increase.
        """
        top = self._top(top)
        velocity = _rounded(np.geomspace(min(knee, WIDEST_KNEE * top), top, self.points), self.velocity_step)
        if velocity[0] <= 0.0 or np.any(np.diff(velocity) <= 0.0):
            raise ConfigurationError(
                f"the drive's table over velocity has steps of {self.velocity_step:.3g}: too coarse for {self.points} "
                f"points up to {top:.3g}"
            )
        torque = np.minimum(_rounded(_friction(full, velocity, share), self.torque_step), self.largest_torque)
        return {
            f"{stem.removeprefix(_DRIVES)}.{k}": float(value)
            for stem, values in ((VELOCITY, velocity), (TORQUE, torque))
            for k, value in enumerate(values)
        }


@dataclass(frozen=True, slots=True)
class Points:
    """A table that a drive plays; shape (k + 1,) each, the origin first."""

    velocity: Floats
    torque: Floats

    @classmethod
    def among(cls, values: Mapping[str, float]) -> Points | None:
        """From a drive's values, named without `feedforward.`; None where there is no table, or an empty one."""
        stems = [stem.removeprefix(_DRIVES) for stem in (VELOCITY, TORQUE)]
        count = numbered(stems[0], values)
        velocity, torque = ([0.0, *(values[f"{stem}.{k}"] for k in range(count))] for stem in stems)
        return cls(np.array(velocity), np.array(torque)) if velocity[-1] > 0.0 else None

    def at(self, velocity: Floats | float) -> Floats:
        """Torque at these velocities, same shape."""
        return np.asarray(np.sign(velocity) * np.interp(np.abs(velocity), self.velocity, self.torque))


def is_point(name: str) -> bool:
    """True for a point of a table, named with or without `feedforward.`."""
    return name.startswith((PREFIX, PREFIX.removeprefix(_DRIVES)))


def _friction(full: LugreParameters, speed: Floats, share: float) -> Floats:
    level = np.array([stribeck_level(full.array(), float(v)) for v in speed])
    return np.asarray(share * level + full.viscous * speed)


def _rounded(values: Floats, step: float) -> Floats:
    return np.asarray(step * np.round(values / step)) if step > 0.0 else values
