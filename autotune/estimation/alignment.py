"""Torque and motion of other people's files, brought together: raster, time, and what one column went through.

Raster: central differences are short by 5 % at a tenth of the sampling rate, the mean of two torques by 4 %, and a
torque moved by half a sample by 4 % again: together they look like an elastic transmission, or friction that grows
with torque. Quintic splines through the samples have none of that up to a third of the rate.

Time: anything from a filtered position, read late, to a torque that was logged after the bus. Where neither a
controller nor repeats tell how columns belong together, the torque is moved by fractions of a sample to where a
model explains it best, the nearest such place.

A controller tells how they belong together only where they are of one moment. A torque that comes a sample or more
after the motion that it causes is not, however well the law of a slower loop explains it: no axis answers before it is
asked (`recorded_late`). Taken as it is, it looks like an elastic transmission too.

Filters: drives and loggers often record a filtered torque or a filtered position. Moving one against the other
mends the delay, not the lag that is left, and that looks like an elastic transmission. So each side is put through
first-order filters; where motion and torque then belong together far better, the other side is filtered alike, and
that is said.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import scipy

from autotune.core.arrays import Flags, Floats
from autotune.estimation.data import Prepared, Stretch, known_resolution, stretches_of
from autotune.estimation.policy import POLICY
from autotune.estimation.residual import acted, smoothed
from autotune.recordings.recording import Recording

CURRENT_LOOP = 0.45e-3
"""s, time constant of the slowest ordinary current loop (350 Hz). Servo drives come with 1 to 2 kHz; a current loop
must be five times as fast as the velocity loop around it, which is 75 Hz as drives are delivered."""
BESIDE = 0.2e-3
"""s, by which a torque that a loop between the samples makes may be early beside how it was recorded, by a usual
current loop: more would hide a lag."""
FINE = 20.0
"""Samples a period of the highest frequency compared, from which differences do: within 1.6 %."""
MOST = 4
DEGREE = 5
TORQUES = ("torque", "torque_command", "torque_feedforward")


def needed(cutoff: float, period: float) -> int:
    """By what the raster must be finer where everything up to `cutoff` [Hz] is compared."""
    return min(MOST, max(1, math.ceil(FINE * cutoff * period - 1e-9)))


def upsampled(recording: Recording, factor: int) -> Recording:
    """The recording with `factor` rows for each one, interpolated between cuts; itself for 1."""
    if factor == 1:
        return recording
    old = np.arange(len(recording), dtype=np.float64)
    new = np.arange((len(recording) - 1) * factor + 1) / factor
    stretches = [stretch.rows for stretch in stretches_of(recording, 0)]
    columns = {
        name: _finer_time(recording, factor, old, new)
        if name == "time"
        else _splined(values, stretches, factor, old, new)
        for name, values in recording.floats.items()
    }
    row = np.floor(new + 1e-9).astype(np.int64)
    missed = np.zeros(len(new), dtype=np.int64)
    missed[::factor] = recording.missed
    metadata = recording.with_metadata(
        sample_period=recording.period / factor,
        position_resolution=known_resolution(recording.metadata, recording["position"]),
    ).metadata
    return Recording.from_columns(columns, metadata, recording.experiment[row], recording.repeat[row], missed)


def _finer_time(recording: Recording, factor: int, old: Floats, new: Floats) -> Floats:
    """Time on the new raster: it goes on after the last row of a segment, as the next one may begin before it."""
    time = recording["time"]
    finer = np.asarray(np.interp(new, old, time), dtype=np.float64)
    behind = np.arange(1, factor) * (recording.period / factor)
    for segment in recording.segments()[:-1]:
        first = (segment.stop - 1) * factor + 1
        finer[first : first + len(behind)] = time[segment.stop - 1] + behind
    return finer


def _splined(values: Floats, stretches: Sequence[slice], factor: int, old: Floats, new: Floats) -> Floats:
    """Values on the new raster: splines within each stretch, straight lines elsewhere."""
    result = np.asarray(np.interp(new, old, values), dtype=np.float64)
    for rows in stretches:
        inside = slice(rows.start * factor, (rows.stop - 1) * factor + 1)
        spline = scipy.interpolate.make_interp_spline(old[rows], values[rows], DEGREE)
        result[inside] = spline(new[inside])
    return result


EARLIEST, LATEST, FARTHEST = -4.0, 6.0, 40.0
"""Half samples of the file by which the torque may be moved; farther only where the misfit shows plainly how far."""
ACAUSAL = 2.0
"""Half samples from which on a torque is later than any way of reading it within its own sample makes it."""
LEAST_FAST = 0.2


def best_shift(
    cost: Callable[[float], float],
    start: float,
    upsampling: int = 1,
    step: float = 0.1,
    farthest: float = LATEST,
    soonest: float = EARLIEST,
) -> tuple[float, float]:
    """The nearest minimum of a cost over the shift, in steps of `step` half samples, and its cost there.

    `upsampling`: rows for each sample of the file; `farthest`, `soonest`: half samples of it by which it may be moved,
    or a sample beyond where it is already.
    """
    earliest, latest = upsampling * soonest, upsampling * farthest
    if start > latest:
        latest = start + upsampling * ACAUSAL
    earliest = min(earliest, start)
    known: dict[float, float] = {}

    def at(shift: float) -> float:
        if shift not in known:
            known[shift] = cost(shift)
        return known[shift]

    best = start
    for _ in range(round(latest - earliest)):
        near = [s for s in (best - 1.0, best + 1.0) if earliest <= s <= latest]
        better = min(near, key=at)
        if at(better) >= at(best):
            break
        best = better
    if not earliest <= best - 1.0 <= best + 1.0 <= latest:
        return best, at(best)
    before, here, after = at(best - 1.0), at(best), at(best + 1.0)
    curve = before - 2.0 * here + after
    vertex = best + step * round(0.5 * (before - after) / curve / step) if curve > 0.0 else best
    return min((best, vertex), key=at), min(at(best), at(vertex))


def shifted(data: Prepared, half_samples: float) -> Prepared:
    """The data with the recorded torque moved to later motion by so many half samples."""
    torque = data.recorded_torque.copy()
    for stretch in data.stretches:
        rows = np.arange(stretch.start, stretch.stop, dtype=np.float64)
        recorded = data.recorded_torque[stretch.rows]
        torque[stretch.rows] = np.interp(rows + 0.5 * half_samples, rows, recorded)
    late = data.late + 0.5 * (data.shift - half_samples)
    return replace(data, torque=torque, shift=half_samples, late=late, lag=0.0, lag_error=0.0, cycles=0)


def acting_later(data: Prepared, part: float) -> Prepared:
    """The data of a demand that acts a part of a row after it was recorded, and is held from then on.

    What it does is what it would have done at once, as much later: the torque is moved on splines, as a mean of two
    demands loses (ωh)²/8 of it in the midst of a row.
    """
    torque = data.recorded_torque.copy()
    for stretch in data.stretches:
        rows = np.arange(stretch.start, stretch.stop, dtype=np.float64)
        if len(rows) > DEGREE:
            spline = scipy.interpolate.make_interp_spline(rows, torque[stretch.rows], DEGREE)
            torque[stretch.rows] = spline(np.maximum(rows - part, rows[0]))
    moved = replace(data, recorded_torque=torque, late=data.late + part)
    return shifted(moved, data.shift)


def a_row_sooner(data: Prepared) -> Prepared:
    """The data of a torque that is read when the next one is due, and so is the feedforward that it holds."""
    fed = data.feedforward.copy()
    for stretch in data.stretches:
        fed[stretch.start : stretch.stop - 1] = data.feedforward[stretch.start + 1 : stretch.stop]
    return replace(shifted(data, 2.0), feedforward=fed)


def later(recording: Recording, rows: float) -> Recording:
    """The recording with the torque of so many rows later at each row, within each stretch."""
    columns = dict(recording.floats)
    for name in TORQUES:
        if name not in columns:
            continue
        moved = columns[name].copy()
        for stretch in stretches_of(recording, 0):
            at = np.arange(stretch.start, stretch.stop, dtype=np.float64)
            moved[stretch.rows] = np.interp(at + rows, at, columns[name][stretch.rows])
        columns[name] = moved
    return replace(recording, floats=MappingProxyType(columns))


def half_a_sample_later(data: Prepared) -> Floats:
    """What an error changes by where the torque acts half a sample later than it is taken to, on the grid, (m,)."""
    change = shifted(data, data.shift - 1.0).torque - data.torque
    return smoothed(data, acted(change))


def behind_current_loop(data: Prepared, time_constant: float, stages: int = 1) -> Prepared:
    """The data with the torque that a current loop of a time constant [s] makes of the recorded demand.

    Of several `stages` each has a part of it.
    """
    prompt = shifted(data, data.shift)
    torque = prompt.torque
    for _ in range(stages):
        torque = followed_late(prompt, torque, time_constant / stages)
    return replace(prompt, torque=torque, lag=time_constant, cycles=data.cycles)


def followed_late(data: Prepared, demand: Floats, time_constant: float) -> Floats:
    """Mean over each sample of what a first-order lag makes of a demand that is held, shape (n,); see `torque_path`.

    The torque has long been what the first demand of a stretch makes of it.
    """
    if time_constant <= 0.0:
        return demand
    ratio = data.period / time_constant
    left = math.exp(-ratio)
    mean = (1.0 - left) / ratio
    result = demand.copy()
    for stretch in data.stretches:
        given = demand[stretch.rows]
        start = [left * given[0]]
        at_sample = np.concatenate(
            [given[:1], scipy.signal.lfilter([1.0 - left], [1.0, -left], given, zi=start)[0]]
        )
        result[stretch.rows] = given - (given - at_sample[:-1]) * mean
    return result


def aligned(data: Prepared) -> Prepared:
    """The data with the torque shifted to where it fits inertia and friction best, beside what else may be there.

    Rows near a reversal do not count: friction that reverses over some travel looks like a delay. Nor does what a
    spring, a weight, friction under load and a viscosity that bends explain (`also_there`): where one of them is
    missing, a torque that is moved by a millisecond stands for a part of it.
    """
    shift = _aligned_beside(data)
    return shifted(data, _aligned_best(data)[0] if shift is None else shift)


def _aligned_beside(data: Prepared) -> float | None:
    """Shift at which inertia and friction and what may be there beside them leave least of the torque.

    None where they leave much of it, are no axis's there, or have no least within the usual range, as in a swing of one
    frequency.
    """
    rows = away_from_reversals(data)
    shift, left = best_shift(lambda s: _misfit_beside(shifted(data, s), rows), 0.0, data.upsampling)
    usual = left <= LARGE and data.upsampling * EARLIEST < shift < data.upsampling * LATEST
    return shift if usual and drives(shifted(data, shift), rows) else None


def _aligned_best(data: Prepared) -> tuple[float, float]:
    """Shift at which inertia and friction explain the torque best, and what they leave of it.

    None where they are no axis's there, and beyond the usual range only where they explain nearly all: what else is
    missing may draw it anywhere. A torque that a bus or a buffer holds back acts many samples after it was recorded.
    """
    rows = away_from_reversals(data)
    known: dict[float, float] = {}

    def cost(shift: float) -> float:
        if shift not in known:
            known[shift] = linear_misfit(shifted(data, shift), rows)
        return known[shift]

    shift, left = best_shift(cost, 0.0, data.upsampling)
    if not drives(shifted(data, shift), rows):
        return 0.0, cost(0.0)
    if data.upsampling * EARLIEST < shift < data.upsampling * LATEST:
        return shift, left
    far, least = best_shift(cost, shift, data.upsampling, farthest=FARTHEST, soonest=-FARTHEST)
    plainly = least <= min(LARGE, CLEARLY * cost(0.0)) and drives(shifted(data, far), rows)
    return (far, least) if plainly else (shift, left)


def acts_after(data: Prepared) -> float:
    """Samples of the file after its row at which the torque acts, by inertia and friction, wherever it was moved to."""
    return -0.5 * _aligned_best(shifted(data, 0.0))[0] / data.upsampling


def recorded_late(data: Prepared) -> float:
    """Seconds by which a single recording's torque comes after the motion that it causes; 0 where within a sample.

    Beyond doubt only where inertia and friction then leave far less of it than at the moment it was recorded.
    """
    if data.repeated or data.steady or data.pace < 1.0:
        return 0.0
    prompt = shifted(data, 0.0)
    shift, left = _aligned_best(prompt)
    if shift < ACAUSAL * data.upsampling or left > LARGE:
        return 0.0
    return 0.5 * shift * data.period if left <= CLEARLY * misfit_here(prompt) else 0.0


def plainly_apart(data: Prepared) -> bool:
    """Whether inertia and friction explain clearly more of the torque where it was moved to than as it was recorded.

    They leave little there, too. A few parts of a sample may be friction's: its bristle bends as a delay does. Where it
    would be moved farther still, as in a swing of one frequency, nothing tells where it belongs.
    """
    at_bound = data.shift == data.upsampling * EARLIEST
    if at_bound or not abs(data.shift) < data.upsampling * FARTHEST:
        return False
    here = misfit_here(data)
    return here <= min(LARGE, POLICY.clearly_less * misfit_here(shifted(data, 0.0)))


def away_from_reversals(data: Prepared) -> Flags:
    """Grid rows whose low-pass sees one direction only, shape (m,); all where those are too few."""
    speed = np.abs(data.velocity)
    slow = speed < 0.1 * float(np.percentile(speed, 99.5))
    near = scipy.ndimage.maximum_filter1d(slow, 2 * (len(data.taps) // 2) + 1)
    rows = np.asarray(~near[data.grid])
    return rows if rows.mean() > LEAST_FAST else np.ones(len(rows), dtype=np.bool_)


def linear_misfit(data: Prepared, rows: Flags, loaded: bool = False) -> float:
    """Share of the torque's variance that inertia, friction and offset leave on some grid rows.

    `loaded`: a spring, a weight and friction that inertia presses too, whatever they are worth.
    """
    _, target, left = linear_fit(data, rows, loaded)
    return float(np.sum(left**2)) / max(float(np.sum((target - target.mean()) ** 2)), 1e-300)


def also_there(data: Prepared) -> Floats:
    """Torques that may be there beside inertia and friction, to a size, on the grid, shape (m, 3 or 5).

    Of a spring and a weight; of friction that grows with the torque of inertia; of one that grows with the square of
    speed.
    """
    pressed = np.abs(data.acceleration) * np.sign(data.velocity)
    bent = data.velocity * np.abs(data.velocity)
    return np.column_stack([_of_place(data), smoothed(data, pressed), smoothed(data, bent)])


def _misfit_beside(data: Prepared, rows: Flags) -> float:
    """Share of the torque's variance that is left beside inertia, friction and what may be there, on some grid rows."""
    table, target = _columns(data)[rows], smoothed(data, acted(data.torque))[rows]
    _, left = _solved(np.column_stack([table, also_there(data)[rows]]), target)
    return float(left @ left) / max(float(np.sum((target - target.mean()) ** 2)), 1e-300)


