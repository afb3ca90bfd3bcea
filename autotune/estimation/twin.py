"""The twin of one contiguous stretch: plant, encoder and controller from where they were measured to start.

The contact starts from the balance of the first torques, the torque behind a lag has settled at the first
demand, and the controller's sum is what makes the twin's first torque equal the measured one.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.estimation.controller_law import EVE, MOMENT, PositionController
from autotune.models import layout
from autotune.models.compiled import compiled
from autotune.models.contact import additive, bristle_damping, friction_limit, viscous_coefficient
from autotune.models.drive_model import Packed
from autotune.models.lanes import WIDTH, filled
from autotune.models.layout import STIFFNESS
from autotune.models.plant import FASTEST, seen_late, simulate, simulate_in_lanes, substeps_for
from autotune.models.torque_lag import IS_LATE, MOTOR_TORQUE, STAGES, STEEPNESS, TIME_CONSTANT
from autotune.models.torque_saturation import bent, saturated
from autotune.signals.between_samples import bend_between, between_moments, delayed, later

START_SECONDS = 0.02
LEADING = 6.0
"""Hz, over the pace: bandwidth of what leads a twin in torque mode, a tenth of the usual cut-off. Led more stiffly
it hides what the model lacks: at 15 Hz a diagnosis found nothing missing where stiction was planted."""
LEAST_SHARE = 0.05
"""Of the stiffness: below, the start is forgotten so soon that its torque says nothing about it."""
QUICKEST = 0.25
"""Of a filter's time constant: what is left of it at least where a twin's filter is the quicker one."""


@compiled
def _first_friction(
    p: Floats, on: Flags, state: Floats, position: Floats, velocity: Floats, period: float, rows: int
) -> tuple[float, float]:
    """Mean friction over the first rows given as A + B·z0; arrays of shape (n,), steps as in `required`."""
    a, b, level, slope = 0.0, 1.0, 0.0, 0.0
    before = velocity[0]
    for k in range(rows):
        q, v = position[k], velocity[k]
        mean = 0.5 * (before + v)
        before = v
        limit = friction_limit(p, on, state, q, mean)
        left = math.exp(-abs(mean) * period / limit)
        a = math.copysign(limit, mean) * (1.0 - left) + left * a
        b *= left
        damping = bristle_damping(p, v)
        drag = damping * abs(v) / friction_limit(p, on, state, q, v)
        level += (p[STIFFNESS] - drag) * a + (damping + viscous_coefficient(p, on, state, v)) * v
        slope += (p[STIFFNESS] - drag) * b
    return level / rows, slope / rows


@compiled
def _mean(values: Floats, rows: int) -> float:
    total = 0.0
    for k in range(rows):
        total += values[k]
    return total / rows


@compiled
def _start(
    p: Floats,
    on: Flags,
    state: Floats,
    torque: Floats,
    position: Floats,
    velocity: Floats,
    acceleration: Floats,
    period: float,
    rows: int,
) -> None:
    """Motion and bristle at the first row, from the first `rows`, written to `state`."""
    outside = additive(p, on, _mean(position, rows))
    spare = _mean(torque, rows) - p[layout.INERTIA] * _mean(acceleration, rows) - outside
    level, slope = _first_friction(p, on, state, position, velocity, period, rows)
    limit = friction_limit(p, on, state, position[0], _mean(velocity, rows))
    known = slope > LEAST_SHARE * p[STIFFNESS]
    bristle = (spare - level) / slope if known else math.copysign(limit, velocity[0])
    state[layout.POSITION], state[layout.VELOCITY] = position[0], velocity[0]
    state[layout.BRISTLE] = min(max(bristle, -limit), limit)


def starting_state(
    packed: Packed,
    torque: Floats,
    position: Floats,
    velocity: Floats,
    acceleration: Floats,
    period: float,
    pace: float = 1.0,
) -> Floats:
    """State at the first row: the bristle carries what balances the first torques, at most friction.

    Arrays of shape (n,), of the whole piece or of its beginning; `pace` as in `Recorded`.
    """
    state = np.zeros(layout.STATES)
    rows = min(max(2, round(START_SECONDS * pace / period)), len(torque))
    _start(packed.p, packed.on, state, torque, position, velocity, acceleration, period, rows)
    return state


class Recorded(Protocol):
    """A contiguous stretch as it was recorded; arrays of shape (n,).

    Attributes:
        closed: whether `reference` was followed; else `torque` is the input.
        measured: position as recorded; `position`, `velocity`, `acceleration`: filtered motion.
        feedforward: part of the torque that was recorded as not the controller's.
        rate, last_reference, last_position: the controller's memory before the first row.
        pace: what lengths of time are multiplied by where the axis is much faster or slower than usual.
        lag: time constant of the current loop that `torque` is behind, and the twin's axis too [s].
        late: samples by which `torque` was taken later than it was recorded, and acts in the twin.
    """

    @property
    def period(self) -> float: ...
    @property
    def pace(self) -> float: ...
    @property
    def closed(self) -> bool: ...
    @property
    def measured(self) -> Floats: ...
    @property
    def reference(self) -> Floats: ...
    @property
    def torque(self) -> Floats: ...
    @property
    def feedforward(self) -> Floats: ...
    @property
    def position(self) -> Floats: ...
    @property
    def velocity(self) -> Floats: ...
    @property
    def acceleration(self) -> Floats: ...
    @property
    def rate(self) -> float: ...
    @property
    def last_reference(self) -> float: ...
    @property
    def last_position(self) -> float: ...
    @property
    def lag(self) -> float: ...
    @property
    def late(self) -> int: ...


def leading(packed: Packed, pace: float) -> PositionController:
    """A controller, slow against what is compared, under which a twin in torque mode moves much as the axis did.

    What is subtracted is the twin's own torque residual, so that the torque that it adds does no harm.
    """
    speed = 2.0 * math.pi * LEADING / pace
    inertia = float(packed.p[layout.INERTIA])
    return PositionController(kp=inertia * speed**2, kd=1.4 * inertia * speed, source="identified")


def simulate_stretch(
    recorded: Recorded,
    packed: Packed,
    controller: PositionController,
    limit: float,
    resolution: float,
    disturbance: Floats,
    position_noise: Floats,
    loop: Loop | None = None,
) -> tuple[Floats, Floats, bool]:
    """Position and torque as the drive would have logged them, shape (n,), and whether all stayed in bounds.

    The torque of a drive whose loop works between the samples is its mean from each to the next, as recorded.

    Args:
        limit: of the torque; infinite where unknown.
        resolution: of the encoder; 0 for none.
        disturbance, position_noise: torque after the demand, and position before it is quantised; shape (n,).
        loop: what `loop_along` gives, where it is known.
    """
    packed = late_as_recorded(recorded, packed)
    given = loop or loop_along(recorded, controller)
    n, period = len(disturbance), recorded.period / given.ticks
    offset = float(position_noise.mean()) if controller.adrift else 0.0
    position, torque = np.zeros(n), np.zeros(n)
    done = simulate(
        packed.p,
        packed.on,
        start_state(recorded, packed),
        given.gains,
        np.array([period, limit, resolution, *given.begun(offset)]),
        recorded.closed,
        _steps(packed, period, given.ticks),
        given.command + offset if offset and recorded.closed else given.command,
        given.feedforward,
        disturbance,
        position_noise,
        position,
        torque,
        given.averaged,
    )
    return position - offset, given.recorded_torque(torque), done == n


def simulate_stretches(
    recorded: Recorded,
    models: Sequence[Packed],
    controller: PositionController,
    bounds: tuple[float, float],
    disturbance: Floats,
    position_noise: Floats,
    given: Loop,
) -> tuple[Floats, Floats, Flags]:
    """`simulate_stretch` of up to eight models in one pass: positions and torques, shape (8, n), and which stay inside.

    They have the same effects, and go in the steps of the one that needs most (`steps_of_twin`). Where one of them
    leaves all bounds, what any of them does afterwards is not there: no numbers that mean anything.

    Args:
        bounds: limit of the torque and resolution, as there.
        disturbance, position_noise: as there, shape (n, 8), or (1, n) where it is one for all (`beside_or_one`).
        given: what `loop_along` gives.
    """
    models = [late_as_recorded(recorded, packed) for packed in models]
    n, period = len(recorded.reference), recorded.period / given.ticks
    rows = position_noise if len(position_noise) == 1 else position_noise.T
    offset = np.broadcast_to([one.mean() for one in rows] if controller.adrift else 0.0, WIDTH)
    commands = given.command[None]
    if recorded.closed and np.any(offset != 0.0):
        commands = given.command + offset[:, None]
    models = [*models, *[models[-1]] * (WIDTH - len(models))]
    begun = {id(packed): start_state(recorded, packed) for packed in models}
    state = filled([begun[id(packed)] for packed in models])
    position, torque = np.empty((2, WIDTH, n))
    done = simulate_in_lanes(
        filled([packed.p for packed in models]),
        models[0].on,
        state,
        given.gains,
        filled([np.array([period, *bounds, *given.begun(float(off))]) for off in offset]),
        recorded.closed,
        max(_steps(packed, period, given.ticks) for packed in models),
        commands,
        given.feedforward[None],
        disturbance,
        position_noise,
        position,
        torque,
        given.averaged,
    )
    inside = np.full(WIDTH, True) if done == n else np.abs(state[layout.VELOCITY]) < FASTEST
    if controller.adrift:
        position -= offset[:, None]
    return position, given.recorded_torque(torque), inside


def steps_of_twin(packed: Packed, period: float, controller: PositionController) -> tuple[int, int]:
    """Steps that a twin needs at the samples, and between them where its loop works there."""
    ticks = controller.ticks
    return _steps(packed, period, 1), _steps(packed, period / ticks, ticks)


def _steps(packed: Packed, tick: float, ticks: int) -> int:
    """Steps in a tick of a loop: two of a sample at least, which ticks are parts of already."""
    return substeps_for(packed.p, tick, packed.on, least=1 if ticks > 1 else 2)


@dataclass(frozen=True, slots=True)
class Loop:
    """What the twin's loop is given; arrays of shape (n·ticks,).

    Attributes:
        command: the reference, or in torque mode the torque.
        memory: the controller's sum, filtered derivative, reference and position before the first tick.
        averaged: whether a torque comes to the mean over a sample's ticks. Of a demand as at the samples it comes to
            the mean of two, which is not what acted between them; a current that follows its demand changes too little
            between them for that.
        shown: torque that such a mean of two lacks of what acted [N m], shape (n,); None where it lacks nothing.
    """

    ticks: int
    gains: Floats
    command: Floats
    feedforward: Floats
    memory: tuple[float, float, float, float]
    averaged: bool = True
    shown: Floats | None = None

    def begun(self, offset: float) -> tuple[float, ...]:
        """The memory where reference and reading are off by so much, and room for the readings that are seen late."""
        total, rate, reference, position = self.memory
        room = np.zeros(seen_late(float(self.gains[5]))).tolist()
        return total, rate, reference + offset, position + offset, *room

    def recorded_torque(self, torque: Floats) -> Floats:
        """What a simulated torque comes to from each sample to the next by its record, shape (…, n)."""
        if self.averaged:
            return torque
        moments = between_moments(torque)
        return moments if self.shown is None else moments + self.shown


def loop_along(recorded: Recorded, controller: PositionController) -> Loop:
    """What the twin's loop is given along a stretch, whatever the model."""
    between = recorded.closed and controller.ticks > 1
    return (_between_samples if between else _at_samples)(recorded, controller)


