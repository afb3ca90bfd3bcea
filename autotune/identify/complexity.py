"""How much model an axis needs (sections 3.3, 3.3.5).

The characteristic displacement x_s = F_s/σ0 (3.15) is the travel over which friction reverses: all but a
share e⁻¹ of it. The kinetic model (friction a function of velocity) reverses at once; on a reversal at
constant acceleration a it is wrong by p = 2·F_s·exp(−a·t²/(2·x_s))·(1 − σ1·a·t/F_s) (3.39), that is for
about √(2·x_s/a) seconds. Where the precision asked for is well above x_s, it does not matter.

x_s belongs to Dahl's curve (6.2.3), which shows the whole reversal. The stiffness of presliding sees the
contact as it is before any element has let go: on an axis with several elastic elements F_s/σ0 is then
several times too short (Table 6.2: 3.3 against 14.8 mrad), which is the unsafe side. Without Dahl's curve it
is a lower bound, and the sentence says so.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.units import torque_symbol
from autotune.identify.estimate import Quantity
from autotune.recordings.recording import Metadata

KINETIC_SUFFICES = 3.0
"""Precision over x_s from which the kinetic model will do."""


@dataclass(frozen=True, slots=True)
class Complexity:
    """x_s [rad or m], the verdict and the sentence that explains it.

    Attributes:
        displacement: x_s, from Dahl's curve where there is one.
        lower_bound: there was none: friction reverses over `displacement` at least.
        lugre_needed: whether friction must be modelled through the reversal for `precision`.
        peak_difference: largest error of the kinetic model at a reversal, 2·F_s [N m].
        duration: how long it lasts at `acceleration` [s].
        acceleration: at the reversal that is judged [rad/s² or m/s²].
    """

    displacement: Quantity
    precision: float
    lugre_needed: bool
    peak_difference: float
    duration: float
    text: str
    lower_bound: bool = False
    acceleration: float = math.nan


def kinetic_difference(
    time: Floats, break_away: float, stiffness: float, micro_damping: float, acceleration: float
) -> Floats:
    """p(t) of (3.39) [N m] after a reversal at constant acceleration, shape as `time`."""
    exponent = -acceleration * time**2 * stiffness / (2.0 * break_away)
    return np.asarray(
        2.0 * break_away * np.exp(exponent) * (1.0 - micro_damping / break_away * acceleration * time)
    )


def judge_complexity(
    parameters: Mapping[str, Quantity],
    precision: float,
    acceleration: float,
    metadata: Metadata,
    reversal: Quantity | None = None,
) -> Complexity | None:
    """Whether the axis needs LuGre for a precision [rad or m]; None without friction or stiffness.

    Args:
        reversal: x_s of Dahl's curve; None where none was recorded.
        acceleration: at the reversals of the application [rad/s² or m/s²].
    """
    levels = [q for q in (parameters.get("break_away"), parameters.get("coulomb")) if q is not None]
    if not levels or max(q.value for q in levels) <= 0.0:
        return None
    friction = max(levels, key=lambda q: q.value)
    at_rest = _at_rest(friction, parameters.get("stiffness"))
    known = [q for q in (reversal, at_rest) if q is not None]
    if not known:
        return None
    displacement = max(known, key=lambda q: q.value)
    value = displacement.value
    duration = math.sqrt(2.0 * value / acceleration) if acceleration > 0 else math.inf
    judged = Complexity(
        displacement,
        precision,
        precision < KINETIC_SUFFICES * max(value, displacement.interval[1]),
        2.0 * friction.value,
        duration,
        "",
        reversal is None,
        acceleration,
    )
    return replace(judged, text=_sentence(judged, metadata))


def _at_rest(friction: Quantity, stiffness: Quantity | None) -> Quantity | None:
    """F_s/σ0 with the stiffness at rest."""
    if stiffness is None or stiffness.value <= 0.0:
        return None
    value = friction.value / stiffness.value
    relative = math.hypot(friction.relative_error, stiffness.relative_error)
    return Quantity(value, value * relative, max(friction.quantile, stiffness.quantile))


def _sentence(judged: Complexity, metadata: Metadata) -> str:
    scale, unit = (1e3, "mrad") if metadata.motion_unit == "rad" else (1e6, "µm")
    torque = torque_symbol(metadata.motion_unit, metadata.torque_unit)
    verdict = (
        "the axis needs the LuGre model"
        if judged.lugre_needed
        else "the kinetic model (friction as a function of velocity) will do"
    )
    least = "at least " if judged.lower_bound else ""
    hint = (
        ". That is what stiffness at rest says; where several elastic elements let go one after another, "
        "friction reverses over more: record Dahl's curve"
        if judged.lower_bound and not judged.lugre_needed
        else ""
    )
    return (
        f"friction reverses over x_s = {least}{scale * judged.displacement.value:.3g} {unit}; for a precision "
        f"of {scale * judged.precision:.3g} {unit} {verdict}. At a reversal with {judged.acceleration:.2g} "
        f"{metadata.motion_unit}/s² the kinetic model is wrong by up to {judged.peak_difference:.3g} {torque} "
        f"for {least or 'about '}{1e3 * judged.duration:.0f} ms{hint}"
    )
