"""Which law a position controller has: the search over filters, delays and forms (`controller_law`).

Least squares in a search over the derivative filter find a PID. Where that explains too little, reference and position
may come late by whole samples, or the torque may be smeared by what recorded it. A drive whose loop works many times
from one sample to the next has a search of its own: `controller_between`.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import scipy

from autotune.core.arrays import Flags, Floats, Integers
from autotune.core.remembered import LastOf
from autotune.estimation.controller_law import (
    SHORTEST_STRETCH,
    LoopSamples,
    PositionController,
    fitted_pid,
    fitted_whole,
    late_rows,
    late_samples,
    law_rows,
    law_terms,
    smeared_samples,
    whole_law,
)
from autotune.estimation.data import compared_below, step_of
from autotune.signals.between_samples import around, missed_around
from autotune.signals.filters import low_pass
from autotune.signals.late_rows import in_time
from autotune.signals.line_search import lowest, settled
from autotune.signals.rounded_recursion import ROUNDED, gains_of_recursion, rows_told
from autotune.signals.triangle import Solved, reduced

PIECE_SECONDS = 3.0
"""Of a run that shares a constant: a sum that a drive makes between the samples wanders away from theirs."""
SHORT_PIECE = 1.0
"""The same where rows may be late, so that the sum of what they are off by wanders [s]."""
ROUGH_ROWS = 8_000
"""Of a first look over delays."""
MOST_LATE = 4
"""Samples of dead time, and of a torque that was recorded a sample late; a drive that interpolates is one later with
its reference."""
LOOKS, LOOK_SECONDS = 8, 4.0
"""Pieces of the data for a first look over delays."""
MOST_SMEARED, MOST_TRIED = 0.95, 40
HOPELESS = 2.0
"""Times more that a law may leave in a first look than in all of the data, beside another."""
EXACT = 1e-6
"""Share of the demand left that rounding explains: nothing is left for another law then."""
NEARLY_EXACT, WORTH_DELAYS = 1e-5, 0.5
"""Share of the demand left from which laws with delays are looked for, and of what is left, to be taken."""
ANY_FILTER = 0.5
"""Share of a new difference in the filtered one, where only the terms of some law are wanted."""
HARDLY_MORE = 1.01
"""Times the share left by a late law with all terms of the reference: a plainer one that leaves no more is taken."""
AROUND_ROW = range(-2, 3)
"""Rows of the reference that feed a demand: those that a drive interpolates between, and its own dead time."""
STANDING, MOST_OF = MOST_LATE + 3, 0.5
"""Rows at the start of a stretch whose second differences are none of a reference that is late. Of the square of all
others: where those that are the planner's acceleration have less, no law is told by them."""
ROWS_LATE = "Rows are written late: the controller was identified by those that are not."
MOST_PROMPT = 0.5
"""Of the rows that move, what a law of the rows explains exactly where some are written late (0.75 and more; 0.35 to
0.47 where the loop was faster than the rows)."""
PLANNED = (
    "The controller feeds forward what its planner knows of each row: its rate, its acceleration, or both."
)
IN_BAND = "The controller was found below {:.0f} Hz: what the drive does between the samples is left out."
ROUGHLY = 3e-3
"""Of a derivative filter: to how much a first look finds it."""
ROUGH_FILTERS = (0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0)
_SPANNING, QUICK_ROWS = (0.1, 0.3, 0.6, 1.0), 3_000
"""Filters whose mixtures are near any, and rows of a first look with all of them."""
OFF_IN_ANY = 10.0
"""Times what another law leaves of all rows: as late as they are (1.7 to 2.6 times; 96 where a law was none)."""
_FILTERS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)


