"""The disturbance of an axis, estimated from what the repeats of an experiment do not share.

The torque residual with the torque that the controller must have asked for, instead of the recorded one, holds
what acted on the axis and what the position sensor added: −d + J·n¨. The difference of the two torques is the
noise of the torque sensor. Spectra of the differences between repeats are matched by a white part, one
autoregression and position noise (non-negative least squares over bands for each of several time constants).
Quantiser and friction add to the differences; how much, a twin that is disturbed by the estimate tells, and the
match is made again. Chunks at speed decide: where the axis hardly moves the quantiser makes its motion chaotic.

Beside it: by how much repeats differ if nothing but the disturbance does it, and what they share by counts alone.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.estimation.alignment import behind_current_loop, followed_late
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.controller import asked
from autotune.estimation.controller_law import PositionController
from autotune.estimation.data import TRAINING, VETO, Prepared, until_sample
from autotune.estimation.disturbance import STILL, Disturbance, coloured_power, jitter_of
from autotune.estimation.least_squares import followed
from autotune.estimation.problem import Problem
from autotune.estimation.residual import (
    Simulated,
    clockless,
    compared_motion,
    raw_residual,
    residual,
    residuals_of_each,
    simulated_motions,
)
from autotune.estimation.twin import steps_of_twin
from autotune.estimation.twin_runs import (
    SEED,
    acted_late,
    moved_later,
    run_twin,
    run_twins,
    shaken,
)
from autotune.models import layout
from autotune.models.drive_model import BASE, Packed
from autotune.models.transmission import has_load
from autotune.signals.chunks import shared

CHUNK_SECONDS = 0.4
LEAST_CHUNKS = 6
FASTER = 0.7
"""Of the chunks, those that are never as slow as the others: they decide."""
LOUD = 4.0
"""Times the median power: such chunks are events, not the usual noise."""
BANDS = 8
HIGHEST = 0.9
"""Of the cut-off of the motion."""
LOWEST_ALONE = 0.3
"""Of the cut-off: below it a single recording's residual is the model's error."""
CORRELATIONS = (1.0, 1.5, 2.0, 3.0, 4.5, 6.5, 10.0, 14.0, 20.0, 30.0, 50.0, 100.0, 200.0)
"""Samples of a millisecond, or of the recording where these are longer: time constants that are tried."""
ROUNDS = 3
INDEPENDENT = 0.2
"""Independent values to a chunk and frequency: chunks overlap, windows taper, a median is less sharp than a mean, and
the twin is as rough as the measurement."""
OVERLAP = 1.5
"""Times the variance of independent chunks: those that overlap by half say less."""
SYSTEMATIC = 0.07
"""Relative error of a band's power that no averaging removes: what the twin is not."""
NOTHING = 1e-12
"""Of the largest band's power: below it a band has none, and it is rounding."""
WORTH_A_PART = 5.0
"""Fall of the misfit, in variances of a band, that another parameter must bring."""
Tried = tuple[tuple[tuple[int, ...], ...], tuple[tuple[int, ...], ...]]
ANY: Tried = ((0,), (0, 1)), ((2,), (1, 2), (0, 2), (0, 1, 2))
WITHOUT_POSITION: Tried = ((0,),), ((2,), (0, 2))
"""Parts that are tried together, without memory and with one: white, position, and coloured."""
QUIETEST = 0.1
"""Of the chunks, where rows are written late."""
CHAOTIC = 0.3
"""Of the measured power in the median band: what quantiser and friction make from which a spectrum is in doubt."""
PARTS_ALONE = (0.7, 0.5, 0.35, 0.25)
"""Of the level found in a recording without repeats, whose residual holds the model's error as well: what is tried."""
LEVELS = (4.0, 8.0, 16.0, 32.0, 64.0)
"""Parts of the level that would make all differences between repeats: what is tried then."""
BY_CHANCE = 0.98
"""Of what a twin leaves: less than that is no chance of its runs."""
UNEVEN = 2.5
"""Mean over median power of chunks, over what it is in the twin: no steady noise."""
TWINS_BY_ROW, ALIKE, LEAST_CERTAIN = 2, 30, 0.2
"""Twins that tell how quiet a row is; rows beside each other, about a seventh of a second, that are taken as alike; and
the least weight of a row."""
NUDGE, NUDGED = 0.01, 4
"""Relative change of base parameters by which twins are set apart, and how many of them: what a good fit is off by."""
LOUDNESS = (0.7, 0.78, 0.87, 0.96, 1.05, 1.15, 1.27, 1.4)
"""Times the estimated disturbance: by so much replicas are shaken, as its level is known to a factor of 1.4."""


