"""Which law a drive has whose loop works many times from one sample to the next (`controller_law`).

What it makes of its set points is computed on ticks between the samples, below the frequency that models are compared
at; its velocity's filter, the delay of its set points and of its torque's answer, and how the torque was recorded are
searched for together with the gains.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from autotune.core.arrays import Floats
from autotune.estimation.controller_law import (
    EVE,
    MOMENT,
    TAKEN,
    LoopSamples,
    PositionController,
    answered,
    filtered_rate,
    fine_position,
    fine_reference,
    late_places,
    law_rows,
    reference_answered,
    share_explained,
    whole_law,
)
from autotune.estimation.controller_search import (
    HARDLY_MORE,
    MOST_LATE,
    NEARLY_EXACT,
    PIECE_SECONDS,
    SHORT_PIECE,
    WORTH_DELAYS,
    first_look,
    how_late,
    in_band,
    searched_late,
)
from autotune.estimation.data import STANDSTILL_COUNTS, STANDSTILL_SECONDS, compared_below, step_of
from autotune.estimation.disturbance import jitter_of
from autotune.signals.filters import low_pass
from autotune.signals.line_search import lowest
from autotune.signals.triangle import Triangle, reduced

TICK, LEAST_TICKS = 250e-6, 4
"""s, between what a drive's loop is computed at where it is identified, and how many to a sample at least."""
BETWEEN_RATES = tuple(100.0 * 1.7**i for i in range(9))
"""1/s, of the filter of its velocity."""
RATE_STEP, FINER_FILTER = math.log(1.7), 1.5
"""Between two of them, in the logarithm; and times the least share left that a finer one can make up for."""
FED = PositionController(velocity_feedforward=1.0)
"""Form of a law that feeds the rate of the reference forward by itself."""
SLOW_ROWS = (
    "Rows are written late: the controller was identified mostly by slow ones, which that hardly moves."
)
QUICK_ROWS = (
    "The encoder's counts are coarse: the controller was identified by rows in which they go by faster than torques "
    "are compared."
)
BETWEEN = "The drive's loop works between the samples, and is simulated so."
HELD = " It takes its set points as they come, and stays at each until the next."
HARDLY_COUNTS = 1e-6
"""Weight of a row that tells nothing beside others."""
FASTEST = 25.0
"""Time constants of that filter in a sample: beyond, nothing is left to filter."""
MOST_ANSWER, FINER, MOST_SET_POINTS = 6, 3, 2
"""Ticks of `TICK` by which an answer may be late, how much finer it is found at last, and samples by which set points
may be less late then."""
A_LINE, MOST_SUMMED = 0.25, 0.75
"""Rows by which a rate that is fed forward makes a held reference move at most: a line is half a row beside it; and by
which one that is summed does, where it is read at the row's end: a line is a row beside it."""
AS_MUCH = 1.1
"""Times the share that another law leaves: as much, within what counts and rounding make."""


def laws_between(
    samples: LoopSamples, found: PositionController, other: bool = False
) -> tuple[PositionController, ...]:
    """The law, or that of a drive that works between the samples where it leaves no more in the band; else both.

    What works from sample to sample would tell itself by an exact law; where both explain alike, it is the drive's.
    `other`: the samples hold another torque than the one the law was found in.
    """
    banded = _banded(samples)
    between, *others = _searched_between(banded)
    rate = found
    if other or (not found.in_band and found.explained > samples.policy.controller_explains):
        rate = searched_late(banded)
    if not _tells(between, samples):
        return (found,)
    others = [law for law in others if _tells(law, samples)]
    no_more = 1.0 - between.explained < AS_MUCH * (1.0 - rate.explained)
    return (between, *others, found) if no_more else (found, between, *others)


def laws_of_slow_rows(samples: LoopSamples) -> tuple[PositionController, ...]:
    """The law of a drive that works between the samples, where rows are written late; none if they explain too little.

    A reading that is late is off by speed times delay (`jitter_of`), which the law did not answer to: least squares
    take that for smaller gains. Slow rows are hardly off.
    """
    if jitter_of(samples.position, samples.stretches, samples.period) == 0.0:
        return ()
    slow = slow_rows(samples)
    laws = _searched_between(_banded(slow))
    return tuple(replace(law, slow=True) for law in laws if _tells(law, slow))