def law_from_data(samples: LoopSamples) -> PositionController:
    """The law that explains the demand best; its source is `none` where it explains too little to drive a twin."""
    found = _searched(samples, cascaded=True)
    if 1.0 - found.explained > EXACT:
        other = _searched(samples, cascaded=False)
        found = other if plainly_better(samples, other, found) else found
    if 1.0 - found.explained > NEARLY_EXACT:
        late = searched_late(samples)
        planned = _planned(samples, late) if not _rounding_explains(samples, found) else None
        if planned is not None:
            return planned
        rounded = any(_rounding_explains(samples, law) for law in (found, late))
        prompt = None if rounded else _of_prompt_rows(samples)  # by all rows, where none is written late
        if prompt is not None and _leaves_as_little(samples, prompt, late):
            return prompt
        if 1.0 - late.explained < WORTH_DELAYS * (1.0 - found.explained):
            found = _plain_of(samples, late)
        enough = HARDLY_MORE if found.reference_delay or found.position_delay else WORTH_DELAYS
        plain = _searched_smeared(samples, found, enough)
        if plain is not None and 1.0 - plain.explained < enough * (1.0 - found.explained):
            found = plain
    wandering = replace(samples, piece=PIECE_SECONDS)
    if found.explained <= samples.policy.controller_explains:
        late = searched_late(wandering)
        found = late if late.explained > found.explained else found
    if found.explained > samples.policy.controller_explains and found.kp > 0.0:
        return found
    banded = searched_late(in_band(wandering))
    if banded.explained > samples.policy.controller_explains_in_band and banded.kp > 0.0:
        said = IN_BAND.format(compared_below(samples.period))
        return replace(banded, why=f"{banded.why} {said}".strip(), in_band=True)
    return replace(found, source="none")


def _planned(samples: LoopSamples, late: PositionController) -> PositionController | None:
    """The exact law of a host that feeds rate and acceleration of its own planner at the row's moment forward.

    None where there is none, or where one without (`late`) leaves as little. Differences of the rows up to now are half
    a row and a row off; those around the row are not, and the row to come was known when this one was commanded.
    """
    if 1.0 - late.explained <= EXACT:
        return None
    look = first_look(samples)
    seen = {rows: late_samples(look, rows, rows) for rows in range(MOST_LATE + 1)}
    near = [rows for rows, one in seen.items() if _left_by_planned(one) < NEARLY_EXACT]
    if not near:
        return None
    trials = {rows: _best_filter(seen[rows], _fitted_planned).explained for rows in near}
    rows = max(near, key=lambda one: trials[one])
    shown = late_samples(samples, rows, rows)
    found = _best_filter(shown, _fitted_planned)
    exact = 1.0 - found.explained < EXACT or _rounding_explains(samples, found)
    other = late_samples(samples, late.reference_delay, late.position_delay)
    terms = law_terms(other, late.derivative_filter)
    without = _solved_where(other, planner_rows(shown), terms, late.derivative_filter).explained
    if not exact or 1.0 - found.explained >= WORTH_DELAYS * (1.0 - without) or found.kp <= 0.0:
        return None
    why = f"{PLANNED} {how_late(samples.period, rows, rows)}" if rows else PLANNED
    return replace(found, smooth=True, reference_delay=rows, position_delay=rows, why=why)


def _left_by_planned(samples: LoopSamples) -> float:
    """Share of the demand that a law with its planner's rates leaves at least, of those so late, whatever its filter.

    With several filters at once, whose mixtures are near any: by one of them alone a true law leaves more than others.
    """
    told = planner_rows(samples)
    if not np.any(told):
        return 1.0
    terms = [law_terms(samples, smoothing, smooth=True) for smoothing in _SPANNING]
    table = np.column_stack([terms[0], *(one[:, [1, 3]] for one in terms[1:])])
    quick = replace(samples, most_rows=QUICK_ROWS)
    return 1.0 - _solved_where(quick, told, table, _SPANNING[0]).explained


def planner_rows(samples: LoopSamples) -> Flags:
    """Rows in which second differences around them are the acceleration that a planner has there, shape (n,).

    None where these are not most of what moves. By the inertia that the demand shows, what they are off by must come
    to less than what an exact law may leave: a jerk that begins between two rows is in no difference of the rows.
    """
    return _PLANNER_ROWS.answer((samples,), lambda: _planner_rows(samples))


_PLANNER_ROWS: LastOf[Flags] = LastOf(MOST_LATE + 1)


def _planner_rows(samples: LoopSamples) -> Flags:
    # a reference that is seen late stands at the start of a stretch, and leaps where it goes on
    inside = np.concatenate([np.arange(rows.start + STANDING, rows.stop) for rows in samples.stretches])
    bend, off = np.zeros((2, len(samples.reference)))
    for rows in samples.stretches:
        bend[rows] = around(samples.reference[rows], samples.period)[1]
        off[rows] = missed_around(bend[rows])
    told = np.zeros(len(bend), dtype=np.bool_)
    if len(inside) > SHORTEST_STRETCH:
        (moved, shared), (_, asked) = np.cov(bend[inside], samples.demand[inside])
        told[inside] = off[inside] * abs(shared) < moved * np.sqrt(EXACT * asked)
        told[inside] &= bool(np.sum(bend[told] ** 2) > MOST_OF * np.sum(bend[inside] ** 2))
    return told


