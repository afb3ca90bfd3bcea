"""What a file does not say of its loop, told by what the torque demand does: a limit, a filter, what is fed forward.

A law of the controller (`controller`) is told by reference, position and torque. Where the drive or its host does more
with them than any column holds, there is a law only once that is told too.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from autotune.core.arrays import Flags, Floats
from autotune.core.remembered import Remembered, digest_of
from autotune.core.units import torque_symbol
from autotune.estimation.controller import (
    AS_READ,
    asked,
    find_controller,
    identified,
    loop_samples,
    mark_of_samples,
    with_column,
)
from autotune.estimation.controller_law import (
    SHORTEST_STRETCH,
    LoopSamples,
    PositionController,
    late_rows,
    late_samples,
    law_rows,
    law_terms,
)
from autotune.estimation.controller_search import (
    ANY_FILTER,
    HARDLY_MORE,
    MOST_LATE,
    PIECE_SECONDS,
    ROUGH_FILTERS,
    ROUGH_ROWS,
    ROUGHLY,
    WORTH_DELAYS,
    first_look,
    in_band,
    late_mixing,
    seen_late,
    values_in_band,
)
from autotune.estimation.data import Prepared
from autotune.estimation.policy import Policy
from autotune.recordings.checks import noisy_limit
from autotune.recordings.held_rows import SET_POINTS_STAND
from autotune.recordings.recording import Recording
from autotune.signals.line_search import lowest
from autotune.signals.runs import runs_of
from autotune.signals.set_point_filters import SET_POINT_FILTERS
from autotune.signals.smooth_sign import SMOOTH_SIGNS, by_tanh
from autotune.signals.triangle import Solved, reduced

FEEDS_FRICTION = "The controller feeds friction forward, "
FRICTION_FED = (
    FEEDS_FRICTION + "{:.3g} {} by the sign of its reference's speed{}; that was told by its demand."
)
OBSERVED = ", ahead of a disturbance observer"
LOGGED_FEEDFORWARD = "The feedforward in the file "
FED_LATE = LOGGED_FEEDFORWARD + (
    "is in the torque {:.2g} rows ({:.2g} ms) later: it was logged as it was asked for, "
    "before the dead time of the loop. It is taken as it acts."
)
ADDED = "To the controller's torque another one was added "
TORQUE_ADDED = ADDED + (
    "in '{names}', which no column of the file holds: what the controller's law, as it is in all other experiments, "
    "does not ask for there was taken for it."
)
KICKED = (
    " It is largest where the speed of the reference steps: an acceleration feedforward kicks the axis there, for less "
    "than a row. Where that is so, round the reference off, and record again."
)
LIMITED = "The torque is cut off at about "
TORQUE_LIMITED = LIMITED + (
    "{:.3g} {unit}, as its noise lets one see: only so has the controller a law. If you know the limit, name it: "
    "autotune data import FILE --torque-limit LIMIT"
)
LEFT_BY_A_LIMIT = 0.5
"""Of what a law without a limit leaves unexplained: what one at the limit leaves at most that is no mere top."""
FILTERED = "The drive filters its set points: "
SET_POINTS_FILTERED = FILTERED + (
    "by {}, told by its demand. The file holds them before that filter, the controller is found behind it. If the "
    "drive can record what its loop follows, record that."
)
SHORTEST_FILTER, LONGEST_FILTER, FILTER_STEPS, FILTER_FINELY = 2.0, 0.1, 16, 0.02
"""Of a set point filter: the shortest [rows] and the longest [s] that are looked for, in so many steps; and to how much
the best is found."""
NEAR_BEST, SETTLED = 4.0, 3.0
"""Times what the best of all leaves in steps: a kind that leaves no more is looked at between them. Times the longest
filter, after which it has forgotten where it began."""
INTERPOLATED = 3
"""Rows by which a reference is later than the position at most, where a drive goes on lines or cubics between them."""
SPANNING, SPANNED = (0.05, 0.1, 0.3, 1.0), (2e-3, 1e-2, 5e-2)
"""Filters of a rate, and widths of a fed sign over the top speed, whose mixtures are near any."""
TOLD_OF_LOOP = (AS_READ, FEEDS_FRICTION, LOGGED_FEEDFORWARD, ADDED, LIMITED, FILTERED, SET_POINTS_STAND)
"""How remarks begin that tell what was found out about the loop."""
KICK, NEAR_KICK = 5.0, 2
"""Times the second differences that a hundredth of the rows exceeds: a step of the speed; and the rows beside it."""
MOST_ADDED, LEAST_LEFT, FAR_LESS = 3, 0.5, 0.5
"""Experiments that a torque may be added in; of the rows, what must be left to tell the law; and what a law's terms may
leave of the demand without such an experiment, of what they leave with it."""
KNOWN_FILTERS: Remembered[tuple[int, float] | None] = Remembered(4)
KNOWN_FED: Remembered[FrictionFed | None] = Remembered(4)
_KNOWN_ADDED: Remembered[tuple[Floats, tuple[str, ...]] | None] = Remembered(4)
AS_FED = 0.1
"""Relative: by how much a feedforward may be another one in the torque than in its column, as units are rounded."""
TURNS_OVER = (1e-5, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1)
"""Of the reference's top speed: over which friction that is fed forward turns, from a plain sign to what hardly differs
from a velocity feedforward."""
FINELY = 0.01
"""Of the speed over which a fed sign turns: to how much it is found."""


def with_feedforward_late(
    recordings: Sequence[Recording], data: Prepared, policy: Policy
) -> Sequence[Recording]:
    """Recordings with their feedforward as late as it is in the torque, where that tells more of their controller.

    As in `with_friction_fed`.
    """
    if not (data.closed and np.any(data.feedforward)):
        return recordings
    before = find_controller(data, policy)
    found = None if before.exact else fed_late(loop_samples(data, policy), data.feedforward)
    if found is None:
        return recordings
    acts, late = found
    after = find_controller(replace(data, feedforward=acts), policy)
    if not _of_all_rows(after) or (_of_all_rows(before) and not _tells_more(after, before)):
        return recordings
    return _with_feedforward(recordings, acts, FED_LATE.format(late, 1e3 * late * data.period))


def _tells_more(law: PositionController, other: PositionController) -> bool:
    """Whether a law is one of the rows and the other told below the compared frequency only, or leaves half."""
    if law.in_band != other.in_band:
        return other.in_band
    return 1.0 - law.explained < WORTH_DELAYS * (1.0 - other.explained)


def with_torque_limit(recordings: Sequence[Recording], data: Prepared, policy: Policy) -> Sequence[Recording]:
    """Recordings with the limit that a noisy torque is cut off at, where their controller has a law only then.

    As in `with_friction_fed`. At a limit the sum of the controller stops, and what it asks for from there on is another
    than its law's; but a measured torque scatters about it, and none of its values comes again (`clamped`).
    """
    if data.metadata.torque_limit is not None or not data.closed:
        return recordings
    before = find_controller(data, policy)
    limit = None if _of_all_rows(before) else noisy_limit(data.recorded_torque)
    if limit is None:
        return recordings
    limited = replace(data, metadata=replace(data.metadata, torque_limit=limit))
    after = find_controller(limited, policy)
    if not after.usable or (before.usable and not _of_all_rows(after)):
        return recordings
    if 1.0 - after.explained > LEFT_BY_A_LIMIT * (1.0 - before.explained):
        return recordings
    unit = torque_symbol(data.metadata.motion_unit, data.metadata.torque_unit)
    said = TORQUE_LIMITED.format(limit, unit=unit)
    return [
        one.with_metadata(torque_limit=limit, remarks=(*one.metadata.remarks, said)) for one in recordings
    ]


def with_friction_fed(recordings: Sequence[Recording], data: Prepared, policy: Policy) -> Sequence[Recording]:
    """Recordings with the friction that their controller feeds forward told apart, where it has a law only then.

    `data`: the recordings made ready, row by row. What is told is known from the reference alone, and stands in the
    column `torque_feedforward` from there on: fit, twin and comparison take it for what it is.
    """
    if not data.closed or _of_all_rows(find_controller(data, policy)):
        return recordings
    samples = loop_samples(data, policy)
    fed = KNOWN_FED.answer(mark_of_samples(samples), lambda: friction_fed_forward(samples))
    if fed is None:
        return recordings
    whole = data.feedforward + fed.torque
    if not _of_all_rows(find_controller(replace(data, feedforward=whole), policy)):
        return recordings
    unit = torque_symbol(data.metadata.motion_unit, data.metadata.torque_unit)
    said = FRICTION_FED.format(fed.level, unit, OBSERVED if fed.observed else "")
    return _with_feedforward(recordings, whole, said)


def with_set_points_filtered(
    recordings: Sequence[Recording], data: Prepared, policy: Policy
) -> Sequence[Recording]:
    """Recordings with set points as their drive's filter leaves them, where the controller has a law only then, or one
    that needs them no later than a drive has them that interpolates.

    As in `with_friction_fed`, which is asked of what is behind the filter, too. Below a few hertz terms of the
    reference and a delay stand for a filter; a twin that is driven by them is another loop.
    """
    if not data.closed:
        return recordings
    before = find_controller(data, policy)
    if before.exact or (_of_all_rows(before) and not _needs_later(before)):
        return recordings
    samples = loop_samples(data, policy)
    for fed in (False,) if _of_all_rows(before) else (False, True):
        found = KNOWN_FILTERS.answer(
            (fed, *mark_of_samples(samples)), partial(set_point_filter, samples, fed)
        )
        if found is None:
            continue
        kind, seconds = found
        shown = replace(data, reference=_behind_filter(samples, kind, seconds))
        said = SET_POINTS_FILTERED.format(SET_POINT_FILTERS[kind].named.format(1e3 * seconds))
        told = _with_columns(recordings, "reference", shown.reference, said)
        after = find_controller(shown, policy)
        if _of_all_rows(after) and (not _of_all_rows(before) or _is_plainer(after, before)):
            return told
        both = with_friction_fed(told, shown, policy) if fed else told
        if both is not told:
            return both
    return recordings


def _needs_later(law: PositionController) -> bool:
    """Whether a law needs its reference later than any drive has it that goes from one set point to the next."""
    return law.reference_delay - law.position_delay > INTERPOLATED


def _is_plainer(law: PositionController, other: PositionController) -> bool:
    """Whether a law leaves half of what one leaves that needs its reference late, or no more and needs it in time."""
    enough = WORTH_DELAYS if _needs_later(law) else HARDLY_MORE
    return 1.0 - law.explained <= enough * (1.0 - other.explained)


def with_torque_added(recordings: Sequence[Recording], data: Prepared, policy: Policy) -> Sequence[Recording]:
    """Recordings with a torque told that some experiments add to their controller's and no column holds, where there is
    a law only then; as in `with_friction_fed`.

    An excitation is often added in the drive, and a law of the loop is told in all rows or in none. In experiments
    without it the law is as it is.
    """
    if not (data.repeated and data.closed) or _of_all_rows(find_controller(data, policy)):
        return recordings
    samples = loop_samples(data, policy)
    names = np.concatenate([recording.experiment for recording in recordings])
    found = _KNOWN_ADDED.answer(
        (mark_of_samples(samples), digest_of(np.unique(names, return_inverse=True)[1])),
        lambda: _torque_added(data, samples, names),
    )
    if found is None:
        return recordings
    added, where = found
    if not _of_all_rows(find_controller(replace(data, feedforward=data.feedforward + added), policy)):
        return recordings
    said = TORQUE_ADDED.format(names="', '".join(where))
    if _is_kicked(data, added, np.isin(names, where)):
        said += KICKED
    return _with_feedforward(recordings, data.feedforward + added, said)


def _is_kicked(data: Prepared, added: Floats, within: Flags) -> bool:
    """Whether a torque that is added, shape (n,), is largest in rows where the reference's speed steps."""
    bent = np.zeros(len(added))
    for stretch in data.stretches:
        bent[stretch.rows][1:-1] = np.abs(np.diff(data.reference[stretch.rows], 2))
    largest = int(np.argmax(np.abs(added)))
    there = bent[max(largest - NEAR_KICK, 0) : largest + NEAR_KICK + 1].max()
    return bool(there > KICK * np.quantile(bent[within], 0.99))


