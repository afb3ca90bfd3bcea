"""The nonlinear loop in time: the model of the axis, its encoder, dead time and a controller of any structure.

The axis is that of `models.plant`: nothing of it is linear, saturation and anti-windup are the drive's. What is
asked of it is what no linear analysis tells: whether the loop hunts (4.2.1), how long steps of any size take.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import scipy

from autotune.control.gains.loop import Gains, LoopTiming
from autotune.core.arrays import Flags, Floats
from autotune.models import layout
from autotune.models.compiled import compiled
from autotune.models.drive_model import DriveModel, Packed
from autotune.models.layout import POSITION, VELOCITY
from autotune.models.plant import advance, substeps_for
from autotune.models.reversal_memory import share_damping
from autotune.models.torque_path import delivered
from autotune.models.torque_saturation import bent
from autotune.models.total_friction import ELEMENTS_DAMPING

SEED = 11
RUNAWAY = 1e5
"""rad/s: no axis gets there; a loop that does is unstable in the large."""


@compiled
def pass_time(
    p: Floats, on: Flags, state: Floats, older: float, newer: float, late: float, period: float, parts: int
) -> None:
    """One sample in which the torque changes from `older` to `newer` after `late` seconds."""
    c = bent(p, on)
    if late > 1e-3 * period:
        first = delivered(p, on, state, older, late, c)
        advance(p, on, state, first, late, max(1, math.ceil(parts * late / period)))
    rest = period - late
    if rest > 1e-3 * period:
        second = delivered(p, on, state, newer, rest, c)
        advance(p, on, state, second, rest, max(1, math.ceil(parts * rest / period)))


@compiled
def run_loop(
    p: Floats,
    on: Flags,
    state: Floats,
    c: Floats,
    loop: Floats,
    held: Floats,
    parts: int,
    reference: Floats,
    feedforward: Floats,
    disturbance: Floats,
    position: Floats,
    torque: Floats,
) -> int:
    """The loop sample by sample; how many samples were played before the state left all bounds.

    Args:
        c: as `Gains.array`.
        loop: period, torque limit, resolution, dead time, then the controller's state, changed in place: sum,
            derivative, last reference, last position, four states of the notch; shape (12,).
        held: the newest torque demands, the newest last, changed in place; longer than the dead time.
        parts: integration steps of a sample.
        disturbance: torque beside the drive's [N m], held for the sample; shape (n,) as the rest.
    """
    period, limit, resolution, dead = loop[0], loop[1], loop[2], loop[3]
    whole = int(dead / period + 1e-9)
    late = max(dead - whole * period, 0.0)
    depth = len(held)
    for k in range(len(reference)):
        measured = state[POSITION]
        if resolution > 0.0:
            measured = math.floor(measured / resolution + 0.5) * resolution
        error = reference[k] - measured
        change = (c[5] * (reference[k] - loop[6]) - measured + loop[7]) / period
        loop[5] += c[3] * (change - loop[5])
        total = loop[4] + error * period
        raw = c[0] * (c[4] * reference[k] - measured) + c[1] * loop[5] + c[2] * total
        demand = c[6] * raw + c[7] * loop[8] + c[8] * loop[9] - c[9] * loop[10] - c[10] * loop[11]
        loop[9], loop[8] = loop[8], raw
        loop[11], loop[10] = loop[10], demand
        demand += feedforward[k]
        if abs(demand) <= limit:
            loop[4] = total
        demand = min(max(demand, -limit), limit)
        loop[6], loop[7] = reference[k], measured
        position[k], torque[k] = measured, demand
        for i in range(depth - 1):
            held[i] = held[i + 1]
        held[depth - 1] = demand
        push = disturbance[k]
        pass_time(
            p, on, state, held[depth - 2 - whole] + push, held[depth - 1 - whole] + push, late, period, parts
        )
        if not abs(state[VELOCITY]) < RUNAWAY:
            return k
    return len(reference)


@dataclass(frozen=True, slots=True)
class Motion:
    """What the loop did: measured position and torque demand, shape (n,); `played` samples are true."""

    reference: Floats
    position: Floats
    torque: Floats
    played: int
    period: float

    @property
    def error(self) -> Floats:
        return np.asarray(self.reference - self.position)

    @property
    def bounded(self) -> bool:
        return self.played == len(self.reference)


def smoothed(reference: Floats, keep: float) -> Floats:
    """The reference behind the low-pass (6.14), from rest at its first value; shape (n,)."""
    if keep <= 0.0:
        return reference
    filtered, _ = scipy.signal.lfilter([1.0 - keep], [1.0, -keep], reference, zi=[keep * reference[0]])
    return np.asarray(filtered, dtype=np.float64)


def with_damping(model: DriveModel, timing: LoopTiming) -> Packed:
    """The model; its damping of presliding shared by the elements of its friction where it says nothing of theirs."""
    packed = model.pack()
    if timing.shared_damping and ELEMENTS_DAMPING not in model.parameters:
        share_damping(packed.p, packed.on)
    return packed


def follow(
    model: DriveModel,
    gains: Gains,
    timing: LoopTiming,
    reference: Floats,
    feedforward: Floats | None = None,
    disturbance: Floats | None = None,
    held_offset: bool = True,
) -> Motion:
    """Plays a reference [rad], shape (n,), on the twin, from rest at its first value.

    With `held_offset` the integral holds the offset already; else it is empty, as when power comes on.
    """
    packed = with_damping(model, timing)
    zero = np.zeros(len(reference))
    state = np.zeros(layout.STATES)
    state[POSITION] = reference[0]
    start = model["offset"] if held_offset else 0.0
    depth = int(timing.dead_time / timing.period + 1e-9) + 2
    held = np.full(depth, start)
    loop = np.zeros(12)
    loop[:4] = timing.period, timing.torque_limit, timing.resolution, timing.dead_time
    constant = gains.kp * (1.0 - gains.proportional_weight) * reference[0]
    if gains.ki > 0.0:
        loop[4] = (start + constant) / gains.ki
    loop[6] = loop[7] = reference[0]
    loop[8:] = start if gains.notch else 0.0
    parts = substeps_for(packed.p, timing.period, packed.on)
    position, torque = np.empty(len(reference)), np.empty(len(reference))
    played = run_loop(
        packed.p,
        packed.on,
        state,
        gains.array(timing.period),
        loop,
        held,
        parts,
        np.ascontiguousarray(reference, dtype=np.float64),
        zero if feedforward is None else feedforward,
        zero if disturbance is None else disturbance,
        position,
        torque,
    )
    position[played:], torque[played:] = np.nan, np.nan
    return Motion(reference, position, torque, played, timing.period)


def shaken(timing: LoopTiming, count: int, seed: int) -> Floats | None:
    """What shakes the axis beside the drive [N m], shape (count,); None where nothing is known of it."""
    if timing.disturbance <= 0.0:
        return None
    return timing.disturbance * _white(count, seed)


@lru_cache(maxsize=256)
def _white(count: int, seed: int) -> Floats:
    return np.random.default_rng([SEED, seed]).normal(0.0, 1.0, count)


def step_reference(size: float, before: float, after: float, timing: LoopTiming) -> Floats:
    """At rest for `before` seconds, then a step of `size` that is held for `after` seconds."""
    rest, stay = round(before / timing.period), round(after / timing.period)
    return smoothed(np.concatenate([np.zeros(rest), np.full(stay, size)]), timing.reference_filter)