@dataclass(frozen=True, slots=True)
class _Chunks:
    """Where spectra are taken: first samples of pairs of chunks, shape (k, 2); the same twice without repeats."""

    starts: NDArray[np.int64]
    length: int
    paired: bool

    def of(self, values: Floats) -> Floats:
        """Detrended values, or the differences of repeats with the variance of one, shape (k, length)."""
        inside = self.starts[:, :, None] + np.arange(self.length)
        table = values[inside]
        part = (table[:, 0] - table[:, 1]) / math.sqrt(2.0) if self.paired else table[:, 0]
        return np.asarray(scipy.signal.detrend(part, axis=1))

    def power(self, values: Floats) -> Floats:
        """Periodograms, white noise of variance σ² having σ² everywhere; shape (k, frequencies)."""
        window = np.hanning(self.length + 2)[1:-1]
        spectrum = np.fft.rfft(self.of(values) * window, axis=1)
        return np.asarray(np.abs(spectrum) ** 2 / float(window @ window))


def estimate_disturbance(problem: Problem, packed: Packed) -> Disturbance:
    """What shakes the axis beside its command; nothing without a controller, whose twin nobody shakes."""
    if problem.controller is None:
        return STILL
    chunks = _chunks(problem)
    if chunks is None:
        return STILL
    data = problem.data
    jitter = jitter_of(data.measured, [stretch.rows for stretch in data.stretches], data.period)
    heard = problem.runs.heard(data, problem.controller, asked_late)
    # where rows are late, what their positions would have asked for is no torque; the slowest chunks hold least of it
    share = QUIETEST if jitter > 0.0 else 0.5
    sensor = float(np.sqrt(np.quantile(np.var(chunks.of(heard), axis=1), share)))
    sooner = replace(problem, data=until_sample(data, int(chunks.starts.max()) + chunks.length))
    raw = raw_residual(sooner.data, packed, problem.moved)
    if jitter == 0.0:
        raw[1:] -= 0.5 * (heard[1:] + heard[:-1])
    matcher = _matcher(problem, packed, chunks)
    measured = chunks.power(raw)
    found, simulated = replace(STILL, jitter=jitter), measured
    own: list[Floats] = []
    uneven: list[Floats] = []
    for number in range(ROUNDS):
        again = _shaken(sooner, packed, replace(found, sensor=sensor), chunks, number)
        if again is None:
            break
        simulated = again[0]
        own.append(matcher.bands(again[1]) - matcher.of_position(found))
        uneven.append(matcher.scatter(again[1]))
        scatter = matcher.scatter(measured) + np.mean(uneven, axis=0) / len(uneven)
        known = matcher.bands(measured), np.mean(own, axis=0), len(chunks.starts), scatter
        found = replace(matcher.matched(*known), jitter=jitter)
    if chunks.paired and own and _chaotic(matcher.bands(measured), np.mean(own, axis=0)):
        found = level_of_least(problem, packed, (found, *_levels_of_all(problem, packed, found)))
    elif own and not chunks.paired:
        found = level_of_least(problem, packed, (found, *(found.louder(part) for part in PARTS_ALONE)))
    if chunks.paired and found.position > 0.0:
        quiet = replace(matcher.matched(*known, WITHOUT_POSITION), jitter=jitter)
        found = _unless_quiet(problem, packed, found, quiet)
    return replace(found, sensor=sensor, uneven=_unevenness(measured, simulated))


def asked_late(data: Prepared, law: PositionController) -> Floats:
    """What a law asks for, behind the current loop that the recorded torque was put behind, shape (n,)."""
    wanted = moved_later(data, asked(behind_current_loop(data, 0.0), law), acted_late(data, law))
    return followed_late(data, wanted, data.lag)


def _chaotic(measured: Floats, own: Floats) -> bool:
    """Whether quantiser and friction alone make about as much of the differences as is measured, in most bands."""
    return float(np.median(own / np.maximum(measured, 1e-300))) > CHAOTIC


def _levels_of_all(problem: Problem, packed: Packed, found: Disturbance) -> list[Disturbance]:
    """White disturbances of several levels, in parts of the one that would make all differences between repeats.

    Where repeats differ by chaos a spectrum says little of what causes it.
    """
    error = residual(problem.data, packed, problem.moved)
    whole = math.sqrt(problem.noise_variance(error, TRAINING) / float(np.sum(problem.data.taps**2)))
    return [replace(STILL, white=whole / parts, jitter=found.jitter) for parts in LEVELS]


