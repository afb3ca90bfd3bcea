"""Conditions on paper, as information: the decision rests on sampled margins and the twin.

PI velocity control about a constant speed v0 (4.12)–(4.21), with the Jacobian's missing 1/J and the condition x_a < 0
that (4.19) lacks; PID position control, Theorem 4.2 (4.71)–(4.73) and Routh's condition of the sliding regime. All
of it is continuous: neither sample time nor dead time is in it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from autotune.control.gains.loop import Gains
from autotune.core.arrays import Floats
from autotune.models.drive_model import DriveModel
from autotune.models.layout import CREEP_TAIL, CREEP_VELOCITY, DAMPING_TAIL, DAMPING_VELOCITY
from autotune.models.lugre import crept, faded_part, falling_level
from autotune.models.stribeck import EXPONENT, STRIBECK, TAIL
from autotune.models.total_friction import damping_at_rest, stiffness_at_rest, total_friction

SPEEDS = 60


@dataclass(frozen=True, slots=True)
class Bristle:
    """LuGre's numbers: J, σ0, σ1, σ2 and g with its slope; SI, motor side."""

    inertia: float
    stiffness: float
    micro_damping: float
    viscous: float
    coulomb: float
    break_away: float
    stribeck_velocity: float
    exponent: float = 2.0
    tail: float = 0.0
    damping_velocity: float = 0.0
    damping_tail: float = 0.0
    creep_velocity: float = 0.0
    creep_tail: float = 0.0

    def level(self, speed: float) -> float:
        """g(v), the deflection in steady sliding [rad]."""
        shape = (self.stribeck_velocity, self.exponent, self.tail)
        force = falling_level(speed, self.coulomb, self.break_away, *shape)
        if self.creep_velocity > 0.0:
            force *= crept(speed, self.creep_velocity, self.creep_tail)
        return float(force) / self.stiffness

    def damping(self, speed: float) -> float:
        """σ1 at a speed [N m s/rad]."""
        return self.micro_damping * float(faded_part(speed, self.damping_velocity, self.damping_tail))

    def slope(self, speed: float) -> float:
        """g'(v) by central differences, exact enough for a smooth curve [s]."""
        step = 1e-4 * max(abs(speed), 1e-6)
        return (self.level(speed + step) - self.level(speed - step)) / (2.0 * step)


def bristle_of(model: DriveModel) -> Bristle:
    """All friction in one bristle, as chapter 4 has it."""
    level = total_friction(model).value
    falls = STRIBECK.name in model
    p = model.pack().p
    excess = model["break_away"] - model["coulomb"] if falls else 0.0
    return Bristle(
        model["inertia"],
        max(stiffness_at_rest(model), 1e-12),
        damping_at_rest(model),
        model["viscous"],
        max(level, 1e-12),
        max(level + excess, 1e-12),
        model["stribeck_velocity"] if falls else 1.0,
        float(p[EXPONENT]) if falls else 2.0,
        float(p[TAIL]) if falls else 0.0,
        float(p[DAMPING_VELOCITY]),
        float(p[DAMPING_TAIL]),
        float(p[CREEP_VELOCITY]),
        float(p[CREEP_TAIL]),
    )


def jacobian(axis: Bristle, kp: float, kv: float, speed: float) -> Floats:
    """Of (4.4) about constant speed v0 > 0: (4.12) with its second row divided by J as a whole; shape (3, 3)."""
    g, slope, damping = axis.level(speed), axis.slope(speed), axis.damping(speed)
    falling = speed * slope / g
    rate = speed / g
    return np.array(
        [
            [0.0, 1.0, 0.0],
            [
                -kp / axis.inertia,
                -(kv + axis.viscous + damping * falling) / axis.inertia,
                (axis.stiffness - damping * rate) / axis.inertia,
            ],
            [0.0, -falling, -rate],
        ]
    )


def routh_stable(axis: Bristle, kp: float, kv: float, speed: float) -> bool:
    """Asymptotically stable about v0: s(as² + bs + c) + kp(s + |v0|/g) is Hurwitz.

    With a, b, c of (4.13): b > 0 and (c ≥ 0 with x_a < 0, or kp above (4.20)). (4.19) leaves x_a < 0 out.
    """
    g = axis.level(speed)
    rate, falling = speed / g, speed * axis.slope(speed) / g
    a = axis.inertia
    b = a * rate + kv + axis.viscous + axis.damping(speed) * falling
    c = (kv + axis.viscous) * rate + axis.stiffness * falling
    # Routh's table of a s³ + b s² + (c + kp) s + kp·rate
    return b > 0.0 and kp > 0.0 and b * (c + kp) > a * kp * rate


def least_damping(axis: Bristle, fastest: float) -> float:
    """The least kv + σ2 that is stable for every kp at all speeds up to `fastest` [N m s/rad] (4.19), corrected."""
    needs = [0.0]
    for speed in np.geomspace(1e-4 * fastest, fastest, SPEEDS):
        g = axis.level(float(speed))
        falling = float(speed) * axis.slope(float(speed)) / g
        asymptote = -axis.damping(float(speed)) * falling  # x_a < 0 (4.14)
        pole = -axis.stiffness * axis.slope(float(speed))  # c ≥ 0
        needs.append(max(asymptote, pole))
    return max(needs)


@dataclass(frozen=True, slots=True)
class Conditions:
    """Theorem 4.2 and Routh for PID; each as (what the gains give, what is needed).

    Attributes:
        position: kp against k·σ0 + ki·σ1/σ0 (4.72); damping: kv + σ2 against k·σ1 + σ0·J/σ1 (4.73).
        routh: (kv + σ2)·kp against J·ki, the sliding regime.
    """

    position: tuple[float, float]
    damping: tuple[float, float]
    routh: tuple[float, float]

    @property
    def sufficient(self) -> bool:
        """Theorem 4.2 guarantees that it does not hunt."""
        return self.position[0] > self.position[1] and self.damping[0] > self.damping[1]

    @property
    def sliding_stable(self) -> bool:
        return self.routh[0] > self.routh[1]


def pid_conditions(model: DriveModel, gains: Gains) -> Conditions:
    """(4.71)–(4.73) with ε = 0, and Routh's condition."""
    axis = bristle_of(model)
    low, high = sorted((axis.coulomb, axis.break_away))
    k = (high - low) / low
    damping = gains.kd + axis.viscous
    needed = k * axis.stiffness + gains.ki * axis.micro_damping / axis.stiffness
    friction = k * axis.micro_damping + (
        axis.stiffness * axis.inertia / axis.micro_damping if axis.micro_damping > 0.0 else math.inf
    )
    return Conditions((gains.kp, needed), (damping, friction), (damping * gains.kp, axis.inertia * gains.ki))


def passivity_margin(model: DriveModel) -> float:
    """σ2 less σ1·(sup g − inf g)/inf g (3.14): above 0 the axis is passive by itself [N m s/rad].

    Below 0, that much velocity gain makes it so.
    """
    axis = bristle_of(model)
    low, high = sorted((axis.coulomb, axis.break_away))
    return axis.viscous - axis.micro_damping * (high - low) / low
