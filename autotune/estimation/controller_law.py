"""The law of a position controller, and its gains from what it made of reference and position.

u = kp·e + kd·d + ki·Σe·h + f·Δr/h + c with d ← d + α·((b·Δr − Δy)/h − d). For a fixed α this is linear in
the rest: least squares give it (Ljung, System Identification, 2nd ed., ch. 7).
b ≠ 1 is a drive with cascaded loops, f a velocity feedforward that the recording does not hold by itself. The
integral is known but for a constant between two clamps of the torque: every such run has one of its own.

Reference and position may come late by whole samples (a host with dead time; a drive that interpolates its set points
and is at r[k−1] when row k is written), and the reference may act by itself: g·r + a·r̈, where a cascade integrates
the error of the velocity with a feedforward, and accelerates by the reference.

A drive's loop may work many times from one sample to the next, on set points that it interpolates. Below the frequency
that models are compared at what it makes of them can be computed from the samples; a twin has its ticks between them.
A torque that is recorded as at the sample is no mean: where set points are on straight lines, the loop answers to the
change of their speed after each, and a sample sees always the same moment of that.

Which of these laws it is: `controller_search`, `controller_between`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy

from autotune.core.arrays import Flags, Floats, Integers
from autotune.core.remembered import LastOf
from autotune.estimation.data import step_of
from autotune.estimation.policy import POLICY, Policy
from autotune.recordings.recording import Controller
from autotune.signals.between_samples import (
    around,
    bend_between,
    delayed,
    filtered_rates,
    filtered_terms,
    finer,
    later,
    rate_between,
    row_means,
)
from autotune.signals.runs import runs_of
from autotune.signals.triangle import Solved, reduced

SHORTEST_RUN = 50  # samples between two clamps
BEND = 2
"""Row of the reference's second difference in `fine_reference`."""
NO_FILTER = 1e-12
"""Of a jump: what is left of it after a sample, at least, where a rate is asked of a law without filter."""
SHORTEST_STRETCH = 100  # samples
MOST_ROWS = 40_000
MOMENT, NEXT, BEFORE, EVE = "moment", "next", "before", "eve"
TAKEN = (MOMENT, NEXT, BEFORE)
"""A recorded torque is that of the sample's moment, or the mean until the next, or since the one before.

Or that of the moment before the drive takes its next set point in (`EVE`): of all that moves on smoothly the same as at
the sample, but what is held from set point to set point shows as it was.
"""