def slow_rows(samples: LoopSamples) -> LoopSamples:
    """The samples, which count by half from the usual speed on."""
    speed = _ways(in_band(samples))
    told = np.concatenate([np.abs(speed[rows]) for rows in samples.stretches])
    return replace(samples, weight=1.0 / (1.0 + (speed / max(float(np.median(told)), 1e-300)) ** 2))


def laws_of_quick_rows(samples: LoopSamples) -> tuple[PositionController, ...]:
    """The law of a drive that works between the samples, where counts are coarse; none if they explain too little.

    A reading is off by a part of a count, and by another one than what the loop read: by noise, or as counts come
    between two rows. While the axis hardly moves that stays for seconds; the law's sum goes with it, and least squares
    take it for smaller gains. Where counts go by faster than torques are compared it averages out.

    What is recorded at a moment of what the loop makes of counts is folded down, beside any law (`_folded`). A law that
    leaves no less in these rows than in all lacks another thing.
    """
    quick = quick_rows(samples)
    if quick.weight is None or np.all(quick.weight < 1.0):
        return ()
    found = _searched_between(_banded(quick))
    banded = _banded(samples)
    best = found[0]
    everywhere = 1.0 - _Between(banded).law(best, best.filter_rate(samples.period)).explained
    if 1.0 - best.explained > WORTH_DELAYS * everywhere:
        return ()
    return tuple(as_quick(law) for law in found if _tells(law, quick))


def quick_rows(samples: LoopSamples) -> LoopSamples:
    """The samples, of which only those count in which the axis moves by more counts than at a standstill, as it is
    told where torques are compared: there counts go by above the compared frequency."""
    banded = in_band(samples)
    speed = _ways(banded) / samples.period
    least = step_of(samples.position) * STANDSTILL_COUNTS / (2.0 * STANDSTILL_SECONDS)
    weight = np.where(np.abs(speed) > least, 1.0, HARDLY_COUNTS)
    return replace(samples, weight=weight, folded=_folded(samples, banded.demand))


def _ways(samples: LoopSamples) -> Floats:
    """Way of the position from each row to the next, shape (n,)."""
    ways = np.zeros(len(samples.position))
    for rows in samples.stretches:
        place = samples.position[rows]
        ways[rows] = np.diff(place, prepend=place[0])
    return ways


def as_quick(law: PositionController) -> PositionController:
    """A law found in quick rows, and said to be."""
    return replace(law, quick=True, why=law.why.replace(SLOW_ROWS, QUICK_ROWS))


def _folded(samples: LoopSamples, banded: Floats) -> float:
    """Share of the demand below the compared frequency, `banded`, that its noise is there, if it is white.

    As it is in the upper half of what the samples show: a torque that is read at a moment has there, and everywhere,
    what a loop between the samples makes beyond it; what is no such noise has fallen off.
    """
    power = 0.0
    rows = np.concatenate([np.arange(s.start, s.stop) for s in samples.stretches])
    for part in samples.stretches:
        own = samples.demand[part]
        power += float(np.sum((own - low_pass(own, 0.25 / samples.period, samples.period)) ** 2))
    density = power / len(rows) / (0.25 / samples.period)
    return density * compared_below(samples.period) / max(float(np.var(banded[rows])), 1e-300)


def smooth_between(samples: LoopSamples, law: PositionController) -> PositionController | None:
    """The same law of a drive that has set points with their rates on the way between them; None if it explains too
    little.

    A torque as at the samples tells next to nothing of what is between them: only a twin chooses between the two.
    """
    banded = _banded(samples)
    best = _best_rate(_Between(first_look(banded)), replace(law, cubic=True, smooth=True))
    found = _Between(banded).law(best, best.filter_rate(samples.period))
    return replace(found, in_band=True, why=law.why) if _tells(found, samples) else None


