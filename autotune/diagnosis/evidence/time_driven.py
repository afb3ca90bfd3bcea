"""What goes by time, not by the motion: one frequency in every experiment, of a torque or of the friction's level.

Repeats of a trajectory do not start in the phase of it, so that it looks like noise; but its phase runs on through
all experiments. A level of the torque that wanders, which repeats played one after the other share. A force that was
there once, in one repeat and not in the other. And what follows the lines of the encoder's scale: the error of a
reading that is interpolated.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.diagnosis.ripple_orders import MOST_LINES
from autotune.diagnosis.starts import Context
from autotune.estimation.bias_corrected_fit import ModelFit, held_out_of
from autotune.estimation.cross_validation import (
    beyond_presliding,
    gain_and_z,
    of_friction,
    with_columns,
)
from autotune.estimation.data import TRAINING, VETO, Clocked, Prepared, ReadingWave, Wander, read_without
from autotune.estimation.disturbance_estimate import estimate_disturbance, with_expected_noise
from autotune.estimation.problem import Problem
from autotune.estimation.residual import acted, measured_motion, residual, smoothed
from autotune.models.drive_model import Packed
from autotune.models.torque_ripple import TORQUE_RIPPLE
from autotune.signals.periodic import period_of
from autotune.signals.place_line import strongest_line

LEAST_HERTZ = 0.7
MOST_CLOCKED = 3
MAINS, AS_STEADY = (50.0 / 3.0, 50.0, 60.0), 3e-3
"""Hz, and how near the mains keep to it, relative: what is at one of these, or a multiple, comes from the supply."""
LOUDER = 0.5
"""Of what a model left: a torque that is more has a cause that matters more than all else."""
BREATHS, QUICKEST_BREATH = 4.0, 2.5
"""Of a friction level that rises and falls: periods in the recording, at least, and the highest frequency [Hz]: quicker
ones change within the reversals that tell friction from torque."""
FINE_BREATH = 0.5
"""Of one over the length of the recording: steps of the frequency."""
AT_ENDS = 8
"""Of the rows, one in so many before and behind: a motion comes up from rest there and goes back to it."""
AS_WELL = 0.5
"""Of what a line over time explains: where a wave over position does as much, nothing says that time drives it."""
IN_STEP = (2.0, 98.0)
"""% of the rows: where an axis comes up to its one speed it is not in step with a clock."""
ALIKE_PHASE = math.radians(30.0)
"""Of a line that comes and goes: how far its phase may be off in a repeat of an experiment."""
FEWEST_EXPERIMENTS, GOES_ON, ALIKE_STEPS = 5, 0.2, 4.0
"""Of a level that wanders: experiments that tell it; its steps' mean square from one to the next, of that of levels in
any order (of seven, chance comes below once in a thousand), and over that between repeats of one experiment."""

LASTS = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0)
"""Seconds that a force of one moment may last."""
ONCE, LEVEL, AGAIN, AS_MUCH = 1.0 / 3.0, 0.5, 0.25, 0.9
"""Of such a force: what it explains at least of all that differs between repeats, and of that in its own stretch; what
one at another time may have of as much, as noise that wanders has a level in every stretch; and what is as much."""
LONGEST, LONGEST_PART = 0.1, 0.8
"""Of all rows, and of those of its experiment: how long it may last."""

LEAST_PERIODS, LEAST_LINES = 20.0, 8.0
"""Of an encoder's scale: periods over the travel and over a turn at least; fewer are waves of the axis."""
COUNTS_A_PERIOD, FINEST_PERIOD = 8.0, 1e-5
"""Counts, and part of the travel, that a period is at least: a finer one cannot be told."""


@dataclass(frozen=True, slots=True)
class TimeLine:
    """A disturbance of constant frequency [Hz] and its share of the residual's variance.

    Attributes:
        steady: as large in every experiment; else it comes and goes with them, in step with the clock.
    """

    hertz: float
    share: float
    steady: bool = True


