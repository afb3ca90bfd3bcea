"""Which law a position controller has: the search over filters, delays and forms (`controller_law`).

Least squares in a search over the derivative filter find a PID. Where that explains too little, reference and position
may come late by whole samples, the torque may be smeared by what recorded it, or the drive's loop works many times
from one sample to the next.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import scipy

from autotune.core.arrays import Floats, Integers
from autotune.estimation.controller_law import (
    MOMENT,
    SHORTEST_STRETCH,
    TAKEN,
    LoopSamples,
    PositionController,
    answered,
    between_table,
    between_terms,
    fitted_pid,
    fitted_whole,
    late_rows,
    late_samples,
    law_terms,
    position_terms,
    reference_terms,
    share_explained,
    smeared_samples,
    taken_at,
)
from autotune.estimation.data import compared_below, step_of
from autotune.estimation.disturbance import in_time
from autotune.signals.filters import low_pass

PIECE_SECONDS = 3.0
"""Of a run that shares a constant: a sum that a drive makes between the samples wanders away from theirs."""
ROUGH_ROWS = 8_000
"""Of a first look over delays."""
MOST_LATE = 4
"""Samples of dead time, and of a torque that was recorded a sample late; a drive that interpolates is one later with
its reference."""
LOOKS, LOOK_SECONDS = 8, 4.0
"""Pieces of the data for a first look over delays."""
MOST_SMEARED, MOST_TRIED = 0.95, 40
EXACT = 1e-6
"""Share of the demand left that rounding explains: nothing is left for another law then."""
NEARLY_EXACT, WORTH_DELAYS = 1e-5, 0.5
"""Share of the demand left from which laws with delays are looked for, and of what is left, to be taken."""
HARDLY_MORE = 1.01
"""Times the share left by a late law with all terms of the reference: a plainer one that leaves no more is taken."""
WEIGHED, PROMPT = 30, 0.05
"""Rounds of a fit that rows which are late shall not lead, and of all rows those that are not, at least."""
SAME_DEMAND = 1e-6
"""Of what a demand changes by: less is no chance."""
ROWS_LATE = "Rows are written late: the controller was identified by those that are not."
IN_BAND = "It was found below {:.0f} Hz: what the drive does between the samples is left out."
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
_ROUGH_FILTERS = (0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0)
_FILTERS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)


def law_from_data(samples: LoopSamples) -> PositionController:
    """The law that explains the demand best; its source is `none` where it explains too little to drive a twin."""
    found = _searched(samples, cascaded=True)
    if 1.0 - found.explained > EXACT:
        other = _searched(samples, cascaded=False)
        found = other if plainly_better(samples, other, found) else found
    if 1.0 - found.explained > NEARLY_EXACT:
        prompt = _of_prompt_rows(samples)
        if prompt is not None:
            return prompt
        late = _searched_late(samples)
        if 1.0 - late.explained < WORTH_DELAYS * (1.0 - found.explained):
            found = late
        plain = _searched_smeared(samples, found)
        enough = HARDLY_MORE if found.reference_delay or found.position_delay else WORTH_DELAYS
        if 1.0 - plain.explained < enough * (1.0 - found.explained):
            found = plain
    wandering = replace(samples, piece=PIECE_SECONDS)
    if found.explained <= samples.policy.controller_explains:
        late = _searched_late(wandering)
        found = late if late.explained > found.explained else found
    if found.explained > samples.policy.controller_explains and found.kp > 0.0:
        return found
    banded = _searched_late(_in_band(wandering))
    if banded.explained > samples.policy.controller_explains_in_band and banded.kp > 0.0:
        return replace(
            banded, why=f"{banded.why} {IN_BAND.format(compared_below(samples.period))}", in_band=True
        )
    return replace(found, source="none")


def laws_between(
    samples: LoopSamples, found: PositionController, other: bool = False
) -> tuple[PositionController, ...]:
    """The law, or that of a drive that works between the samples where it leaves no more in the band; else both.

    What works from sample to sample would tell itself by an exact law; where both explain alike, it is the drive's.
    `other`: the samples hold another torque than the one the law was found in.
    """
    banded = _in_band(replace(samples, piece=PIECE_SECONDS))
    between = _searched_between(banded)
    rate = found
    if other or (not found.in_band and found.explained > samples.policy.controller_explains):
        rate = _searched_late(banded)
    enough = between.explained > samples.policy.controller_explains_in_band
    if not (enough and between.kp > 0.0 and between.kd > 0.0):
        return (found,)
    no_more = 1.0 - between.explained < AS_MUCH * (1.0 - rate.explained)
    return (between,) if no_more else (found, between)


def smooth_between(samples: LoopSamples, law: PositionController) -> PositionController | None:
    """The same law of a drive that has set points with their rates on the way between them; None if it explains too
    little.

    A torque as at the samples tells next to nothing of what is between them: only a twin chooses between the two.
    """
    banded = _in_band(replace(samples, piece=PIECE_SECONDS))
    best = _best_rate(_first_look(banded), replace(law, cubic=True, smooth=True))
    found = _fitted_between(banded, best, _rate_of(best, samples.period))
    enough = found.explained > samples.policy.controller_explains_in_band
    return replace(found, in_band=True, why=law.why) if enough and found.kp > 0.0 and found.kd > 0.0 else None


def answering_late(samples: LoopSamples, law: PositionController) -> tuple[PositionController, ...]:
    """Laws of a drive that works between the samples whose torque answers late; none if they explain too little.

    A loop takes a tick or two to be computed, and a current loop follows some tenths of a millisecond later: the torque
    that is recorded as at the samples is what the axis feels then. Without the delay another moment of recording is
    found in its place, and the loop of the twin is faster than that of the axis. Where counts are coarse the velocity's
    filter stands for a part of the delay: beside the law that explains most, the promptest that explains as much.
    """
    banded = _in_band(replace(samples, piece=PIECE_SECONDS))
    coarse = _first_look(banded)
    ticks = max(LEAST_TICKS, round(samples.period / TICK))
    delays = sorted({round(k * TICK / samples.period * ticks) / ticks for k in range(1, MOST_ANSWER + 1)})
    form = replace(FED, ticks=ticks, cubic=law.cubic, smooth=True, taken=MOMENT)
    trials = list(_late_answers(coarse, form, BETWEEN_RATES, delays))
    best = max(trials, key=lambda trial: trial.explained)
    alike = [trial for trial in trials if 1.0 - trial.explained <= AS_MUCH * (1.0 - best.explained)]
    soonest = min(trial.answer_delay for trial in alike)
    prompt = max((one for one in alike if one.answer_delay == soonest), key=lambda trial: trial.explained)
    found = [_refined_answer(banded, coarse, one) for one in dict.fromkeys((best, prompt))]
    enough = samples.policy.controller_explains_in_band
    why = f"{_how_late(samples.period)} {BETWEEN}"
    return tuple(
        replace(one, ticks=ticks, in_band=True, why=why)
        for one in found
        if one.explained > enough and one.kp > 0.0 and one.kd > 0.0
    )


def following_late(samples: LoopSamples, acted: Floats, law: PositionController) -> PositionController | None:
    """The law of the demand, as at the samples, and by how much the torque by its sensor follows late; None if neither
    explains enough.

    Args:
        acted: torque by its sensor, less the feedforward that was recorded, shape (n,).
    """
    banded = _in_band(replace(samples, piece=PIECE_SECONDS))
    coarse = _first_look(banded)
    ticks = max(LEAST_TICKS, round(samples.period / TICK))
    form = replace(FED, ticks=ticks, cubic=law.cubic, smooth=True, taken=MOMENT)
    best = max(_late_answers(coarse, form, BETWEEN_RATES, [0.0]), key=lambda trial: trial.explained)
    found = _best_rate(banded, best)
    late, follows = _follows_by(banded, _in_band(replace(samples, demand=acted)).demand)
    least = min(found.explained, follows)
    if least <= samples.policy.controller_explains_in_band or found.kp <= 0.0 or found.kd <= 0.0:
        return None
    why = f"{_how_late(samples.period)} {BETWEEN}"
    return replace(found, answer_delay=late, explained=least, sensed=True, in_band=True, why=why)


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
    late = _lowest(left, (0.0, most), 1e-3)
    return late, 1.0 - left(late)


def _refined_answer(
    banded: LoopSamples, coarse: LoopSamples, found: PositionController
) -> PositionController:
    """The law with filter and delay found more finely, beside where they are."""
    ticks, rate = FINER * found.ticks, _rate_of(found, coarse.period)
    rates = [rate * math.exp(part * RATE_STEP) for part in (-0.5, -0.25, 0.0, 0.25, 0.5)]
    near = [found.answer_delay + part / ticks for part in (-1, 0, 1)]
    form = replace(FED, ticks=ticks, cubic=found.cubic, smooth=True, taken=MOMENT)
    best = max(_late_answers(coarse, form, rates, near), key=lambda trial: trial.explained)
    return _fitted_between(banded, best, _rate_of(best, coarse.period))


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


def plainly_better(samples: LoopSamples, one: PositionController, other: PositionController) -> bool:
    return 1.0 - one.explained < samples.policy.controller_better * (1.0 - other.explained)


def _searched(samples: LoopSamples, cascaded: bool) -> PositionController:
    """The best law with its own share of the reference's rate, or with a velocity feedforward; unfiltered where that
    explains as much."""
    found = _best_filter(partial(fitted_pid, samples, cascaded=cascaded))
    at_one = fitted_pid(samples, 1.0, cascaded)
    return at_one if 1.0 - at_one.explained <= 1.0001 * (1.0 - found.explained) else found


def _best_filter(law: Callable[[float], PositionController]) -> PositionController:
    """The law of the derivative filter that leaves least: the best of a grid, and then beside it."""

    def unexplained(smoothing: float) -> float:
        return 1.0 - law(float(smoothing)).explained

    costs = [unexplained(value) for value in _FILTERS]
    best = int(np.argmin(costs))
    bounds = _FILTERS[max(best - 1, 0)], _FILTERS[min(best + 1, len(_FILTERS) - 1)]
    return law(_lowest(unexplained, bounds, 1e-4))


def _lowest(cost: Callable[[float], float], bounds: tuple[float, float], within: float) -> float:
    """Where a cost is lowest between two bounds, to so much."""
    options: Any = {"xatol": within}
    return float(scipy.optimize.minimize_scalar(cost, bounds=bounds, method="bounded", options=options).x)


def _of_prompt_rows(samples: LoopSamples) -> PositionController | None:
    """The plain law where rows are written late: exact in those that are not; None where none is.

    A reading that is late is off by speed times delay and stays in the law's filter. So its recursion is fitted, which
    has three errors and two demands in a row: (1 − z)·(1 − β·z)·u = (A·(1 − z)·(1 − β·z) + B·(1 − z)² + C·(1 − β·z))·e
    with β = 1 − α, A = kp, B = kd·α/h, C = ki·h. Slow rows are hardly off.
    """
    slow = np.abs(np.gradient(samples.position))
    for delay in range(MOST_LATE + 1):
        late = late_samples(samples, delay, delay)
        error, change = late.reference - late.position, np.diff(late.demand, prepend=late.demand[:1])
        rows = _recursive_rows(late)
        # a demand that stays is explained by any law, and with the reference at rest so is any gain of its rate
        rows = rows[np.diff(error, 2, prepend=error[:2])[rows] != 0.0]
        rows = rows[:: max(1, len(rows) // samples.most_rows)]
        if len(rows) < SHORTEST_STRETCH:
            return None
        table = np.column_stack([change[rows - 1], *(error[rows - back] for back in range(3))])
        slowest = np.argsort(slow[rows], kind="stable")[: len(rows) // 3]
        gains = _least_absolute(table[slowest], change[rows[slowest]])
        same = np.abs(change[rows] - table @ gains) < SAME_DEMAND * np.std(change[rows])
        followed = (np.diff(late.reference, prepend=late.reference[:1])[rows] != 0.0) & (change[rows] != 0.0)
        told = max(int(np.sum(followed)), SHORTEST_STRETCH)
        if int(np.sum(same & followed)) > PROMPT * told:
            return _of_recursion(gains.tolist(), samples.period, delay)
    return None


def _least_absolute(table: Floats, wanted: Floats) -> Floats:
    """Gains of the columns that leave least in absolute value, shape (k,): rows that are wrong do not count.

    Least squares that weigh every row by what it left before.
    """
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    weight = np.ones(len(wanted))
    gains = np.zeros(table.shape[1])
    least = SAME_DEMAND**2 * float(np.std(wanted))
    for _ in range(WEIGHED):
        gains = np.linalg.lstsq(table / size * weight[:, None], weight * wanted, rcond=1e-12)[0] / size
        weight = 1.0 / np.sqrt(np.maximum(np.abs(wanted - table @ gains), least))
    return np.asarray(gains)


def _recursive_rows(samples: LoopSamples) -> Integers:
    """Rows that are free, with the three before them in the same stretch."""
    inside = [
        np.arange(s.start + 3, s.stop) for s in samples.stretches if s.stop - s.start > SHORTEST_STRETCH
    ]
    rows = np.concatenate(inside) if inside else np.zeros(0, dtype=np.int64)
    held = np.any([samples.clamped[rows - back] for back in range(4)], axis=0)
    return np.asarray(rows[~held])


def _of_recursion(gains: list[float], period: float, delay: int) -> PositionController | None:
    """The law of these coefficients: of the change before, of the error now and of the two before it."""
    memory, now, before, third = gains
    if not -0.5 < memory < 1.0:
        return None
    summed = (now + before + third) / (1.0 - memory)
    kp = (now - summed - third) / (1.0 - memory)
    share = 1.0 - memory
    kd = (third - memory * kp) * period / share
    why = f"{ROWS_LATE} {_how_late(period)}" if delay else ROWS_LATE
    law = PositionController(
        kp, kd, summed / period, min(share, 1.0), explained=1.0, source="identified", why=why
    )
    return replace(law, reference_delay=delay, position_delay=delay) if kp > 0.0 and summed >= 0.0 else None


def _searched_late(samples: LoopSamples) -> PositionController:
    """The best of the laws whose reference and position come late; first roughly, over delays and filters."""
    trials = list(_late_trials(_first_look(samples)))
    _, r, y = max(trials, key=lambda trial: trial[0].explained)
    late = late_samples(samples, r, y)
    found = _best_filter(partial(_fitted_late, late))
    return replace(found, reference_delay=r, position_delay=y, why=_how_late(samples.period))


def _late_trials(samples: LoopSamples) -> Iterator[tuple[PositionController, int, int]]:
    """Laws of all delays and rough filters, with their delays: what a filter makes of late samples comes as late."""
    filtered = {smoothing: law_terms(samples, smoothing)[:, [1, 3]].T for smoothing in _ROUGH_FILTERS}
    for r in range(MOST_LATE + 2):
        for y in range(min(r, MOST_LATE) + 1):
            late = late_samples(samples, r, y)
            terms = law_terms(late, 1.0)
            for smoothing, (moved, wanted) in filtered.items():
                terms[:, 1], terms[:, 3] = late_rows(moved, samples, y), late_rows(wanted, samples, r)
                yield fitted_whole(late, terms, smoothing), r, y


def _fitted_late(samples: LoopSamples, smoothing: float) -> PositionController:
    """Gains of the law with all terms of the reference, by least squares."""
    return fitted_whole(samples, law_terms(samples, smoothing), smoothing)


def _searched_smeared(samples: LoopSamples, near: PositionController) -> PositionController:
    """The best plain law whose torque was recorded with a part of the sample before; delays as those of `near` or one
    off, as what a current loop smears was taken there for a delay, or for terms of the reference."""
    coarse = replace(_first_look(samples), most_rows=samples.most_rows)
    begin = [near.derivative_filter, 0.1]

    def best(late: LoopSamples, start: list[float], simplex: float) -> tuple[float, list[float]]:
        def left(x: Floats) -> float:
            inside = np.clip(x, [_FILTERS[0], 0.0], [1.0, MOST_SMEARED])
            law = fitted_pid(smeared_samples(late, float(inside[1])), float(inside[0]), cascaded=False)
            return 1.0 - law.explained + float(np.sum(np.abs(x - inside)))

        corners = np.array([start, [start[0] * (1.0 + simplex), start[1]], [start[0], start[1] + simplex]])
        options: Any = {"initial_simplex": corners, "maxfev": MOST_TRIED, "xatol": 1e-4, "fatol": 1e-9}
        done = scipy.optimize.minimize(left, np.array(start), method="Nelder-Mead", options=options)
        return float(done.fun), [float(value) for value in done.x]

    delays = [d for d in range(near.position_delay - 1, near.position_delay + 2) if 0 <= d <= MOST_LATE]
    found = {d: best(late_samples(coarse, d, d), begin, 0.1) for d in delays}
    d = min(delays, key=lambda delay: found[delay][0])
    late = late_samples(samples, d, d)
    _, (smoothing, share) = best(late, found[d][1], 0.01)
    smoothing, share = min(max(smoothing, _FILTERS[0]), 1.0), min(max(share, 0.0), MOST_SMEARED)
    law = fitted_pid(smeared_samples(late, share), smoothing, cascaded=False)
    why = _how_late(samples.period) if d else ""
    return replace(law, reference_delay=d, position_delay=d, smeared=share, why=why)


def _searched_between(samples: LoopSamples) -> PositionController:
    """The best law of a drive whose loop works between the samples.

    One that feeds the rate of its reference forward past its filter, as cascades do, where that leaves clearly less.
    """
    found = _best_between(samples, PositionController())
    if 1.0 - found.explained <= NEARLY_EXACT:
        return found
    fed = _best_between(samples, FED)
    return fed if 1.0 - fed.explained < WORTH_DELAYS * (1.0 - found.explained) else found


def _best_between(samples: LoopSamples, form: PositionController) -> PositionController:
    """The best law of a drive whose loop works between the samples, on columns below the compared frequency.

    There what it makes of its set points can be computed from the samples: u = kp·e + kd·λ/(s + λ)·(b·ṙ − ẏ) + ki∫e and
    what the reference adds. Set points are late by whole samples. Of laws that explain alike the one whose reference
    does least by itself is taken: a law with another delay makes up for it with the reference's derivatives.
    """
    ticks = max(LEAST_TICKS, round(samples.period / TICK))
    coarse = _first_look(samples)
    start = replace(form, ticks=ticks)
    trials = [trial for rate in BETWEEN_RATES for trial in _between_trials(coarse, rate, start)]
    most = (1.0 - max(trial.explained for trial in trials)) * HARDLY_MORE
    near = [trial for trial in trials if 1.0 - trial.explained <= most]
    plain = min(near, key=lambda trial: abs(trial.position_feedforward) / max(abs(trial.ki), 1e-300))
    alike = [trial for trial in near if trial.reference_delay == plain.reference_delay]
    best = max(alike, key=lambda trial: trial.explained)
    forms: dict[tuple[bool, str], PositionController] = {}
    for trial in sorted(trials, key=lambda trial: trial.explained):
        if trial.reference_delay == best.reference_delay and 1.0 - trial.explained <= FINER_FILTER * most:
            forms[trial.cubic, trial.taken] = trial
    refined = [_best_rate(coarse, form) for form in forms.values()]
    best = max(refined, key=lambda trial: trial.explained)
    why = f"{_how_late(samples.period)} {BETWEEN}"
    return replace(_fitted_between(samples, best, _rate_of(best, samples.period)), in_band=True, why=why)


def _best_rate(samples: LoopSamples, form: PositionController) -> PositionController:
    """A law of this form with the filter that leaves least."""

    def law(logarithm: float) -> PositionController:
        return _fitted_between(samples, form, math.exp(logarithm))

    near = math.log(_rate_of(form, samples.period))
    bounds = near - RATE_STEP, near + RATE_STEP
    return law(_lowest(lambda logarithm: 1.0 - law(logarithm).explained, bounds, 0.05))


def _rate_of(law: PositionController, period: float) -> float:
    return -math.log(1.0 - law.derivative_filter) / period


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


def _in_band(samples: LoopSamples) -> LoopSamples:
    """The same below the frequency that models are compared at.

    What a drive makes of counts between the samples, and the noise of a torque sensor, lie above it. Low-passes and
    the law may change places: both are linear, but for the clamped sum.
    """
    cutoff = compared_below(samples.period)
    banded = [
        samples.reference.copy(),
        in_time(samples.position, samples.stretches, step_of(samples.position)),
        samples.demand.copy(),
    ]
    for rows in samples.stretches:
        for values in banded:
            values[rows] = low_pass(values[rows], cutoff, samples.period)
    reach = 2 * round(0.5 / (cutoff * samples.period)) + 1
    near = scipy.ndimage.maximum_filter1d(samples.clamped, reach)
    return replace(samples, reference=banded[0], position=banded[1], demand=banded[2], clamped=near)


def _first_look(samples: LoopSamples) -> LoopSamples:
    """A few pieces of the data, evenly spread."""
    rows = np.concatenate([np.arange(s.start, s.stop) for s in samples.stretches])
    length = min(round(LOOK_SECONDS / samples.period), len(rows) // LOOKS)
    if length < SHORTEST_STRETCH:
        return replace(samples, most_rows=ROUGH_ROWS)
    first = np.linspace(0, len(rows) - length, LOOKS).astype(int)
    looked = np.unique(rows[(first[:, None] + np.arange(length)).ravel()])
    cuts = np.flatnonzero(np.diff(looked) > 1) + 1
    edges = [0, *cuts.tolist(), len(looked)]
    parts = tuple(slice(a, b) for a, b in itertools.pairwise(edges))
    return replace(
        samples,
        reference=samples.reference[looked],
        position=samples.position[looked],
        demand=samples.demand[looked],
        clamped=samples.clamped[looked],
        stretches=parts,
        most_rows=ROUGH_ROWS,
    )


def _how_late(period: float) -> str:
    return (
        "The controller was identified with its reference or position late by whole samples, as a host with dead time "
        f"or a drive that interpolates its set points has it ({1e3 * period:.3g} ms a sample)."
    )