def holding(samples: LoopSamples, law: PositionController) -> tuple[PositionController, ...]:
    """Laws of a drive that takes its set points as they come and stays at each until the next, one for each way of
    recording a torque that explains as much as `law` does, with a reference that need not move between them.

    A reading at the row's moment is the same on lines, on cubics and on steps; what acts until the next is not: the
    position follows half a sample later, and a loop that answers to a step works it off within the row.
    """
    banded = _banded(samples)
    coarse, whole = _Between(first_look(banded)), _Between(banded)
    late = range(law.reference_delay + 2)
    # whose rate goes past the filter: through it a step is gone before it is read
    form = replace(FED, ticks=law.ticks, held=True)
    found = []
    for taken in (*TAKEN, EVE):
        trials = coarse.laws(replace(form, taken=taken), law.filter_rate(samples.period), late)
        best = _best_rate(coarse, max(trials, key=lambda trial: trial.explained))
        rate = best.filter_rate(samples.period)
        found.append(whole.law(_feeding_least(coarse.laws(best, rate, late), samples.period), rate))
    most = AS_MUCH * (1.0 - max(law.explained, *(one.explained for one in found)))
    steps = [one for law in found if (one := _as_fed(law, samples.period)) is not None]
    return tuple(_said(one, samples) for one in steps if _tells(one, samples) and 1.0 - one.explained <= most)


def _as_fed(law: PositionController, period: float) -> PositionController | None:
    """A law on held set points as it feeds their rate forward: not at all, or as much as it damps; None if neither.

    The sum of a cascade's velocity loop has a rate that comes with each set point as well: by it the reference goes on
    a line, for the part of the gain that sums it. Read before the next set point that part is at the line's end.
    """
    a_row = law.kp * period
    summed = law.velocity_feedforward - law.kd
    if law.taken == EVE and law.kd > 0.0 and A_LINE * a_row <= summed < MOST_SUMMED * a_row:
        return replace(law, rate_grows=summed / law.velocity_feedforward)
    return law if _fed_beside(law) < A_LINE * a_row else None


def _feeding_least(laws: Sequence[PositionController], period: float) -> PositionController:
    """Of laws that explain alike the one whose reference's rate and acceleration do least by themselves.

    They make up for another delay, and a drive that holds its set points has no use for the rate of its steps.
    """
    most = (1.0 - max(law.explained for law in laws)) * HARDLY_MORE
    near = [law for law in laws if 1.0 - law.explained <= most]
    return min(near, key=lambda law: _fed_beside(law) + abs(law.acceleration_feedforward) / period)


def _fed_beside(law: PositionController) -> float:
    """Rate of a held reference that is fed forward beside none of it, or all that is damped [N m s/rad]."""
    return min(abs(law.velocity_feedforward), abs(law.velocity_feedforward - law.kd))


def read_before_steps(samples: LoopSamples, law: PositionController) -> tuple[PositionController, ...]:
    """Laws of a drive that holds what it feeds forward of the acceleration from set point to set point, and whose
    torque is that of the moment before it takes the next one in; none where that is no other than `law`.

    What is read is then a set point old, and what the place of the reference adds is not: as a law of a torque as at
    the samples it looks as one whose set points come a sample later. Half a step of the feedforward is between what the
    mean of two readings shows and what acts. Beside it the law of a loop that is computed once in a tick: what is
    read at its end is a tick old then, what acts half of one in the mean. The columns do not tell that age from the
    filter, whose time is as much shorter.
    """
    banded = _banded(samples)
    coarse, whole = _Between(first_look(banded)), _Between(banded)
    late = law.reference_delay
    form = replace(_as_felt(law, law.ticks), smooth=False, taken=EVE, stepped=True)
    trials = coarse.laws(form, law.filter_rate(samples.period), range(max(late - 1, 0), late + 1))
    best = _best_rate(coarse, max(trials, key=lambda trial: trial.explained))
    filtered = 1.0 / best.filter_rate(samples.period)
    prompt = whole.law(best, 1.0 / filtered)
    shown = [prompt.held_until_read(banded.reference[rows], samples.period) for rows in banded.stretches]
    left = (1.0 - prompt.explained) * float(np.var(banded.demand))
    if not _tells(prompt, samples) or float(np.mean(np.concatenate(shown) ** 2)) <= (AS_MUCH - 1.0) * left:
        return ()
    old = replace(best, answer_delay=0.5 * TICK / samples.period)
    younger = whole.law(old, 1.0 / max(filtered - 0.5 * TICK, samples.period / FASTEST))
    found = prompt, replace(younger, answer_delay=0.0)
    return tuple(_said(one, samples) for one in found if _tells(one, samples))


