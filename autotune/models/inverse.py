"""The inverse of the drive: the torque that a measured motion needs, with the kernels of the plant.

The contact's states are driven by the mean velocity of each interval. A load beyond an elastic or slack
transmission is integrated as a body of its own, pulled by the measured motor.
"""

from __future__ import annotations

import math

from autotune.core.arrays import Flags, Floats
from autotune.models.compiled import compiled
from autotune.models.contact import (
    additive,
    bend,
    bending,
    bristle_damping,
    friction_limit,
    kept_by_elements,
    stiffened,
    viscous_coefficient,
)
from autotune.models.encoder_eccentricity import IS_ECCENTRIC, true_motion
from autotune.models.lanes import along, anywhere, side_by_side
from autotune.models.layout import BRISTLE, INERTIA, MICRO_DAMPING, POSITION, STIFFNESS, VELOCITY
from autotune.models.load_dependent_friction import IS_PRESSED, press, transmitted
from autotune.models.plant import MOST_SUBSTEPS, rubbing
from autotune.models.reversal_memory import (
    ATTRACTION,
    DAMPING,
    ELEMENT_STATES,
    REMEMBERS,
    memory_stiffness,
    side_of_elements,
)
from autotune.models.thermal_drift import WARMS, warm
from autotune.models.torque_path import delivered
from autotune.models.torque_saturation import bent
from autotune.models.transmission import (
    COUPLED_STEP,
    LOAD_BRISTLE,
    LOAD_ELEMENTS,
    LOAD_POSITION,
    LOAD_VELOCITY,
    RELAXED,
    STARTED,
    Between,
    between_masses,
    coupling,
    foreseen,
    has_load,
    load_shares,
    passed_torque,
    relaxed,
)


@compiled
def applied_torque(
    p: Floats, on: Flags, state: Floats, demand: Floats, period: float, torque: Floats
) -> None:
    """Mean torque at the shaft around each sampling instant, written to `torque`; arrays of shape (n,).

    A demand acts from its sample to the next, so that the mean of the intervals before and after the
    instant belongs to it.
    """
    before, c = demand[0], bent(p, on)
    for k in range(len(demand)):
        now = delivered(p, on, state, demand[k], period, c)
        if k == 0:
            before = now
        torque[k] = 0.5 * (before + now)
        before = now


@compiled
def _load_side(
    p: Floats,
    on: Flags,
    state: Floats,
    between: Between,
    position: float,
    velocity: float,
    period: float,
    substeps: int,
) -> tuple[float, float]:
    """Moves the load behind a motor that reaches `position` with `velocity`; returns the torque passed [N m] and what
    friction at the load heats [W].

    `between` is what `between_masses` gives.
    """
    mass, rub, weight, stiffness, damping, half, impact, harder, relaxing, fading = between
    if anywhere(state[STARTED] == 0.0):
        state[STARTED], state[LOAD_POSITION], state[LOAD_VELOCITY] = 1.0, position, velocity
        state[POSITION], state[VELOCITY] = position, velocity
    _, far = side_of_elements(p, rub)
    step = period / substeps
    start, rate = state[POSITION], state[VELOCITY]
    passed, heat = 0.0 * velocity, 0.0 * velocity
    for i in range(substeps):
        share = (i + 0.5) / substeps
        speed = state[LOAD_VELOCITY]
        motor = start + (position - start) * share
        pace = rate + (velocity - rate) * share
        twist = motor - state[LOAD_POSITION] - 0.5 * step * speed
        passed = passed_torque(stiffness, damping, half, impact, harder, twist, pace - speed)
        ahead = foreseen(stiffness, damping, half, impact, harder, relaxing, twist, passed, step)
        passed += relaxed(state, relaxing, fading, pace - speed, step)
        friction, slope = rubbing(p, on, state, LOAD_BRISTLE, rub, state[LOAD_POSITION], speed, step)
        if anywhere(far > 0.0):
            place, way = state[LOAD_POSITION], step * speed
            held, damped = kept_by_elements(p, on, state, LOAD_ELEMENTS, place, way, speed, step)
            friction += far * held
            slope += far * damped
        heavier = p[INERTIA] * mass + 0.5 * step * slope + ahead
        later = speed + step * (passed - friction - weight) / heavier
        state[LOAD_POSITION] += 0.5 * step * (speed + later)
        state[LOAD_VELOCITY] = later
        heat += friction * later / substeps
    state[POSITION], state[VELOCITY] = position, velocity
    twist = position - state[LOAD_POSITION]
    passed = passed_torque(stiffness, damping, half, impact, harder, twist, velocity - state[LOAD_VELOCITY])
    return float(passed + relaxing * state[RELAXED]), float(heat)