def _fitted_planned(samples: LoopSamples, smoothing: float) -> PositionController:
    """Gains of the law with its planner's rates, in the rows that tell them."""
    terms = law_terms(samples, smoothing, smooth=True)
    return whole_law(_solved_where(samples, planner_rows(samples), terms, smoothing), smoothing)


def _solved_where(samples: LoopSamples, told: Flags, terms: Floats, smoothing: float) -> Solved:
    """The demand by terms of shape (n, k), in those of the rows that are told, shape (n,)."""
    chosen, run = law_rows(samples, smoothing)
    kept = told[chosen]
    return reduced(terms[chosen[kept]].T, samples.demand[chosen[kept]], run[kept]).fitted()


def plainly_better(samples: LoopSamples, one: PositionController, other: PositionController) -> bool:
    return 1.0 - one.explained < samples.policy.controller_better * (1.0 - other.explained)


def _searched(samples: LoopSamples, cascaded: bool) -> PositionController:
    """The best law with its own share of the reference's rate, or with a velocity feedforward; unfiltered where that
    explains as much."""
    found = _best_filter(samples, partial(fitted_pid, cascaded=cascaded))
    at_one = fitted_pid(samples, 1.0, cascaded)
    return at_one if 1.0 - at_one.explained <= 1.0001 * (1.0 - found.explained) else found


def _best_filter(
    samples: LoopSamples, law: Callable[[LoopSamples, float], PositionController]
) -> PositionController:
    """The law of the derivative filter that leaves least: roughly in a first look, and from there on all rows."""
    looked = first_look(samples)

    def left(of: LoopSamples) -> Callable[[float], float]:
        return lambda smoothing: 1.0 - law(of, float(smoothing)).explained

    costs = [left(looked)(value) for value in _FILTERS]
    best = int(np.argmin(costs))
    low, high = _FILTERS[max(best - 1, 0)], _FILTERS[min(best + 1, len(_FILTERS) - 1)]
    return law(
        samples, settled(left(samples), lowest(left(looked), (low, high), ROUGHLY), (_FILTERS[0], 1.0))
    )


