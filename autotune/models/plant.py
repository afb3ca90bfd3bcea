"""The drive as one compiled routine: every effect, in closed loop.

J·q'' = u − F − F_g − Σ effects (3.8), with the LuGre friction F of (3.9). The bristle is integrated
exactly (5.8), half a step away from the velocity (leapfrog), and the velocity implicitly in the
damping, which is of second order and stable where the friction is stiff. Where a transmission is elastic
or has play, motor and load are two masses. Physics enters in `contact`, `transmission` and `torque_path`
only; the inverse routine (`inverse`) and the twin call the same kernels.
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
    damping_slope,
    kept_by_elements,
    stiffened,
    viscous_coefficient,
)
from autotune.models.encoder_eccentricity import IS_ECCENTRIC, reading_error
from autotune.models.lanes import along, anywhere, shared_or_beside, side_by_side, where
from autotune.models.layout import BRISTLE, INERTIA, MICRO_DAMPING, POSITION, STIFFNESS, VELOCITY
from autotune.models.load_dependent_friction import IS_PRESSED, press, transmitted
from autotune.models.reversal_memory import (
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
    STARTED,
    Between,
    between_masses,
    coupling_rate,
    foreseen,
    has_load,
    load_shares,
    passed_torque,
    relaxed,
)

MOST_SUBSTEPS = 64
FASTEST = 1e6
"""Velocity that no axis reaches [rad/s or m/s]: one that does has left all bounds."""
DAMPED = 0.25
"""Of the rate at which micro-damping brakes: the step is implicit in it, and of second order. A step of 0.4 of its time
constant is 0.5 % off, as one of 0.35 rad of an oscillation is."""
LOOP = 7
"""Numbers of a twin's loop before the readings that it sees late."""


@compiled
def rubbing(
    p: Floats, on: Flags, state: Floats, at: int, share: float, position: float, velocity: float, step: float
) -> tuple[float, float]:
    """Friction of one side of the axis [N m] and its slope over velocity [N m s/rad].

    `at` is the state of the side's bristle, `share` the side's part of the friction.
    """
    limit = bend(p, on, state, at, share, position, velocity, step)
    bristle = state[at]
    viscous = viscous_coefficient(p, on, state, velocity)
    stiffer = stiffened(p, on, state, velocity)
    stiffness, damping = stiffer * p[STIFFNESS], stiffer * bristle_damping(p, velocity)
    torque = stiffness * bristle + damping * bending(p, bristle, velocity, limit) + viscous * velocity
    return share * torque, share * (max(viscous, 0.0) + damping_slope(p, damping, bristle, velocity, limit))


@compiled
def one_mass(p: Floats, on: Flags, state: Floats, drive: float, step: float) -> None:
    """One step of the rigid axis, in place."""
    position, velocity = state[POSITION], state[VELOCITY]
    friction, slope = rubbing(p, on, state, BRISTLE, 1.0, position, velocity, step)
    way = step * velocity
    held, damping = kept_by_elements(p, on, state, ELEMENT_STATES, position, way, velocity, step)
    friction += held
    slope += damping
    outside = additive(p, on, position + 0.5 * step * velocity)
    later = velocity + step * (drive - outside - friction) / (p[INERTIA] + 0.5 * step * slope)
    state[POSITION] = position + 0.5 * step * (velocity + later)
    state[VELOCITY] = later
    if on[IS_PRESSED]:
        passed = transmitted(p, p[INERTIA] * (later - velocity) / step + outside)
        press(p, state, passed, friction, step)
    if on[WARMS]:
        warm(p, state, friction * later, step)