def _torque_added(
    data: Prepared, samples: LoopSamples, names: NDArray[np.str_]
) -> tuple[Floats, tuple[str, ...]] | None:
    """What experiments add to the controller's torque, shape (n,), and which do; None where no few of them do."""
    terms = np.column_stack([law_terms(samples, ANY_FILTER), np.ones(len(names))])
    terms /= np.maximum(np.linalg.norm(terms, axis=0), 1e-300)
    controlled = np.zeros(len(names), dtype=np.bool_)
    for rows in samples.stretches:
        controlled[rows] = True
    outside: list[str] = []
    while len(outside) < MOST_ADDED:
        name = _unlike_others(terms, samples.demand, names, controlled & ~np.isin(names, outside))
        if name is None:
            return None
        outside.append(name)
        out = np.isin(names, outside)
        law = identified(replace(samples, stretches=_rows_left(samples, out)))
        if not _of_all_rows(law):
            continue
        added = data.torque - asked(data, law)
        for rows in samples.stretches:
            rest = added[rows][~out[rows]]
            added[rows] -= float(np.median(rest)) if len(rest) else 0.0
        return np.where(out, added, 0.0), tuple(outside)
    return None


def _unlike_others(terms: Floats, demand: Floats, names: NDArray[np.str_], within: Flags) -> str | None:
    """The experiment without which a law's terms, shape (n, k), explain far more of the demand in the others `within`.

    None where there is none of which enough rows are left without it.
    """

    def left(rows: Flags) -> float:
        table, wanted = terms[rows], demand[rows]
        gains = np.linalg.lstsq(table.T @ table, table.T @ wanted, rcond=1e-12)[0]
        return float(np.var(wanted - table @ gains)) / max(float(np.var(wanted)), 1e-300)

    there, counts = np.unique(names[within], return_counts=True)
    small = there[counts <= within.sum() - LEAST_LEFT * len(names)].tolist()
    shares = {name: left(within & (names != name)) for name in small}
    best = min(shares, key=lambda name: shares[name], default=None)
    return best if best is not None and shares[best] <= FAR_LESS * left(within) else None