@dataclass(frozen=True, slots=True)
class PositionController:
    """A position controller and how it was found.

    Attributes:
        kp, kd, ki, derivative_filter: as in `recording.Controller`.
        reference_rate: b, the part of the reference's rate in the derivative.
        velocity_feedforward: f, on the rate of the reference [N m s/rad].
        position_feedforward, acceleration_feedforward: g and a, on the reference and on its second difference.
        reference_delay, position_delay: samples by which the law sees either late.
        part_late: part of a sample by which it sees both later still: a demand that acts as much later.
        constant: torque that is always added where there is no integral to hold it [N m].
        explained: share of the variance of the torque demand, R²; nan where it could not be checked.
        in_band: found below the frequency that models are compared at; `explained` is the share there.
        smeared: share of the sample before in a recorded torque: a current loop's lag, read by the torque's own sensor.
        ticks: times that the law works from one sample to the next; `derivative_filter` is of a whole sample all the
            same. `cubic`: its reference is on cubics between them, else on straight lines. `smooth`: what it feeds
            forward of rate and acceleration is that of the set points, as where a planner gives them with their rates,
            and on straight lines between them; else it is that of the step to each, and held. `held`: its reference
            is no line, but stays at each set point until the next. `rate_grows`: share of the rate fed forward then
            that comes while it stays, as where the loop sums that rate; all of it is there as it is read.
        own_ticks: times that the drive's loop works, where that of its twin takes fewer, `ticks`; 0 where it does not.
        taken: how the torque of such a law was recorded, one of `TAKEN`.
        answer_delay: samples by which the torque of such a law answers late to all that it sees: what its loop takes to
            be computed, and a current loop to follow. `sensed`: it is the law of the torque by its own sensor.
        demanded: it is the law of the demand, though the torque by its sensor is the quieter one (`quieter`).
        stepped: what it holds of the acceleration from set point to set point acts as soon as the drive takes the set
            point in, however late it answers to the axis.
        adrift: where the counts of its encoder lie the twin does not know, and has them elsewhere in every run.
        slow: found by slow rows, as rows are written late (`LoopSamples.weight`). `quick`: by quick ones, as counts are
            coarse. `prompt`: by less than half of the rows that move, which it explains to rounding.
        asked: frequency [Hz] above which what it asks for along the recorded motion is compared, and not the torque as
            it was recorded; 0 where that is compared.
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
    own_ticks: int = 0
    cubic: bool = False
    smooth: bool = False
    held: bool = False
    rate_grows: float = 0.0
    taken: str = "next"
    answer_delay: float = 0.0
    stepped: bool = False
    sensed: bool = False
    demanded: bool = False
    adrift: bool = False
    slow: bool = False
    quick: bool = False
    prompt: bool = False
    asked: float = 0.0
    part_late: float = 0.0

    @property
    def usable(self) -> bool:
        """Whether it may drive a twin."""
        return self.source != "none"

    @property
    def feeds_rate(self) -> bool:
        """Whether it feeds the rate of what it holds forward, and not just what makes up for a delay."""
        return self.velocity_feedforward > 0.5 * self.kd

    @property
    def within(self) -> bool:
        """Whether the drive works between the samples, also where its law is one of the samples."""
        return not self.exact and (self.in_band or self.reference_delay > self.position_delay)

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
                self.position_delay + self.part_late if self.ticks == 1 else self.ticks_late,
            ]
        )

    def sooner(self) -> PositionController:
        """The law that sees reference and position a sample sooner."""
        return replace(self, reference_delay=self.reference_delay - 1, position_delay=self.position_delay - 1)

    def on_ticks(self, ticks: int, period: float) -> PositionController:
        """The same law of a loop that works so many times from one sample to the next; the period in s.

        Its sum has the error of the tick already, half a tick more than the integral: what that is less of is the
        proportional part's. A cascade that feeds no velocity forward has a following error so large that without this
        the same gains ask for a multiple of what the axis needs.
        """
        sooner = 0.5 * period * (1.0 / self.ticks - 1.0 / ticks)
        if self.held:
            return self._held_longer(ticks, sooner)
        return replace(self, ticks=ticks, kp=self.kp + self.ki * sooner)

    def _held_longer(self, ticks: int, sooner: float) -> PositionController:
        """The same of a drive that holds its set points, where half a tick is by `sooner` shorter [s].

        In the sum of the error set points that are held are behind a line by as much more. What is read as a row
        begins has half a tick more of the position in that sum, as ever; a tick before it has half of one less, and all
        of the position a tick older; a mean has no more of it, and answers to a position half a tick older.
        """
        more, older = {MOMENT: (1.0, 0.0), EVE: (-1.0, 2.0)}.get(self.taken, (0.0, 1.0))
        return replace(
            self,
            ticks=ticks,
            kp=self.kp + more * self.ki * sooner,
            position_feedforward=self.position_feedforward + self.ki * sooner,
            velocity_feedforward=self.velocity_feedforward + older * self.kp * sooner,
            acceleration_feedforward=self.acceleration_feedforward + older * self.kd * sooner,
        )

    def answering(self, late: int) -> PositionController:
        """The law whose torque answers so many samples later."""
        if late == 0:
            return self
        return replace(self, answer_delay=late + max(self.answer_delay, 0.5 / self.drive_ticks))

    def filter_rate(self, period: float) -> float:
        """Rate of the velocity's filter [1/s]; the period in s. Without a filter one that a sample ends by far."""
        return -math.log(max(1.0 - self.derivative_filter, NO_FILTER)) / period

    @property
    def drive_ticks(self) -> int:
        """Times that the drive's loop works from one sample to the next."""
        return self.own_ticks or self.ticks

    def on_fewer(self, ticks: int, period: float) -> PositionController:
        """The same where a twin takes so many ticks for it, which its drive does not."""
        return replace(self.on_ticks(ticks, period), own_ticks=self.drive_ticks)

    def of_its_drive(self, period: float) -> PositionController:
        """The same on all ticks of its drive."""
        return replace(self.on_ticks(self.drive_ticks, period), own_ticks=0)

    @property
    def held_longer(self) -> float:
        """Samples by which a torque of fewer ticks is later than the drive's own, as each is held until the next."""
        few, own = (max(0.5 / ticks - self.answer_delay, 0.0) for ticks in (self.ticks, self.drive_ticks))
        return few - own

    @property
    def ticks_late(self) -> float:
        """Ticks of its loop by which a twin sees everything late: held for a tick a torque is half of one late."""
        return max(self.answer_delay * self.ticks - 0.5, 0.0)

    @property
    def terms_gains(self) -> Floats:
        """Gains of `law_terms` or `between_table`, shape (7,)."""
        kd = self.kd
        law = [self.kp, kd, self.ki, kd * self.reference_rate, self.velocity_feedforward]
        return np.array([*law, self.position_feedforward, self.acceleration_feedforward])

    @property
    def notes(self) -> tuple[str, ...]:
        """What a user should know of a controller that is used."""
        return (self.why,) if self.usable and self.why else ()

    def feedforward(self, reference: Floats, before: float, period: float) -> Floats:
        """What the reference alone causes [N m], shape (n,), as the law sees it; `before`: a sample earlier."""
        rate = np.diff(reference, prepend=before) / period
        change = np.diff(rate, prepend=rate[:1]) / period
        if self.smooth:
            rate, change = around(reference, period)
        moved = self.velocity_feedforward * rate + self.acceleration_feedforward * change
        return np.asarray(moved + self.position_feedforward * reference + self.constant)

    def feedforward_between(self, reference: Floats, fine: Floats, period: float, cycles: int = 0) -> Floats:
        """The same of a law that works between the samples, shape (n·ticks,), as `between_table` has it.

        `cycles`: of the answer's delay those by which the drive takes set points in later than it is read.
        """
        bend = self.acceleration_feedforward * bend_between(reference, period, self.ticks, self.smooth)
        rate = self.velocity_feedforward * self.rate_of(reference, fine, period)
        moved = np.asarray(self.position_feedforward * fine + rate + self.constant)
        return later(moved, self.ticks_late) + later(
            bend, cycles * self.ticks if self.stepped else self.ticks_late
        )

    def between(self, reference: Floats) -> Floats:
        """The reference of shape (n,) as the drive has it from each set point to the next, shape (n·ticks,)."""
        return np.repeat(reference, self.ticks) if self.held else finer(reference, self.ticks, self.cubic)

    def rate_of(self, reference: Floats, fine: Floats, period: float) -> Floats:
        """Its rate there, `fine` the reference itself; where that stays at each set point, of the last step."""
        if self.held:
            steps = np.diff(reference, prepend=reference[:1]) / period
            tick = np.arange(1.0, self.ticks + 1.0) / self.ticks
            return np.outer(steps, 1.0 - self.rate_grows * (1.0 - tick)).ravel()
        return rate_between(reference, fine, period, self.ticks, self.smooth)

    @property
    def read_off(self) -> bool:
        """Whether its torque was read at a moment of what steps with each set point, and so is not what acts.

        On lines from one to the next it is the set points' rate that steps, and the derivative's part with it: read as
        the row begins that part is the one of the row before, and has died down since.
        """
        on_lines = self.ticks > 1 and not self.cubic and self.taken == MOMENT
        return on_lines or (self.held and self.taken in (MOMENT, EVE))

    def held_until_read(self, reference: Floats, period: float) -> Floats:
        """What is missing in the mean of two readings, each of the moment before a step, of a feedforward that is held.

        Of the torque from each sample to the next, shape (n,) [N m]; on the reference as the law sees it, shape (n,).
        The readings hold the mean of the steps before and now, and the axis feels the one of now.
        """
        if self.taken != EVE:
            return np.zeros(len(reference))
        held = bend_between(reference, period, 1, False)
        return np.asarray(0.5 * self.acceleration_feedforward * np.diff(held, prepend=held[:1]))