def drives(data: Prepared, rows: Flags) -> bool:
    """Whether the torque accelerates the axis and works against its friction.

    A controller's answer does neither: it holds against every motion, and the way of the sensor to the controller looks
    like a filter of the one column or the other.
    """
    inertia, viscous, coulomb, _ = linear_fit(data, rows)[0]
    speed = smoothed(data, data.velocity)[rows]
    friction = viscous * speed + coulomb * smoothed(data, np.sign(data.velocity))[rows]
    return bool(inertia > 0.0 and friction @ (speed - speed.mean()) >= 0.0)


def misfit_here(data: Prepared) -> float:
    """The same on rows away from reversals, with the torque where it is."""
    return linear_misfit(data, away_from_reversals(data))


def linear_fit(data: Prepared, rows: Flags, loaded: bool = False) -> tuple[Floats, Floats, Floats]:
    """Gains of acceleration, velocity, its sign and 1 on some grid rows, the torque there, and what they leave of it.

    Shapes (4,), (r,), (r,). A spring and a weight stand beside them where much is left that they explain; and friction
    that grows with the torque of inertia where they are `loaded`.
    """
    target, table = smoothed(data, acted(data.torque))[rows], _columns(data)[rows]
    gains, left = _solved(table, target)
    if loaded or left @ left > LARGE * float(np.sum((target - target.mean()) ** 2)):
        columns = [table, _of_place(data)[rows]]
        if loaded:
            pressed = np.abs(data.acceleration) * np.sign(data.velocity)
            columns.append(smoothed(data, pressed)[rows, None])
        beside, less = _solved(np.column_stack(columns), target)
        if loaded or less @ less <= CLEARLY * float(left @ left):
            gains, left = beside[: len(gains)], less
    return gains, target, left