def answering_late(samples: LoopSamples, law: PositionController) -> tuple[PositionController, ...]:
    """Laws of a drive that works between the samples whose torque answers late; none if they explain too little.

    A loop takes a tick or two to be computed, and a current loop follows some tenths of a millisecond later: the torque
    that is recorded as at the samples is what the axis feels then. Without the delay another moment of recording is
    found in its place, and the loop of the twin is faster than that of the axis. Where counts are coarse the velocity's
    filter stands for a part of the delay: beside the law that explains most, the promptest that explains as much.
    """
    banded = _banded(samples)
    coarse = _Between(first_look(banded))
    ticks = _ticks(samples)
    delays = sorted({round(k * TICK / samples.period * ticks) / ticks for k in range(1, MOST_ANSWER + 1)})
    trials = list(_late_answers(coarse, _as_felt(law, ticks), BETWEEN_RATES, delays))
    best = max(trials, key=lambda trial: trial.explained)
    alike = [trial for trial in trials if 1.0 - trial.explained <= AS_MUCH * (1.0 - best.explained)]
    soonest = min(trial.answer_delay for trial in alike)
    prompt = max((one for one in alike if one.answer_delay == soonest), key=lambda trial: trial.explained)
    whole = _Between(banded)
    found = [_refined_answer(whole, coarse, one) for one in dict.fromkeys((best, prompt))]
    return tuple(_said(one.on_ticks(ticks, samples.period), samples) for one in found if _tells(one, samples))


def following_late(samples: LoopSamples, acted: Floats, law: PositionController) -> PositionController | None:
    """The law of the demand, as at the samples, and by how much the torque by its sensor follows late; None if neither
    explains enough.

    Args:
        acted: torque by its sensor, less the feedforward that was recorded, shape (n,).
    """
    banded = _banded(samples)
    coarse = _Between(first_look(banded))
    form = _as_felt(law, _ticks(samples))
    best = max(_late_answers(coarse, form, BETWEEN_RATES, [0.0]), key=lambda trial: trial.explained)
    best = _best_rate(coarse, best)
    found = _Between(banded).law(best, best.filter_rate(samples.period))
    late, follows = _follows_by(banded, in_band(replace(samples, demand=acted)).demand)
    found = replace(found, answer_delay=late, explained=min(found.explained, follows), sensed=True)
    return _said(found, samples) if _tells(found, samples) else None


def _banded(samples: LoopSamples) -> LoopSamples:
    """The samples in which such laws are looked for."""
    late = samples.weight is not None
    return in_band(replace(samples, piece=SHORT_PIECE if late else PIECE_SECONDS))


def _ticks(samples: LoopSamples) -> int:
    """Ticks of a loop from one sample to the next."""
    return max(LEAST_TICKS, round(samples.period / TICK))


def _as_felt(law: PositionController, ticks: int) -> PositionController:
    """Form of a law whose torque is recorded as at the samples, on set points as those of `law`, and as late."""
    form = FED if law.velocity_feedforward != 0.0 else PositionController()
    late = law.reference_delay
    return replace(form, ticks=ticks, cubic=law.cubic, smooth=True, taken=MOMENT, reference_delay=late)


def _tells(law: PositionController, samples: LoopSamples) -> bool:
    """Whether it explains enough to drive a twin, by gains that hold an axis.

    Where rows are written late, or counts are coarse, the rest is theirs: enough is what says that the torque is a
    controller's answer, beside what is folded into it.
    """
    policy = samples.policy
    least = policy.controller_explains_in_band if samples.weight is None else policy.answer_explains
    return law.explained > least - samples.folded and law.kp > 0.0 and law.kd > 0.0


def _said(law: PositionController, samples: LoopSamples) -> PositionController:
    """The law, with what is to be said of it."""
    rows = "" if samples.weight is None else SLOW_ROWS
    late = how_late(samples.period, law.reference_delay, law.position_delay)
    said = " ".join(text for text in (rows, late, BETWEEN) if text)
    return replace(law, in_band=True, why=f"{said}{HELD * law.held}")