def _rows_left(samples: LoopSamples, out: Flags) -> tuple[slice, ...]:
    """The stretches without some rows, those of a second at least."""
    left = []
    for rows in samples.stretches:
        runs = runs_of(~out[rows])
        left += [slice(rows.start + a, rows.start + b) for a, b in runs if (b - a) * samples.period >= 1.0]
    return tuple(left)


def _with_feedforward(recordings: Sequence[Recording], torque: Floats, said: str) -> list[Recording]:
    """Recordings with a torque beside the controller's in a column of its own, and a remark on it."""
    return _with_columns(recordings, "torque_feedforward", torque, said)


def _with_columns(recordings: Sequence[Recording], name: str, values: Floats, said: str) -> list[Recording]:
    """Recordings each with its part of values of shape (n,) in a column, and a remark on it."""
    edges = np.cumsum([len(recording) for recording in recordings])[:-1]
    parts = zip(recordings, np.split(values, edges), strict=True)
    return [with_column(recording, name, part, said) for recording, part in parts]


def _of_all_rows(law: PositionController) -> bool:
    """Whether a law was found, and not in quick rows alone, where a constant a second may stand for fed friction."""
    return law.usable and not law.quick


def set_point_filter(samples: LoopSamples, fed: bool) -> tuple[int, float] | None:
    """The filter of a drive's set points: its place in `SET_POINT_FILTERS` and its time [s]; None where none is told.

    Looked for below the frequency that models are compared at, over kinds, times and the delays of a drive that
    interpolates, by what any law of the position beside the terms of such a reference leaves of the demand; with `fed`
    beside friction that is fed forward by it, whose edges show when a drive has its set points. A filter is told where
    half is left of what is left without one.
    """
    looked = _settled_look(samples)
    shortest = SHORTEST_FILTER * samples.period
    if shortest >= LONGEST_FILTER or len(law_rows(looked, SPANNING[0])[0]) < SHORTEST_STRETCH:
        return None
    beside = _AnyLaw(looked, fed)
    lates = range(0, INTERPOLATED + 1, 2)
    without = min(beside.left(late_rows(looked.reference, looked, late)) for late in lates)

    def left(kind: int, late: int, log_seconds: float) -> float:
        shown = _behind_filter(looked, kind, float(np.exp(log_seconds)))
        return beside.left(late_rows(shown, looked, late))

    steps = np.linspace(np.log(shortest), np.log(LONGEST_FILTER), FILTER_STEPS).tolist()
    costs = {
        (kind, late): [left(kind, late, one) for one in steps]
        for kind, late in itertools.product(range(len(SET_POINT_FILTERS)), lates)
    }
    most = NEAR_BEST * min(map(min, costs.values()))
    best = np.inf, 0, 0.0
    for (kind, late), along in costs.items():
        place = int(np.argmin(along))
        if along[place] <= most:
            near = steps[max(place - 1, 0)], steps[min(place + 1, FILTER_STEPS - 1)]
            log_seconds = lowest(partial(left, kind, late), near, FILTER_FINELY)
            best = min(best, (left(kind, late, log_seconds), kind, log_seconds))
    least, kind, log_seconds = best
    return (kind, float(np.exp(log_seconds))) if least < WORTH_DELAYS * without else None