def _at_samples(recorded: Recorded, controller: PositionController) -> Loop:
    """The loop of a drive that works at the samples, or none: torque mode."""
    feedforward = recorded.feedforward * recorded.closed
    if not recorded.closed:
        before = 0.0, 0.0, recorded.last_reference, recorded.last_position
        return Loop(1, controller.gains, recorded.torque, feedforward, before)
    reference = delayed(recorded.reference, controller.reference_delay, recorded.last_reference)
    if controller.part_late > 0.0:
        reference, feedforward = (later(one, controller.part_late) for one in (reference, feedforward))
    feedforward = feedforward + controller.feedforward(reference, recorded.last_reference, recorded.period)
    memory = _memory(recorded, controller, float(feedforward[0]))
    return Loop(1, controller.gains, reference, feedforward, memory)


def _between_samples(recorded: Recorded, controller: PositionController) -> Loop:
    """The loop of a drive that works between the samples; its torque answers as late as it acts on the axis."""
    ticks, eve = controller.ticks, controller.taken == EVE
    at_once = controller.taken == MOMENT and controller.answer_delay == 0.0
    averaged = controller.read_off or not (eve or at_once)
    controller = controller.answering(recorded.late)
    reference = delayed(recorded.reference, controller.reference_delay, recorded.last_reference)
    fine = controller.between(reference)
    pushed = controller.feedforward_between(reference, fine, recorded.period, recorded.late)
    controller, pushed = _as_soon(controller, pushed, recorded.period)
    share = 1.0 - (1.0 - controller.derivative_filter) ** (1.0 / ticks)
    pushed = pushed + np.repeat(later(recorded.feedforward, recorded.late), ticks)
    rate = controller.reference_rate * (fine[ticks] - fine[0]) / recorded.period - float(recorded.velocity[0])
    total = 0.0
    if controller.ki > 0:
        rest = recorded.torque[0] - pushed[0] - controller.kp * (fine[0] - recorded.measured[0])
        total = float(rest - controller.kd * rate) / controller.ki
    gains = replace(controller, derivative_filter=share).gains
    fine = later(fine, controller.ticks_late)
    memory = total, rate, float(fine[0]), float(recorded.measured[0])
    shown = held_after_read(recorded, controller, reference) if eve and not averaged else None
    return Loop(ticks, gains, fine, pushed, memory, averaged, shown)


