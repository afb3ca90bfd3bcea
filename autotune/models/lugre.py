"""The LuGre bristle and the shapes of steady-state friction.

z' = v − |v|/g(v)·z (3.10), integrated exactly for constant velocity (5.8); friction is
σ0·z + σ1·z' + σ2·v (3.9). Shapes of σ0·g(v): Table 2.1. Where σ1 fades with speed it is σ1·exp(−(v/v_d)²)
[canudas-1995], or σ1/(1 + (v/v_d)²): the contact is damped while it bends, and hardly while it slides. Where g goes to
nothing with speed the contact has no static friction (`crept`): it creeps under any torque, as a film does.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.models.compiled import compiled
from autotune.models.lanes import anywhere, where

Shape = Literal[
    "linear", "piecewise_linear", "exponential", "gaussian", "generalised_exponential", "lorentzian"
]
SHAPES: tuple[Shape, ...] = (
    "linear",
    "piecewise_linear",
    "exponential",
    "gaussian",
    "generalised_exponential",
    "lorentzian",
)


SLOWEST_CREEP = 1e-6
"""Of the speed at which a contact creeps: below it no film is followed."""
LEAST_TAIL = 1e-3
"""Below it the course is tanh to seven digits, and no power resolves it."""
NEVER = 1e30
"""Speed at which damping fades that does not [rad/s or m/s]."""


@compiled
def gaussian_level(velocity: float, coulomb: float, break_away: float, stribeck_velocity: float) -> float:
    """Steady-state friction level σ0·g(v) of (3.5) [N m]."""
    ratio = velocity / stribeck_velocity
    return coulomb + (break_away - coulomb) * math.exp(-ratio * ratio)


@compiled
def fallen(velocity: float, speed: float, exponent: float, tail: float) -> float:
    """How far a quantity has fallen from rest, 1 to 0: exp(−|v/v_s|^δ), and with a tail t (1 + t·|v/v_s|^δ)^(−1/t).

    The second comes to the first as t goes to 0; with t = 1 it is the Lorentz curve (δ = 2) and the hyperbola (δ = 1).
    """
    ratio = abs(velocity / speed)
    fall = ratio * ratio
    if anywhere(exponent != 2.0):
        fall = where(exponent == 2.0, fall, ratio**exponent)
    left = fall
    if anywhere(tail <= 0.0):
        left = math.exp(-fall)
    if anywhere(tail > 0.0):
        left = where(tail > 0.0, (1.0 + tail * fall) ** (-1.0 / where(tail > 0.0, tail, 1.0)), left)
    return left


@compiled
def falling_level(
    velocity: float, coulomb: float, break_away: float, stribeck_velocity: float, exponent: float, tail: float
) -> float:
    """Generalised exponential of Table 2.1, or what is between it and a hyperbola (`fallen`) [N m].

    `gaussian_level` where the exponent is 2 and the tail 0.
    """
    return coulomb + (break_away - coulomb) * fallen(velocity, stribeck_velocity, exponent, tail)


@compiled
def faded_part(velocity: float, damping_velocity: float, tail: float) -> float:
    """Part of the damping at rest that is left at a speed (`fallen`); 1 where `damping_velocity` is 0."""
    part = 1.0 + 0.0 * velocity
    if anywhere(damping_velocity > 0.0):
        speed = where(damping_velocity > 0.0, damping_velocity, NEVER)
        part = fallen(velocity, speed, 2.0 + 0.0 * speed, tail)
    return part


@compiled
def crept(velocity: float, speed: float, tail: float) -> float:
    """Part of its level that friction without a static part has at a speed: tanh(v/v_c), without the sign.

    With a tail t it is tanh(asinh(t·v/v_c)/t): x/√(1 + x²) at 1, and nearly (2/π)·arctan and x/(1 + x) at 2.
    """
    ratio = max(abs(velocity) / speed, SLOWEST_CREEP)
    left = math.exp(-2.0 * ratio)
    if anywhere(tail > LEAST_TAIL):
        some = where(tail > LEAST_TAIL, tail, 1.0)
        drawn = some * ratio
        left = where(tail > LEAST_TAIL, (drawn + (1.0 + drawn * drawn) ** 0.5) ** (-2.0 / some), left)
    return (1.0 - left) / (1.0 + left)


@compiled
def bristle_step(bristle: float, velocity: float, limit: float, duration: float) -> float:
    """Deflection after `duration` at constant velocity (5.8).

    `limit` is g(v), the deflection in steady state; all in the motion unit.
    """
    distance = abs(velocity) * duration / limit
    steady = math.copysign(limit, velocity)
    bent = steady + (bristle - steady) * math.exp(-distance)
    return float(where(distance < 1e-12, bristle, bent))


@compiled
def bristle_rate(bristle: float, velocity: float, limit: float) -> float:
    """z' of (3.10)."""
    return velocity - abs(velocity) / limit * bristle