@compiled
def two_masses(
    p: Floats,
    on: Flags,
    state: Floats,
    drive: float,
    step: float,
    between: Between,
) -> None:
    """One step of motor and load, in place; `between` is what `between_masses` gives."""
    if anywhere(state[STARTED] == 0.0):
        state[STARTED], state[LOAD_POSITION], state[LOAD_VELOCITY] = 1.0, state[POSITION], state[VELOCITY]
    position, velocity = state[POSITION], state[VELOCITY]
    beyond, speed = state[LOAD_POSITION], state[LOAD_VELOCITY]
    mass, rub, weight, stiffness, damping, half, impact, harder, relaxing, fading = between
    twist = position - beyond + 0.5 * step * (velocity - speed)
    passed = passed_torque(stiffness, damping, half, impact, harder, twist, velocity - speed)
    ahead = foreseen(stiffness, damping, half, impact, harder, relaxing, twist, passed, step)
    passed += relaxed(state, relaxing, fading, velocity - speed, step)
    friction, slope = rubbing(p, on, state, BRISTLE, 1.0 - rub, position, velocity, step)
    near, far = side_of_elements(p, rub)
    way = step * velocity
    held, damped = kept_by_elements(p, on, state, ELEMENT_STATES, position, way, velocity, step)
    friction += near * held
    slope += near * damped
    outside = additive(p, on, position + 0.5 * step * velocity) - weight
    inertia = p[INERTIA] * (1.0 - mass) + 0.5 * step * slope
    carried, slope = rubbing(p, on, state, LOAD_BRISTLE, rub, beyond, speed, step)
    if anywhere(far > 0.0):
        held, damped = kept_by_elements(p, on, state, LOAD_ELEMENTS, beyond, step * speed, speed, step)
        carried += far * held
        slope += far * damped
    heavier = p[INERTIA] * mass + 0.5 * step * slope
    pushed, pulled = drive - outside - friction - passed, passed - carried - weight
    gained = step / (inertia * heavier + ahead * (inertia + heavier))
    later = velocity + gained * (heavier * pushed + ahead * (pushed + pulled))
    faster = speed + gained * (inertia * pulled + ahead * (pushed + pulled))
    state[POSITION], state[VELOCITY] = position + 0.5 * step * (velocity + later), later
    state[LOAD_POSITION], state[LOAD_VELOCITY] = beyond + 0.5 * step * (speed + faster), faster
    if on[IS_PRESSED]:
        press(p, state, passed + ahead * (later - velocity - faster + speed) / step, friction, step)
    if on[WARMS]:
        warm(p, state, friction * later + carried * faster, step)


@compiled
def advance(p: Floats, on: Flags, state: Floats, torque: float, duration: float, substeps: int) -> None:
    """Moves the state by `duration` under a torque demand that is held, and a share of it lost on the way."""
    _advance(p, on, state, torque, duration, substeps, between_masses(p, on))


@compiled
def _advance(
    p: Floats,
    on: Flags,
    state: Floats,
    torque: float,
    duration: float,
    substeps: int,
    between: Between,
) -> None:
    """`advance` where what is between the masses is known."""
    step = duration / substeps
    loaded = has_load(on)
    for _ in range(substeps):
        if loaded:
            two_masses(p, on, state, torque, step, between)
        else:
            one_mass(p, on, state, torque, step)


@compiled
def _measured(p: Floats, on: Flags, position: float, noise: float, resolution: float) -> float:
    """What the encoder tells of a position, with its error once a turn and in whole counts."""
    measured = position + noise
    if on[IS_ECCENTRIC]:
        measured += reading_error(p, position)
    if anywhere(resolution > 0.0):
        measured = math.floor(measured / resolution + 0.5) * resolution
    return float(measured)


@compiled
def _seen(loop: Floats, room: int, place: int, late: int, part: float, measured: float) -> float:
    """What the controller sees of a reading now, so many ticks and a part of one late; kept in the room of the loop."""
    if room == 0:
        return measured
    loop[LOOP + place] = measured
    back = place - late if place >= late else place - late + room
    seen = loop[LOOP + back]
    if part > 0.0:
        seen += part * (loop[LOOP + (back - 1 if back > 0 else room - 1)] - seen)
    return float(seen)


@compiled
def _next(number: int, count: int) -> int:
    """The number after this one, round and round."""
    return number + 1 if number + 1 < count else 0