def _follows_by(samples: LoopSamples, acted: Floats) -> tuple[float, float]:
    """Samples by which a torque follows the demand, both below the compared frequency, and the share it follows."""
    at = np.arange(len(acted), dtype=np.float64)
    inside = np.zeros(len(acted), dtype=np.bool_)
    for rows in samples.stretches:
        inside[rows] = True
        inside[rows.start : rows.start + MOST_ANSWER] = False

    def left(late: float) -> float:
        shown = np.interp(at - late, at, samples.demand)[inside]
        table = np.column_stack([shown, np.ones(len(shown))])
        rest = acted[inside] - table @ np.linalg.lstsq(table, acted[inside], rcond=None)[0]
        return 1.0 - share_explained(rest, acted[inside])

    most = MOST_ANSWER * TICK / samples.period
    late = lowest(left, (0.0, most), 1e-3)
    return late, 1.0 - left(late)


def _refined_answer(whole: _Between, coarse: _Between, found: PositionController) -> PositionController:
    """The law with filter and delay found more finely, beside where they are."""
    ticks, rate = FINER * found.ticks, found.filter_rate(coarse.samples.period)
    rates = [rate * math.exp(part * RATE_STEP) for part in (-0.5, -0.25, 0.0, 0.25, 0.5)]
    near = [found.answer_delay + part / ticks for part in (-1, 0, 1)]
    best = max(_late_answers(coarse, _as_felt(found, ticks), rates, near), key=lambda trial: trial.explained)
    return whole.law(best, best.filter_rate(coarse.samples.period))


def _late_answers(
    samples: _Between, form: PositionController, rates: Sequence[float], delays: Sequence[float]
) -> Iterator[PositionController]:
    """Laws of one form with these filters and delays of their answer, on set points late by whole samples.

    A part of the form's own delay of the set points may be the answer's.
    """
    most = max(form.reference_delay, MOST_SET_POINTS)
    late = range(most - MOST_SET_POINTS, most + 1)
    for rate in rates:
        for delay in delays:
            yield from samples.laws(replace(form, answer_delay=delay), rate, late)


def _searched_between(samples: LoopSamples) -> tuple[PositionController, ...]:
    """The best law of a drive whose loop works between the samples, and those of a torque that is recorded otherwise.

    One that feeds the rate of its reference forward past its filter, as cascades do, where that leaves clearly less.
    """
    coarse = _Between(first_look(samples))
    trials = _between_trials(coarse, _ticks(samples), (PositionController(), FED))
    found = _best_between(samples, coarse, trials[0])
    left = 1.0 - found[0].explained
    least = (1.0 - max(trial.explained for trial in trials[1])) / FINER_FILTER**2
    if left <= NEARLY_EXACT or least >= WORTH_DELAYS * left:
        return found
    fed = _best_between(samples, coarse, trials[1])
    return fed if 1.0 - fed[0].explained < WORTH_DELAYS * left else found


def _best_between(
    samples: LoopSamples, coarse: _Between, trials: Sequence[PositionController]
) -> tuple[PositionController, ...]:
    """The best law of a drive whose loop works between the samples, on columns below the compared frequency.

    There what it makes of its set points can be computed from the samples: u = kp·e + kd·λ/(s + λ)·(b·ṙ − ẏ) + ki∫e and
    what the reference adds. Set points are late by whole samples. Of laws that explain alike the one whose reference
    does least by itself is taken: a law with another delay makes up for it with the reference's derivatives.

    After it the same of each other way of recording a torque that explains as much: a mean over the last sample and a
    later set point are the same below that frequency, but for a twin they are not. What a loop makes of its set points
    from sample to sample is in a torque as at the samples, and not in a mean. And the best with its set points on the
    other curve between the samples, which most columns do not tell either.

    Filters are found before delays and curves are told: between rough ones the true one leaves more than another does.
    """
    enough = (1.0 - max(trial.explained for trial in trials)) * HARDLY_MORE * FINER_FILTER
    forms: dict[tuple[str, bool, int], PositionController] = {}
    for trial in sorted(trials, key=lambda trial: trial.explained):
        if 1.0 - trial.explained <= enough:
            forms[trial.taken, trial.cubic, trial.reference_delay] = trial
    refined = [_best_rate(coarse, form) for form in forms.values()]
    best = _plainest(refined, samples.period)
    ways = [[one for one in refined if one.taken == taken] for taken in TAKEN if taken != best.taken]
    ways.append([one for one in refined if one.taken == best.taken and one.cubic != best.cubic])
    found = [best, *(_plainest(way, samples.period) for way in ways if way)]
    whole = _Between(samples)
    laws = [whole.law(one, one.filter_rate(samples.period)) for one in found]
    least = AS_MUCH * (1.0 - laws[0].explained)
    return tuple(_said(law, samples) for law in laws if law is laws[0] or 1.0 - law.explained <= least)