def _columns(data: Prepared) -> Floats:
    """Acceleration, velocity, its sign and 1, on the grid, shape (m, 4)."""
    return np.column_stack(
        [
            smoothed(data, data.acceleration),
            smoothed(data, data.velocity),
            smoothed(data, np.sign(data.velocity)),
            np.ones(len(data.grid)),
        ]
    )


def _solved(table: Floats, target: Floats) -> tuple[Floats, Floats]:
    """Least squares gains of columns, and what they leave."""
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    gains = np.linalg.lstsq(table / size, target, rcond=1e-10)[0]
    return gains / size, target - (table / size) @ gains


def _of_place(data: Prepared) -> Floats:
    """Torques of a spring and of a weight, on the grid, shape (m, 1 or 3)."""
    place = data.position - data.position.mean()
    rotary = data.metadata.motion_unit == "rad"
    columns = (place, np.sin(place), np.cos(place)) if rotary else (place,)
    return np.column_stack([smoothed(data, column) for column in columns])


SAMPLES = (2.0, 4.0, 8.0, 16.0)
"""Time constants tried, of the file."""
CLEARLY = 0.4
"""Of the misfit: less must be left."""
NO_TIE = 0.95
"""Of the misfit of a torque that is moved far: what is left with a filter beside a shift, one parameter more."""
LARGE = 0.1
"""Of the torque: where more is left, something else is missing that a filter could imitate. (Counts of an encoder that
are a part of the acceleration, and seem to need torque, it swallows too.)"""


