"""Torque residual R = L[T(u) − required(q, v, a)] of a model on prepared data, and its bias in a twin.

T is what lag and saturation make of the demand, L a zero-phase low-pass on a coarse grid. The same
measurement chain applied to a simulation of the model itself (with quantiser, controller and process
noise) gives the bias that filters, derivatives and quantisation cause; subtracting it is what makes small
effects visible (`twin_runs`).

Where there is a twin, both motions go through the inverse of the rigid axis, also where motor and load are two masses
(`Prepared.load_in_twin`): what is left is what the twin did not do as the axis did, an output error. The inverse of two
masses rings at the antiresonance, and a load that floats in a gap meets its walls there whenever a small error of the
measured motion wants it to.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.arrays import Floats, Integers
from autotune.core.remembered import LastOf
from autotune.core.side_by_side import on_each
from autotune.estimation.data import Prepared, filtered_motion
from autotune.estimation.twin import started_torque
from autotune.models import layout
from autotune.models.compiled import compiled
from autotune.models.drive_model import Packed
from autotune.models.dwell_time_break_away import AGES
from autotune.models.inverse import (
    applied_in_lanes,
    applied_torque,
    load_substeps,
    required,
    required_in_lanes,
)
from autotune.models.lanes import WIDTH, along, filled, room_for, side_by_side, zeros_for
from autotune.models.load_dependent_friction import IS_PRESSED
from autotune.models.reversal_memory import REMEMBERS
from autotune.models.stribeck import FALLS
from autotune.models.thermal_drift import WARMS
from autotune.models.torque_lag import IS_LATE
from autotune.models.torque_saturation import OF_SATURATION, SATURATES, torque_slope
from autotune.models.transmission import has_load, of_one_mass
from autotune.signals.filters import low_pass_of
from autotune.signals.in_pieces import Pieces, in_pieces

FORGOTTEN = 60.0
"""Reaches of the bristle on whose way it forgets where it began, to e^-30 where friction is twice as high."""
SHARED, SAME = 8, 1e-11
"""Rows in which two pieces of a motion must agree, and to how much of the torque: only then both have forgotten."""
LEAST_PIECES = 4
"""Pieces that are worth the trouble: two take as long as all rows at once, with what is copied for them."""
LONGEST_MEMORY = (REMEMBERS, WARMS, AGES, IS_PRESSED)
"""Effects that do not forget as the axis moves."""


@dataclass(frozen=True, slots=True)
class Simulated:
    """What the twin would have recorded; arrays of shape (n,). `stable`: it stayed within all bounds."""

    position: Floats
    torque: Floats
    disturbance: Floats
    stable: bool


@dataclass(frozen=True, slots=True)
class Motion:
    """Torque and motion to compute a residual from; arrays of shape (n,)."""

    torque: Floats
    position: Floats
    velocity: Floats
    acceleration: Floats


@compiled
def smooth_at(values: Floats, taps: Floats, rows: Integers, result: Floats) -> None:
    """`values` filtered by symmetric `taps`, at `rows` only."""
    half = len(taps) // 2
    for j in range(len(rows)):
        centre = rows[j]
        total = taps[half] * values[centre]
        for i in range(1, half + 1):
            total += taps[half + i] * (values[centre - i] + values[centre + i])
        result[j] = total


@compiled
def _smooth_in_lanes(values: Floats, taps: Floats, rows: Integers, result: Floats) -> None:
    """`smooth_at` for values of shape (n, 8), to (8, m)."""
    smooth_at(side_by_side(values), taps, rows, along(result))


def smoothed(data: Prepared, values: Floats) -> Floats:
    """Values of shape (n,) low-passed onto the grid, shape (m,)."""
    result = np.empty(len(data.grid))
    smooth_at(values, data.taps, data.grid, result)
    return result


def measured_motion(data: Prepared) -> Motion:
    """What was recorded, without torques that follow the clock."""
    return Motion(clockless(data, data.torque), data.position, data.velocity, data.acceleration)


def simulated_motions(data: Prepared, runs: Sequence[Simulated]) -> list[Motion]:
    """Simulations through the same filters as the measurement."""
    if not runs:
        return []
    return [
        one for first in range(0, len(runs), WIDTH) for one in _motions(data, runs[first : first + WIDTH])
    ]


def _motions(data: Prepared, runs: Sequence[Simulated]) -> list[Motion]:
    """`simulated_motions` of up to eight."""
    positions = [run.position for run in runs]
    spans = [(stretch.start, stretch.stop) for stretch in data.stretches]
    parts = motions_in_lanes(positions, data.period, data.motion_cutoff, spans) if len(runs) > 1 else None
    if parts is None:
        parts = filtered_motion(positions, data.stretches, data.period, data.motion_cutoff)
    return [Motion(run.torque, *moved) for run, *moved in zip(runs, *parts, strict=False)]


def motions_in_lanes(
    positions: Sequence[Floats], period: float, cutoff: float, spans: Sequence[tuple[int, int]]
) -> tuple[Floats, Floats, Floats] | None:
    """`filters.motion` of up to eight positions, arrays of shape (8, n): lanes beyond the last have its motion.

    A recursion waits for its last result; eight of them in vectors take little longer than one. Every number is the
    same to the last bit as alone.

    None, and nothing is done, where the cut-off leaves positions as they are or a span is too short to be filtered.
    """
    found = low_pass_of(cutoff, period)
    if found is None or min(last - first for first, last in spans) < 4:
        return None
    smooth, velocity, acceleration = np.empty((3, WIDTH, len(positions[0])))
    for lane in range(WIDTH):
        smooth[lane] = positions[min(lane, len(positions) - 1)]
    done = 0
    for first, last in spans:
        _still(smooth, velocity, acceleration, done, first)
        done, padding = last, min(last - first - 1, found.padding)
        long = room_for(last - first + 2 * padding)
        _motion_in_lanes(
            found.sections, found.rest, padding, first, period, long, smooth, velocity, acceleration
        )
    _still(smooth, velocity, acceleration, done, smooth.shape[1])
    return smooth, velocity, acceleration


def _still(smooth: Floats, velocity: Floats, acceleration: Floats, first: int, last: int) -> None:
    """What is beside the spans."""
    for part in (smooth, velocity, acceleration):
        part[:, first:last] = 0.0


@compiled
def _through(sections: Floats, rest: Floats, values: Floats, back: bool) -> None:
    """Both sections, from rest at the first value, in place; from the last one `back` to the first."""
    b0, b1, b2, a1, a2 = sections[0, 0], sections[0, 1], sections[0, 2], sections[0, 4], sections[0, 5]
    d0, d1, d2, c1, c2 = sections[1, 0], sections[1, 1], sections[1, 2], sections[1, 4], sections[1, 5]
    count = len(values)
    x = values[count - 1 if back else 0]
    z, w, s, t = rest[0, 0] * x, rest[0, 1] * x, rest[1, 0] * x, rest[1, 1] * x
    for k in range(count):
        at = count - 1 - k if back else k
        x = values[at]
        y = b0 * x + z
        z = b1 * x - a1 * y + w
        w = b2 * x - a2 * y
        x = d0 * y + s
        s = d1 * y - c1 * x + t
        t = d2 * y - c2 * x
        values[at] = x


@compiled
def _filtered_motion(
    sections: Floats,
    rest: Floats,
    padding: int,
    start: int,
    period: float,
    long: Floats,
    smooth: Floats,
    velocity: Floats,
    acceleration: Floats,
) -> None:
    """Positions filtered in place and their differences, from a sample on; `long` is room for them and their ends."""
    n = len(long) - 2 * padding
    for k in range(n):
        long[padding + k] = smooth[start + k]
    for i in range(padding):  # an odd extension
        long[i] = 2.0 * long[padding] - long[2 * padding - i]
        long[n + padding + i] = 2.0 * long[n + padding - 1] - long[n + padding - 2 - i]
    _through(sections, rest, long, False)
    _through(sections, rest, long, True)
    for k in range(n):
        smooth[start + k] = long[padding + k]
    for k in range(1, n - 1):
        before, here, later = long[padding + k - 1], long[padding + k], long[padding + k + 1]
        velocity[start + k] = (later - before) / (2.0 * period)
        acceleration[start + k] = ((later - here) - (here - before)) / (period * period)
    end = start + n - 1
    velocity[start] = (long[padding + 1] - long[padding]) / period
    velocity[end] = (long[padding + n - 1] - long[padding + n - 2]) / period
    acceleration[start] = acceleration[end] = 0.0 * long[padding]


@compiled
def _motion_in_lanes(
    sections: Floats,
    rest: Floats,
    padding: int,
    start: int,
    period: float,
    long: Floats,
    smooth: Floats,
    velocity: Floats,
    acceleration: Floats,
) -> None:
    """`_filtered_motion` of eight rows, shape (8, n); `long` of shape (rows, 8)."""
    _filtered_motion(
        sections, rest, padding, start, period, side_by_side(long), along(smooth), along(velocity),
        along(acceleration),
    )  # fmt: skip


def compared_motion(data: Prepared, run: Simulated) -> Motion:
    """The same of one without the torques that follow the clock; the measured motion has none: `measured_motion`."""
    (moved,) = simulated_motions(data, [run])
    return replace(moved, torque=clockless(data, moved.torque))


def acted(torque: Floats) -> Floats:
    """A torque that is held from each sample to the next, as it acted about each: shape (n,)."""
    return np.concatenate([torque[:1], 0.5 * (torque[1:] + torque[:-1])])


def clockless(data: Prepared, torque: Floats) -> Floats:
    """A torque without what follows the clock, and without its level's wandering, shape (n,)."""
    for one in data.clocked:
        torque = torque - one.torque(data)
    return torque if data.wander is None else torque - data.wander.torque(data)