@compiled
def bends(ratio: float, back: float, at_35: float, at_65: float, at_85: float) -> float:
    """Part of the motion that bends the contact, where it carries `ratio` of its level in the motion's direction.

    1 at nothing and 0 at its level, in straight pieces by way of 35, 65 and 85 % of it; `back` where it is bent as far
    the other way. Any law of one contact that knows no time is such a curve (Duhem): 1 - ratio is LuGre's,
    (1 - ratio)^i Dahl's, and that of Bouc and Wen is 1 - ratio^n on the way up; an elastic-then-plastic contact has 1
    until it begins to slide.
    """
    part = 1.0 + (back - 1.0) * min(max(-ratio, 0.0), 1.0)
    part += (at_35 - 1.0) / 0.35 * min(max(ratio, 0.0), 0.35)
    part += (at_65 - at_35) / 0.3 * min(max(ratio - 0.35, 0.0), 0.3)
    part += (at_85 - at_65) / 0.2 * min(max(ratio - 0.65, 0.0), 0.2)
    return part - at_85 / 0.15 * max(ratio - 0.85, 0.0)


@compiled
def bent_on(ratio: float, distance: float, back: float, at_35: float, at_65: float, at_85: float) -> float:
    """Part of its level that a contact carries after `distance` limits more, at the pace that it has halfway."""
    half = halfway(ratio, distance, bends(ratio, back, at_35, at_65, at_85))
    return onward(ratio, distance, half, bends(half, back, at_35, at_65, at_85), at_85)


@compiled
def halfway(ratio: float, distance: float, part: float) -> float:
    """Part of its level that a contact carries halfway, where `part` of the motion bends it."""
    return min(max(ratio + 0.5 * distance * part, min(ratio, 1.0)), 1.0)


@compiled
def onward(ratio: float, distance: float, half: float, part: float, at_85: float) -> float:
    """The same after the whole `distance`, where `part` of the motion bends it halfway; exact on the last piece."""
    pace = part / max(1.0 - half, 0.15)
    if anywhere(half > 0.85):
        pace = where(half > 0.85, at_85 / 0.15, pace)
    return 1.0 - (1.0 - ratio) * math.exp(-pace * distance)


def level(
    shape: Shape,
    velocity: Floats,
    coulomb: float,
    break_away: float,
    stribeck_velocity: float,
    exponent: float = 2.0,
) -> Floats:
    """σ0·g(v) of Table 2.1 at each velocity [N m], without the sign.

    In the piecewise linear shape the level falls from break-away to Coulomb over `stribeck_velocity`
    (R = (F_s − F_c)/v_s); the generalised exponential has α = v_s^−δ with δ = `exponent`.

    Raises:
        ConfigurationError: unknown shape.
    """
    ratio = np.abs(velocity) / stribeck_velocity
    rise = break_away - coulomb
    if shape == "linear":
        return np.full_like(ratio, coulomb)
    if shape == "piecewise_linear":
        return coulomb + rise * np.clip(1.0 - ratio, 0.0, 1.0)
    if shape == "exponential":
        return coulomb + rise * np.exp(-ratio)
    if shape == "gaussian":
        return coulomb + rise * np.exp(-(ratio**2))
    if shape == "generalised_exponential":
        return coulomb + rise * np.exp(-(ratio**exponent))
    if shape == "lorentzian":
        return coulomb + rise / (1.0 + ratio**2)
    raise ConfigurationError(f"friction shape is {shape!r}; allowed are {', '.join(SHAPES)}")
