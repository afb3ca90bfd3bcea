"""The drive as one compiled routine: every effect, for a prescribed motion and in closed loop.

J·q'' = u − F − F_g − Σ effects (3.8), with the LuGre friction F of (3.9). The bristle is integrated
exactly (5.8), half a step away from the velocity (leapfrog), and the velocity implicitly in the
damping, which is of second order and stable where the friction is stiff. `friction` and `additive` are
the only places where physics enters; both the inverse routine and the twin call them.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from autotune.models.compiled import compiled
from autotune.models.direction_asymmetry import level_difference, viscous_difference
from autotune.models.layout import (
    BREAK_AWAY,
    BRISTLE,
    COULOMB,
    INERTIA,
    MICRO_DAMPING,
    OFFSET,
    POSITION,
    STIFFNESS,
    STRIBECK_VELOCITY,
    VELOCITY,
    VISCOUS,
    flag,
)
from autotune.models.lugre import Floats, bristle_rate, bristle_step, gaussian_level
from autotune.models.torque_ripple import ripple

Flags = NDArray[np.bool_]

_STRIBECK = flag("stribeck")
_ASYMMETRY = flag("direction_asymmetry")
_RIPPLE = flag("torque_ripple")
_LEAST_DEFLECTION = 1e-15
MOST_SUBSTEPS = 64


@compiled
def friction_limit(p: Floats, on: Flags, velocity: float) -> float:
    """g(v), the bristle's deflection in steady state [rad or m]."""
    level = float(p[COULOMB])
    if on[_STRIBECK]:
        level = gaussian_level(velocity, level, p[BREAK_AWAY], p[STRIBECK_VELOCITY])
    if on[_ASYMMETRY]:
        level += level_difference(p, velocity)
    return float(max(level / p[STIFFNESS], _LEAST_DEFLECTION))


@compiled
def viscous_coefficient(p: Floats, on: Flags, velocity: float) -> float:
    """Slope of the viscous torque [N m s/rad]."""
    coefficient = float(p[VISCOUS])
    if on[_ASYMMETRY]:
        coefficient += viscous_difference(p, velocity)
    return coefficient


@compiled
def additive(p: Floats, on: Flags, position: float) -> float:
    """Torque needed beside inertia and friction [N m]."""
    total = float(p[OFFSET])
    if on[_RIPPLE]:
        total += ripple(p, position)
    return total


@compiled
def advance(p: Floats, on: Flags, state: Floats, torque: float, duration: float, substeps: int) -> None:
    """Moves the state by `duration` under a constant torque, in place."""
    step = duration / substeps
    position, velocity, bristle = state[POSITION], state[VELOCITY], state[BRISTLE]
    inertia = p[INERTIA]
    for _ in range(substeps):
        limit = friction_limit(p, on, velocity)
        bristle = bristle_step(bristle, velocity, limit, step)
        viscous = viscous_coefficient(p, on, velocity)
        force = torque - additive(p, on, position + 0.5 * step * velocity) - viscous * velocity
        force -= p[STIFFNESS] * bristle + p[MICRO_DAMPING] * bristle_rate(bristle, velocity, limit)
        slope = viscous + p[MICRO_DAMPING] * (1.0 - math.copysign(bristle, bristle * velocity) / limit)
        later = velocity + step * force / (inertia + 0.5 * step * max(slope, 0.0))
        position += 0.5 * step * (velocity + later)
        velocity = later
    state[POSITION], state[VELOCITY], state[BRISTLE] = position, velocity, bristle


@compiled
def required_torque(
    p: Floats,
    on: Flags,
    position: Floats,
    velocity: Floats,
    acceleration: Floats,
    bristle: float,
    period: float,
    torque: Floats,
) -> None:
    """Torque that a motion needs, written to `torque`; all arrays of shape (n,).

    The bristle starts at `bristle` and is driven by the mean velocity of each interval.
    """
    before = velocity[0]
    for k in range(len(position)):
        mean = 0.5 * (before + velocity[k])
        before = velocity[k]
        bristle = bristle_step(bristle, mean, friction_limit(p, on, mean), period)
        rate = bristle_rate(bristle, before, friction_limit(p, on, before))
        friction = p[STIFFNESS] * bristle + p[MICRO_DAMPING] * rate
        friction += viscous_coefficient(p, on, before) * before
        torque[k] = p[INERTIA] * acceleration[k] + friction + additive(p, on, position[k])


@compiled
def simulate(
    p: Floats,
    on: Flags,
    state: Floats,
    gains: Floats,
    loop: Floats,
    closed: bool,
    substeps: int,
    command: Floats,
    feedforward: Floats,
    disturbance: Floats,
    position_noise: Floats,
    position: Floats,
    torque: Floats,
) -> int:
    """The twin: plant, quantiser and controller, sample by sample.

    Args:
        gains: kp, kd, ki, derivative filter.
        loop: sample period [s], torque limit [N m], position resolution (0: none), then the controller's
            state to start from, and in place the one it ends with: sum Σe·h, filtered derivative,
            reference and position of the sample before.
        closed: whether `command` is the position reference (else it is the torque demand).
        feedforward, disturbance: added to the demand before, and to the torque after it [N m].
        position_noise: added to the position before it is quantised.
        position, torque: results, as the drive would report them; arrays of shape (n,).

    Returns:
        How many samples were simulated before the state left all bounds; n if it did not.
    """
    period, limit, resolution = loop[0], loop[1], loop[2]
    total, rate, last_reference, last_position = loop[3], loop[4], loop[5], loop[6]
    kp, kd, ki, smoothing = gains[0], gains[1], gains[2], gains[3]
    for k in range(len(command)):
        measured = state[POSITION] + position_noise[k]
        if resolution > 0.0:
            measured = math.floor(measured / resolution + 0.5) * resolution
        if closed:
            error = command[k] - measured
            change = (command[k] - last_reference - measured + last_position) / period
            rate += smoothing * (change - rate)
            demand = kp * error + kd * rate + ki * (total + error * period) + feedforward[k]
            if abs(demand) <= limit:
                total += error * period
            last_reference = command[k]
        else:
            demand = command[k]
        last_position = measured
        demand = min(max(demand, -limit), limit)
        position[k] = measured
        torque[k] = demand
        advance(p, on, state, demand + disturbance[k], period, substeps)
        if not abs(state[VELOCITY]) < 1e6:
            return k
    loop[3], loop[4], loop[5], loop[6] = total, rate, last_reference, last_position
    return len(command)


def substeps_for(p: Floats, period: float) -> int:
    """Steps a sample that resolve the bristle's oscillation and damping to about 0.1 rad a step."""
    fastest = max(math.sqrt(p[STIFFNESS] / p[INERTIA]), p[MICRO_DAMPING] / p[INERTIA])
    return int(min(max(math.ceil(10.0 * period * fastest), 2), MOST_SUBSTEPS))