def time_driven_line(problem: Problem, error: Floats) -> TimeLine | None:
    """The strongest line whose phase runs on through all experiments; None where there is none.

    Its size may be another in each of them: a tool cuts only while the axis feeds. Not where nothing is repeated: the
    parts of one motion go on from each other, and what a stroke makes at one speed is in step through all of it.
    """
    data = problem.data
    if len(data.stretches) != 1 or len({b.name for b in data.blocks if b.role == TRAINING}) < 3:
        return None
    rows = problem.training > 0
    clock = _clock(problem)
    time, values = clock[rows], error[rows] - error[rows].mean()
    step = float(np.median(np.diff(np.sort(time))))
    series = np.zeros(math.ceil(time.max() / step) + 2)
    series[np.round(time / step).astype(np.int64)] = values
    power = np.abs(np.fft.rfft(series)) ** 2
    hertz = np.fft.rfftfreq(len(series), step)
    band = (hertz > LEAST_HERTZ) & (hertz < 0.8 * hertz[-1])
    best = int(np.argmax(np.where(band, power, 0.0)))
    if power[best] < problem.policy.line_contrast * np.median(power[band]):
        return None
    finest = min(
        hertz[best] + np.linspace(-1.0, 1.0, 41) / time.max(), key=lambda f: -_share(time, values, float(f))
    )
    periods = [part.samples for part in data.periodic] or _period(data)
    if any(_of_the_motion(float(finest), samples * data.period, time.max()) for samples in periods):
        return None
    line = TimeLine(float(finest), _share(time, values, float(finest)))
    if line.share <= problem.policy.line_part or _over_place(problem, values, line):
        return None
    if _everywhere(problem, error, line.hertz):
        return line
    in_step = data.repeated and _in_step(problem, error, line.hertz)
    return replace(line, steady=False) if in_step else None


def without_clocked(problem: Problem, packed: Packed, error: Floats) -> Problem | None:
    """The problem without the torque that follows the clock in what a model leaves; None where there is none.

    Where experiments last whole periods of it, it comes again in every repeat, and no effect of the axis explains it.
    The twin is shaken then as the axis is beside it. Not from a lone recording: at one speed cogging follows the clock.
    """
    data = problem.data
    looked = data.repeated and len(data.clocked) < MOST_CLOCKED
    line = time_driven_line(problem, error) if looked else None
    if line is None or not line.steady:
        return None
    units = [Clocked(line.hertz, sine, cosine, data.shift) for sine, cosine in ((1.0, 0.0), (0.0, 1.0))]
    terms = np.column_stack([smoothed(data, acted(one.torque(data))) for one in units])
    rows = problem.training > 0
    sine, cosine = np.linalg.lstsq(terms[rows], error[rows], rcond=None)[0]
    found = Clocked(line.hertz, float(sine), float(cosine), data.shift, line.share)
    return _by_time(problem, packed, replace(data, clocked=(*data.clocked, found)))


def _by_time(problem: Problem, packed: Packed, data: Prepared) -> Problem:
    """The problem with less in its torque that goes by time, shaken as the axis is beside that."""
    problem = replace(problem, data=data, moved=measured_motion(data))
    problem = replace(problem, disturbance=estimate_disturbance(problem, packed))
    return with_expected_noise(problem, packed)