def _settled_look(samples: LoopSamples) -> LoopSamples:
    """A first look whose pieces tell nothing until a filter has forgotten what was before them."""
    looked = first_look(samples)
    held = looked.clamped.copy()
    for rows in looked.stretches:
        held[rows.start : rows.start + round(SETTLED * LONGEST_FILTER / samples.period)] = True
    return replace(looked, clamped=held, piece=PIECE_SECONDS)


def _behind_filter(samples: LoopSamples, kind: int, seconds: float) -> Floats:
    """The reference behind a filter of its set points, stretch by stretch, shape (n,)."""
    shown = samples.reference.copy()
    for rows in samples.stretches:
        shown[rows] = SET_POINT_FILTERS[kind].apply(samples.reference[rows], seconds / samples.period)
    return shown


class _AnyLaw:
    """What any law of the position leaves of the demand beside a reference's terms; with `fed` beside friction that is
    fed forward by that reference, too.
    """

    def __init__(self, samples: LoopSamples, fed: bool) -> None:
        self._samples, self._fed = samples, fed
        self._quick = replace(in_band(samples), most_rows=ROUGH_ROWS)
        self._chosen, self._run = law_rows(self._quick, SPANNING[0])
        place = self._quick.position
        moved = [seen_late(self._quick, place, smoothing, 0)[2] for smoothing in SPANNING]
        past = [late_rows(place, self._quick, late) for late in range(MOST_LATE + 1)]
        ahead = np.append(place[1:], place[-1:])
        self._position = np.array([*moved, *past, ahead])[:, self._chosen]

    def left(self, reference: Floats) -> float:
        """Share of the demand's variance; the reference as the loop has it, shape (n,)."""
        shown, *fed = values_in_band(self._samples, np.stack([reference, *self._signs(reference)]))
        terms = law_terms(replace(self._quick, reference=shown), ANY_FILTER)[:, [2, 3, 5, 6]]
        table = [self._position, terms[self._chosen].T, *(one[None, self._chosen] for one in fed)]
        fitted = reduced(np.concatenate(table), self._quick.demand[self._chosen], self._run).fitted()
        return 1.0 - fitted.explained

    def _signs(self, reference: Floats) -> list[Floats]:
        """Friction that may be fed forward by a reference, each of shape (n,); none where it is not asked for."""
        if not self._fed:
            return []
        samples, rate = self._samples, _rate_of(self._samples, reference)
        top = float(np.max(np.abs(rate), initial=1e-300))
        signs = [_fed_terms(samples, rate, by_tanh, width * top, summed=False)[0] for width in SPANNED]
        return [*signs, _fed_terms(samples, rate, by_tanh, SPANNED[1] * top, summed=True)[1]]


