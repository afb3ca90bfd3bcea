"""The kinetic friction model with Karnopp's zone, for comparison with the bristle (section 3.1).

    J·q'' = u − F(q', u) − F_g,   F = σ2·q' + σ0·g(q')·sign q' + (1 − |sign q'|)·sat(u − F_g, F_s)   (3.1), (3.2)

with sign 0 within [−m, m] (3.7): inside it the axis stands, and friction takes what is applied up to F_s (3.3). The
model knows no presliding: between a stop and break-away nothing moves.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.models.compiled import compiled


@dataclass(frozen=True, slots=True)
class KineticAxis:
    """J, σ2, F_c, F_s, v_s, F_g and the half width m of Karnopp's zone; SI, motor side."""

    inertia: float
    viscous: float
    coulomb: float
    break_away: float
    stribeck_velocity: float = 1.0
    offset: float = 0.0
    zone: float = 1e-4

    def __post_init__(self) -> None:
        if not (self.inertia > 0.0 and self.stribeck_velocity > 0.0 and self.zone > 0.0):
            raise ConfigurationError(f"inertia, stribeck_velocity and zone must be above 0, got {self}")

    def array(self) -> Floats:
        return np.array(
            [
                self.inertia,
                self.viscous,
                self.coulomb,
                self.break_away,
                self.stribeck_velocity,
                self.offset,
                self.zone,
            ]
        )


@compiled
def kinetic_level(k: Floats, velocity: float) -> float:
    """σ0·g(v) of (3.5) [N m]."""
    ratio = velocity / k[4]
    return float(k[2] + (k[3] - k[2]) * math.exp(-ratio * ratio))


@compiled
def kinetic_step(k: Floats, state: Floats, torque: float, step: float) -> None:
    """One step of (3.1) with (3.7), in place; `state` is [q, q']."""
    velocity, applied = state[1], torque - k[5]
    if abs(velocity) <= k[6]:
        if abs(applied) <= k[3]:
            state[1] = 0.0
            return
        friction = math.copysign(k[3], applied)
    else:
        friction = math.copysign(kinetic_level(k, velocity), velocity) + k[1] * velocity
    later = velocity + step * (applied - friction) / k[0]
    if velocity * later < 0.0 and abs(velocity) > k[6]:
        later = 0.0  # it passes through the zone and must be looked at there
    state[0] += 0.5 * step * (velocity + later)
    state[1] = later


@compiled
def _pulled(
    k: Floats,
    state: Floats,
    kp: float,
    kv: float,
    speed: float,
    step: float,
    position: Floats,
    velocity: Floats,
) -> None:
    for i in range(len(position)):
        reference = speed * i * step
        torque = kp * (reference - state[0]) + kv * (speed - state[1])
        position[i], velocity[i] = state[0], state[1]
        kinetic_step(k, state, torque + k[5], step)


def pulled(
    axis: KineticAxis, kp: float, kv: float, speed: float, seconds: float, step: float = 1e-5
) -> tuple[Floats, Floats]:
    """Position and velocity of an axis that is pulled at constant speed through kp and kv (3.6), from rest.

    Args:
        kp: spring [N m/rad]; kv: damper [N m s/rad], below 0 for positive velocity feedback.

    Returns:
        Position [rad] and velocity [rad/s], shape (n,) each, every `step` seconds.
    """
    count = max(round(seconds / step), 2)
    position, velocity = np.zeros(count), np.zeros(count)
    _pulled(axis.array(), np.zeros(2), kp, kv, speed, step, position, velocity)
    return position, velocity
