"""Which law a drive has whose loop works many times from one sample to the next (`controller_law`).

What it makes of its set points is computed on ticks between the samples, below the frequency that models are compared
at; its velocity's filter, the delay of its set points and of its torque's answer, and how the torque was recorded are
searched for together with the gains.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from autotune.core.arrays import Floats
from autotune.estimation.controller_law import (
    MOMENT,
    TAKEN,
    LoopSamples,
    PositionController,
    answered,
    between_table,
    between_terms,
    fitted_whole,
    late_rows,
    position_terms,
    reference_terms,
    share_explained,
    taken_at,
)
from autotune.estimation.controller_search import (
    HARDLY_MORE,
    MOST_LATE,
    NEARLY_EXACT,
    PIECE_SECONDS,
    WORTH_DELAYS,
    first_look,
    how_late,
    in_band,
    lowest,
    searched_late,
)

TICK, LEAST_TICKS = 250e-6, 4
"""s, between what a drive's loop is computed at where it is identified, and how many to a sample at least."""
BETWEEN_RATES = tuple(100.0 * 1.7**i for i in range(9))
"""1/s, of the filter of its velocity."""
RATE_STEP, FINER_FILTER = math.log(1.7), 1.5
"""Between two of them, in the logarithm; and times the least share left that a finer one can make up for."""
FED = PositionController(velocity_feedforward=1.0)
"""Form of a law that feeds the rate of the reference forward by itself."""
BETWEEN = "The drive's loop works between the samples, and is simulated so."
FASTEST = 25.0
"""Time constants of that filter in a sample: beyond, nothing is left to filter."""
MOST_ANSWER, FINER, MOST_SET_POINTS = 6, 3, 2
"""Ticks of `TICK` by which an answer may be late, how much finer it is found at last, and samples by which set points
are late then."""
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
    return (between, *others) if no_more else (found, between, *others)


def smooth_between(samples: LoopSamples, law: PositionController) -> PositionController | None:
    """The same law of a drive that has set points with their rates on the way between them; None if it explains too
    little.

    A torque as at the samples tells next to nothing of what is between them: only a twin chooses between the two.
    """
    banded = _banded(samples)
    best = _best_rate(first_look(banded), replace(law, cubic=True, smooth=True))
    found = _fitted_between(banded, best, best.filter_rate(samples.period))
    return replace(found, in_band=True, why=law.why) if _tells(found, samples) else None


def answering_late(samples: LoopSamples, law: PositionController) -> tuple[PositionController, ...]:
    """Laws of a drive that works between the samples whose torque answers late; none if they explain too little.

    A loop takes a tick or two to be computed, and a current loop follows some tenths of a millisecond later: the torque
    that is recorded as at the samples is what the axis feels then. Without the delay another moment of recording is
    found in its place, and the loop of the twin is faster than that of the axis. Where counts are coarse the velocity's
    filter stands for a part of the delay: beside the law that explains most, the promptest that explains as much.
    """
    banded = _banded(samples)
    coarse = first_look(banded)
    ticks = _ticks(samples)
    delays = sorted({round(k * TICK / samples.period * ticks) / ticks for k in range(1, MOST_ANSWER + 1)})
    trials = list(_late_answers(coarse, _as_felt(law, ticks), BETWEEN_RATES, delays))
    best = max(trials, key=lambda trial: trial.explained)
    alike = [trial for trial in trials if 1.0 - trial.explained <= AS_MUCH * (1.0 - best.explained)]
    soonest = min(trial.answer_delay for trial in alike)
    prompt = max((one for one in alike if one.answer_delay == soonest), key=lambda trial: trial.explained)
    found = [_refined_answer(banded, coarse, one) for one in dict.fromkeys((best, prompt))]
    return tuple(_said(replace(one, ticks=ticks), samples) for one in found if _tells(one, samples))