@compiled
def _asked(gains: Floats, weight: float, loop: Floats, command: float, pushed: float, seen: float) -> float:
    """What the controller asks for [N m], beyond the limit too; its memory in the loop is moved on."""
    period = loop[0]
    error = command - seen
    change = (weight * (command - loop[5]) - seen + loop[6]) / period
    loop[4] += gains[3] * (change - loop[4])
    demand = gains[0] * error + gains[1] * loop[4] + gains[2] * (loop[3] + error * period) + pushed
    loop[3] += where(abs(demand) <= loop[1], error * period, 0.0)
    loop[5] = command
    return float(demand)


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
    averaged: bool = True,
) -> int:
    """The twin: plant, quantiser and controller, tick by tick; what is recorded, and what shakes it, by sample.

    Args:
        gains: kp, kd, ki, derivative filter, and optionally both the part of the reference's rate in the derivative,
            and how many ticks late the controller sees the position; on a straight line between two of them.
        loop: length of a tick [s], torque limit [N m], position resolution (0: none), then the controller's
            state to start from, and in place the one it ends with: sum Σe·h, filtered derivative,
            reference and position of the tick before; then room for the readings that are seen late (`seen_late`).
        closed: whether `command` is the position reference (else it is the torque demand).
        command, feedforward: arrays of shape (n·ticks,); the latter is added to the demand [N m].
        disturbance: added to the torque after the demand [N m]; like all below an array of shape (n,).
        position_noise: added to the position before it is quantised: a row's at its first tick (`_noise_at`).
        position, torque: results, as the drive would report them: the reading of a sample's first tick, and the mean
            of the demands of all its ticks; where that is not `averaged`, the demand of the first.

    Returns:
        How many samples were simulated before the state left all bounds; n if it did not; 0 without that room.
    """
    limit = loop[1]
    weight, late, part = (gains[4], int(gains[5]), gains[5] % 1.0) if len(gains) > 5 else (1.0, 0, 0.0)
    room, ticks = len(loop) - LOOP, len(command) // len(torque)
    if (late > 0 or part > 0.0) and room < late + 2:
        return 0
    for i in range(room):
        loop[LOOP + i] = loop[6]  # what was seen until then
    summed, c, between = 0.0 * loop[6], bent(p, on), between_masses(p, on)
    row = tick = place = 0
    for k in range(len(command)):
        heard = position_noise[_noise_at(row, tick, len(torque), ticks)]
        measured = _measured(p, on, state[POSITION], heard, loop[2])
        seen = _seen(loop, room, place, late, part, measured)
        demand = _asked(gains, weight, loop, command[k], feedforward[k], seen) if closed else command[k]
        loop[6], demand = seen, min(max(demand, -limit), limit)
        if tick == 0:
            position[row], torque[row], summed = measured, demand, 0.0 * demand
        summed += demand
        if averaged and tick == ticks - 1:
            torque[row] = summed / ticks
        actual = delivered(p, on, state, demand, loop[0], c)
        _advance(p, on, state, actual + disturbance[row], loop[0], substeps, between)
        if anywhere(abs(state[VELOCITY]) >= FASTEST) or anywhere(state[VELOCITY] != state[VELOCITY]):
            return row
        row, tick, place = row + int(tick + 1 == ticks), _next(tick, ticks), _next(place, room)
    return len(torque)


@compiled
def _noise_at(row: int, tick: int, rows: int, ticks: int) -> int:
    """Row whose noise a tick's reading has: its own at first, others far from it then, as none is held.

    Held, an encoder's noise would have as many times its power below the rate of the rows.
    """
    place = row + tick * (rows // ticks)
    return place - rows * int(place >= rows)


def seen_late(ticks: float) -> int:
    """Room for readings in a loop that sees them so many ticks late."""
    return math.floor(ticks) + 2 if ticks > 0.0 else 0


@compiled
def simulate_in_lanes(
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
    averaged: bool = True,
) -> int:
    """`simulate` for eight twins of one command: up to the first of them that leaves all bounds.

    p, `state` and `loop` are of shape (places, 8), disturbance and noise (n, 8), results (8, n); what all are given
    (1, n).
    """
    return simulate(
        side_by_side(p),
        on,
        side_by_side(state),
        gains,
        side_by_side(loop),
        closed,
        substeps,
        along(command),
        along(feedforward),
        shared_or_beside(disturbance),
        shared_or_beside(position_noise),
        along(position),
        along(torque),
        averaged,
    )


@compiled
def _fastest(p: Floats, on: Flags) -> float:
    stiffness, damping, inertia = p[STIFFNESS], p[MICRO_DAMPING], p[INERTIA]
    if on[REMEMBERS]:
        stiffness, damping = stiffness + memory_stiffness(p), damping + p[DAMPING]
    coupled = 0.0
    if has_load(on):
        mass, rub = load_shares(p, on)
        coupled = 0.1 / COUPLED_STEP * coupling_rate(p, on)
        worst = max((1.0 - rub) / (1.0 - mass), rub / mass)
        stiffness *= worst
        inertia /= worst
    return float(max(max(math.sqrt(stiffness / p[INERTIA]), DAMPED * damping / inertia), coupled))


def substeps_for(p: Floats, period: float, on: Flags | None = None, least: int = 2) -> int:
    """Steps a sample that resolve the bristle's oscillation to about 0.1 rad a step, and its damping to 0.4.

    The ringing of two masses to `COUPLED_STEP`.
    """
    if on is None:
        fastest = max(math.sqrt(p[STIFFNESS] / p[INERTIA]), DAMPED * p[MICRO_DAMPING] / p[INERTIA])
    else:
        fastest = _fastest(p, on)
    return int(min(max(math.ceil(10.0 * period * fastest), least), MOST_SUBSTEPS))