def without_wander(problem: Problem, packed: Packed, error: Floats) -> Problem | None:
    """The problem without the torque's level that wanders in what a model leaves; None where it does not.

    Repeats that are played one after the other share it, so that it seems to come again. But it goes on from each
    repeat to the next one, of the same experiment or of another, and what an effect makes is as large in both repeats
    of an experiment, whenever they are played, and another one in the next experiment. What the veto trajectory has of
    it is a level for each of its repeats.
    """
    data = problem.data
    if not data.repeated or len(data.starts) > 1:
        return None
    times, levels, blocks = _levels(problem, error)
    if len(levels) < 2 * FEWEST_EXPERIMENTS:
        return None
    repeated = np.concatenate([np.diff(levels[blocks == block]) for block in np.unique(blocks)])
    onwards = np.diff(levels)[blocks[1:] != blocks[:-1]]
    if min(repeated.size, onwards.size) < FEWEST_EXPERIMENTS - 1:
        return None
    variance = float(np.var(levels))
    within, across = (float(np.mean(steps**2)) for steps in (repeated, onwards))
    goes_on = across <= GOES_ON * 2.0 * variance and across <= ALIKE_STEPS * within
    if not goes_on or variance < problem.policy.structure_part * problem.noise_variance(error, TRAINING):
        return None
    before = 0.0 if data.wander is None else np.interp(times, data.wander.times, data.wander.levels)
    wander = Wander(times, before + levels - levels.mean())  # the mean is the base's offset
    return _by_time(problem, packed, replace(data, wander=wander))


def _levels(problem: Problem, error: Floats) -> tuple[Floats, Floats, NDArray[np.int_]]:
    """Time [s], level and number of the experiment of every repeat in the order of time, shape (k,) each."""
    clock, found = _clock(problem), []
    for number, block in enumerate(problem.data.blocks):
        if block.role not in (TRAINING, VETO) or block.repeats < 2:
            continue
        counts = block.by_repeat(problem.weight > 0.0)
        for rows, time, rest in zip(counts, block.by_repeat(clock), block.by_repeat(error), strict=True):
            if rows.any():
                found.append((float(time[rows].mean()), float(rest[rows].mean()), number))
    found.sort()
    times, levels, numbers = np.array(found).reshape(-1, 3).T
    return times, levels, numbers.astype(int)


def without_reading_waves(problem: Problem, model_fit: ModelFit) -> Problem | None:
    """The problem without what the encoder's interpolation adds to the motion; None where there is none.

    It is alike in every repeat, and no effect of the axis. A reading y = q + e(y) leaves -J·e'' of what a model leaves:
    by its size over speed it differs from a torque over place, which must predict experiments held out less well.

    At a constant speed every wave of the axis has another beside it that is the same at the samples: of more waves, by
    as many as pass between two of them. So where a wave of fewer periods stands out more, it must gain beside that too.
    And waves of a torque that are near each other predict nothing one by one: what gains nothing beside all that stand
    out, which gain beside it, is one of them. A scale is read wherever the axis moves: what gains only near reversals
    and rests is the contact's.
    """
    data = problem.data
    if not data.repeated or data.steady or data.reading is not None:
        return None
    bent = _bent(problem, model_fit.fitted.error)
    finer, finest = _lines_of_scales(problem)
    line = strongest_line(data.measured, bent, (finer, finest), problem.policy.line_contrast)
    if line is None:
        return None
    found = max(
        (_read(problem, model_fit, line.wavenumber / times) for times in (1.0, 2.0)), key=lambda one: one.gain
    )
    if not (_is_known(problem, found) and _gains_while_sliding(problem, model_fit, found.wave)):
        return None
    if _is_of_a_ripple(problem, model_fit, found.wave.wavenumber):
        return None
    coarse = strongest_line(
        data.measured, bent, (2.0 * math.pi / problem.scales.travel, finer), line.contrast
    )
    if coarse is not None:
        beside = _alike_large(np.hstack(_waves(problem, model_fit, coarse.wavenumber)))
        if not _is_known(problem, _read(problem, model_fit, found.wave.wavenumber, beside)):
            return None
    if _rather_torques(problem, model_fit, found.wave.wavenumber):
        return None
    data = read_without(data, found.wave)
    problem = replace(problem, data=data, moved=measured_motion(data))
    packed = model_fit.fitted.packed
    problem = replace(problem, disturbance=estimate_disturbance(problem, packed))
    return with_expected_noise(problem, packed)


def _is_known(problem: Problem, found: _Read) -> bool:
    """Whether an error of the reading gains beyond chance, and more than a torque over place does."""
    policy = problem.policy
    known = found.gain >= policy.least_gain and policy.no_chance(found.gain, found.z)
    return known and found.gain > found.as_torque and found.wave.steepest < 1.0