def following_late(samples: LoopSamples, acted: Floats, law: PositionController) -> PositionController | None:
    """The law of the demand, as at the samples, and by how much the torque by its sensor follows late; None if neither
    explains enough.

    Args:
        acted: torque by its sensor, less the feedforward that was recorded, shape (n,).
    """
    banded = _banded(samples)
    coarse = first_look(banded)
    form = _as_felt(law, _ticks(samples))
    best = max(_late_answers(coarse, form, BETWEEN_RATES, [0.0]), key=lambda trial: trial.explained)
    found = _best_rate(banded, best)
    late, follows = _follows_by(banded, in_band(replace(samples, demand=acted)).demand)
    found = replace(found, answer_delay=late, explained=min(found.explained, follows), sensed=True)
    return _said(found, samples) if _tells(found, samples) else None


def _banded(samples: LoopSamples) -> LoopSamples:
    """The samples in which such laws are looked for."""
    return in_band(replace(samples, piece=PIECE_SECONDS))


def _ticks(samples: LoopSamples) -> int:
    """Ticks of a loop from one sample to the next."""
    return max(LEAST_TICKS, round(samples.period / TICK))


def _as_felt(law: PositionController, ticks: int) -> PositionController:
    """Form of a law whose torque is recorded as at the samples, on set points as those of `law`."""
    return replace(FED, ticks=ticks, cubic=law.cubic, smooth=True, taken=MOMENT)


def _tells(law: PositionController, samples: LoopSamples) -> bool:
    """Whether it explains enough to drive a twin, by gains that hold an axis."""
    return law.explained > samples.policy.controller_explains_in_band and law.kp > 0.0 and law.kd > 0.0


def _said(law: PositionController, samples: LoopSamples) -> PositionController:
    """The law, with what is to be said of it."""
    return replace(law, in_band=True, why=f"{how_late(samples.period)} {BETWEEN}")


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


def _refined_answer(
    banded: LoopSamples, coarse: LoopSamples, found: PositionController
) -> PositionController:
    """The law with filter and delay found more finely, beside where they are."""
    ticks, rate = FINER * found.ticks, found.filter_rate(coarse.period)
    rates = [rate * math.exp(part * RATE_STEP) for part in (-0.5, -0.25, 0.0, 0.25, 0.5)]
    near = [found.answer_delay + part / ticks for part in (-1, 0, 1)]
    best = max(_late_answers(coarse, _as_felt(found, ticks), rates, near), key=lambda trial: trial.explained)
    return _fitted_between(banded, best, best.filter_rate(coarse.period))


def _late_answers(
    samples: LoopSamples, form: PositionController, rates: Sequence[float], delays: Sequence[float]
) -> Iterator[PositionController]:
    """Laws of one form with these filters and delays of their answer, on set points late by whole samples."""
    for rate in rates:
        moved, wanted = position_terms(samples, rate, form.ticks), reference_terms(samples, form, rate)
        for delay in delays:
            one = replace(form, answer_delay=delay)
            seen, given = (answered(samples, terms, one) for terms in (moved, wanted))
            for late in range(MOST_SET_POINTS + 1):
                rows = np.array([late_rows(row, samples, late) for row in given])
                yield _with_gains(
                    samples, replace(one, reference_delay=late), rate, between_table(rows, seen)
                )


def _searched_between(samples: LoopSamples) -> tuple[PositionController, ...]:
    """The best law of a drive whose loop works between the samples, and those of a torque that is recorded otherwise.

    One that feeds the rate of its reference forward past its filter, as cascades do, where that leaves clearly less.
    """
    found = _best_between(samples, PositionController())
    if 1.0 - found[0].explained <= NEARLY_EXACT:
        return found
    fed = _best_between(samples, FED)
    return fed if 1.0 - fed[0].explained < WORTH_DELAYS * (1.0 - found[0].explained) else found