def level_of_least(problem: Problem, packed: Packed, levels: Sequence[Disturbance]) -> Disturbance:
    """The disturbance with which the twin's bias leaves least: the first where nothing tells.

    How much friction and counts are averaged tells how much the axis is shaken: a twin that is shaken too much, or too
    little, leaves what comes again in every repeat.
    """
    return levels[int(np.argmin(_left(problem, packed, levels)))]


def _unless_quiet(problem: Problem, packed: Packed, found: Disturbance, quiet: Disturbance) -> Disturbance:
    """The disturbance with the encoder's noise that its spectrum tells, or without, where its twin clearly leaves less.

    What repeats differ by at the upper end of the band, as friction, counts or late rows make them, looks as that noise
    does; a twin that hears it in every tick is shaken by all that its loop makes of it far above the band.
    """
    heard, without = _left(problem, packed, (found, quiet))
    return quiet if without < BY_CHANCE * heard else found


def _left(problem: Problem, packed: Packed, levels: Sequence[Disturbance]) -> list[float]:
    """Mean square that twins under several disturbances leave of the training rows [(N m)²]; inf: unstable."""
    problem = problem.until_trained()
    error = problem.raw(packed)
    return [
        problem.mean_square(error - one.bias, TRAINING) if one.stable else math.inf
        for one in problem.corrections_under(levels, packed)
    ]


def _shaken(
    problem: Problem, packed: Packed, found: Disturbance, chunks: _Chunks, number: int
) -> tuple[Floats, Floats] | None:
    """Spectra of the twin's chunks, and what quantiser and friction have in them; None where it is unstable."""
    if problem.controller is None:
        return None
    random = np.random.default_rng([SEED, number])
    data = problem.data
    run = run_twin(data, packed, problem.controller, found, random, loops=problem.runs.loops)
    if not run.stable:
        return None
    if found.jitter > 0.0:  # the noise of the torque's sensor is in the measured residual then
        heard = found.sensor * np.random.default_rng([SEED, 9 + number]).standard_normal(len(run.torque))
        run = replace(run, torque=run.torque + heard)
    raw = raw_residual(data, packed, compared_motion(data, run))
    own = raw.copy()
    # what is compared has nothing of the torque that follows the clock, and of what shakes the twin it is left out too
    shaking = run.disturbance - clockless(data, np.zeros(len(run.disturbance)))
    own[1:] += 0.5 * (shaking[1:] + shaking[:-1])
    return chunks.power(raw), chunks.power(own)