def _as_soon(law: PositionController, pushed: Floats, period: float) -> tuple[PositionController, Floats]:
    """The law, and what its reference adds, so much sooner as fewer ticks than the drive's own hold a torque longer.

    To the first order of that delay δ a filter is as much quicker, and what the proportional part multiplies is
    further by δ times its rate; so is its sum, and what is fed forward, but for steps, which come with the ticks.
    """
    if law.held_longer <= 0.0:
        return law, pushed
    delta, lag = law.held_longer * period, 1.0 / law.filter_rate(period)
    kd = law.kd + law.kp * delta
    wanted = law.kd * law.reference_rate + (0.0 if law.held else law.kp * delta)
    sooner = replace(
        law,
        kp=law.kp + law.ki * delta,
        kd=kd,
        reference_rate=wanted / kd if kd > 0.0 else law.reference_rate,
        derivative_filter=1.0 - math.exp(-period / max(lag - delta, QUICKEST * lag)),
    )
    if not (law.smooth or law.cubic):
        return sooner, pushed
    return sooner, pushed + law.held_longer * law.ticks * np.diff(pushed, append=pushed[-1:])


def held_after_read(recorded: Recorded, controller: PositionController, reference: Floats) -> Floats:
    """What the mean of a twin's torques, each of the moment when its feedforward has stepped, lacks of what acts.

    Shape (n,) [N m], as the `reference` is that the loop sees; the recorded torque has lost what it lacks
    (`PositionController.held_until_read`).
    """
    bend = bend_between(reference, recorded.period, 1, False)
    held = later(controller.acceleration_feedforward * bend, recorded.late)
    return np.asarray(held - between_moments(held))