def raw_residual(data: Prepared, packed: Packed, moved: Motion) -> Floats:
    """Torque that acted less the torque the model needs, sample by sample, shape (n,)."""
    packed = _inverted(data, packed)
    rest = np.zeros(len(moved.torque))
    for stretch in data.stretches:
        rows = stretch.rows
        part = _rows_of(moved, rows)
        own = rest[rows, None]
        if not _in_pieces(data, rows, [packed], [part], own):
            own[:, 0] = stretch_residual(packed, np.zeros(layout.STATES), part, data.period)
    return rest


def _rows_of(moved: Motion, rows: slice) -> Motion:
    return Motion(moved.torque[rows], moved.position[rows], moved.velocity[rows], moved.acceleration[rows])


_CUTS: LastOf[dict[tuple[int, int, float, int], Pieces | None]] = LastOf(4)


def _in_pieces(
    data: Prepared, rows: slice, models: Sequence[Packed], moved: Sequence[Motion], rest: Floats
) -> bool:
    """`stretch_residual` of a few models over the rows of a stretch, each with its motion or all with one.

    Written to `rest`, shape (n, models or more). Pieces of the motion fill the pass of a kernel that models do not. A
    rigid axis whose torque acts as it is asked for has one state, its bristle's, and moves by far more than that
    reaches: so every piece has forgotten where it began, once it has moved as far. False, and nothing is written, where
    it has not, or where that would take as long.
    """
    on, most = models[0].on, WIDTH // len(models)
    if most < LEAST_PIECES or has_load(on) or on[[*LONGEST_MEMORY, IS_LATE, SATURATES]].any():
        return False
    pieces = _cut(data, rows, max(_reach(one) for one in models), most)
    if pieces is None:
        return False
    lanes = [(i, k) for i in range(len(models)) for k in range(len(pieces.first))]
    needed = _needed_in_pieces(data.period, models, moved, pieces, lanes)
    if not _agree(pieces, lanes, needed):
        return False
    acted = [np.empty(len(rest)) for _ in moved]
    for torque, one in zip(acted, moved, strict=True):
        applied_torque(models[0].p, on, np.zeros(layout.STATES), one.torque, data.period, torque)
    for lane, (i, k) in enumerate(lanes):
        own, first = slice(pieces.begin[k], pieces.end[k]), pieces.first[k]
        given = needed[own.start - first : own.stop - first, lane]
        rest[own, i] = acted[min(i, len(acted) - 1)][own] - given
    return True