@dataclass(frozen=True, slots=True)
class FrictionFed:
    """Friction that a controller feeds forward: what the demand has of it, shape (n,), and its level [N m or N].

    Attributes:
        observed: it is fed ahead of a disturbance observer.
        left: share of the demand that a law beside it leaves.
    """

    torque: Floats
    level: float
    observed: bool
    left: float


def friction_fed_forward(samples: LoopSamples) -> FrictionFed | None:
    """Coulomb friction that a controller adds by the sign of its reference's speed.

    None where no law of the samples explains enough for a twin with it either.

    Feedforward of friction is as usual in drives and robots as that of inertia. It is known from the reference but for
    its size, which is linear beside the law's gains, and the speed over which the sign is smoothed. Both are told below
    the frequency that models are compared at, so that it need not be known how the drive works between the samples.

    Ahead of a disturbance observer the demand has its sum as well. With the observer's filter g/(s + g) the demand is
    u = (1 + g/s)·w - g·J·v, where w is what is asked without it (Ohnishi et al. 1996, IEEE/ASME Transactions on
    Mechatronics 1): of a PD and of all that is fed forward by the reference's derivatives this makes a PID, of a sign
    the sign and g times its sum.
    """
    banded = in_band(replace(samples, piece=PIECE_SECONDS))
    rate = _rate_of(samples, samples.reference)
    top = float(np.max(np.abs(rate), initial=0.0))
    if top == 0.0:
        return None
    plain, observed = (_friction_fed(samples, banded, rate, top, ahead) for ahead in (False, True))
    if plain is None or observed is None:
        return plain or observed
    return observed if observed.left < WORTH_DELAYS * plain.left else plain