def _of_prompt_rows(samples: LoopSamples) -> PositionController | None:
    """The plain law where rows are written late: exact in those that are not; None where none is.

    A reading that is late is off by speed times delay and stays in the law's filter. So its recursion is fitted, which
    has three errors and two demands in a row: (1 − z)·(1 − β·z)·u = (A·(1 − z)·(1 − β·z) + B·(1 − z)² + C·(1 − β·z))·e
    with β = 1 − α, A = kp, B = kd·α/h, C = ki·h. Slow rows are hardly off.
    """
    slow = np.abs(np.gradient(samples.position))
    step = samples.step
    best, most = None, 0
    for delay in range(MOST_LATE + 1):
        late = late_samples(samples, delay, delay)
        error, change = late.reference - late.position, np.diff(late.demand, prepend=late.demand[:1])
        rows = _recursive_rows(late)
        # a demand that stays is explained by any law, and with the reference at rest so is any gain of its rate
        rows = rows[np.diff(error, 2, prepend=error[:2])[rows] != 0.0]
        rows = rows[:: max(1, len(rows) // samples.most_rows)]
        if len(rows) < SHORTEST_STRETCH:
            break
        table = np.column_stack([change[rows - 1], *(error[rows - back] for back in range(3))])
        slowest = np.argsort(slow[rows], kind="stable")[: len(rows) // 3]
        gains, left, same, rounded = gains_of_recursion(table, change[rows], slowest, step)
        followed = np.diff(late.reference, prepend=late.reference[:1])[rows] != 0.0
        moved = followed & (np.abs(change[rows]) > rounded)
        told = rows_told(left[moved], same, rounded)
        if told > most:
            fed = _fed_not_late(late.reference, rows, (table, change[rows], moved), slowest, step, told)
            few = told < MOST_PROMPT * len(left[moved])
            best, most = None if fed else _of_recursion(gains.tolist(), samples.period, delay, few), told
        if told and step == 0.0:
            break
    return best


def _leaves_as_little(samples: LoopSamples, prompt: PositionController, other: PositionController) -> bool:
    """Whether a law of the rows that are not late leaves of all rows hardly more than another law does.

    A reading that is late is off in any law. Where another one leaves a tenth, that holds in all rows, and what the
    recursion held to its rounding are changes of a slow loop's demand, which are near to any mixture of its errors.
    """
    seen = late_samples(samples, prompt.reference_delay, prompt.position_delay)
    whole = fitted_pid(seen, prompt.derivative_filter, cascaded=False)
    return 1.0 - whole.explained <= OFF_IN_ANY * (1.0 - other.explained)


def _fed_not_late(
    reference: Floats,
    rows: Integers,
    recursion: tuple[Floats, Floats, Flags],
    slowest: Integers,
    step: float,
    told: int,
) -> bool:
    """Whether most rows that a recursion does not tell are told where it has the reference's second differences too.

    A reading that is late is off by its delay, whatever the reference does. So these rows are not late: the drive feeds
    velocity or acceleration forward. `recursion`: its table, what it shall make, and which rows count; `told`: how many
    of these it tells.
    """
    table, wanted, moved = recursion
    bent = np.diff(reference, 2, prepend=reference[:2])
    table = np.column_stack([table, *(np.roll(bent, by)[rows] for by in AROUND_ROW)])
    _, left, same, _ = gains_of_recursion(table, wanted, slowest, step)
    both = int(np.count_nonzero(left[moved] < same))
    return bool(both - told > 0.5 * (np.count_nonzero(moved) - told))


def _rounding_explains(samples: LoopSamples, law: PositionController) -> bool:
    """Whether a law leaves no more than steps of the demand come to."""
    left = (1.0 - law.explained) * float(np.var(samples.demand))
    return left < (ROUNDED * samples.step) ** 2 / 12.0


def _recursive_rows(samples: LoopSamples) -> Integers:
    """Rows that are free, with the three before them in the same stretch."""
    inside = [
        np.arange(s.start + 3, s.stop) for s in samples.stretches if s.stop - s.start > SHORTEST_STRETCH
    ]
    rows = np.concatenate(inside) if inside else np.zeros(0, dtype=np.int64)
    held = np.any([samples.clamped[rows - back] for back in range(4)], axis=0)
    return np.asarray(rows[~held])


def _of_recursion(gains: list[float], period: float, delay: int, few: bool) -> PositionController | None:
    """The law of these coefficients: of the change before, of the error now and of the two before it.

    `few`: it is exact in few of the rows that move.
    """
    memory, now, before, third = gains
    if not -0.5 < memory < 1.0:
        return None
    summed = (now + before + third) / (1.0 - memory)
    kp = (now - summed - third) / (1.0 - memory)
    share = 1.0 - memory
    kd = (third - memory * kp) * period / share
    why = f"{ROWS_LATE} {how_late(period, delay, delay)}" if delay else ROWS_LATE
    law = PositionController(
        kp, kd, summed / period, min(share, 1.0), explained=1.0, source="identified", why=why, prompt=few
    )
    return replace(law, reference_delay=delay, position_delay=delay) if kp > 0.0 and summed >= 0.0 else None


def plain_in_band(samples: LoopSamples) -> PositionController | None:
    """The plain law that leaves least below the compared frequency; None where it explains too little for a twin.

    A reading that is late, and a torque by its own sensor, leave no law exact. Least squares over all frequencies then
    take gain from the rate, or put terms of the reference and another delay in its place. Both lie above that
    frequency, nearly all: below it a host's law keeps its gains, and its delay.
    """
    banded = in_band(replace(samples, piece=SHORT_PIECE))
    coarse = first_look(banded)
    found = [
        replace(
            _best_filter(late_samples(coarse, late, late), partial(fitted_pid, cascaded=False)),
            reference_delay=late,
            position_delay=late,
        )
        for late in range(MOST_LATE + 1)
    ]
    best = max(found, key=lambda law: law.explained)
    late = best.position_delay
    law = fitted_pid(late_samples(banded, late, late), best.derivative_filter, cascaded=False)
    if law.explained <= samples.policy.controller_explains_in_band or min(law.kp, law.kd) <= 0.0:
        return None
    why = how_late(samples.period, late, late)
    return replace(law, reference_delay=late, position_delay=late, why=why)


def searched_late(samples: LoopSamples) -> PositionController:
    """The best of the laws whose reference and position come late; first roughly, over delays and filters."""
    r, y = _best_delays(first_look(samples))
    found = _best_filter(late_samples(samples, r, y), _fitted_late)
    return replace(found, reference_delay=r, position_delay=y, why=how_late(samples.period, r, y))


def _plain_of(samples: LoopSamples, late: PositionController) -> PositionController:
    """The plain law of the same delays, where that leaves no more of the demand than rounding does; else the law."""
    r, y = late.reference_delay, late.position_delay
    if r != y:
        return late
    plain = _best_filter(late_samples(samples, r, y), partial(fitted_pid, cascaded=True))
    exact = 1.0 - plain.explained < EXACT or _rounding_explains(samples, plain)
    return replace(plain, reference_delay=r, position_delay=y, why=late.why) if exact else late


def _best_delays(samples: LoopSamples) -> tuple[int, int]:
    """Delays of reference and position whose law leaves least, each with the filter that is best for it.

    Between the rough filters even the true delays leave more than others do with terms of the reference in their place.
    """
    rough: dict[tuple[int, int], PositionController] = {}
    for law, r, y in _late_trials(samples):
        if (r, y) not in rough or law.explained > rough[r, y].explained:
            rough[r, y] = law

    def left(delays: tuple[int, int]) -> float:
        late = late_samples(samples, *delays)
        place = ROUGH_FILTERS.index(rough[delays].derivative_filter)
        near = ROUGH_FILTERS[max(place - 1, 0)], ROUGH_FILTERS[min(place + 1, len(ROUGH_FILTERS) - 1)]
        best = lowest(lambda one: 1.0 - _fitted_late(late, float(one)).explained, near, ROUGHLY)
        return 1.0 - max(_fitted_late(late, best).explained, rough[delays].explained)

    return min(rough, key=left)


def _late_trials(samples: LoopSamples) -> Iterator[tuple[PositionController, int, int]]:
    """Laws of all delays and rough filters, with their delays: what a filter makes of late samples comes as late.

    All delays of one filter are in one triangle.
    """
    for smoothing in ROUGH_FILTERS:
        chosen, run = law_rows(samples, smoothing)
        seen = [seen_late(samples, samples.reference, smoothing, late) for late in range(MOST_LATE + 2)]
        moved = [seen_late(samples, samples.position, smoothing, late)[:3] for late in range(MOST_LATE + 1)]
        triangle = reduced(np.concatenate([*seen, *moved])[:, chosen], samples.demand[chosen], run)
        for r in range(MOST_LATE + 2):
            for y in range(min(r, MOST_LATE) + 1):
                yield whole_law(triangle.fitted(late_mixing(r, y)), smoothing), r, y


def seen_late(samples: LoopSamples, values: Floats, smoothing: float, late: int) -> Floats:
    """Values some samples ago, their held sum, their filtered rate, their rate and its change, shape (5, n)."""
    shown, h = late_rows(values, samples, late), samples.period
    terms = np.zeros((5, len(values)))
    for rows in samples.stretches:
        here, start = shown[rows], samples.position[rows.start]
        rate = np.diff(here, prepend=here[0]) / h
        filtered = scipy.signal.lfilter([smoothing], [1.0, smoothing - 1.0], rate)
        terms[:, rows] = (
            here, np.cumsum((here - start) * ~samples.clamped[rows]) * h, filtered, rate,
            np.diff(rate, prepend=rate[:1]) / h,
        )  # fmt: skip
    return terms


def late_mixing(r: int, y: int) -> Floats:
    """Terms as in `law_terms` as mixtures of what `_late_trials` reduces, of a reference and a position so late."""
    wanted, moved = 5 * r, 5 * (MOST_LATE + 2) + 3 * y
    mixing = np.zeros((5 * (MOST_LATE + 2) + 3 * (MOST_LATE + 1), 7))
    for term, place in ((0, 0), (2, 1)):
        mixing[[wanted + place, moved + place], term] = 1.0, -1.0
    mixing[moved + 2, 1] = -1.0
    for term, place in ((3, 2), (4, 3), (5, 0), (6, 4)):
        mixing[wanted + place, term] = 1.0
    return mixing


def _fitted_late(samples: LoopSamples, smoothing: float) -> PositionController:
    """Gains of the law with all terms of the reference, by least squares."""
    return fitted_whole(samples, law_terms(samples, smoothing), smoothing)


def _left_in(samples: LoopSamples, law: PositionController) -> float:
    """Share of the demand that a law of this form and filter leaves in other samples."""
    if law.reference_delay or law.position_delay:
        late = late_samples(samples, law.reference_delay, law.position_delay)
        return 1.0 - _fitted_late(late, law.derivative_filter).explained
    return 1.0 - fitted_pid(samples, law.derivative_filter, law.velocity_feedforward == 0.0).explained


def _searched_smeared(
    samples: LoopSamples, near: PositionController, enough: float
) -> PositionController | None:
    """The best plain law whose torque was recorded with a part of the sample before; delays as those of `near` or one
    off, as what a current loop smears was taken there for a delay, or for terms of the reference.

    None where a first look shows that it leaves far more than `enough` times what `near` leaves.
    """
    coarse = first_look(samples)
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
    if found[d][0] > HOPELESS * enough * _left_in(coarse, near):
        return None
    late = late_samples(samples, d, d)
    _, (smoothing, share) = best(late, found[d][1], 0.01)
    smoothing, share = min(max(smoothing, _FILTERS[0]), 1.0), min(max(share, 0.0), MOST_SMEARED)
    law = fitted_pid(smeared_samples(late, share), smoothing, cascaded=False)
    why = how_late(samples.period, d, d)
    return replace(law, reference_delay=d, position_delay=d, smeared=share, why=why)


def in_band(samples: LoopSamples) -> LoopSamples:
    """The same below the frequency that models are compared at.

    What a drive makes of counts between the samples, and the noise of a torque sensor, lie above it. Low-passes and
    the law may change places: both are linear, but for the clamped sum.
    """
    moved = in_time(samples.position, samples.stretches, step_of(samples.position))
    reference, position, demand = values_in_band(
        samples, np.stack([samples.reference, moved, samples.demand])
    )
    reach = 2 * round(0.5 / (compared_below(samples.period) * samples.period)) + 1
    near = scipy.ndimage.maximum_filter1d(samples.clamped, reach)
    return replace(samples, reference=reference, position=position, demand=demand, clamped=near)


def values_in_band(samples: LoopSamples, values: Floats) -> Floats:
    """Values of shape (k, n) below the frequency that models are compared at, stretch by stretch."""
    below = values.copy()
    for one in below:
        for rows in samples.stretches:
            one[rows] = low_pass(one[rows], compared_below(samples.period), samples.period)
    return below


def first_look(samples: LoopSamples) -> LoopSamples:
    """A few pieces of the data, evenly spread, none beyond the end of its stretch: those of a look lie side by side."""
    rows = np.concatenate([np.arange(s.start, s.stop) for s in samples.stretches])
    number = np.repeat(np.arange(len(samples.stretches)), [s.stop - s.start for s in samples.stretches])
    length = min(round(LOOK_SECONDS / samples.period), len(rows) // LOOKS)
    if length < SHORTEST_STRETCH:
        return replace(samples, most_rows=ROUGH_ROWS)
    first = np.linspace(0, len(rows) - length, LOOKS).astype(int)
    places = np.unique((first[:, None] + np.arange(length)).ravel())
    looked = rows[places]
    cuts = np.flatnonzero((np.diff(looked) > 1) | (np.diff(number[places]) > 0)) + 1
    edges = [0, *cuts.tolist(), len(looked)]
    parts = tuple(slice(a, b) for a, b in itertools.pairwise(edges))
    return replace(
        samples,
        reference=samples.reference[looked],
        position=samples.position[looked],
        demand=samples.demand[looked],
        clamped=samples.clamped[looked],
        weight=samples.weight_of(looked),
        stretches=parts,
        most_rows=ROUGH_ROWS,
    )


def how_late(period: float, reference: int, position: int) -> str:
    """What is said of a law whose reference or position comes so many samples late; "" of neither. The period in s."""
    if reference == position:
        late = {"reference and position": reference}
    else:
        late = {"its reference": reference, "its position": position}
    seen = " and ".join(f"{name} {_samples(rows, period)}" for name, rows in late.items() if rows)
    if not seen:
        return ""
    return (
        f"The controller was identified with {seen} late, as a host with dead time or a drive that interpolates its "
        "set points has it; a loop that is faster than the rows, or a filter of its velocity, looks so too."
    )


def _samples(rows: int, period: float) -> str:
    return f"{rows} sample{'s' * (rows != 1)} ({1e3 * rows * period:.3g} ms)"