def without_twin(data: Prepared) -> tuple[Prepared, tuple[str, ...]]:
    """A single recording's columns brought together where no controller tells how they belong together.

    Not those of a fast axis, where friction that reverses would be taken for a delay: its model aligns them.
    """
    if data.repeated or data.steady or data.pace < 1.0:
        return data, ()
    data, said = compensated(aligned(data))
    return data, () if said is None else (said,)


@dataclass(frozen=True, slots=True)
class Filtered:
    """How columns belong together where one of them was filtered, not only read late.

    Attributes:
        column: `torque` or `position`: the one that was filtered; "" for none.
        rows: time constant, in rows of the raster; `shift`: of the torque beside it, in half rows.
        change: of the gains of inertia and friction against none, over themselves, shape (4,), as in `linear_fit`.
    """

    column: str
    rows: float
    shift: float
    change: Floats


def filtered_or_late(data: Prepared) -> Filtered:
    """Whichever explains the torque better: the torque where it is, or a first-order filter of one of the columns;
    beside a load too (`low_passed`)."""
    rows = away_from_reversals(data)
    gains, left = linear_fit(data, rows)[0], linear_misfit(data, rows)
    most = POLICY.clearly_less * linear_misfit(data, rows, loaded=True)
    best, found = POLICY.clearly_less * left, Filtered("", 0.0, data.shift, np.zeros(len(gains)))
    if left > LARGE or data.coarse:
        return found
    for samples in (data.upsampling * count for count in SAMPLES):
        for column, through in (("torque", _motion_through), ("position", _torque_through)):
            alike = through(data, samples)
            shift, misfit = _shift_from_here(alike)
            if misfit < best and abs(shift) < abs(data.shift):  # it is why the torque seemed early or late
                if not drives(shifted(alike, shift), rows):
                    continue
                if linear_misfit(shifted(alike, shift), rows, loaded=True) > most:
                    continue
                change = _relative(linear_fit(shifted(alike, shift), rows)[0], gains)
                best, found = misfit, Filtered(column, samples, shift, change)
    return found