def late_as_recorded(recorded: Recorded, packed: Packed) -> Packed:
    """The model behind the current loop that the recorded torque was put behind, and behind its own lag, if it has one.

    In torque mode it is given that torque, which is late already.
    """
    if recorded.lag <= 0.0 or not recorded.closed:
        return packed
    p, on = packed.p.copy(), packed.on.copy()
    own, steep = (p[TIME_CONSTANT], p[STEEPNESS]) if on[IS_LATE] else (0.0, 0.0)
    p[TIME_CONSTANT], p[STEEPNESS], on[IS_LATE] = own + recorded.lag, steep, True
    return Packed(p, on)


def start_state(recorded: Recorded, packed: Packed) -> Floats:
    """Motion, bristle and the torque behind lag and saturation at the first row."""
    state = starting_state(
        packed,
        recorded.torque,
        recorded.position,
        recorded.velocity,
        recorded.acceleration,
        recorded.period,
        recorded.pace,
    )
    return started_torque(packed, state, float(recorded.torque[0]))


def started_torque(packed: Packed, start: Floats, demand: float) -> Floats:
    """The start with the torque behind lag and saturation settled at a demand."""
    state = start.copy()
    state[MOTOR_TORQUE : MOTOR_TORQUE + 1 + STAGES] = saturated(
        packed.p, packed.on, demand, bent(packed.p, packed.on)
    )
    return state


def _memory(
    recorded: Recorded, controller: PositionController, feedforward: float
) -> tuple[float, float, float, float]:
    """Sum, filtered derivative, reference and position before the first row, in closed loop."""
    reference = recorded.last_reference if controller.reference_delay else recorded.reference[0]
    measured = recorded.last_position if controller.position_delay else recorded.measured[0]
    error = reference - measured
    change = controller.reference_rate * (reference - recorded.last_reference)
    change = (change - measured + recorded.last_position) / recorded.period
    rate = recorded.rate + controller.derivative_filter * (change - recorded.rate)
    total = 0.0
    if controller.ki > 0:
        rest = recorded.torque[0] - feedforward - controller.kp * error - controller.kd * rate
        total = rest / controller.ki - error * recorded.period
    return total, recorded.rate, recorded.last_reference, recorded.last_position