def _friction_fed(
    samples: LoopSamples, banded: LoopSamples, rate: Floats, top: float, observed: bool
) -> FrictionFed | None:
    """What is fed forward by the sign of the reference's `rate`, and by its sum ahead of an observer; as above."""
    best = max(_fed_trials(banded, rate, top, observed), key=lambda trial: trial[0])
    _, sign, width, (r, y), smoothing = best
    late, asked = late_samples(banded, r, y), late_rows(rate, samples, r)

    def fed(log_width: float, filtered: float) -> Solved:
        terms = values_in_band(samples, _fed_terms(samples, asked, sign, float(np.exp(log_width)), observed))
        return _beside_fed(late, terms, filtered)

    def left(log_width: float, filtered: float = smoothing) -> float:
        return 1.0 - fed(log_width, filtered).explained

    sharp = float(np.log(width))
    reach = float(np.log(TURNS_OVER[-1] / TURNS_OVER[-2]))
    sharp = lowest(left, (sharp - reach, sharp + reach), FINELY)
    place = ROUGH_FILTERS.index(smoothing)
    near = ROUGH_FILTERS[max(place - 1, 0)], ROUGH_FILTERS[min(place + 1, len(ROUGH_FILTERS) - 1)]
    smoothing = lowest(partial(left, sharp), near, ROUGHLY)
    sharp = lowest(partial(left, filtered=smoothing), (sharp - 0.5 * reach, sharp + 0.5 * reach), FINELY)
    found = fed(sharp, smoothing)
    terms = _fed_terms(samples, asked, sign, float(np.exp(sharp)), observed)
    sizes = found.gains[-len(terms) :]
    if np.any(sizes <= 0.0) or found.explained <= samples.policy.controller_explains_in_band:
        return None
    return FrictionFed(np.asarray(sizes @ terms), float(sizes[0]), observed, 1.0 - found.explained)