@compiled
def required_after(
    p: Floats,
    on: Flags,
    state: Floats,
    before: float,
    position: Floats,
    velocity: Floats,
    acceleration: Floats,
    period: float,
    substeps: int,
    torque: Floats,
) -> None:
    """`required` of a motion whose velocity one period before its first row is `before`."""
    loaded = has_load(on)
    between = between_masses(p, on)
    mass, rub, weight = between[:3]
    near, _ = side_of_elements(p, rub)
    for k in range(len(position)):
        q, v, a = position[k], velocity[k], acceleration[k]
        if on[IS_ECCENTRIC]:
            q, v, a = true_motion(p, q, v, a)
        mean = 0.5 * (before + v)
        before = v
        bend(p, on, state, BRISTLE, 1.0 - rub, q, mean, period)
        rate = bending(p, state[BRISTLE], v, friction_limit(p, on, state, q, v))
        friction = p[STIFFNESS] * state[BRISTLE] + bristle_damping(p, v) * rate
        friction *= stiffened(p, on, state, v)
        friction += viscous_coefficient(p, on, state, v) * v
        friction *= 1.0 - rub
        held, _ = kept_by_elements(p, on, state, ELEMENT_STATES, q, period * mean, v, period)
        friction += near * held
        outside = additive(p, on, q)
        if loaded:
            outside -= weight
        passed, heat = 0.0 * v, 0.0 * v
        if loaded:
            passed, heat = _load_side(p, on, state, between, q, v, period, substeps)
        torque[k] = p[INERTIA] * (1.0 - mass) * a + friction + outside + passed
        if on[IS_PRESSED]:
            press(p, state, passed if loaded else transmitted(p, p[INERTIA] * a + outside), friction, period)
        if on[WARMS]:
            warm(p, state, friction * v + heat, period)


@compiled
def required(
    p: Floats,
    on: Flags,
    state: Floats,
    position: Floats,
    velocity: Floats,
    acceleration: Floats,
    period: float,
    substeps: int,
    torque: Floats,
) -> None:
    """Torque that a motion needs, written to `torque`; arrays of shape (n,), `state` changed in place.

    `substeps` are for the load beyond a transmission; they do not matter for a rigid axis.
    """
    before = velocity[0]
    required_after(p, on, state, before, position, velocity, acceleration, period, substeps, torque)


@compiled
def applied_in_lanes(
    p: Floats, on: Flags, state: Floats, demand: Floats, period: float, torque: Floats
) -> None:
    """`applied_torque` of eight models at once.

    p, `state` and `torque` are of shape (places or n, 8), `demand` is one for all, (1, n), or one for each, (8, n).
    """
    applied_torque(side_by_side(p), on, side_by_side(state), along(demand), period, side_by_side(torque))


@compiled
def required_in_lanes(
    p: Floats,
    on: Flags,
    state: Floats,
    position: Floats,
    velocity: Floats,
    acceleration: Floats,
    period: float,
    substeps: int,
    torque: Floats,
) -> None:
    """`required` of eight models at once.

    p, `state` and `torque` are of shape (places or n, 8), the motion is one for all, (1, n), or one for each, (8, n).
    """
    rate = along(velocity)
    required_after(
        side_by_side(p),
        on,
        side_by_side(state),
        rate[0],
        along(position),
        rate,
        along(acceleration),
        period,
        substeps,
        side_by_side(torque),
    )


@compiled
def _load_rate(p: Floats, on: Flags) -> float:
    mass, rub = load_shares(p, on)
    inertia, stiffness, damping = p[INERTIA] * mass, p[STIFFNESS], p[MICRO_DAMPING]
    if on[REMEMBERS] and p[ATTRACTION] > 0.0:
        stiffness, damping = stiffness + memory_stiffness(p), damping + p[DAMPING]
    elastic = math.sqrt(coupling(p, on)[0] / inertia) / (3.0 * COUPLED_STEP)
    held = math.sqrt(stiffness * rub / inertia)
    return float(max(max(elastic, held), 0.5 * damping * rub / inertia))


def load_substeps(p: Floats, on: Flags, period: float) -> int:
    """Steps a sample that the load beyond a transmission needs; 1 for a rigid axis.

    About 0.3 rad each of its contact's swing, and of its spring's as many as two masses' (`COUPLED_STEP`).
    """
    if not has_load(on):
        return 1
    return int(min(max(math.ceil(3.0 * period * _load_rate(p, on)), 1), MOST_SUBSTEPS))
