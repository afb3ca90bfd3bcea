"""Torque ripple of a model reduced to what a drive holds: harmonics, or a table of whole steps over a turn.

A drive adds its torque over the turn of its commutation encoder, so what it holds repeats every turn: orders
must be whole. A wave C of order n is the torque Re(C·e^{inθ}) that the motor has to give.

Harmonics: the largest go in first. A table of N points with straight lines between them plays a wave
sinc²(n/N) times as large as its points say; the points are made larger by that. Points are rounded to whole
steps of max|torque| / largest step; the rounding leaves step²/12 of variance, mostly between the points.

What is kept is the share of the ripple's rms that the drive takes away: 1 − rms(left) / rms(all).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.core.ripple_parameters import (
    GAIN,
    HIGHEST_ORDER,
    LARGEST_STEP,
    ORDER,
    PHASE,
    SOURCE,
    TABLE,
    TORQUE,
    numbered,
)
from autotune.models.waves import Wave

WHOLE = 0.02
"""An order this near to a whole number is that number: over one turn it errs by a fiftieth of a wave at most."""
POINTS_A_WAVE = 4
"""A table plays no wave with fewer points: straight lines between them would leave half of it and add others."""
DRIVE_MEMORY = 2.0


@dataclass(frozen=True, slots=True)
class RippleBlock:
    """What a drive can hold: `harmonics` of at most `highest_order`, or `points` of at most `largest_step` steps."""

    harmonics: int = 0
    points: int = 0
    highest_order: int = 0
    largest_step: int = 0
    has_source: bool = False

    @classmethod
    def of(cls, held: Mapping[str, float]) -> RippleBlock | None:
        """From the drive's parameters; None where it holds no ripple."""
        if GAIN not in held:
            return None
        points = numbered(TABLE, held)
        if points:
            largest = int(held.get(LARGEST_STEP, 127.0))
            return cls(points=points, highest_order=points // POINTS_A_WAVE, largest_step=largest)
        highest = int(held.get(HIGHEST_ORDER, 0.0))
        return cls(numbered(ORDER, held), highest_order=highest, has_source=SOURCE in held)

    @property
    def in_words(self) -> str:
        if self.points:
            return f"a table of {self.points} points of ±{self.largest_step} steps"
        return f"{self.harmonics} harmonics up to order {self.highest_order}"


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A wave that the drive cannot hold: its order, amplitude [N m], and why."""

    order: float
    amplitude: float
    why: str


@dataclass(frozen=True, slots=True)
class KeptRipple:
    """What goes into the drive.

    Attributes:
        waves: order → C, in the model's own angle [N m].
        left_out: the others.
        kept: predicted share of the ripple's rms that is taken away, rounding included; 0 to 1.
    """

    waves: Mapping[int, complex]
    left_out: tuple[LeftOut, ...]
    kept: float

    def in_words(self) -> str:
        """For a person, before it is written."""
        orders = ", ".join(str(order) for order in sorted(self.waves)) or "none"
        told = f"torque ripple of order {orders}: {100 * self.kept:.0f} % of it"
        if self.left_out:
            rest = "; ".join(
                f"order {one.order:g} with {1e3 * one.amplitude:.2g} mN m, {one.why}" for one in self.left_out
            )
            told += f" (left out: {rest})"
        return told


def keep(waves: Iterable[Wave], block: RippleBlock) -> KeptRipple:
    """Which waves of a model the drive can hold, and what is lost."""
    kept: dict[int, complex] = {}
    out: list[LeftOut] = []
    every = sorted(waves, key=lambda wave: -wave.amplitude)
    most = block.harmonics or len(every)
    for wave in every:
        why = _why_not(wave, block)
        if not why and len(kept) >= most and round(wave.order) not in kept:
            why = f"as the drive holds {most} harmonics and this is one of the smaller"
        if why:
            out.append(LeftOut(wave.order, wave.amplitude, why))
            continue
        order = round(wave.order)  # A·sin(Nq + φ) = Re(−iA·e^{iφ}·e^{iNq})
        kept[order] = kept.get(order, 0j) - 1j * wave.amplitude * np.exp(1j * wave.phase)
    total = math.sqrt(sum(wave.amplitude**2 for wave in every) / 2.0)
    left = sum(one.amplitude**2 for one in out) / 2.0 + rounding(kept, block) ** 2
    share = max(0.0, 1.0 - math.sqrt(left) / total) if total > 0.0 else 0.0
    return KeptRipple(kept, tuple(out), share)


def _why_not(wave: Wave, block: RippleBlock) -> str:
    if abs(wave.order - round(wave.order)) > WHOLE or round(wave.order) < 1:
        return "not whole, so it is at another place after each turn"
    if wave.order > block.highest_order + WHOLE:
        return f"above order {block.highest_order}, the drive's highest"
    return ""


def rounding(waves: Mapping[int, complex], block: RippleBlock) -> float:
    """Rms that rounding to whole steps leaves [N m]; 0 for harmonics."""
    if not block.points or not waves:
        return 0.0
    return step_of(table_of(waves, block.points), block) / math.sqrt(12.0)


def table_of(waves: Mapping[int, complex], points: int) -> Floats:
    """Torque at the points of a table whose straight lines play these waves; shape (points,) [N m]."""
    angle = 2.0 * np.pi * np.arange(points) / points
    torque = np.zeros(points)
    for order, wave in waves.items():
        torque += np.real(wave / np.sinc(order / points) ** 2 * np.exp(1j * order * angle))
    return torque


def step_of(torque: Floats, block: RippleBlock) -> float:
    """The smallest step with which the table fits [N m]."""
    return float(np.max(np.abs(torque))) / block.largest_step


def drive_values(waves: Mapping[int, complex], sense: int, block: RippleBlock) -> dict[str, float]:
    """The complete set of parameters that holds waves of the drive's angle, in the order of writing.

    Args:
        waves: order → C with the torque Re(C·e^{inφ}) over the drive's angle φ, counted in the axis's direction.
        sense: −1 where the drive counts its angle or its phases the other way.

    Raises:
        ConfigurationError: more waves than it holds, or of a higher order.
    """
    if len(waves) > (block.harmonics or len(waves)) or max(waves, default=0) > block.highest_order:
        raise ConfigurationError(
            f"{len(waves)} harmonics up to order {max(waves, default=0)} do not fit into this drive, which holds "
            f"{block.in_words}; reduce the model first"
        )
    own = {order: wave if sense > 0 else wave.conjugate() for order, wave in waves.items()}
    return _table_values(own, block) if block.points else _harmonic_values(own, block)


def _harmonic_values(own: Mapping[int, complex], block: RippleBlock) -> dict[str, float]:
    values = {SOURCE: DRIVE_MEMORY} if block.has_source else {}
    listed = [*sorted(own.items()), *([(0, 0j)] * (block.harmonics - len(own)))]
    for number, (order, wave) in enumerate(listed):
        values[f"{ORDER}.{number}"] = float(order)
        values[f"{PHASE}.{number}"] = float(np.angle(wave)) % (2.0 * math.pi) if wave else 0.0
        values[f"{TORQUE}.{number}"] = abs(wave)
    return values | {GAIN: 1.0}


def _table_values(own: Mapping[int, complex], block: RippleBlock) -> dict[str, float]:
    torque = table_of(own, block.points)
    step = step_of(torque, block)
    steps = whole_steps(torque, step, block) if step > 0.0 else np.zeros(block.points)
    return {f"{TABLE}.{k}": float(value) for k, value in enumerate(steps)} | {GAIN: step}


def whole_steps(torque: Floats, step: float, block: RippleBlock) -> Floats:
    """The table in whole steps of `step` [N m]; shape (points,).

    Raises:
        ConfigurationError: it does not fit; the step with which it would is named.
    """
    steps = np.rint(torque / step)
    most = float(np.max(np.abs(steps)))
    if most > block.largest_step:
        raise ConfigurationError(
            f"the table needs {most:.0f} steps of {step:.4g} N m, and the drive holds at most {block.largest_step}; "
            f"with a step of {step_of(torque, block):.4g} N m it fits, a little coarser"
        )
    return np.asarray(steps)


def is_on(held: Mapping[str, float]) -> bool:
    """True where the drive adds ripple by itself."""
    return held.get(GAIN, 0.0) != 0.0


def off(held: Collection[str]) -> dict[str, float]:
    """What switches it off; empty where there is nothing to switch."""
    return {GAIN: 0.0} if GAIN in held else {}