def _chunks(problem: Problem) -> _Chunks | None:
    """Chunks of the faster half of the training data, of pairs of repeats where there are any."""
    data = problem.data
    length = max(32, round(CHUNK_SECONDS * data.pace / data.period))
    step = max(1, int(np.median(np.diff(data.grid[: max(50, len(data.grid) // 10)]))))
    starts: list[tuple[int, int]] = []
    slowest: list[float] = []
    for block in data.blocks:
        if block.role != TRAINING or (data.repeated and block.repeats < 2):
            continue
        table = block.by_repeat(data.grid)
        speed = np.abs(data.velocity[table[0]])
        for i in range(0, block.count, max(1, length // step // 2)):
            last = i + (length - 1) // step
            if last >= block.count or table[0, last] - table[0, i] > length:
                continue
            for one, other in (
                zip(table[:-1, i], table[1:, i], strict=True) if data.repeated else [(table[0, i],) * 2]
            ):
                starts.append((int(one), int(other)))
                slowest.append(float(speed[i : last + 1].min()))
    inside = [k for k, pair in enumerate(starts) if max(pair) + length <= len(data.time)]
    if len(inside) < LEAST_CHUNKS:
        return None
    order = sorted(inside, key=lambda k: -slowest[k])[: max(LEAST_CHUNKS, round(FASTER * len(inside)))]
    return _Chunks(np.array([starts[k] for k in order]), length, data.repeated)


@dataclass(frozen=True, slots=True)
class _Matcher:
    """Bands of frequencies, and what each part of a disturbance puts into them."""

    hertz: Floats
    edges: Floats
    period: float
    seen: Floats
    moved: Floats

    def bands(self, power: Floats) -> Floats:
        """Median over the frequencies of each band of the mean over the usual chunks."""
        mean = _usual(power).mean(axis=0)
        return self._by_band(mean)

    def _by_band(self, spectrum: Floats) -> Floats:
        parts = zip(self.edges[:-1], self.edges[1:], strict=True)
        return np.array([np.median(spectrum[(self.hertz >= a) & (self.hertz < b)]) for a, b in parts])

    def scatter(self, power: Floats) -> Floats:
        """Variance of a band's power as the mean over the usual chunks, by how much they differ."""
        usual = _usual(power)
        parts = zip(self.edges[:-1], self.edges[1:], strict=True)
        chunks = np.array([usual[:, (self.hertz >= a) & (self.hertz < b)].mean(axis=1) for a, b in parts])
        return np.asarray(OVERLAP * chunks.var(axis=1, ddof=1) / chunks.shape[1])

    def _columns(self, correlation: float) -> Floats:
        coloured = self.seen * coloured_power(self.hertz, correlation, self.period)
        return np.column_stack([self._by_band(c) for c in (self.seen, self.moved, coloured)])

    def of_position(self, found: Disturbance) -> Floats:
        """Power of the position noise by band."""
        return np.asarray(found.position**2 * self._by_band(self.moved))

    def _averaged(self, chunks: int) -> Floats:
        """How many independent values a band's power is the mean of, in the measurement and in the twin."""
        parts = zip(self.edges[:-1], self.edges[1:], strict=True)
        return np.array(
            [INDEPENDENT * chunks * np.sum((self.hertz >= a) & (self.hertz < b)) for a, b in parts]
        )

    def matched(
        self, measured: Floats, own: Floats, chunks: int, scatter: Floats, tried: Tried = ANY
    ) -> Disturbance:
        """The disturbance that adds to what quantiser and friction have in each band what was measured there.

        Of models with one part or more the plainest that comes near the best. `scatter`: variance of `measured` less
        `own`, by how much chunks differ: where friction and quantiser are chaotic it is far more than steady noise has.
        """
        larger = np.maximum(measured, own)
        if not np.any(larger > 0.0):  # repeats that are the same to the last digit
            return STILL
        larger = np.maximum(larger, NOTHING * np.max(larger))
        steady = larger**2 / self._averaged(chunks)
        weight = 1.0 / np.sqrt(np.maximum(steady, scatter) + (SYSTEMATIC * larger) ** 2)
        memories = [samples * max(self.period, 1e-3) for samples in CORRELATIONS]
        best, lowest = STILL, math.inf
        for memory in (0.0, *memories):
            columns = self._columns(memory)
            for parts in tried[memory > 0.0]:
                table = columns[:, list(parts)] * weight[:, None]
                size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
                powers, misfit = scipy.optimize.nnls(table / size, (measured - own) * weight)
                cost = misfit**2 + WORTH_A_PART * (len(parts) + (memory > 0.0))
                if cost < lowest:
                    levels = np.zeros(3)
                    levels[list(parts)] = np.sqrt(powers / size)
                    white, position, coloured = levels.tolist()
                    best, lowest = Disturbance(white, coloured, memory, position), cost
        return best


def _matcher(problem: Problem, packed: Packed, chunks: _Chunks) -> _Matcher:
    data = problem.data
    hertz = np.asarray(np.fft.rfftfreq(chunks.length, data.period), dtype=np.float64)
    top = min(HIGHEST * data.motion_cutoff, 0.42 / data.period)
    low = 1.6 * hertz[1] if chunks.paired else max(LOWEST_ALONE * data.cutoff, 1.6 * hertz[1])
    low = min(low, 0.3 * top)
    count = int(min(BANDS, max(2, np.sum((hertz >= low) & (hertz < top)) // 3)))
    edges = np.geomspace(low, top, count + 1)
    wide = [edges[0]]
    for edge in edges[1:]:
        if np.sum((hertz >= wide[-1]) & (hertz < edge)) >= 2:
            wide.append(edge)
    angle = 2.0 * np.pi * hertz * data.period
    passed = 1.0 / (1.0 + (hertz / data.motion_cutoff) ** 8)
    felt = float(packed.p[layout.INERTIA]) * (2.0 - 2.0 * np.cos(angle)) / data.period**2 * passed
    # where no loop answers any more, a disturbance is seen by the acceleration it makes: as far as its filter passes it
    seen = np.cos(0.5 * angle) ** 2 * passed**2
    return _Matcher(hertz, np.array(wide), data.period, seen, felt**2)


def _usual(power: Floats) -> Floats:
    """Chunks without the loud ones."""
    total = power[:, 1:].sum(axis=1)
    return np.asarray(power[total <= LOUD * np.median(total)])


def _unevenness(measured: Floats, simulated: Floats) -> float:
    """How much more the power of chunks differs than in the twin; 1 where that is chance."""
    ratios = []
    for power in (measured, simulated):
        total = power[:, 1:].sum(axis=1)
        ratios.append(float(np.mean(total) / max(float(np.median(total)), 1e-300)))
    uneven = ratios[0] / ratios[1]
    return uneven if uneven > UNEVEN else 1.0


def with_expected_noise(problem: Problem, packed: Packed) -> Problem:
    """The problem, knowing by how much repeats would differ if nothing but the disturbance did it.

    The twin is shaken as usual stretches are; where some are far louder the mean is as much more.
    """
    data, disturbance = problem.data, problem.disturbance
    if problem.controller is None or not data.repeated or not math.isfinite(disturbance.sensor):
        return replace(problem, expected=None)
    errors = _errors_of_twins(problem, packed, np.random.default_rng([SEED, 1]), 1)
    if not errors:
        return replace(problem, expected=None)
    expected = np.full(len(data.blocks), _heard(problem))
    for i, block in enumerate(data.blocks):
        if block.repeats > 1:
            table = problem.compared(block, errors[0])
            expected[i] += disturbance.uneven * float(table.var(axis=0, ddof=1).mean())
    return replace(problem, expected=expected)


def _errors_of_twins(
    problem: Problem, packed: Packed, random: np.random.Generator, count: int
) -> list[Floats]:
    """Residuals of so many runs of the twin, shape (m,) each, disturbed as the axis is; none where one is unstable."""
    controller = problem.controller
    if controller is None:
        return []
    alike = ((packed, controller, problem.disturbance) for _ in range(count))
    errors = _errors_of(problem, alike, random)
    stable = [one for one in errors if one is not None]
    return stable if len(stable) == len(errors) else []


def _heard(problem: Problem) -> float:
    """Variance that the torque sensor's noise has in what is compared [(N m)²]."""
    taps = np.convolve(problem.data.taps, [0.5, 0.5])
    return problem.disturbance.sensor**2 * float(np.sum(taps**2))


def by_certainty(problem: Problem, packed: Packed) -> Problem:
    """The problem with every row of an experiment weighted by how quiet the twin is there.

    Motion below the encoder's counts is chaotic, and rows written late err with the speed: a tenth of the rows then has
    most of the error that any model leaves, and drowns what the others tell. The twin says where; repeats would too,
    but they differ where friction remembers as well. What a model lacks is there too, and is no noise: so a row counts
    by the error of its twins and not by its square.
    """
    data = problem.data
    if problem.controller is None or not data.repeated or not math.isfinite(problem.disturbance.sensor):
        return problem
    errors = _errors_of_twins(problem, packed, np.random.default_rng([SEED, 7]), TWINS_BY_ROW)
    if not errors:
        return problem
    heard, certainty = _heard(problem), np.ones(len(data.grid))
    for block in data.blocks:
        if block.role not in (TRAINING, VETO) or block.repeats < 2:
            continue
        levels = np.mean([block.by_repeat(error).var(axis=0, ddof=1) for error in errors], axis=0)
        level = heard + scipy.ndimage.uniform_filter1d(levels, min(ALIKE, block.count), mode="nearest")
        known = np.clip(np.sqrt(np.median(level) / np.maximum(level, 1e-300)), LEAST_CERTAIN, 1.0)
        certainty[block.rows] = np.tile(known, block.repeats)
    data = replace(data, certainty=certainty)
    return replace(problem, data=data, weight=problem.weight * certainty)


def with_counts(problem: Problem, packed: Packed) -> Problem:
    """The problem, knowing what twins of this model share in their repeats, and not with each other.

    Their parameters are apart by what a good fit is off by. That is nothing where the encoder is fine; where it is
    coarse, or the axis sticks and slips, each twin has a course of its own that comes again in its repeats. Twins that
    swing by more than the axis did share no more than its part of that.
    """
    data = problem.data
    if problem.controller is None or not data.repeated or problem.two_masses(packed):
        return replace(problem, by_counts=None)
    random = np.random.default_rng([SEED, 2])
    law = problem.controller
    apart = (
        (_off_by_a_little(packed, random), _nudged(law, random), problem.disturbance) for _ in range(NUDGED)
    )
    errors = [one for one in _errors_of(problem, apart, random) if one is not None]
    if len(errors) < 2:
        return replace(problem, by_counts=None)
    pairs = [one - other for i, one in enumerate(errors) for other in errors[:i]]
    level = np.zeros((len(pairs), len(data.blocks)))
    for i, block in enumerate(data.blocks):
        if block.repeats > 1:
            level[:, i] = [shared(problem.compared(block, pair)).mean() for pair in pairs]
    noise = problem.noise_variance(residual(data, packed, problem.moved), TRAINING)
    swings = np.array([0.5 * problem.noise_variance(pair, TRAINING) for pair in pairs])
    return replace(problem, by_counts=level * np.minimum(noise / np.maximum(swings, 1e-300), 1.0)[:, None])


def null_errors(problem: Problem, root: ModelFit) -> list[Floats]:
    """Errors that this axis would leave if its model lacked nothing, of replicas by its law, shape (m,) each.

    Every replica is simulated with a disturbance and parameters as uncertain as they are, goes through the same chain
    and the same bias, and the base parameters are fitted to it, linearised. None without a law, or between two masses.
    """
    data, packed, law = problem.data, root.fitted.packed, problem.controller or problem.rough
    if law is None or not data.repeated or has_load(packed.on):
        return []
    disturbance = problem.disturbance
    if problem.controller is None:
        disturbance = estimate_disturbance(replace(problem, controller=law), packed)
    random = np.random.default_rng([SEED, 5])
    apart = (
        (_off_by_a_little(packed, random), _nudged(law, random), disturbance.louder(factor))
        for factor in LOUDNESS
    )
    errors = [one for one in _errors_of(problem, apart, random) if one is not None]
    return [
        followed(root.fitted.jacobian, error - root.correction.bias, problem.training) for error in errors
    ]


def _errors_of(
    problem: Problem,
    twins: Iterable[tuple[Packed, PositionController, Disturbance]],
    random: np.random.Generator,
) -> list[Floats | None]:
    """Residuals of a run of each of several twins, shape (m,); None of one that is unstable.

    Each is drawn after the one before it has been shaken, and those with the same law go side by side, and in the steps
    that each would go in: where friction and counts are chaotic, other steps are another run.
    """
    data, errors = problem.data, dict[int, Floats | None]()
    groups: dict[Hashable, list[tuple[int, Packed, PositionController, tuple[Floats, Floats]]]] = {}
    for number, (packed, law, disturbance) in enumerate(twins):
        if disturbance.jitter > 0.0:  # at what moments rows are written is drawn after the run
            run = run_twin(data, packed, law, disturbance, random, loops=problem.runs.loops)
            (errors[number],) = _errors_of_runs(data, [packed], [run])
        else:
            group = groups.setdefault((id(law), steps_of_twin(packed, data.period, law)), [])
            group.append((number, packed, law, shaken(data, disturbance, random)))
    for group in groups.values():
        models = [packed for _, packed, _, _ in group]
        runs = run_twins(data, models, group[0][2], [noise for *_, noise in group], problem.runs.loops)
        found = _errors_of_runs(data, models, runs)
        errors |= {number: error for (number, *_), error in zip(group, found, strict=True)}
    return [errors[number] for number in range(len(errors))]


def _errors_of_runs(
    data: Prepared, models: Sequence[Packed], runs: Sequence[Simulated]
) -> list[Floats | None]:
    """Residual of each run, without the torques that follow the clock; None of one that is unstable."""
    stable = [(packed, run) for packed, run in zip(models, runs, strict=True) if run.stable]
    moved = simulated_motions(data, [run for _, run in stable])
    motions = [replace(one, torque=clockless(data, one.torque)) for one in moved]
    found = iter(residuals_of_each(data, [packed for packed, _ in stable], motions))
    return [next(found) if run.stable else None for run in runs]


def _off_by_a_little(packed: Packed, random: np.random.Generator) -> Packed:
    """A model whose base parameters are off by what those of a good fit are."""
    p = packed.p.copy()
    p[: len(BASE)] *= 1.0 + NUDGE * random.standard_normal(len(BASE))
    return Packed(p, packed.on)


def _nudged(law: PositionController, random: np.random.Generator) -> PositionController:
    """A law with gains that a fit below the compared frequency may have found as well; an exact one as it is.

    One whose torque is what it asks for, too: no other gains would ask for it.
    """
    if not law.in_band or law.asked > 0.0:
        return law
    kp, kd, ki = (1.0 + NUDGE * random.standard_normal(3)) * (law.kp, law.kd, law.ki)
    return replace(law, kp=float(kp), kd=float(kd), ki=float(ki))
