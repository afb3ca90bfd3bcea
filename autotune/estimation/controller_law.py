"""The law of a position controller, and how it is found in what it made of reference and position.

u = kp·e + kd·d + ki·Σe·h + f·Δr/h + c with d ← d + α·((b·Δr − Δy)/h − d). For a fixed α this is linear in
the rest, so that least squares in a search over α finds them (Ljung, System Identification, 2nd ed., ch. 7).
b ≠ 1 is a drive with cascaded loops, f a velocity feedforward that the recording does not hold by itself. The
integral is known but for a constant between two clamps of the torque: every such run has one of its own.

Where that explains too little, reference and position may come late by whole samples (a host with dead time; a
drive that interpolates its set points and is at r[k−1] when row k is written), and the reference may act by itself:
g·r + a·r̈, where a cascade integrates the error of the velocity with a feedforward, and accelerates by the reference.

A drive's loop may work many times from one sample to the next. Below the frequency that models are compared at the
continuous form of its law can be computed from the samples; a twin then has its ticks between them.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from autotune.core.arrays import Flags, Floats, Integers
from autotune.estimation.data import CUTOFF
from autotune.estimation.policy import POLICY, Policy
from autotune.recordings.recording import Controller
from autotune.signals.filters import low_pass

SHORTEST_RUN = 50  # samples between two clamps
SHORTEST_STRETCH = 100  # samples
PIECE_SECONDS = 3.0
"""Of a run that shares a constant: a sum that a drive makes between the samples wanders away from theirs."""
MOST_ROWS = 40_000
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
IN_BAND = f"It was found below {CUTOFF:.0f} Hz: what the drive does between the samples is left out."
TICK = 250e-6
"""s, at which a drive's loop is simulated: its bandwidth is far below."""
BETWEEN_RATES = tuple(100.0 * 1.7**i for i in range(9))
"""1/s, of the filter of its velocity."""
BETWEEN_MOMENTS = (-0.5, 0.0, 0.5)
BETWEEN = "The drive's loop works between the samples, and is simulated so."
AS_MUCH = 1.1
"""Times the share that another law leaves: as much, within what counts and rounding make."""
_ROUGH_FILTERS = (0.05, 0.1, 0.15, 0.2, 0.3, 0.45, 0.7, 1.0)
_FILTERS = (0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)