@dataclass(frozen=True, slots=True)
class LoopSamples:
    """What a controller is found in; arrays of shape (n,).

    Attributes:
        demand: torque less the feedforward that was recorded.
        clamped: rows at the torque limit.
        stretches: contiguous rows under position control.
        known: the controller that the file names.
        piece: longest run that shares a constant [s].
        weight: of each row's square; all alike where there is none.
        folded: share of the demand below the compared frequency that is folded down there, beside any law.
        rounded: step that the torque was rounded to before a feedforward was taken off it; None where none was.
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
    weight: Floats | None = None
    folded: float = 0.0
    rounded: float | None = None

    @property
    def step(self) -> float:
        """Step that the demand was rounded to [N m]; 0 for none."""
        return step_of(self.demand) if self.rounded is None else self.rounded

    def weight_of(self, rows: Integers) -> Floats | None:
        """Weights of some rows, of the same shape."""
        return None if self.weight is None else np.asarray(self.weight[rows])


def late_samples(samples: LoopSamples, reference_delay: int, position_delay: int) -> LoopSamples:
    """The same with reference and position as a law sees them that is late by whole samples."""
    reference = late_rows(samples.reference, samples, reference_delay)
    position = late_rows(samples.position, samples, position_delay)
    return replace(samples, reference=reference, position=position)


def late_rows(values: Floats, samples: LoopSamples, late: int) -> Floats:
    """Values of shape (n,) some samples ago, in each stretch."""
    shown = values.copy()
    for rows in samples.stretches if late else ():
        shown[rows] = delayed(values[rows], late, float(values[rows.start]))
    return shown


def late_places(samples: LoopSamples, rows: Integers, late: int) -> Integers:
    """Where values are that rows see some samples late: their own place less the delay, in the same stretch."""
    starts = np.array([stretch.start for stretch in samples.stretches])
    first = starts[np.searchsorted(starts, rows, side="right") - 1]
    return np.asarray(np.maximum(rows - late, first))


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
    kp, kd, ki, last = fitted.gains.tolist()
    return PositionController(
        kp,
        kd,
        max(ki, 0.0),
        smoothing,
        reference_rate=(last / kd if kd != 0.0 else 0.0) if cascaded else 1.0,
        velocity_feedforward=0.0 if cascaded else last,
        constant=_constant(fitted),
        explained=fitted.explained,
        source="identified",
    )


def fitted_whole(samples: LoopSamples, terms: Floats, smoothing: float) -> PositionController:
    """Gains by least squares of the law with all terms of the reference, of shape (n, 7) as in `law_terms`."""
    return whole_law(_least_squares(samples, terms, smoothing), smoothing)


def whole_law(fitted: Solved, smoothing: float) -> PositionController:
    """The law of gains of the terms as in `law_terms`."""
    kp, kd, ki, wanted, velocity, place, acceleration = fitted.gains.tolist()
    return PositionController(
        kp,
        kd,
        max(ki, 0.0),
        smoothing,
        reference_rate=wanted / kd if kd != 0.0 else 0.0,
        velocity_feedforward=velocity,
        position_feedforward=place,
        acceleration_feedforward=acceleration,
        constant=_constant(fitted),
        explained=fitted.explained,
        source="identified",
    )


def law_rows(samples: LoopSamples, smoothing: float) -> tuple[Integers, Integers]:
    """Rows that a law is fitted to, of all that tell it, shape (m,), and the run of each of them."""
    rows, run = regular_rows(samples, smoothing)
    every = slice(None, None, max(1, int(rows.sum()) // samples.most_rows))
    return np.flatnonzero(rows)[every], run[every]


def _least_squares(samples: LoopSamples, terms: Floats, smoothing: float) -> Solved:
    """The demand by terms of shape (n, k), with a constant for every run."""
    chosen, run = law_rows(samples, smoothing)
    return reduced(terms[chosen].T, samples.demand[chosen], run).fitted()


def _constant(fitted: Solved) -> float:
    """The constant where there is no integral to hold it."""
    kp, ki = float(fitted.gains[0]), float(fitted.gains[2])
    held = abs(ki) >= 1e-9 * abs(kp) and ki > 0.0
    return 0.0 if held else fitted.rest


def share_explained(rest: Floats, demand: Floats) -> float:
    return 1.0 - float(np.var(rest)) / max(float(np.var(demand)), 1e-300)


def law_terms(samples: LoopSamples, smoothing: float, smooth: bool = False) -> Floats:
    """Regressors, shape (n, 7): e, filtered rate of −y, held sum of e, filtered rate of r, rate of r, r, r̈.

    Where set points come with their rates (`PositionController.smooth`) the rate of r and r̈ are around each row.
    """
    known, moved = _UNFILTERED.answer((samples,), lambda: _unfiltered(samples))
    terms = known.copy()
    filtered_terms(moved, known[:, 4], _edges(samples), smoothing, terms)
    for rows in samples.stretches if smooth else ():
        terms[rows, 4], terms[rows, 6] = around(samples.reference[rows], samples.period)
    return terms


def _edges(samples: LoopSamples) -> Integers:
    """First row of each stretch and the one after its last, shape (stretches, 2)."""
    edges = [(rows.start, rows.stop) for rows in samples.stretches]
    return np.array(edges, dtype=np.int64).reshape(-1, 2)


_UNFILTERED: LastOf[tuple[Floats, Floats]] = LastOf(2)


def _unfiltered(samples: LoopSamples) -> tuple[Floats, Floats]:
    """Terms as in `law_terms`, 0 where they are filtered, and the rate of the position, shape (n,)."""
    h = samples.period
    error = samples.reference - samples.position
    terms, moved = np.zeros((len(error), 7)), np.zeros(len(error))
    terms[:, 0] = error
    for rows in samples.stretches:
        moved[rows] = np.diff(samples.position[rows], prepend=samples.position[rows.start]) / h
        wanted = np.diff(samples.reference[rows], prepend=samples.reference[rows.start]) / h
        terms[rows, 2] = np.cumsum(error[rows] * ~samples.clamped[rows]) * h
        terms[rows, 4] = wanted
        terms[rows, 5] = samples.reference[rows]
        terms[rows, 6] = np.diff(wanted, prepend=wanted[:1]) / h
    return terms, moved


def taken_at(fine: Floats, ticks: int, taken: str) -> Floats:
    """Rows of values of shape (n·ticks,) as a torque is recorded, shape (n,)."""
    table = fine.reshape(-1, ticks)
    if taken in (MOMENT, EVE):
        return table[:, 0].copy()
    mean = row_means(table)
    return np.asarray(np.concatenate([mean[:1], mean[:-1]]) if taken == BEFORE else mean)


def fine_position(samples: LoopSamples, ticks: int) -> Floats:
    """Position and its sum between the samples, shape (2, n·ticks)."""
    step = samples.period / ticks
    terms = np.zeros((2, len(samples.position) * ticks))
    for rows in samples.stretches:
        inside = slice(rows.start * ticks, rows.stop * ticks)
        values = samples.position[rows]
        fine = finer(values, ticks, cubic=False)
        at = np.arange((len(values) - 1) * ticks) / ticks
        fine[: len(at)] = scipy.interpolate.make_interp_spline(np.arange(len(values)), values, 3)(at)
        terms[:, inside] = fine, step * np.cumsum(fine - fine[0])
    return terms


def fine_reference(samples: LoopSamples, law: PositionController) -> Floats:
    """The same of the reference, its second difference and its rate, as a law has them; shape (4, n·ticks)."""
    ticks, step = law.ticks, samples.period / law.ticks
    terms = np.zeros((4, len(samples.reference) * ticks))
    for rows in samples.stretches:
        inside = slice(rows.start * ticks, rows.stop * ticks)
        fine = law.between(samples.reference[rows])
        summed = step * np.cumsum(fine - samples.position[rows.start])
        bend = bend_between(samples.reference[rows], samples.period, ticks, law.smooth)
        moved = law.rate_of(samples.reference[rows], fine, samples.period)
        terms[:, inside] = fine, summed, bend, moved
    return terms


def filtered_rate(samples: LoopSamples, fine: Floats, ticks: int, rate: float) -> Floats:
    """Rate of values between the samples through a filter at `rate` [1/s], shape (n·ticks,)."""
    step = samples.period / ticks
    moved = np.zeros(len(fine))
    edges = ticks * _edges(samples)
    filtered_rates(fine, edges, step, float(1.0 - np.exp(-rate * step)), moved)
    return moved


def between_terms(samples: LoopSamples, law: PositionController, rate: float) -> Floats:
    """Regressors of a law that works between the samples, as its torque is recorded: as `law_terms`, shape (n, 7)."""
    late = late_samples(samples, law.reference_delay, 0)
    fine = fine_reference(late, law), fine_position(samples, law.ticks)
    rates = np.array([filtered_rate(samples, one[0], law.ticks, rate) for one in fine])
    wanted = reference_answered(samples, fine[0], law)
    moved, filtered = (answered(samples, terms, law) for terms in (fine[1], rates))
    error, summed = wanted[0] - moved[0], wanted[1] - moved[1]
    return np.column_stack([error, -filtered[1], summed, filtered[0], wanted[3], wanted[0], wanted[2]])


def answered(samples: LoopSamples, terms: Floats, law: PositionController) -> Floats:
    """Rows of terms between the samples, shape (k, n·ticks), as the torque that answers to them is recorded, (k, n).

    Read before a drive takes in a set point that it holds, it is what the loop asked for a tick ago.
    """
    if law.held and law.taken == EVE:
        terms = np.concatenate([terms[:, :1], terms[:, :-1]], axis=1)
    shown = terms
    if law.answer_delay and law.taken in (MOMENT, EVE):
        shown = terms[:, :: law.ticks].copy()
        for rows in samples.stretches:
            inside = slice(rows.start * law.ticks, rows.stop * law.ticks)
            shown[:, rows] = later(terms[:, inside], law.answer_delay * law.ticks, law.ticks)
        return shown
    if law.answer_delay:
        shown = terms.copy()
        for rows in samples.stretches:
            inside = slice(rows.start * law.ticks, rows.stop * law.ticks)
            shown[:, inside] = later(terms[:, inside], law.answer_delay * law.ticks)
    return np.array([taken_at(row, law.ticks, law.taken) for row in shown])


def reference_answered(samples: LoopSamples, fine: Floats, law: PositionController) -> Floats:
    """`answered` of the reference's terms (`fine_reference`): where its bend is held from set point to set point, that
    answers to nothing late, and is read as it was held.
    """
    shown = answered(samples, fine, law)
    if law.stepped:
        held = fine[BEND].reshape(-1, law.ticks)[:, 0]
        shown[BEND] = late_rows(held, samples, 1) if law.taken in (BEFORE, EVE) else held
    return shown


def regular_rows(samples: LoopSamples, smoothing: float) -> tuple[Flags, Integers]:
    """Rows that tell the law, shape (n,), and the number of the run that each of them belongs to.

    Not the clamped ones, nor those after a start where the derivative still remembers what was before it, nor the
    last one, whose mean until the next would need a position that was not recorded, nor runs so short that their
    constant would explain them.
    """
    skipped = max(20, round(10.0 / smoothing))
    known = _REGULAR.answer((samples,), dict)
    if skipped not in known:
        known[skipped] = _regular(samples, skipped)
    return known[skipped]


_REGULAR: LastOf[dict[int, tuple[Flags, Integers]]] = LastOf(2)


def _regular(samples: LoopSamples, skipped: int) -> tuple[Flags, Integers]:
    """`regular_rows` with so many left out after every start."""
    kept = np.zeros(len(samples.demand), dtype=np.bool_)
    number = np.zeros(len(samples.demand), dtype=np.int64)
    count = 0
    longest = max(1.0, samples.piece / samples.period)
    for rows in samples.stretches:
        if rows.stop - rows.start < SHORTEST_STRETCH:
            continue
        free = ~samples.clamped[rows]
        free[: min(len(free) // 4, skipped)] = False
        free[-1] = False
        for start, stop in ((rows.start + a, rows.start + b) for a, b in runs_of(free)):
            if stop - start >= SHORTEST_RUN:
                kept[start:stop] = True
                pieces = max(1, int((stop - start) // longest))
                number[start:stop] = count + np.arange(stop - start) * pieces // (stop - start)
                count += pieces
    return kept, number[kept]