def _off_by(law: PositionController, period: float) -> float:
    """How much later or sooner than the law's delays say the reference must act, at least [s].

    A reference that is sooner by δ gives terms of its own: ki·δ of its place, and of its acceleration kd·b·δ and what
    an unfiltered rate has beside a filtered one, kp·δ/λ. A cascade that feeds forward less than the whole rate has
    terms of the place besides, and a drive that feeds the acceleration forward has those: either may be so. Less than
    none of the rate is never fed forward, but found where the reference is later than the law says: kp·δ.
    """
    by_place = abs(law.position_feedforward) / max(abs(law.ki), 1e-300)
    fed, filtered = law.kd * law.reference_rate + law.velocity_feedforward, law.kp / law.filter_rate(period)
    by_bend = abs(law.acceleration_feedforward) / max(abs(fed) + abs(filtered), 1e-300)
    return min(by_place, max(by_bend, -fed / max(abs(law.kp), 1e-300)))


def _plainest(laws: Sequence[PositionController], period: float) -> PositionController:
    """Of laws that explain as much as the best of them the best with the delay for which it is least off."""
    most = (1.0 - max(law.explained for law in laws)) * HARDLY_MORE
    near = [law for law in laws if 1.0 - law.explained <= most]
    plain = min(near, key=lambda law: _off_by(law, period))
    alike = [law for law in near if law.reference_delay == plain.reference_delay]
    return max(alike, key=lambda law: law.explained)


def _best_rate(samples: _Between, form: PositionController) -> PositionController:
    """A law of this form with the filter that leaves least."""

    def law(logarithm: float) -> PositionController:
        return samples.law(form, math.exp(logarithm))

    near = math.log(form.filter_rate(samples.samples.period))
    bounds = near - RATE_STEP, near + RATE_STEP
    return law(lowest(lambda logarithm: 1.0 - law(logarithm).explained, bounds, 0.05))


def _between_trials(
    samples: _Between, ticks: int, forms: Sequence[PositionController]
) -> list[list[PositionController]]:
    """For each of several forms laws of all filters and delays, both interpolations, all ways of recording a torque."""
    trials: list[list[PositionController]] = [[] for _ in forms]
    for rate, cubic, taken in itertools.product(BETWEEN_RATES, (False, True), TAKEN):
        for form, laws in zip(forms, trials, strict=True):
            one = replace(form, ticks=ticks, cubic=cubic, taken=taken)
            laws += samples.laws(one, rate, range(MOST_LATE + 2))
    return trials