def _is_of_a_ripple(problem: Problem, model_fit: ModelFit, wavenumber: float) -> bool:
    """Whether the model has a torque over the place whose waves, or twice them, these data do not tell from a wave.

    Where that torque acts later or sooner than it is taken to, or bends with speed, it leaves what an error of the
    reading would at the same place.
    """
    if TORQUE_RIPPLE.name not in model_fit.effects:
        return False
    context = Context(problem, model_fit.fitted, model_fit.fitted.packed)
    waves = [times * order * context.angle for order in context.ripple_orders() for times in (1.0, 2.0)]
    apart = 2.0 * math.pi / problem.scales.travel
    return any(abs(one - wave) <= apart for one in (wavenumber, 2.0 * wavenumber) for wave in waves)


def _gains_while_sliding(problem: Problem, model_fit: ModelFit, wave: ReadingWave) -> bool:
    """Whether a reading's wave gains where the contact slides, whatever its law; where nothing slides, it may."""
    sliding = beyond_presliding(problem, model_fit.fitted.packed)
    return sliding is None or _read(sliding, held_out_of(sliding, model_fit), wave.wavenumber).gain > 0.0


def _rather_torques(problem: Problem, model_fit: ModelFit, wavenumber: float) -> bool:
    """Whether waves of a torque that stand out of what is left gain beside a reading's, and that not beside them."""
    fitted, policy = model_fit.fitted, problem.policy
    context = Context(problem, fitted, fitted.packed)
    lines = [order * context.angle for order in context.orders_in_residual(MOST_LINES)]
    if not lines:
        return False
    read, torques = _waves(problem, model_fit, wavenumber)[0], _over_place_at(problem, lines)
    both = [_alike_large(one) for one in (read, torques)]
    beside = with_columns(problem, fitted, np.hstack(both))
    of_torque, of_reading = (gain_and_z(with_columns(problem, fitted, one), beside) for one in both)
    gains = [gain >= policy.least_gain and policy.no_chance(gain, z) for gain, z in (of_torque, of_reading)]
    return gains == [True, False]


def _over_place_at(problem: Problem, wavenumbers: Sequence[float]) -> Floats:
    """Sine and cosine of a torque over the place of each wave, as the low-pass leaves them; shape (m, 2 · waves)."""
    angles = np.outer(wavenumbers, problem.data.position)
    waves = (wave for angle in angles for wave in (np.sin(angle), np.cos(angle)))
    return np.column_stack([smoothed(problem.data, wave) for wave in waves])


def _alike_large(columns: Floats) -> Floats:
    """Columns as large as each other: a fit of experiments held out knows of no sizes."""
    return np.asarray(columns / np.maximum(np.std(columns, axis=0), 1e-300))


def _bent(problem: Problem, error: Floats) -> Floats:
    """What sums over all samples of a wave along the motion, so that it is what the wave as a reading's error has in
    common with an error of shape (m,): through the low-pass, and differentiated twice; shape (n,).
    """
    data = problem.data
    spread = np.zeros(len(data.torque))
    spread[data.grid] = problem.training * error
    spread = np.convolve(spread, data.taps, mode="same")
    for stretch in data.stretches:
        spread[stretch.rows] = np.gradient(np.gradient(spread[stretch.rows]))
    return spread


def _lines_of_scales(problem: Problem) -> tuple[float, float]:
    """Wavenumbers [rad/motion unit] of a scale's periods: many over the travel and a turn, of many counts each."""
    data = problem.data
    least = 2.0 * math.pi * LEAST_PERIODS / problem.scales.travel
    if data.metadata.motion_unit == "rad":
        least = max(least, LEAST_LINES)
    return least, 2.0 * math.pi / max(
        COUNTS_A_PERIOD * data.resolution, FINEST_PERIOD * problem.scales.travel
    )


@dataclass(frozen=True, slots=True)
class _Read:
    """A reading's wave, what it gains on experiments held out and by what z, and what a torque over place does."""

    wave: ReadingWave
    gain: float
    z: float
    as_torque: float


