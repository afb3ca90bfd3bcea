"""How much model an axis needs (sections 3.3, 3.3.5).

The characteristic displacement x_s = F_s/σ0 (3.15) is the travel over which friction reverses. The
kinetic model (friction a function of velocity) reverses at once; on a reversal at constant
acceleration a it is wrong by p = 2·F_s·exp(−a·t²/(2·x_s))·(1 − σ1·a·t/F_s) (3.39), that is for about
√(2·x_s/a) seconds. Where the precision asked for is well above x_s, it does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autotune.core.recording import Metadata, torque_symbol
from autotune.identify.estimate import Quantity

Floats = NDArray[np.float64]
KINETIC_SUFFICES = 3.0
"""Precision over x_s from which the kinetic model will do."""


@dataclass(frozen=True, slots=True)
class Complexity:
    """x_s [rad or m], the verdict and the sentence that explains it.

    Attributes:
        lugre_needed: whether friction must be modelled through the reversal for `precision`.
        peak_difference: largest error of the kinetic model at a reversal, 2·F_s [N m].
        duration: how long it lasts at the acceleration of the benchmark [s].
    """

    displacement: Quantity
    precision: float
    lugre_needed: bool
    peak_difference: float
    duration: float
    text: str


def kinetic_difference(
    time: Floats, break_away: float, stiffness: float, micro_damping: float, acceleration: float
) -> Floats:
    """p(t) of (3.39) [N m] after a reversal at constant acceleration, shape as `time`."""
    exponent = -acceleration * time**2 * stiffness / (2.0 * break_away)
    return np.asarray(
        2.0 * break_away * np.exp(exponent) * (1.0 - micro_damping / break_away * acceleration * time)
    )


def judge_complexity(
    parameters: Mapping[str, Quantity], precision: float, acceleration: float, metadata: Metadata
) -> Complexity | None:
    """Whether the axis needs LuGre for a precision [rad or m]; None without friction or stiffness."""
    friction = parameters.get("break_away") or parameters.get("coulomb")
    stiffness = parameters.get("stiffness")
    if friction is None or stiffness is None or friction.value <= 0 or stiffness.value <= 0:
        return None
    value = friction.value / stiffness.value
    relative = math.hypot(friction.relative_error, stiffness.relative_error)
    displacement = Quantity(value, value * relative, max(friction.quantile, stiffness.quantile))
    needed = precision < KINETIC_SUFFICES * value
    duration = math.sqrt(2.0 * value / acceleration) if acceleration > 0 else math.inf
    return Complexity(
        displacement,
        precision,
        needed,
        2.0 * friction.value,
        duration,
        _sentence(value, precision, needed, 2.0 * friction.value, duration, metadata),
    )


def _sentence(
    value: float, precision: float, needed: bool, peak: float, duration: float, metadata: Metadata
) -> str:
    scale, unit = (1e3, "mrad") if metadata.motion_unit == "rad" else (1e6, "µm")
    torque = torque_symbol(metadata.motion_unit, metadata.torque_unit)
    verdict = (
        "the axis needs the LuGre model"
        if needed
        else "the kinetic model (friction as a function of velocity) will do"
    )
    return (
        f"friction reverses over x_s = {scale * value:.3g} {unit}; for a precision of "
        f"{scale * precision:.3g} {unit} {verdict}. At a reversal of the benchmark the kinetic model is "
        f"wrong by up to {peak:.3g} {torque} for about {1e3 * duration:.0f} ms"
    )