def change_of_gains(before: Prepared, after: Prepared) -> Floats:
    """By how much gains of inertia and friction differ between two preparations, over themselves, shape (4,)."""
    one, other = (linear_fit(data, away_from_reversals(data))[0] for data in (before, after))
    return _relative(other, one)


def _relative(gains: Floats, of: Floats) -> Floats:
    return np.asarray(np.abs(gains - of) / np.maximum(np.abs(of), 1e-300))


def brought_together(recording: Recording, how: Filtered) -> Recording:
    """The recording with what was not filtered put through the same filter, and its torque moved."""
    columns = dict(recording.floats)
    motion, torque = ("position", "velocity", "reference"), TORQUES
    for name in {"torque": motion, "position": torque}.get(how.column, ()):
        if name in columns:
            through = _through(tuple(stretches_of(recording, 0)), how.rows)
            columns[name] = through(columns[name])
    return later(replace(recording, floats=MappingProxyType(columns)), 0.5 * how.shift)


def low_passed(data: Prepared) -> tuple[str, float] | None:
    """The column that seems low-passed against the others, and its time constant [s]; None where none does.

    It leaves clearly less than a torque that was moved by a few samples, and less than one that was moved farther; and
    so beside a load: a weight whose place is passed fast is what a filter takes away, and friction that the load
    presses is late.
    """
    here = _misfit(data)
    if here > LARGE or data.coarse:
        return None
    far = not data.upsampling * EARLIEST <= data.shift <= data.upsampling * LATEST
    near = shifted(data, 0.0) if far else data
    plain = _misfit(near) if far else here
    trials: list[tuple[float, str, float]] = []
    for samples in (data.upsampling * count for count in SAMPLES):
        trials.append((_misfit(_motion_through(data, samples)), "torque", samples))
        trials.append((_misfit(_torque_through(data, samples)), "position", samples))
    misfit, column, samples = min(trials)
    clearly = misfit <= CLEARLY * plain and (not far or misfit < NO_TIE * here)
    if not clearly:
        return None
    alike = (_motion_through if column == "torque" else _torque_through)(data, samples)
    if _misfit(alike, loaded=True) > CLEARLY * _misfit(near, loaded=True):
        return None
    rows, shift = away_from_reversals(alike), _shift_from_here(alike)[0]
    return (column, samples * data.period) if drives(shifted(alike, shift), rows) else None


