"""Steady-state characteristics of several lubricants, dates or temperatures beside each other (section 6.1).

Friction over speed with its band, from the standard errors of a model; whether it rises everywhere, and how sure that
is; the least velocity gain that damps motion at every speed where it falls (4.19), corrected by x_a < 0 (4.14).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from autotune.control.gains.routh import bristle_of, least_damping
from autotune.core.arrays import Floats
from autotune.core.errors import AutotuneError, ConfigurationError
from autotune.core.units import damping_symbol
from autotune.models import layout
from autotune.models.contact import elements_carry, friction_limit, stiffened, viscous_coefficient
from autotune.models.contributions import all_multiplied
from autotune.models.drive_model import DriveModel
from autotune.models.layout import STIFFNESS
from autotune.models.stribeck import STRIBECK
from autotune.models.total_friction import total_friction

SPEEDS, DRAWS, SEED = 80, 200, 61
SLOWEST = 1e-3
"""Of the fastest speed shown: below it the axis sticks."""
FALLS = 2e-3
"""Of the friction level: a curve that falls by less is flat."""
MOST_SURE = 0.995
"""As much as a few hundred draws can tell."""
BAND = (2.5, 97.5)
AT_ZERO = np.zeros(1)
_level_factor = all_multiplied("level_factor")
VARIED = ("coulomb", "viscous", "break_away", "stribeck_velocity")


@dataclass(frozen=True, slots=True)
class Characteristic:
    """One curve.

    Attributes:
        speed, torque, low, high: shape (n,); friction without the offset, positive direction [N m or N].
        monotonic: it rises (or stays) everywhere; `confidence`: the part of the draws that say the same.
        falls: speeds between which it falls, None where it does not.
        least_gain: velocity gain that damps it at every speed, its viscous friction counted [N m s/rad].
        falling_term: the model can fall with speed at all.
    """

    name: str
    speed: Floats
    torque: Floats
    low: Floats
    high: Floats
    monotonic: bool
    confidence: float
    falls: tuple[float, float] | None
    least_gain: float
    intervals: bool
    falling_term: bool = True

    def as_json(self) -> dict[str, object]:
        return {
            "name": self.name,
            "monotonic": self.monotonic,
            "confidence": self.confidence if self.intervals else None,
            "falls_between": list(self.falls) if self.falls else None,
            "least_velocity_gain": self.least_gain,
            "speed": self.speed.tolist(),
            "friction": self.torque.tolist(),
            "low": self.low.tolist(),
            "high": self.high.tolist(),
        }

    def sentence(self, unit: str) -> str:
        """What it means for slow motion."""
        if self.monotonic:
            return (
                f"{self.name}: friction rises with speed everywhere{self._sure()}; it makes no stick-slip by itself, "
                "whatever the gains."
            )
        between = f" between {self.falls[0]:.2g} and {self.falls[1]:.2g} {unit}/s" if self.falls else ""
        falls = f"{self.name}: friction falls with speed{between}{self._sure()}"
        if self.least_gain <= 0.0:
            return f"{falls}; its own viscous friction damps that."
        return (
            f"{falls}; motion there needs a velocity gain (kd) of at least {self.least_gain:.3g} "
            f"{damping_symbol(unit)}, or it stick-slips."
        )

    def _sure(self) -> str:
        if not self.falling_term and self.monotonic:
            return (
                " (the model has no term that falls; whether one is missing, 'autotune model diagnose' tells)"
            )
        if not self.intervals:
            return " (how sure is not known, the model has no standard errors)"
        sure = f"{100 * self.confidence:.0f}" if self.confidence < MOST_SURE else "more than 99"
        return f" ({sure} % sure)"


def characteristic(name: str, model: DriveModel, fastest: float) -> Characteristic:
    """The curve of a model up to `fastest` [rad/s or m/s].

    Raises:
        ConfigurationError: `fastest` is not above 0.
    """
    if not fastest > 0.0:
        raise ConfigurationError(f"the fastest speed is {fastest!r}; it must be above 0")
    speed = np.geomspace(SLOWEST * fastest, fastest, SPEEDS)
    torque = friction_at(model, speed)
    drawn = [friction_at(one, speed) for one in _draws(model)]
    low, high = np.percentile(drawn, BAND, axis=0) if drawn else (torque, torque)
    rises = _rises(torque)
    same = float(np.mean([_rises(one) == rises for one in drawn])) if drawn else 1.0
    axis = bristle_of(model)
    return Characteristic(
        name,
        speed,
        torque,
        low,
        high,
        rises,
        same,
        None if rises else _falling(speed, torque),
        max(least_damping(axis, fastest) - axis.viscous, 0.0),
        bool(drawn),
        STRIBECK.name in model,
    )


def friction_at(model: DriveModel, velocity: Floats, places: Floats = AT_ZERO) -> Floats:
    """Friction against steady motion in either direction, without offset; shape (n,) [N m or N].

    Where it depends on the place it is the mean over `places`.
    """
    packed, state = model.pack(), np.zeros(layout.STATES)
    p, on = packed.p, packed.on
    elements = total_friction(model).value - model["coulomb"]

    def at(v: float) -> float:
        stiffness = float(p[STIFFNESS]) * stiffened(p, on, state, v)
        carried = elements * elements_carry(p, on, state, v)
        levels = [
            stiffness * friction_limit(p, on, state, float(place), v)
            + _level_factor(carried, p, on, state, float(place))
            for place in places
        ]
        return float(np.mean(levels)) + viscous_coefficient(p, on, state, v) * abs(v)

    return np.array([at(float(v)) for v in velocity])


def _rises(torque: Floats) -> bool:
    """Nowhere below what it has been at a lower speed, but for `FALLS`."""
    return bool(np.max(np.maximum.accumulate(torque) - torque) <= FALLS * float(np.max(torque)))


def _falling(speed: Floats, torque: Floats) -> tuple[float, float]:
    """From the speed of the highest value before the deepest fall, to that of its end."""
    fall = np.maximum.accumulate(torque) - torque
    end = int(np.argmax(fall))
    start = int(np.argmax(torque[: end + 1]))
    return float(speed[start]), float(speed[end])


def _draws(model: DriveModel) -> list[DriveModel]:
    """Models within the standard errors, drawn with a fixed seed; none where the model has no errors."""
    table = model.parameters
    errors = {name: table[name].standard_error for name in VARIED if name in table}
    known = {name: error for name, error in errors.items() if error is not None and error > 0.0}
    if not known:
        return []
    random = np.random.default_rng(SEED)
    found = []
    for _ in range(DRAWS):
        values = {name: max(random.normal(table[name].value, error), 0.0) for name, error in known.items()}
        if "stribeck_velocity" in values:
            values["stribeck_velocity"] = max(
                values["stribeck_velocity"], 0.1 * table["stribeck_velocity"].value
            )
        try:
            found.append(model.with_values(values))
        except AutotuneError:  # beyond what the parameter may be
            continue
    return found


def fastest_shown(models: Sequence[DriveModel]) -> float:
    """Ten times the largest Stribeck velocity, or where viscous friction is a fifth of all other [rad/s or m/s]."""
    speeds = []
    for model in models:
        if STRIBECK.name in model:
            speeds.append(10.0 * model["stribeck_velocity"])
        elif model["viscous"] > 0.0:
            speeds.append(0.2 * max(total_friction(model).value, 1e-9) / model["viscous"])
    return max(speeds, default=1.0)