def _needed_in_pieces(
    period: float,
    models: Sequence[Packed],
    moved: Sequence[Motion],
    pieces: Pieces,
    lanes: Sequence[tuple[int, int]],
) -> Floats:
    """Torque that each lane's piece of a motion needs of a model, given as numbers of both, shape (rows, 8)."""
    lanes = [*lanes, *[lanes[-1]] * (WIDTH - len(lanes))]
    parts = np.empty((3, WIDTH, pieces.rows))
    for lane, (i, k) in enumerate(lanes):
        one, rows = moved[min(i, len(moved) - 1)], slice(pieces.first[k], pieces.first[k] + pieces.rows)
        parts[0, lane], parts[1, lane] = one.position[rows], one.velocity[rows]
        parts[2, lane] = one.acceleration[rows]
    needed = room_for(pieces.rows)
    p, state = filled([models[i].p for i, _ in lanes]), zeros_for(layout.STATES)
    required_in_lanes(p, models[0].on, state, parts[0], parts[1], parts[2], period, 1, needed)
    return needed


def _agree(pieces: Pieces, lanes: Sequence[tuple[int, int]], needed: Floats) -> bool:
    """Whether every piece needs the same where the one before it ends."""
    least = SAME * float(np.max(np.abs(needed)))
    for lane, (_, k) in enumerate(lanes):
        end = pieces.begin[k] - pieces.first[k]
        if k and not np.max(np.abs(needed[-SHARED:, lane - 1] - needed[end - SHARED : end, lane])) <= least:
            return False
    return True