def _read(problem: Problem, model_fit: ModelFit, wavenumber: float, beside: Floats | None = None) -> _Read:
    """The error of a reading that has so many radians per motion unit, by the slopes of what the model leaves.

    `beside`: columns of another wave, shape (m, k); the slopes are those beside it.
    """
    fitted = model_fit.fitted
    before = model_fit.unseen if beside is None else with_columns(problem, fitted, beside)
    known = np.empty((len(fitted.error), 0)) if beside is None else beside
    columns, waves = _waves(problem, model_fit, wavenumber)
    weight = problem.training
    table = np.hstack([fitted.jacobian, known, columns])
    sizes = np.maximum(np.sqrt(weight @ table**2 / weight.sum()), 1e-300)
    table, root = table / sizes, np.sqrt(weight)
    steps = np.linalg.lstsq(root[:, None] * table, root * fitted.error, rcond=None)[0]
    parts = -(steps / sizes)[-4:]
    gains = [
        gain_and_z(before, with_columns(problem, fitted, np.hstack([known, one])))
        for one in (table[:, -4:], waves)
    ]
    return _Read(ReadingWave(wavenumber, tuple(parts.tolist())), *gains[0], gains[1][0])


def _waves(problem: Problem, model_fit: ModelFit, wavenumber: float) -> tuple[Floats, Floats]:
    """Slopes of what a model leaves over a wave and its second harmonic, shape (m, 4) each: of the reading's error, for
    each part of it, and of a torque over place.
    """
    data, fitted = problem.data, model_fit.fitted
    size = 1e-3 / wavenumber
    plain = problem.raw(fitted.packed)
    columns = np.empty((len(plain), 4))
    for i, parts in enumerate(np.eye(4) * size):
        moved = read_without(data, ReadingWave(wavenumber, tuple(parts)))
        columns[:, i] = (residual(moved, fitted.packed, measured_motion(moved)) - plain) / size
    return columns, _over_place_at(problem, [wavenumber, 2.0 * wavenumber])


def louder_than_all(data: Prepared) -> bool:
    """Whether a torque that was taken out, and is not of the mains, is most of what the model left."""
    return any(one.share > LOUDER and not _of_the_mains(one.hertz) for one in data.clocked)


def comes_and_goes(line: TimeLine | None) -> bool:
    """Whether something follows the clock, and not as much in every experiment; the supply may."""
    return line is not None and not line.steady and not _of_the_mains(line.hertz)


def all_lines(data: Prepared, line: TimeLine | None) -> list[TimeLine]:
    """What follows the clock, taken out or not: each frequency once, as loud as it was."""
    lines = [TimeLine(one.hertz, one.share) for one in data.clocked] + ([] if line is None else [line])
    loudest = {round(one.hertz, 1): one for one in sorted(lines, key=lambda one: one.share)}
    return list(loudest.values())


def _of_the_mains(hertz: float) -> bool:
    return any(abs(hertz - max(round(hertz / base), 1) * base) <= AS_STEADY * hertz for base in MAINS)


def without_line(problem: Problem, error: Floats, line: TimeLine) -> Floats:
    """An error without such a disturbance, shape (m,)."""
    terms, rows = _terms(_clock(problem), line.hertz), problem.training > 0
    return np.asarray(error - terms @ np.linalg.lstsq(terms[rows], error[rows], rcond=None)[0])