def _best_between(samples: LoopSamples, form: PositionController) -> tuple[PositionController, ...]:
    """The best law of a drive whose loop works between the samples, on columns below the compared frequency.

    There what it makes of its set points can be computed from the samples: u = kp·e + kd·λ/(s + λ)·(b·ṙ − ẏ) + ki∫e and
    what the reference adds. Set points are late by whole samples. Of laws that explain alike the one whose reference
    does least by itself is taken: a law with another delay makes up for it with the reference's derivatives.

    After it the best of each other way of recording a torque that explains as much: a mean over the last sample and a
    later set point are the same below that frequency, but for a twin they are not. What a loop makes of its set points
    from sample to sample is in a torque as at the samples, and not in a mean.
    """
    coarse = first_look(samples)
    start = replace(form, ticks=_ticks(samples))
    trials = [trial for rate in BETWEEN_RATES for trial in _between_trials(coarse, rate, start)]
    most = (1.0 - max(trial.explained for trial in trials)) * HARDLY_MORE
    near = [trial for trial in trials if 1.0 - trial.explained <= most]
    plain = min(near, key=lambda trial: abs(trial.position_feedforward) / max(abs(trial.ki), 1e-300))
    alike = [trial for trial in near if trial.reference_delay == plain.reference_delay]
    best = max(alike, key=lambda trial: trial.explained)
    enough = FINER_FILTER * most
    forms: dict[tuple[bool, str], PositionController] = {}
    for trial in sorted(trials, key=lambda trial: trial.explained):
        if trial.reference_delay == best.reference_delay and 1.0 - trial.explained <= enough:
            forms[trial.cubic, trial.taken] = trial
    refined = [_best_rate(coarse, form) for form in forms.values()]
    best = max(refined, key=lambda trial: trial.explained)
    found = [best, *_recorded_otherwise(coarse, trials, best, enough)]
    laws = [_fitted_between(samples, one, one.filter_rate(samples.period)) for one in found]
    least = AS_MUCH * (1.0 - laws[0].explained)
    return tuple(_said(law, samples) for law in laws if law is laws[0] or 1.0 - law.explained <= least)


def _recorded_otherwise(
    samples: LoopSamples, trials: Sequence[PositionController], best: PositionController, enough: float
) -> Iterator[PositionController]:
    """The best of the laws for each other way of recording a torque; `enough` is the largest share left of a trial."""
    for taken in TAKEN:
        ways = [one for one in trials if one.taken == taken and 1.0 - one.explained <= enough]
        if ways and taken != best.taken:
            yield _best_rate(samples, max(ways, key=lambda trial: trial.explained))


def _best_rate(samples: LoopSamples, form: PositionController) -> PositionController:
    """A law of this form with the filter that leaves least."""

    def law(logarithm: float) -> PositionController:
        return _fitted_between(samples, form, math.exp(logarithm))

    near = math.log(form.filter_rate(samples.period))
    bounds = near - RATE_STEP, near + RATE_STEP
    return law(lowest(lambda logarithm: 1.0 - law(logarithm).explained, bounds, 0.05))


def _between_trials(
    samples: LoopSamples, rate: float, start: PositionController
) -> Iterator[PositionController]:
    """Laws with one filter: all delays, both kinds of interpolation, all ways of recording a torque."""
    ticks = start.ticks
    moved = position_terms(samples, rate, ticks)
    for cubic in (False, True):
        wanted = reference_terms(samples, replace(start, cubic=cubic), rate)
        for taken in TAKEN:
            at_rows = [np.array([taken_at(row, ticks, taken) for row in terms]) for terms in (wanted, moved)]
            for late in range(MOST_LATE + 2):
                delayed_rows = np.array([late_rows(row, samples, late) for row in at_rows[0]])
                form = replace(start, reference_delay=late, cubic=cubic, taken=taken)
                yield _with_gains(samples, form, rate, between_table(delayed_rows, at_rows[1]))


def _fitted_between(samples: LoopSamples, form: PositionController, rate: float) -> PositionController:
    """A law of the same form with another filter, by least squares."""
    return _with_gains(samples, form, rate, between_terms(samples, form, rate))


def _with_gains(
    samples: LoopSamples, form: PositionController, rate: float, table: Floats
) -> PositionController:
    # through the filter or past it: with both, large gains of nearly equal terms make up for what neither is
    table[:, 3 if form.velocity_feedforward != 0.0 else 4] = 0.0
    fitted = fitted_whole(samples, table, min(1.0, rate * samples.period))
    return replace(
        fitted,
        reference_delay=form.reference_delay,
        derivative_filter=1.0 - math.exp(-min(rate * samples.period, FASTEST)),
        ticks=form.ticks,
        cubic=form.cubic,
        smooth=form.smooth,
        taken=form.taken,
        answer_delay=form.answer_delay,
        sensed=form.sensed,
    )