def _cut(data: Prepared, rows: slice, reach: float, most: int) -> Pieces | None:
    """Pieces of a stretch, by the motion that was recorded, with a reach up to twice as long."""
    longer = 2.0 ** math.ceil(math.log2(reach)) if 0.0 < reach < math.inf else 0.0
    if longer == 0.0:
        return None
    known, question = _CUTS.answer((data.velocity,), dict), (rows.start, rows.stop, longer, most)
    if question not in known:
        moved = np.cumsum(np.abs(data.velocity[rows])) * data.period
        known[question] = in_pieces(moved, FORGOTTEN * longer, most, SHARED)
    return known[question]


def _reach(packed: Packed) -> float:
    """About how far the bristle bends [rad or m]."""
    p = packed.p
    level = max(p[layout.COULOMB], p[layout.BREAK_AWAY] if packed.on[FALLS] else 0.0)
    return float(level / p[layout.STIFFNESS])


def _inverted(data: Prepared, packed: Packed) -> Packed:
    """The model whose inverse motions go through."""
    if not (data.load_in_twin and has_load(packed.on)):
        return packed
    return Packed(packed.p, of_one_mass(packed.on))


def stretch_residual(packed: Packed, start: Floats, moved: Motion, period: float) -> Floats:
    """Torque that acted less the torque the model needs over one contiguous stretch, shape (n,).

    The torque behind a lag has long been what the first demand makes of it. `start` is where motion and
    contact begin.
    """
    needed, acted = np.empty(len(moved.torque)), np.empty(len(moved.torque))
    state = started_torque(packed, start, moved.torque[0])
    applied_torque(packed.p, packed.on, state, moved.torque, period, acted)
    required(
        packed.p,
        packed.on,
        state,
        moved.position,
        moved.velocity,
        moved.acceleration,
        period,
        load_substeps(packed.p, packed.on, period),
        needed,
    )
    return np.asarray((acted - needed) / torque_slope(packed.p, packed.on, moved.torque))


def residual(data: Prepared, packed: Packed, moved: Motion) -> Floats:
    """R on the grid, shape (m,)."""
    return smoothed(data, raw_residual(data, packed, moved))


