"""The law of a position controller, and its gains from what it made of reference and position.

u = kp·e + kd·d + ki·Σe·h + f·Δr/h + c with d ← d + α·((b·Δr − Δy)/h − d). For a fixed α this is linear in
the rest: least squares give it (Ljung, System Identification, 2nd ed., ch. 7).
b ≠ 1 is a drive with cascaded loops, f a velocity feedforward that the recording does not hold by itself. The
integral is known but for a constant between two clamps of the torque: every such run has one of its own.

Reference and position may come late by whole samples (a host with dead time; a drive that interpolates its set points
and is at r[k−1] when row k is written), and the reference may act by itself: g·r + a·r̈, where a cascade integrates
the error of the velocity with a feedforward, and accelerates by the reference.

A drive's loop may work many times from one sample to the next. Below the frequency that models are compared at the
continuous form of its law can be computed from the samples; a twin then has its ticks between them.

Which of these laws it is: `controller_search`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy

from autotune.core.arrays import Flags, Floats, Integers
from autotune.estimation.policy import POLICY, Policy
from autotune.recordings.recording import Controller

SHORTEST_RUN = 50  # samples between two clamps
SHORTEST_STRETCH = 100  # samples
MOST_ROWS = 40_000
ALIKE = 1e-10
"""Of the largest singular value: terms that differ by less are one, and share its gain."""


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


def fitted_pid(samples: LoopSamples, smoothing: float, cascaded: bool) -> PositionController:
    """Gains by least squares of a law with its own share of the reference's rate, or with a velocity feedforward."""
    terms = law_terms(samples, smoothing)
    if cascaded:
        table = terms[:, :4]
    else:
        table = np.column_stack([terms[:, 0], terms[:, 1] + terms[:, 3], terms[:, 2], terms[:, 4]])
    fitted = _least_squares(samples, table, smoothing)
    kp, kd, ki, last = fitted.gains
    return PositionController(
        kp,
        kd,
        max(ki, 0.0),
        smoothing,
        reference_rate=(last / kd if kd != 0.0 else 0.0) if cascaded else 1.0,
        velocity_feedforward=0.0 if cascaded else last,
        constant=fitted.constant,
        explained=fitted.explained,
        source="identified",
    )


def fitted_whole(samples: LoopSamples, terms: Floats, smoothing: float) -> PositionController:
    """Gains by least squares of the law with all terms of the reference, of shape (n, 7) as in `law_terms`."""
    fitted = _least_squares(samples, terms, smoothing)
    kp, kd, ki, wanted, velocity, place, acceleration = fitted.gains
    return PositionController(
        kp,
        kd,
        max(ki, 0.0),
        smoothing,
        reference_rate=wanted / kd if kd != 0.0 else 0.0,
        velocity_feedforward=velocity,
        position_feedforward=place,
        acceleration_feedforward=acceleration,
        constant=fitted.constant,
        explained=fitted.explained,
        source="identified",
    )


@dataclass(frozen=True, slots=True)
class _Fitted:
    """Gains of the terms, the constant where there is no integral to hold it, and the share explained."""

    gains: list[float]
    constant: float
    explained: float


def _least_squares(samples: LoopSamples, terms: Floats, smoothing: float) -> _Fitted:
    """The demand by terms of shape (n, k), with a constant for every run."""
    rows, run = regular_rows(samples, smoothing)
    every = slice(None, None, max(1, int(rows.sum()) // samples.most_rows))
    chosen = np.flatnonzero(rows)[every]
    table, demand = terms[chosen], samples.demand[chosen]
    centred = less_run_means(np.column_stack([table, demand]), run[every])
    size = np.maximum(np.linalg.norm(centred[:, :-1], axis=0), 1e-300)
    gains = np.linalg.lstsq(centred[:, :-1] / size, centred[:, -1], rcond=ALIKE)[0] / size
    kp, ki = float(gains[0]), float(gains[2])
    held = abs(ki) >= 1e-9 * abs(kp) and ki > 0.0
    return _Fitted(
        [float(value) for value in gains],
        0.0 if held else float(np.mean(demand - table @ gains)),
        share_explained(centred[:, -1] - centred[:, :-1] @ gains, centred[:, -1]),
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