def breathing_friction(problem: Problem, model_fit: ModelFit) -> TimeLine | None:
    """A friction level that rises and falls with the clock, by what repeats do not share; None where there is none.

    Repeats make the same motion at other moments: what they share drops out of their difference, and only a level that
    turns its sign with the velocity explains it then. A torque that follows the clock explains more without that sign.
    The share is that of what differs between repeats.
    """
    column = of_friction(problem, model_fit.fitted, model_fit.correction, TRAINING)
    if column is None:
        return None
    parts = _differences(problem, model_fit.fitted.error, column)
    if len(parts) < 3:
        return None
    seconds = float(max(part.times[-1].max() for part in parts) - min(part.times[0].min() for part in parts))
    every = np.arange(BREATHS / seconds, QUICKEST_BREATH, FINE_BREATH / seconds)
    if len(every) < 3:
        return None
    levels = _shares(parts, every)
    best, policy = int(np.argmax(levels)), problem.policy
    line = TimeLine(float(every[best]), float(levels[best]))
    if line.share <= max(policy.drift_part, policy.line_contrast * float(np.median(levels))):
        return None
    as_torque = float(_shares([part.plain() for part in parts], every).max())
    told = line.share > as_torque and _foretold(parts, line.hertz) > policy.drift_part
    return line if told else None


@dataclass(frozen=True, slots=True)
class Moment:
    """A force that was there once: from when to when [s], and its share of what differs between repeats.

    `torque` is what the motor gave more for it, `friction` how much higher that was [N m or N]; that which explains
    less is 0.
    """

    start: float
    end: float
    torque: float
    friction: float
    share: float


def acted_once(problem: Problem, model_fit: ModelFit) -> Moment | None:
    """The torque or friction that one repeat had for a while and another one of the same motion had not; None where
    what differs between repeats is no such thing.

    A jam, a hand, a cable that catches: it explains much of all that differs, most of that in its own stretch, and no
    other stretch has the like. It is looked for where the contact slides: before, each repeat has what the motion
    before it left there.
    """
    fitted = model_fit.fitted
    column = of_friction(problem, fitted, model_fit.correction, TRAINING)
    sliding = beyond_presliding(problem, fitted.packed)
    if column is None or sliding is None:
        return None
    scale = fitted.scales[[one.name for one in fitted.free].index("coulomb")]
    parts = _differences(sliding, fitted.error, column / scale)
    total = sum(float(part.error @ part.error) for part in parts)
    rows = sum(len(part.error) for part in parts)
    found = [(part, one) for part in parts for one in part.stretches(LONGEST * rows)]
    most = max((one.explained for _, one in found), default=0.0)
    if most <= 0.0:
        return None
    as_good = [(part, one) for part, one in found if one.explained >= AS_MUCH * most]
    part, best = min(as_good, key=lambda item: item[1].length)
    if best.explained < max(ONCE * total, LEVEL * best.energy):
        return None
    moment = part.moment(best, best.explained / total)
    like = [(one, of.moment(one, 0.0)) for of, one in found if one.explained > AGAIN * best.explained]
    if any(max(one.start - moment.end, moment.start - one.end) > max(LASTS) for _, one in like):
        return None
    whole = [moment, *(one for stretch, one in like if stretch.level >= AS_MUCH * best.level)]
    return replace(moment, start=min(one.start for one in whole), end=max(one.end for one in whole))


class _Stretch(NamedTuple):
    """Rows `start` to `stop` of a difference: its squares' sum, and what a torque and a friction level explain."""

    start: int
    stop: int
    energy: float
    explained: float

    @property
    def length(self) -> int:
        return self.stop - self.start

    @property
    def level(self) -> float:
        """Of the squares, what is explained."""
        return self.explained / max(self.energy, 1e-300)