class _Between:
    """Samples in which laws that work between them are looked for, and what has been computed there.

    What lies between the samples is the same for every filter, and the triangle of one filter for every delay of the
    set points and every gain: a search asks for hundreds of laws, and a dozen of them differ in nothing else.
    """

    def __init__(self, samples: LoopSamples) -> None:
        self.samples = samples
        self._fine: dict[tuple[object, ...], Floats] = {}
        self._recorded: dict[tuple[object, ...], Floats] = {}
        self._last: tuple[tuple[object, ...], Triangle] | None = None
        self._rates: dict[tuple[object, ...], Floats] = {}

    def law(self, form: PositionController, rate: float) -> PositionController:
        """The law of this form, delay of its set points included, with a filter at `rate` [1/s]."""
        return self.laws(form, rate, [form.reference_delay])[0]

    def laws(self, form: PositionController, rate: float, delays: Sequence[int]) -> list[PositionController]:
        """Laws of this form with a filter, on set points late by these samples."""
        triangle = self._triangle(form, rate, delays)
        smoothing = min(1.0, rate * self.samples.period)
        found = []
        for place, delay in enumerate(delays):
            fitted = triangle.fitted(_mixing(place, len(delays), form.velocity_feedforward != 0.0))
            found.append(
                replace(
                    whole_law(fitted, smoothing),
                    reference_delay=delay,
                    derivative_filter=1.0 - math.exp(-min(rate * self.samples.period, FASTEST)),
                    ticks=form.ticks,
                    cubic=form.cubic,
                    smooth=form.smooth,
                    held=form.held,
                    taken=form.taken,
                    answer_delay=form.answer_delay,
                    stepped=form.stepped,
                    sensed=form.sensed,
                )
            )
        return found

    def _triangle(self, form: PositionController, rate: float, delays: Sequence[int]) -> Triangle:
        """Of position, its filtered rate, and for every delay error, its sum, filtered rate, rate and bend of r."""
        shape = form.ticks, form.cubic, form.smooth, form.held, form.taken, form.answer_delay, form.stepped
        key = *shape, rate, tuple(delays)
        if self._last is not None and self._last[0] == key:
            return self._last[1]
        samples = self.samples
        chosen, run = law_rows(samples, min(1.0, rate * samples.period))
        moved, wanted = self._as_recorded(form, False), self._as_recorded(form, True)
        filtered = [self._filtered(form, rate, wants) for wants in (False, True)]
        here = moved[:, chosen]
        columns = [here[0], filtered[0][chosen]]
        for delay in delays:
            at = late_places(samples, chosen, delay)
            place, summed, bend, speed = wanted[:, at]
            columns += [place - here[0], summed - here[1], filtered[1][at], speed, bend]
        triangle = reduced(columns, samples.demand[chosen], run, samples.weight_of(chosen))
        self._last = key, triangle
        return triangle

    def _between(self, form: PositionController, wants: bool) -> Floats:
        """`fine_reference` or `fine_position`."""
        key = (form.ticks, form.cubic, form.smooth, form.held) if wants else (form.ticks,)
        if key not in self._fine:
            self._fine = {known: fine for known, fine in self._fine.items() if known[0] == form.ticks}
            now = replace(form, reference_delay=0)
            self._fine[key] = (
                fine_reference(self.samples, now) if wants else fine_position(self.samples, form.ticks)
            )
        return self._fine[key]

    def _as_recorded(self, form: PositionController, wants: bool) -> Floats:
        """The same as the torque that answers to it is recorded."""
        shape = (form.cubic, form.smooth, form.stepped) if wants else ()
        key = wants, form.ticks, form.taken, form.answer_delay, form.held, *shape
        if key not in self._recorded:
            as_recorded = reference_answered if wants else answered
            self._recorded[key] = as_recorded(self.samples, self._between(form, wants), form)
        return self._recorded[key]

    def _filtered(self, form: PositionController, rate: float, wants: bool) -> Floats:
        """Filtered rate of reference or position, as the torque that answers to it is recorded, shape (n,)."""
        shape = (form.cubic, form.held) if wants else ()
        key = rate, wants, form.ticks, *shape
        if key not in self._rates:
            self._rates = {known: fine for known, fine in self._rates.items() if known[0] == rate}
            fine = self._between(form, wants)[0]
            self._rates[key] = filtered_rate(self.samples, fine, form.ticks, rate)
        return np.asarray(answered(self.samples, self._rates[key][None], form)[0])


def _mixing(place: int, count: int, past: bool) -> Floats:
    """Terms as in `law_terms` as mixtures of the columns of a triangle, shape (2 + 5·count, 7).

    The reference's rate goes through the filter or past it: with both, large gains of nearly equal terms make up for
    what neither is.
    """
    mixing = np.zeros((2 + 5 * count, 7))
    error, summed, filtered, speed, bend = range(2 + 5 * place, 7 + 5 * place)
    mixing[error, 0] = mixing[summed, 2] = mixing[bend, 6] = 1.0
    mixing[1, 1] = -1.0
    mixing[speed if past else filtered, 4 if past else 3] = 1.0
    mixing[0, 5] = mixing[error, 5] = 1.0
    return mixing