def compensated(data: Prepared) -> tuple[Prepared, str | None]:
    """The data with both sides filtered alike, and a sentence on it; as they are where no column seems filtered."""
    found = low_passed(data)
    if found is None:
        return data, None
    column, constant = found
    through, other = (_motion_through, "motion") if column == "torque" else (_torque_through, "torque")
    said = (
        f"The {column} looks low-passed against the other columns, by about {1e3 * constant:.2g} ms; "
        f"the {other} was filtered alike. An elastic transmission cannot be told from that: record the {column} "
        "unfiltered."
    )
    alike = through(data, constant / data.period)
    return replace(shifted(alike, _shift_from_here(alike)[0]), filtered=True), said


def _shift_from_here(data: Prepared, loaded: bool = False) -> tuple[float, float]:
    """As `best_shift`, from where the torque is."""
    rows = away_from_reversals(data)
    return best_shift(
        lambda shift: linear_misfit(shifted(data, shift), rows, loaded), data.shift, data.upsampling
    )


def _misfit(data: Prepared, loaded: bool = False) -> float:
    """Share of the torque's variance that inertia and friction leave, at the best shift."""
    return _shift_from_here(data, loaded)[1]


def _motion_through(data: Prepared, samples: float) -> Prepared:
    through = _through(data.stretches, samples)
    return replace(
        data,
        position=through(data.position),
        velocity=through(data.velocity),
        acceleration=through(data.acceleration),
    )


def _torque_through(data: Prepared, samples: float) -> Prepared:
    return replace(data, recorded_torque=_through(data.stretches, samples)(data.recorded_torque))


def _through(stretches: Sequence[Stretch], samples: float) -> Callable[[Floats], Floats]:
    share = 1.0 - float(np.exp(-1.0 / samples))

    def run(values: Floats) -> Floats:
        result = values.copy()
        for stretch in stretches:
            part = values[stretch.rows]
            state = [(1.0 - share) * part[0]]
            result[stretch.rows] = scipy.signal.lfilter([share], [1.0, share - 1.0], part, zi=state)[0]
        return result

    return run