@dataclass(frozen=True, slots=True)
class _Difference:
    """Last less first repeat of an experiment: error, times and levels of both, shape (2, k)."""

    errors: Floats
    times: Floats
    levels: Floats

    @property
    def error(self) -> Floats:
        """Shape (k,)."""
        return np.asarray(self.errors[1] - self.errors[0])

    def stretches(self, most: float) -> Iterator[_Stretch]:
        """Stretches of at most so many rows, one after the other by quarters of their length."""
        if len(self.error) < 2:
            return
        pace = float(np.median(np.diff(self.times[0])))
        level, error = self.levels.mean(axis=0), self.error
        products = [np.ones_like(level), level, level**2, error, level * error, error**2]
        sums = np.cumsum(np.hstack([np.zeros((6, 1)), np.array(products)]), axis=1)
        for seconds in LASTS:
            length = max(round(seconds / pace), 2)
            if length > min(most, LONGEST_PART * len(error)):
                return
            starts = np.arange(0, len(error) - length + 1, max(length // 4, 1))
            n, x, xx, y, xy, yy = sums[:, starts + length] - sums[:, starts]
            spread = np.maximum(xx - x * x / n, 0.0)
            along = np.where(
                spread > 1e-9 * np.maximum(xx, 1e-300),
                (xy - x * y / n) ** 2 / np.maximum(spread, 1e-300),
                0.0,
            )
            for start, energy, explained in zip(starts, yy, y * y / n + along, strict=True):
                yield _Stretch(int(start), int(start) + length, float(energy), float(explained))

    def moment(self, stretch: _Stretch, share: float) -> Moment:
        """What was there in a stretch, in the repeat that the model explains less."""
        rows = slice(stretch.start, stretch.stop)
        which = int(np.argmax((self.errors[:, rows] ** 2).sum(axis=1)))
        apart, level = (self.errors[which] - self.errors[1 - which])[rows], self.levels[which, rows]
        torque, against = float(apart.mean()), max(float(level @ level), 1e-300)
        friction = -float(level @ apart) / against  # more friction in a model leaves less
        if friction**2 * against >= torque**2 * len(apart):
            torque = 0.0
        else:
            friction = 0.0
        start, end = (float(one) for one in self.times[which, rows][[0, -1]])
        return Moment(start, end, torque, friction, share)

    def plain(self) -> _Difference:
        """The same for a torque that does not turn with the velocity."""
        return replace(self, levels=np.ones_like(self.levels))

    def terms(self, hertz: float) -> Floats:
        """What a level of that frequency makes, shape (k, 2)."""
        first, last = (
            _terms(t, hertz) * level[:, None] for t, level in zip(self.times, self.levels, strict=True)
        )
        return np.asarray(last - first)


def _differences(problem: Problem, error: Floats, column: Floats) -> list[_Difference]:
    clock, parts = _clock(problem), []
    for block in problem.data.blocks:
        if block.role != TRAINING or block.repeats < 2:
            continue
        ends = [0, -1]
        counts = (block.by_repeat(problem.training)[ends] > 0).all(axis=0)
        if counts.any():
            parts.append(_Difference(*(block.by_repeat(v)[ends][:, counts] for v in (error, clock, column))))
    return parts


def _shares(parts: Sequence[_Difference], every: Floats) -> Floats:
    """Of the differences, what a level of each frequency explains, shape (f,)."""
    error = np.concatenate([part.error for part in parts])
    total = max(float(error @ error), 1e-300)
    found = []
    for hertz in every:
        terms = np.concatenate([part.terms(float(hertz)) for part in parts])
        along = terms.T @ error
        found.append(float(along @ np.linalg.lstsq(terms.T @ terms, along, rcond=None)[0]) / total)
    return np.array(found)


def _foretold(parts: Sequence[_Difference], hertz: float) -> float:
    """Of the differences of each experiment, what the level found in the others explains."""
    before = after = 0.0
    for i, part in enumerate(parts):
        others = [one for k, one in enumerate(parts) if k != i]
        terms = np.concatenate([one.terms(hertz) for one in others])
        slope = np.linalg.lstsq(terms, np.concatenate([one.error for one in others]), rcond=None)[0]
        before += float(part.error @ part.error)
        after += float(np.sum((part.error - part.terms(hertz) @ slope) ** 2))
    return 1.0 - after / max(before, 1e-300)


def _period(data: Prepared) -> list[float]:
    """Rows after which a motion comes again that comes up from rest and goes back to it; none where it does not."""
    if data.repeated:
        return []
    ends = len(data.position) // AT_ENDS
    samples = period_of(data.position[ends : len(data.position) - ends])
    return [] if samples is None else [samples]


def _of_the_motion(hertz: float, period: float, seconds: float) -> bool:
    """Whether a line is a harmonic of a motion that repeats itself: nothing says then that time drives it."""
    return abs(hertz - round(hertz * period) / period) < 2.0 / seconds


def _over_place(problem: Problem, values: Floats, line: TimeLine) -> bool:
    """Whether a wave over position explains most of what a line over time does: the axis goes on at one speed.

    Or could: a motor that is caught by its cogging and let go makes no sine over the place, and is in step with the
    clock as long as it is never a period ahead of one speed, nor behind.
    """
    data, rows = problem.data, problem.training > 0
    place, clock = data.position[data.grid[rows]], _clock(problem)[rows]
    turns = line.hertz * float(np.ptp(clock)) / max(float(np.ptp(place)), 1e-300)
    speed, start = np.polyfit(clock, place, 1)
    behind, before = np.percentile(line.hertz * ((place - start) - speed * clock), IN_STEP)
    if before - behind < abs(float(speed)):
        return True
    cycles = turns + np.linspace(-4.0, 4.0, 81) / max(float(np.ptp(place)), 1e-300)
    return max(_share(place, values, float(one)) for one in cycles) > AS_WELL * line.share


def _clock(problem: Problem) -> Floats:
    """Time of each grid row [s], shape (m,)."""
    return np.asarray(problem.data.grid * problem.data.period, dtype=np.float64)


def _terms(time: Floats, hertz: float) -> Floats:
    angle = 2.0 * math.pi * hertz * time
    return np.asarray(np.column_stack([np.sin(angle), np.cos(angle)]), dtype=np.float64)


def _share(time: Floats, values: Floats, hertz: float) -> float:
    terms = _terms(time, hertz)
    slope = np.linalg.lstsq(terms, values, rcond=None)[0]
    return float(1.0 - np.sum((values - terms @ slope) ** 2) / max(float(np.sum(values**2)), 1e-300))


def _everywhere(problem: Problem, error: Floats, hertz: float) -> bool:
    """Whether amplitude and phase are about the same in nearly every experiment."""
    data = problem.data
    rows, clock = problem.training > 0, _clock(problem)
    whole = np.linalg.lstsq(_terms(clock[rows], hertz), error[rows], rcond=None)[0]
    alike = []
    for block in data.blocks:
        if block.role == TRAINING:
            own = np.arange(block.rows.start, block.rows.stop)
            found = np.linalg.lstsq(_terms(clock[own], hertz), error[own], rcond=None)[0]
            alike.append(float(np.linalg.norm(found - whole)) < 0.5 * float(np.linalg.norm(whole)))
    return float(np.mean(alike)) >= problem.policy.line_everywhere


def _in_step(problem: Problem, error: Floats, hertz: float) -> bool:
    """Whether the phase is the same wherever the line is, and that in three experiments at least.

    Each repeat of an experiment by itself: what a motion makes at this frequency begins with it, at any phase of a
    clock, and the repeats do not agree.
    """
    clock, parts = _clock(problem), []
    for block in problem.data.blocks:
        if block.role == TRAINING:
            for time, left in zip(block.by_repeat(clock), block.by_repeat(error), strict=True):
                slope = np.linalg.lstsq(_terms(time, hertz), left, rcond=None)[0]
                parts.append((block.name, len(time), complex(*slope)))
    phases = np.array([slope for _, _, slope in parts])
    powers = np.array([count for _, count, _ in parts]) * np.abs(phases) ** 2
    mean = np.sum(powers * phases / np.maximum(np.abs(phases), 1e-300))
    turned = phases * np.conj(mean)
    alike = turned.real > math.cos(ALIKE_PHASE) * np.abs(turned)
    loud = alike & (np.abs(phases) > 0.5 * np.sqrt(np.mean(np.abs(phases) ** 2)))
    experiments = {name for (name, _, _), there in zip(parts, loud, strict=True) if there}
    return bool(
        powers[alike].sum() >= problem.policy.line_everywhere * powers.sum() and len(experiments) >= 3
    )