def residuals(data: Prepared, models: Sequence[Packed], moved: Motion) -> Floats:
    """R of each of several models, shape (k, m): the same numbers as `residual`, in less time."""

    def of(chosen: list[int]) -> Floats:
        if len(chosen) == 1:
            return residual(data, models[chosen[0]], moved)[None]
        return _smoothed_in_lanes(data, _raw_in_lanes(data, [models[i] for i in chosen], [moved]))

    result = np.empty((len(models), len(data.grid)))
    passes = list(_together(data, models))
    for chosen, found in zip(passes, on_each(of, passes), strict=True):
        result[chosen] = found[: len(chosen)]
    return result


def _together(data: Prepared, models: Sequence[Packed]) -> Iterator[list[int]]:
    """Numbers of the models that one pass can take: the same effects, as many steps a sample."""
    return batches([kind_of_pass(data, packed) for packed in models])


def batches(keys: Sequence[Hashable]) -> Iterator[list[int]]:
    """Places of equal keys, at most eight of them together."""
    alike: dict[Hashable, list[int]] = {}
    for i, key in enumerate(keys):
        alike.setdefault(key, []).append(i)
    for members in alike.values():
        for first in range(0, len(members), WIDTH):
            yield members[first : first + WIDTH]


def alike(keys: Sequence[Hashable]) -> int:
    """How many of the first keys are equal."""
    return next((i for i, key in enumerate(keys) if key != keys[0]), len(keys))


def kind_of_pass(data: Prepared, packed: Packed) -> tuple[bytes, int]:
    """What must be equal for models that one pass of the inverse can take."""
    packed = _inverted(data, packed)
    return packed.on.tobytes(), load_substeps(packed.p, packed.on, data.period)


def _raw_in_lanes(data: Prepared, models: Sequence[Packed], moved: Sequence[Motion]) -> Floats:
    """`raw_residual` of up to eight models, each with its motion or all with one, shape (n, 8)."""
    asked = [_inverted(data, one) for one in models]
    models = [*asked, *[asked[-1]] * (WIDTH - len(asked))]
    rest, before = room_for(len(moved[0].torque)), 0
    for stretch in data.stretches:
        rest[before : stretch.start], before = 0.0, stretch.stop
        parts = [_rows_of(one, stretch.rows) for one in moved]
        if _in_pieces(data, stretch.rows, asked, parts, rest[stretch.rows]):
            continue
        still = [np.zeros(layout.STATES)] * WIDTH
        _lanes_of_stretch(models, still, parts, data.period, rest[stretch.rows])
    rest[before:] = 0.0
    return rest


def _lanes_of_stretch(
    models: Sequence[Packed], starts: Sequence[Floats], moved: Sequence[Motion], period: float, rest: Floats
) -> None:
    """`stretch_residual` of eight models, each with its motion or all with one, written to `rest`, shape (n, 8)."""
    torque, position, velocity, acceleration = (
        abreast([getattr(one, name) for one in moved])
        for name in ("torque", "position", "velocity", "acceleration")
    )
    p, on = filled([packed.p for packed in models]), models[0].on
    first = np.broadcast_to(torque[:, 0], WIDTH).tolist()
    state = filled([started_torque(*one) for one in zip(models, starts, first, strict=True)])
    needed = room_for(torque.shape[-1])
    applied_in_lanes(p, on, state, torque, period, rest)
    substeps = load_substeps(models[0].p, on, period)
    required_in_lanes(p, on, state, position, velocity, acceleration, period, substeps, needed)
    rest -= needed
    if on[SATURATES]:
        rest /= _slopes(models, torque)