def fed_late(samples: LoopSamples, fed: Floats) -> tuple[Floats, float] | None:
    """A recorded feedforward, shape (n,), as it is in the torque, and how many rows later that is; None where it is in
    step with it, or where nothing tells.

    A host logs what it asks for in a row, and the torque that its drive tells of has all of that rows later: after its
    dead time, and smeared over two rows by a current loop. Any law of the last rows of reference and position stands
    for the rest, so that none need be known.
    """
    chosen, run = law_rows(samples, ANY_FILTER)
    rows = range(MOST_LATE + 3)
    own = [late_rows(fed, samples, late)[chosen] for late in rows]
    seen = [samples.reference, samples.position]
    past = [late_rows(values, samples, late)[chosen] for values in seen for late in rows]
    past.append(law_terms(samples, ANY_FILTER)[chosen, 2])
    triangle = reduced([*past, *own], (samples.demand + fed)[chosen], run)

    def beside_law(*late: int) -> Solved:
        places = [*range(len(past)), *(len(past) + one for one in late)]
        return triangle.fitted(np.eye(len(past) + len(own))[:, places])

    fits = [beside_law(late, late + 1) for late in rows[:-1]]
    late = max(rows[:-1], key=lambda one: fits[one].explained)
    whole, last = float(fits[late].gains[-2:].sum()), float(fits[late].gains[-1])
    in_step = 1.0 - beside_law(0).explained
    if 1.0 - fits[late].explained > WORTH_DELAYS * in_step or abs(whole - 1.0) > AS_FED:
        return None
    share = min(max(last / whole, 0.0), 1.0)
    acts = whole * ((1.0 - share) * late_rows(fed, samples, late) + share * late_rows(fed, samples, late + 1))
    return acts, late + share


def _fed_trials(
    banded: LoopSamples, rate: Floats, top: float, summed: bool
) -> Iterator[tuple[float, Callable[[Floats, float], Floats], float, tuple[int, int], float]]:
    """Share explained by the laws of all delays and rough filters with friction fed forward by the reference's `rate`
    [rad/s or m/s], shape (n,); and the smooth sign, its width, the delays and the filter of each."""
    forms = [(sign, share * top) for sign in SMOOTH_SIGNS for share in TURNS_OVER]
    every = [
        values_in_band(banded, _fed_terms(banded, late_rows(rate, banded, late), sign, width, summed))
        for late in range(MOST_LATE + 2)
        for sign, width in forms
    ]
    own = len(every[0])
    quick = replace(banded, most_rows=ROUGH_ROWS)
    for smoothing in ROUGH_FILTERS:
        chosen, run = law_rows(quick, smoothing)
        seen = [seen_late(quick, quick.reference, smoothing, late) for late in range(MOST_LATE + 2)]
        moved = [seen_late(quick, quick.position, smoothing, late)[:3] for late in range(MOST_LATE + 1)]
        table = np.concatenate([*seen, *moved, *every])[:, chosen]
        triangle = reduced(table, quick.demand[chosen], run)
        for r in range(MOST_LATE + 2):
            for y in range(min(r, MOST_LATE) + 1):
                mixing = late_mixing(r, y)
                for i, (sign, width) in enumerate(forms):
                    whole = np.zeros((len(table), mixing.shape[1] + own))
                    whole[: len(mixing), :-own] = mixing
                    first = len(mixing) + own * (r * len(forms) + i)
                    whole[first : first + own, -own:] = np.eye(own)
                    yield triangle.fitted(whole).explained, sign, width, (r, y), smoothing


def _rate_of(samples: LoopSamples, reference: Floats) -> Floats:
    """Rate of a reference from row to row, stretch by stretch, shape (n,)."""
    rate = np.zeros(len(reference))
    for rows in samples.stretches:
        rate[rows] = np.diff(reference[rows], prepend=reference[rows.start]) / samples.period
    return rate


def _fed_terms(
    samples: LoopSamples, rate: Floats, sign: Callable[[Floats, float], Floats], width: float, summed: bool
) -> Floats:
    """A smooth sign of a rate of shape (n,), and its sum over time [s] where that is asked; shape (1 or 2, n)."""
    signs = sign(rate, width)
    if not summed:
        return signs[None]
    sums = np.zeros(len(signs))
    for rows in samples.stretches:
        sums[rows] = np.cumsum(signs[rows]) * samples.period
    return np.stack([signs, sums])


def _beside_fed(late: LoopSamples, fed: Floats, smoothing: float) -> Solved:
    """All terms of a law beside what is fed forward, shape (k, n), whose sizes come last."""
    chosen, run = law_rows(replace(late, most_rows=ROUGH_ROWS), smoothing)
    table = np.concatenate([law_terms(late, smoothing).T, fed])[:, chosen]
    return reduced(table, late.demand[chosen], run).fitted()