@dataclass(frozen=True, slots=True)
class PositionController:
    """A position controller and how it was found.

    Attributes:
        kp, kd, ki, derivative_filter: as in `recording.Controller`.
        reference_rate: b, the part of the reference's rate in the derivative.
        velocity_feedforward: f, on the rate of the reference [N m s/rad].
        position_feedforward, acceleration_feedforward: g and a, on the reference and on its second difference.
        reference_delay, position_delay: samples by which the law sees either late.
        constant: torque that is always added where there is no integral to hold it [N m].
        explained: share of the variance of the torque demand, R²; nan where it could not be checked.
        in_band: found below the frequency that models are compared at; `explained` is the share there.
        smeared: share of the sample before in a recorded torque: a current loop's lag, read by the torque's own sensor.
        ticks: times that the law works from one sample to the next, its reference on a straight line between them;
            `derivative_filter` is of a whole sample all the same.
        exact: leaves no more than rounding of numbers, or of the recorded torque: the law works at the samples.
        source: `metadata` (the file's, verified), `identified`, `trusted` (the file's, which these data
            cannot verify) or `none`.
        why: what there is to say on it: why there is none, why it is trusted, or why the file's is not used.
    """

    kp: float = 0.0
    kd: float = 0.0
    ki: float = 0.0
    derivative_filter: float = 1.0
    reference_rate: float = 1.0
    velocity_feedforward: float = 0.0
    position_feedforward: float = 0.0
    acceleration_feedforward: float = 0.0
    reference_delay: int = 0
    position_delay: int = 0
    constant: float = 0.0
    explained: float = 0.0
    source: str = "none"
    why: str = ""
    in_band: bool = False
    smeared: float = 0.0
    exact: bool = False
    ticks: int = 1

    @property
    def usable(self) -> bool:
        """Whether it may drive a twin."""
        return self.source != "none"

    @property
    def gains(self) -> Floats:
        """As the compiled twin takes them."""
        return np.array(
            [
                self.kp,
                self.kd,
                self.ki,
                self.derivative_filter,
                self.reference_rate,
                float(self.position_delay),
            ]
        )

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of a controller that is used."""
        return (self.why,) if self.usable and self.why else ()

    def feedforward(self, reference: Floats, before: float, period: float) -> Floats:
        """What the reference alone causes [N m], shape (n,), as the law sees it; `before`: a sample earlier."""
        rate = np.diff(reference, prepend=before) / period
        change = np.diff(rate, prepend=rate[:1]) / period
        moved = self.velocity_feedforward * rate + self.acceleration_feedforward * change
        return np.asarray(moved + self.position_feedforward * reference + self.constant)

    def continuous_feedforward(self, reference: Floats, period: float) -> Floats:
        """The same of a law that works between the samples, as `between_terms` has it."""
        rate = np.gradient(reference, period)
        moved = self.velocity_feedforward * rate + self.acceleration_feedforward * np.gradient(rate, period)
        return np.asarray(moved + self.position_feedforward * reference + self.constant)


@dataclass(frozen=True, slots=True)
class LoopSamples:
    """What a controller is found in; arrays of shape (n,).

    Attributes:
        demand: torque less the feedforward that was recorded.
        clamped: rows at the torque limit.
        stretches: contiguous rows under position control.
        known: the controller that the file names.
        piece: longest run that shares a constant [s].
    """

    period: float
    reference: Floats
    position: Floats
    demand: Floats
    clamped: Flags
    stretches: tuple[slice, ...]
    known: Controller | None
    policy: Policy = POLICY
    most_rows: int = MOST_ROWS
    piece: float = np.inf


def law_from_data(samples: LoopSamples) -> PositionController:
    """The law that explains the demand best; its source is `none` where it explains too little to drive a twin."""
    found = _searched(samples, cascaded=True)
    if 1.0 - found.explained > EXACT:
        other = _searched(samples, cascaded=False)
        found = other if plainly_better(samples, other, found) else found
    if 1.0 - found.explained > NEARLY_EXACT:
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
        return replace(banded, why=f"{banded.why} {IN_BAND}", in_band=True)
    return replace(found, source="none")


def or_between(samples: LoopSamples, found: PositionController) -> PositionController:
    """The law, or that of a drive that works between the samples, where it leaves no more in the band.

    What works from sample to sample would tell itself by an exact law; where both explain alike, it is the drive's.
    """
    banded = _in_band(replace(samples, piece=PIECE_SECONDS))
    between = _searched_between(banded)
    rate = found
    if not found.in_band and found.explained > samples.policy.controller_explains:
        rate = _searched_late(banded)
    no_more = 1.0 - between.explained < AS_MUCH * (1.0 - rate.explained)
    enough = between.explained > samples.policy.controller_explains_in_band
    return between if no_more and enough and between.kp > 0.0 and between.kd > 0.0 else found


def _searched_between(samples: LoopSamples) -> PositionController:
    """The best law of a drive whose loop works between the samples, on columns below the compared frequency.

    There its continuous form can be computed from the samples: u = kp·e + kd·λ/(s + λ)·(b·ṙ − ẏ) + ki∫e and what the
    reference adds. The reference is late by whole samples; the torque is of a sample's moment, or a mean around it.
    """
    coarse = _first_look(samples)
    trials = []
    for r in range(MOST_LATE + 2):
        late = late_samples(coarse, r, 0)
        for rate in BETWEEN_RATES:
            terms = between_terms(late, rate)
            for moment in BETWEEN_MOMENTS:
                trials.append((_regressed_between(late, rate, moment, terms).explained, r, rate, moment))
    most = (1.0 - max(trials)[0]) * HARDLY_MORE
    _, r, rate, moment = max(t for t in trials if t[1] == min(t[1] for t in trials if 1.0 - t[0] <= most))
    late = late_samples(samples, r, 0)

    def unexplained(logarithm: float) -> float:
        return 1.0 - _regressed_between(late, math.exp(logarithm), moment).explained

    bounds = math.log(0.5 * rate), math.log(2.0 * rate)
    best = scipy.optimize.minimize_scalar(
        unexplained, bounds=bounds, method="bounded", options={"xatol": 0.01}
    )
    found = _regressed_between(late, math.exp(best.x), moment)
    ticks = max(2, round(samples.period / TICK))
    share = 1.0 - math.exp(-math.exp(best.x) * samples.period)
    why = f"{_how_late(samples.period)} {BETWEEN}"
    return replace(found, reference_delay=r, derivative_filter=share, ticks=ticks, in_band=True, why=why)


def _regressed_between(
    samples: LoopSamples, rate: float, moment: float, terms: Floats | None = None
) -> PositionController:
    """Gains of the continuous law by least squares; `moment` in samples after a row."""
    terms = between_terms(samples, rate) if terms is None else terms
    demand = samples.demand
    if moment != 0.0:
        demand = demand.copy()
        for rows in samples.stretches:
            demand[rows] = scipy.ndimage.shift(samples.demand[rows], moment, order=3, mode="nearest")
    return _solved(replace(samples, demand=demand), terms, min(1.0, rate * samples.period))


def between_terms(samples: LoopSamples, rate: float) -> Floats:
    """As `law_terms`, of the continuous law with its filter at `rate` [1/s], shape (n, 7)."""
    h = samples.period
    error = samples.reference - samples.position
    terms = np.zeros((len(error), 7))
    w = 0.5 * rate * h
    coefficients = [w, w], [1.0 + w, w - 1.0]
    for rows in samples.stretches:
        moved, wanted = (np.gradient(values[rows], h) for values in (samples.position, samples.reference))
        held = error[rows] * ~samples.clamped[rows] * h
        terms[rows, 1] = -scipy.signal.lfilter(*coefficients, moved)
        terms[rows, 2] = np.cumsum(held) - 0.5 * held
        terms[rows, 3] = scipy.signal.lfilter(*coefficients, wanted)
        terms[rows, 4] = wanted
        terms[rows, 6] = np.gradient(wanted, h)
    terms[:, 0], terms[:, 5] = error, samples.reference
    return terms


def _in_band(samples: LoopSamples) -> LoopSamples:
    """The same below the frequency that models are compared at.

    What a drive makes of counts between the samples, and the noise of a torque sensor, lie above it. Low-passes and
    the law may change places: both are linear, but for the clamped sum.
    """
    banded = [samples.reference.copy(), samples.position.copy(), samples.demand.copy()]
    for rows in samples.stretches:
        for values in banded:
            values[rows] = low_pass(values[rows], CUTOFF, samples.period)
    reach = 2 * round(0.5 / (CUTOFF * samples.period)) + 1
    near = scipy.ndimage.maximum_filter1d(samples.clamped, reach)
    return replace(samples, reference=banded[0], position=banded[1], demand=banded[2], clamped=near)


def plainly_better(samples: LoopSamples, one: PositionController, other: PositionController) -> bool:
    return 1.0 - one.explained < samples.policy.controller_better * (1.0 - other.explained)


def _searched(samples: LoopSamples, cascaded: bool) -> PositionController:
    """Least squares over the derivative filter: a law with its own share of the reference's rate, or with
    a velocity feedforward."""

    def unexplained(smoothing: float) -> float:
        return 1.0 - _regressed(samples, float(smoothing), cascaded).explained

    costs = [unexplained(value) for value in _FILTERS]
    best = int(np.argmin(costs))
    bounds = _FILTERS[max(best - 1, 0)], _FILTERS[min(best + 1, len(_FILTERS) - 1)]
    smoothing = scipy.optimize.minimize_scalar(
        unexplained, bounds=bounds, method="bounded", options={"xatol": 1e-4}
    ).x
    found, at_one = (_regressed(samples, float(value), cascaded) for value in (smoothing, 1.0))
    return at_one if 1.0 - at_one.explained <= 1.0001 * (1.0 - found.explained) else found


def _searched_late(samples: LoopSamples) -> PositionController:
    """The best of the laws whose reference and position come late; first roughly, over delays and filters."""
    coarse = _first_look(samples)
    trials = [
        (_regressed_late(late_samples(coarse, r, y), smoothing), r, y)
        for r in range(MOST_LATE + 2)
        for y in range(min(r, MOST_LATE) + 1)
        for smoothing in _ROUGH_FILTERS
    ]
    _, r, y = max(trials, key=lambda trial: trial[0].explained)
    late = late_samples(samples, r, y)

    def unexplained(smoothing: float) -> float:
        return 1.0 - _regressed_late(late, float(smoothing)).explained

    costs = [unexplained(value) for value in _FILTERS]
    best = int(np.argmin(costs))
    bounds = _FILTERS[max(best - 1, 0)], _FILTERS[min(best + 1, len(_FILTERS) - 1)]
    smoothing = scipy.optimize.minimize_scalar(
        unexplained, bounds=bounds, method="bounded", options={"xatol": 1e-4}
    ).x
    found = _regressed_late(late, float(smoothing))
    return replace(found, reference_delay=r, position_delay=y)


def _searched_smeared(samples: LoopSamples, near: PositionController) -> PositionController:
    """The best plain law whose torque was recorded with a part of the sample before; delays as those of `near` or one
    off, as what a current loop smears was taken there for a delay, or for terms of the reference."""
    coarse = _first_look(samples)
    begin = [near.derivative_filter, 0.1]

    def best(late: LoopSamples, start: list[float], simplex: float) -> tuple[float, list[float]]:
        def left(x: Floats) -> float:
            inside = np.clip(x, [_FILTERS[0], 0.0], [1.0, MOST_SMEARED])
            law = _regressed(smeared_samples(late, float(inside[1])), float(inside[0]), cascaded=False)
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
    law = _regressed(smeared_samples(late, share), smoothing, cascaded=False)
    why = _how_late(samples.period) if d else ""
    return replace(law, reference_delay=d, position_delay=d, smeared=share, why=why)


def smeared_samples(samples: LoopSamples, share: float) -> LoopSamples:
    """The same with a share of the sample before in reference and position: so a smeared torque answers to them."""
    if share == 0.0:
        return samples
    before = late_samples(samples, 1, 1)
    return replace(
        samples,
        reference=(1.0 - share) * samples.reference + share * before.reference,
        position=(1.0 - share) * samples.position + share * before.position,
    )


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


def late_samples(samples: LoopSamples, reference_delay: int, position_delay: int) -> LoopSamples:
    """The same with reference and position as a law sees them that is late by whole samples."""
    reference, position = samples.reference.copy(), samples.position.copy()
    for late, values, source in (
        (reference_delay, reference, samples.reference),
        (position_delay, position, samples.position),
    ):
        for rows in samples.stretches if late else ():
            values[rows] = delayed(source[rows], late, float(source[rows.start]))
    return replace(samples, reference=reference, position=position)


def delayed(values: Floats, late: int, before: float) -> Floats:
    """Values `late` samples ago, shape (n,); `before` where that is before the first."""
    if late == 0:
        return values
    shown: Floats = np.concatenate([np.full(min(late, len(values)), before), values[:-late]])
    return shown


def _regressed_late(samples: LoopSamples, smoothing: float) -> PositionController:
    """Gains of the law with all terms of the reference, by least squares."""
    return _solved(samples, law_terms(samples, smoothing), smoothing)


def _solved(samples: LoopSamples, terms: Floats, smoothing: float) -> PositionController:
    """Gains by least squares on terms of shape (n, 7)."""
    rows, run = regular_rows(samples, smoothing)
    every = slice(None, None, max(1, int(rows.sum()) // samples.most_rows))
    chosen = np.flatnonzero(rows)[every]
    table, demand = terms[chosen], samples.demand[chosen]
    centred = less_run_means(np.column_stack([table, demand]), run[every])
    size = np.maximum(np.linalg.norm(centred[:, :-1], axis=0), 1e-300)
    solution = np.linalg.lstsq(centred[:, :-1] / size, centred[:, -1], rcond=1e-10)[0] / size
    kp, kd, ki, wanted, velocity, place, acceleration = (float(value) for value in solution)
    held = abs(ki) >= 1e-9 * abs(kp) and ki > 0.0
    return PositionController(
        kp,
        kd,
        max(ki, 0.0),
        smoothing,
        reference_rate=wanted / kd if kd != 0.0 else 0.0,
        velocity_feedforward=velocity,
        position_feedforward=place,
        acceleration_feedforward=acceleration,
        constant=0.0 if held else float(np.mean(demand - table @ solution)),
        explained=share_explained(centred[:, -1] - centred[:, :-1] @ solution, centred[:, -1]),
        source="identified",
        why=_how_late(samples.period),
    )


def _how_late(period: float) -> str:
    return (
        "The controller was identified with its reference or position late by whole samples, as a host with dead time "
        f"or a drive that interpolates its set points has it ({1e3 * period:.3g} ms a sample)."
    )


def _regressed(samples: LoopSamples, smoothing: float, cascaded: bool) -> PositionController:
    """Gains by least squares with a constant for every run."""
    rows, run = regular_rows(samples, smoothing)
    every = slice(None, None, max(1, int(rows.sum()) // MOST_ROWS))
    chosen = np.flatnonzero(rows)[every]
    terms, demand = law_terms(samples, smoothing)[chosen], samples.demand[chosen]
    if cascaded:
        table = terms[:, :4]
    else:
        table = np.column_stack([terms[:, 0], terms[:, 1] + terms[:, 3], terms[:, 2], terms[:, 4]])
    centred = less_run_means(np.column_stack([table, demand]), run[every])
    size = np.maximum(np.linalg.norm(centred[:, :4], axis=0), 1e-300)
    solution = np.linalg.lstsq(centred[:, :4] / size, centred[:, 4], rcond=1e-12)[0] / size
    kp, kd, ki, last = (float(value) for value in solution)
    rest = centred[:, 4] - centred[:, :4] @ solution
    held = abs(ki) >= 1e-9 * abs(kp) and ki > 0.0
    return PositionController(
        kp,
        kd,
        max(ki, 0.0),
        smoothing,
        reference_rate=(last / kd if kd != 0.0 else 0.0) if cascaded else 1.0,
        velocity_feedforward=0.0 if cascaded else last,
        constant=0.0 if held else float(np.mean(demand - table @ solution)),
        explained=share_explained(rest, centred[:, 4]),
        source="identified",
    )


def share_explained(rest: Floats, demand: Floats) -> float:
    return 1.0 - float(np.var(rest)) / max(float(np.var(demand)), 1e-300)


def law_terms(samples: LoopSamples, smoothing: float) -> Floats:
    """Regressors, shape (n, 7): e, filtered rate of −y, held sum of e, filtered rate of r, rate of r, r, r̈."""
    h = samples.period
    error = samples.reference - samples.position
    terms = np.zeros((len(error), 7))
    terms[:, 0] = error
    coefficients = [smoothing], [1.0, smoothing - 1.0]
    for rows in samples.stretches:
        moved = np.diff(samples.position[rows], prepend=samples.position[rows.start]) / h
        wanted = np.diff(samples.reference[rows], prepend=samples.reference[rows.start]) / h
        terms[rows, 1] = -scipy.signal.lfilter(*coefficients, moved)
        terms[rows, 2] = np.cumsum(error[rows] * ~samples.clamped[rows]) * h
        terms[rows, 3] = scipy.signal.lfilter(*coefficients, wanted)
        terms[rows, 4] = wanted
        terms[rows, 5] = samples.reference[rows]
        terms[rows, 6] = np.diff(wanted, prepend=wanted[:1]) / h
    return terms


def regular_rows(samples: LoopSamples, smoothing: float) -> tuple[Flags, Integers]:
    """Rows that tell the law, shape (n,), and the number of the run that each of them belongs to.

    Not the clamped ones, nor those after a start where the derivative still remembers what was before it, nor
    runs so short that their constant would explain them.
    """
    kept = np.zeros(len(samples.demand), dtype=np.bool_)
    number = np.zeros(len(samples.demand), dtype=np.int64)
    count = 0
    longest = max(1.0, samples.piece / samples.period)
    for rows in samples.stretches:
        if rows.stop - rows.start < SHORTEST_STRETCH:
            continue
        free = ~samples.clamped[rows]
        free[: min(len(free) // 4, max(20, round(10.0 / smoothing)))] = False
        edges = np.flatnonzero(np.diff(np.concatenate([[False], free, [False]]).astype(np.int8)))
        for start, stop in (edges.reshape(-1, 2) + rows.start).tolist():
            if stop - start >= SHORTEST_RUN:
                kept[start:stop] = True
                pieces = max(1, int((stop - start) // longest))
                number[start:stop] = count + np.arange(stop - start) * pieces // (stop - start)
                count += pieces
    return kept, number[kept]


def less_run_means(values: Floats, run: Integers) -> Floats:
    """Values of shape (m, k) less their mean in the run that each row belongs to; `run` of shape (m,)."""
    count = np.maximum(np.bincount(run), 1)
    means = np.column_stack([np.bincount(run, column) / count for column in values.T])
    return np.asarray(values - means[run])