def stretch_residuals(
    models: Sequence[Packed], starts: Sequence[Floats], moved: Sequence[Motion], period: float
) -> Floats:
    """`stretch_residual` of several models with the same effects, each with a motion of its own; shape (k, n)."""
    result = np.empty((len(models), len(moved[0].torque)))
    for chosen in batches([load_substeps(one.p, one.on, period) for one in models]):
        if len(chosen) == 1:
            (i,) = chosen
            result[i] = stretch_residual(models[i], starts[i], moved[i], period)
            continue
        lanes = [*chosen, *[chosen[-1]] * (WIDTH - len(chosen))]
        parts = [moved[i] for i in lanes]
        alike = all(one is parts[0] for one in parts)
        found = room_for(result.shape[1])
        _lanes_of_stretch(
            [models[i] for i in lanes],
            [starts[i] for i in lanes],
            parts[:1] if alike else parts,
            period,
            found,
        )
        result[chosen] = found.T[: len(chosen)]
    return result


def _slopes(models: Sequence[Packed], demand: Floats) -> Floats:
    """`torque_slope` of eight models at their demands, shape (8, n), or at one, (1, n); shape (n, 8).

    Most of them saturate alike: columns of a Jacobian, and lanes that only fill a pass.
    """
    known: dict[tuple[bytes, int], Floats | float] = {}
    slopes = np.empty((demand.shape[-1], WIDTH))
    for lane, one in enumerate(models):
        row = min(lane, len(demand) - 1)
        key = one.p[OF_SATURATION].tobytes(), row
        if key not in known:
            known[key] = torque_slope(one.p, one.on, demand[row])
        slopes[:, lane] = known[key]
    return slopes


def abreast(values: Sequence[Floats]) -> Floats:
    """Values of shape (n,), for each lane, as a kernel takes them: one for all (1, n), or (8, n)."""
    if len(values) == 1:
        return np.ascontiguousarray(values[0])[None]
    result = np.empty((WIDTH, len(values[0])))
    for lane in range(WIDTH):
        result[lane] = values[min(lane, len(values) - 1)]
    return result


def _smoothed_in_lanes(data: Prepared, raw: Floats) -> Floats:
    """Values of shape (n, 8) low-passed onto the grid, shape (8, m)."""
    result = np.empty((WIDTH, len(data.grid)))
    _smooth_in_lanes(raw, data.taps, data.grid, result)
    return result


@compiled
def _take_out(raw: Floats, acted: Floats) -> None:
    """Takes out of a residual, in place, what acted from each sample to the next; arrays of shape (n,)."""
    for k in range(1, len(raw)):
        raw[k] += 0.5 * (acted[k] + acted[k - 1])


@compiled
def _take_out_in_lanes(raw: Floats, acted: Floats) -> None:
    """`_take_out` of one torque, shape (n,), from residuals of shape (n, 8)."""
    _take_out(side_by_side(raw), acted)


def _take_out_of_each(raw: Floats, acted: Sequence[Floats | None]) -> None:
    """`_take_out` of each of some residuals, shape (n, 1 or 8); at once where all were shaken alike."""
    first = acted[0]
    if first is not None and len(acted) > 1 and all(one is first for one in acted):
        _take_out_in_lanes(raw, first)
        return
    for lane, one in enumerate(acted):
        if one is not None:
            _take_out(raw[:, lane], one)


def residuals_of_each(
    data: Prepared,
    models: Sequence[Packed],
    moved: Sequence[Motion],
    disturbances: Sequence[Floats | None] | None = None,
) -> list[Floats]:
    """Residuals of several models, each of a motion of its own, shape (m,).

    What is known to have disturbed a motion, shape (n,), is taken out of its residual.
    """
    known = disturbances or [None] * len(models)

    def of(chosen: list[int]) -> Floats:
        if len(chosen) == 1:
            raw = raw_residual(data, models[chosen[0]], moved[chosen[0]])[:, None]
        else:
            raw = _raw_in_lanes(data, [models[i] for i in chosen], [moved[i] for i in chosen])
        _take_out_of_each(raw, [known[i] for i in chosen])
        return smoothed(data, raw[:, 0])[None] if len(chosen) == 1 else _smoothed_in_lanes(data, raw)

    result: dict[int, Floats] = {}
    passes = list(_together(data, models))
    for chosen, smooth in zip(passes, on_each(of, passes), strict=True):
        result |= dict(zip(chosen, smooth, strict=False))
    return [result[i] for i in range(len(models))]
