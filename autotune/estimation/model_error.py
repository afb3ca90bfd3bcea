"""The torque error of a model as it is, nothing fitted: the one statement that fit, compare and diagnose make.

The residual is corrected by a twin where a controller is known, so that the measurement chain is not blamed on
the model. A single recording without one is aligned to the model first, and single events are left out.

The noise floor: what repeats of an experiment do not share, as an estimate with its interval.

With errors e_k of k repeats of one trajectory the variance over repeats estimates the noise, whatever a
model lacks (that is the same in all of them). A chunk of n rows with an autocorrelation r_l of the noise
has about ν = n·(k − 1)/(1 + 2·Σ r_l²) degrees of freedom, and its variance a relative standard error of
√(2/ν) (Bartlett 1946); the interval is that of the logarithm of the pooled variance.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.core.remembered import Remembered, digest_of
from autotune.estimation.alignment import (
    BESIDE,
    CURRENT_LOOP,
    best_shift,
    half_a_sample_later,
    shifted,
    without_twin,
)
from autotune.estimation.contact_start import LEAST_ROWS, BaseTold, begun_contact
from autotune.estimation.controller import (
    as_acted,
    as_recorded,
    controllers_of,
    find_controller,
    recorded_again,
)
from autotune.estimation.controller_between import AS_MUCH, TICK
from autotune.estimation.controller_law import NEXT, PositionController
from autotune.estimation.controller_search import PIECE_SECONDS
from autotune.estimation.data import Prepared
from autotune.estimation.disturbance import STILL, Disturbance
from autotune.estimation.disturbance_estimate import (
    asked_late,
    estimate_disturbance,
    with_counts,
    with_expected_noise,
)
from autotune.estimation.least_squares import Fitted, followed, followed_within
from autotune.estimation.policy import POLICY, Policy
from autotune.estimation.problem import (
    Correction,
    Problem,
    base_free,
    new_problem,
    refit,
    without_outlying,
)
from autotune.estimation.residual import acted, measured_motion, residual, smoothed
from autotune.models import layout
from autotune.models.drive_model import DriveModel, Packed
from autotune.signals.chunks import CHUNK

SIMULATIONS = 3
"""Of the twin: its bias is their mean."""


@dataclass(frozen=True, slots=True)
class ModelError:
    """What a model leaves of the torque; arrays of shape (m,), on the grid of `problem.data`.

    Attributes:
        rows: that count.
        notes: in words, why there is no twin.
        late_record: whether the torque was recorded a sample late, as a refit of the model tells: what the model as it
            is leaves may be less as it was recorded.
    """

    problem: Problem
    error: Floats
    rows: Flags
    notes: tuple[str, ...]
    late_record: bool = False

    @property
    def torque(self) -> Floats:
        """The demand in the same bands, rows that count only [N m or N]."""
        return smoothed(self.problem.data, self.problem.data.torque)[self.rows]

    @property
    def error_rms(self) -> float:
        return float(np.sqrt(np.mean(self.error[self.rows] ** 2)))

    @property
    def relative_error(self) -> float:
        """Over the rms of the torque."""
        return self.error_rms / math.sqrt(max(float(np.mean(self.torque**2)), 1e-300))


TOLD_LAWS: Remembered[tuple[PositionController, Disturbance]] = Remembered()
CLEARLY_LESS = 0.98
"""Of the cost: the chance of a twin's bias."""
WANDERS = (1.0, 3.0, 9.0, 27.0)
"""Times faster a law's sum may wander than usual: above that, what it asks for may be compared."""
AS_LITTLE = 1.001
"""Times the cost of another fit: within what is left of a way downhill."""
FAR = 1.5
"""Times what the best law's twin leaves: a law that leaves so much more is another at any rate of its loop."""
TIMES = (1.0, 1.5, 2.0, 3.0)
"""Times a drive's loop may be faster than at `TICK`."""
FEWEST, HARDLY = 0.5, 1.02
"""The same of the fewest ticks that its twin may take, and times what it leaves with all: so few that leave no more."""


@dataclass(frozen=True, slots=True)
class PlainFit:
    """A model fitted without any twin, and what no change of its parameters makes of its error.

    `trained` is the problem up to the last row that is fitted.
    """

    problem: Problem
    trained: Problem
    fitted: Fitted

    def left_by(self, law: PositionController, disturbance: Disturbance) -> tuple[float, float]:
        """Mean square of the training rows that a law's twin leaves once the parameters have followed [(N m)²].

        And the torque the motion, by as much as an ordinary current loop takes: the model is aligned once a law is
        told, and a law that is right but for that delay must not lose to one that has another in its place. By how
        many half samples the torque acts later so is the second.
        """
        problem = replace(self.trained, controller=law, disturbance=disturbance)
        correction = problem.correction(self.fitted.packed)
        if not correction.stable:
            return math.inf, 0.0
        weight, jacobian = problem.training, self.fitted.jacobian
        left = followed_within(self.fitted, self.fitted.error - correction.bias, weight)
        later = followed(jacobian, half_a_sample_later(problem.data), weight)
        moved = -float((weight * later) @ left) / max(float((weight * later) @ later), 1e-300)
        half = 0.5 * problem.data.period
        moved = min(max(moved, -BESIDE / half), CURRENT_LOOP / half)
        left = left + moved * later
        return float(np.sum(weight * left**2)) / float(np.sum(weight)), moved


def by_chance(problem: Problem, correction: Correction) -> float:
    """Mean square of the training rows that the chance of the twin's few runs puts there [(N m)²]."""
    weight = problem.training
    blocks = zip(problem.data.blocks, correction.variance, strict=True)
    return float(sum(spare * weight[block.rows].sum() for block, spare in blocks)) / float(weight.sum())


def with_misfit(problem: Problem) -> Problem:
    """The problem, knowing what the law of a drive that works between the samples leaves of the recorded torque.

    Less its mean over runs of `PIECE_SECONDS`: the law's sum wanders off by what jitter and interpolation add.
    """
    law, data = problem.controller, problem.data
    if law is None or not law.in_band or law.asked > 0.0 or not data.repeated or data.by_sensor:
        return replace(problem, misfit=None)
    misfit = smoothed(data, acted(data.torque - asked_late(data, law)))
    for block in data.blocks:
        rows = block.by_repeat(np.arange(len(misfit)))
        clock = data.grid[rows[0]] * data.period
        for run in np.unique((clock - clock[0]) // PIECE_SECONDS):
            own = rows[:, (clock - clock[0]) // PIECE_SECONDS == run]
            misfit[own] -= misfit[own].mean(axis=1, keepdims=True)
    return replace(problem, misfit=misfit)


def with_misfit_again(problem: Problem) -> Problem:
    """The same where it was known already: of the law and the torque as they are now."""
    return problem if problem.misfit is None else with_misfit(problem)


def told_by_twin(
    data: Prepared, laws: Sequence[PositionController], model: Packed, policy: Policy = POLICY
) -> tuple[PositionController, Disturbance]:
    """Of laws that explain alike the one whose twin leaves least, with the ticks of its loop, and what shakes the axis.

    How fast a drive's loop is shows in no sample below the compared frequency. It does in how its encoder's counts
    shake the contact: at rest, between two of them, friction lets go so much faster as the loop is late.
    """
    if len(laws) == 1 and laws[0].ticks == 1:
        return laws[0], STILL
    return TOLD_LAWS.answer(
        _question(data, laws, model, policy), lambda: _told_beside_usual(data, laws, model, policy)
    )


def _told_beside_usual(
    data: Prepared, laws: Sequence[PositionController], model: Packed, policy: Policy
) -> tuple[PositionController, Disturbance]:
    """The law, told beside the base that these recordings tell, and what shakes the axis if it is as this model says.

    Which law it is is a question to the recordings. Fitted without a twin bases that start elsewhere end at the same
    place, to a part in a thousand of a parameter; where twins of two laws leave alike, the chance of them there must
    not tell another one to `compare` than to a diagnosis. A model with effects, or a base of a law of its own, is told
    beside itself; so is one whose fit leaves less.
    """
    usual = _usual_base(data, laws[0], model, policy)
    if usual is None:
        return _told(data, laws, model, policy)
    law, shaken = TOLD_LAWS.answer(
        _question(data, laws, usual, policy), lambda: _told(data, laws, usual, policy)
    )
    if np.array_equal(usual.p, model.p):
        return law, shaken
    return law, _shaken(plain_fit(as_recorded(data, laws[-1]), model, policy), laws[-1])


def _usual_base(data: Prepared, law: PositionController, model: Packed, policy: Policy) -> Packed | None:
    """The base that a search begins with in these recordings; None where the model must be told beside itself."""
    known = model.p[[layout.DAMPING_VELOCITY, layout.BENDS_BACK, layout.CREEP_VELOCITY]]
    problem, told = new_problem(data, None, policy), BaseTold.of(data)
    if model.on.any() or np.any(known > 0.0) or told.rows.sum() < LEAST_ROWS:
        return None
    usual = begun_contact(problem, told.values(problem.scales.one_way))
    if np.array_equal(usual.p, model.p):
        return usual
    one, other = (plain_fit(as_recorded(data, law), base, policy).fitted.cost for base in (usual, model))
    return usual if one <= AS_LITTLE * other else None


def _shaken(plain: PlainFit, law: PositionController) -> Disturbance:
    """What shakes the axis beside a law, as a fit without a twin leaves it."""
    return estimate_disturbance(replace(plain.problem, controller=law), plain.fitted.packed)


def _told(
    data: Prepared, laws: Sequence[PositionController], model: Packed, policy: Policy
) -> tuple[PositionController, Disturbance]:
    def fitted(law: PositionController) -> PlainFit:
        return plain_fit(as_recorded(data, law), model, policy)

    told = _least_left(laws, fitted, data.period)
    told = _on_few_ticks(_or_asked(data, laws, told, fitted), fitted, data.period)
    return told.law, told.disturbance


def _or_asked(
    data: Prepared,
    laws: Sequence[PositionController],
    told: _Least,
    fitted: Callable[[PositionController], PlainFit],
) -> _Least:
    """The law that was told, or what laws ask for in place of the torque where a twin leaves clearly less so.

    Repeats tell what is no noise. What drowned the ticks of its loop is gone then, and what drowned which law it is:
    both are told again. Where that was a law by chance, what it asks for may be no torque that any motor gave; so the
    one that explains most is tried as well. A law of the rows that was told by chance knows nothing of what a drive's
    loop makes of counts between them; one that explains the demand exactly has nothing that drowned.
    """
    law, between = told.law, [one for one in laws if one.ticks > 1]
    if not between or not data.repeated or law.exact:
        return told
    explains_most = between[0]
    tried = (law, explains_most.on_ticks(law.ticks, data.period)) if law.ticks > 1 else (explains_most,)
    most = CLEARLY_LESS * told.left / (AS_MUCH if law.demanded else 1.0)
    for one in dict.fromkeys(tried):
        trials = [replace(one, asked=times / PIECE_SECONDS) for times in WANDERS]
        left = [fitted(trial).left_by(trial, told.disturbance)[0] for trial in trials]
        if min(left) < most:
            break
    else:
        return told
    best = trials[int(np.argmin(left))]
    others = [replace(one, asked=best.asked) for one in between]
    return _least_left([*others, best], fitted, data.period, told.disturbance)


@dataclass(frozen=True, slots=True)
class _Least:
    """The law whose twin leaves least [(N m)²], under a disturbance, its torque so many half samples later."""

    law: PositionController
    disturbance: Disturbance
    left: float = math.inf
    later: float = 0.0


def _least_left(
    laws: Sequence[PositionController],
    fitted: Callable[[PositionController], PlainFit],
    period: float,
    disturbance: Disturbance | None = None,
) -> _Least:
    """Of laws, with the ticks of their loops, the one whose twin leaves least; `fitted`: what is fitted to its torque.

    Where no disturbance is known yet, the first law that is told takes its own; later ones begin at the ticks of the
    best of those before.
    """
    every = disturbance is not None
    plain: dict[tuple[object, ...], PlainFit] = {}
    best = _Least(laws[0], disturbance or STILL)
    for law in reversed(laws):
        own = law if law.asked > 0.0 or law.stepped or law.held or law.read_off else None
        key = law.in_band, law.taken, law.sensed, law.demanded, own
        if key not in plain:
            plain[key] = fitted(law)
        here = plain[key]
        if disturbance is None:
            disturbance = _shaken(here, law)
        before = math.inf
        for one in _faster(law, 1 if every or math.isinf(best.left) else best.law.ticks, period):
            left, later = here.left_by(one, disturbance)
            left *= _handicap(one)
            if left < best.left:
                best = _Least(one, disturbance, left, later)
            if left > min(before, FAR * best.left):
                break
            before = left
    return replace(best, disturbance=disturbance or STILL)


def _on_few_ticks(best: _Least, fitted: Callable[[PositionController], PlainFit], period: float) -> _Least:
    """The law with the fewest ticks of a twin that leave as little, to `HARDLY`: every run takes as long as its ticks.

    What a torque is later that is held for longer, the twin makes up for; so few ticks do as many, but where counts
    are coarse, or a loop is quick.
    """
    law = best.law
    counts = [count for count in _counts((FEWEST, *TIMES), period) if count < law.ticks]
    if not counts:
        return best
    plain = fitted(law)  # of the drive's torque, whatever its twin takes
    for one in (law.on_fewer(count, period) for count in counts):
        left, later = plain.left_by(one, best.disturbance)
        left *= _handicap(one)
        if left <= HARDLY * best.left:
            return replace(best, law=one, left=left, later=later)
    return best


def _handicap(law: PositionController) -> float:
    """Times what the twin of a law leaves, beside those of others.

    One of another torque has another noise; what explains every row needs no more than chance beside it. Most drives
    interpolate: one that does not must leave clearly less, and not by chance. One that feeds the rate of what it holds
    forward besides looks as one on lines that are a part of a row late: it must leave far less.
    """
    if law.demanded:
        return AS_MUCH
    if law.held:
        return FAR if law.feeds_rate else 1.0 / CLEARLY_LESS
    return CLEARLY_LESS if law.exact else 1.0


def told_beside(problem: Problem, fitted: Fitted, root: Packed | None = None) -> Problem:
    """The problem with the law that is told beside a model; the same where it leaves no less than the one it has.

    It was told by a model that lacked an effect, and what was missing may have told another, one whose torque was
    recorded at another moment, or drowned what every twin took out, so that none was used. What counts make of two
    masses nothing tells: it is that of the `root` then.
    """
    law, known = problem.controller or problem.rough, problem.told
    if known is None or law is None:
        return problem

    def beside(one: PositionController) -> PlainFit:
        data = recorded_again(problem.data, known.data, one)
        its = replace(problem, data=data, moved=measured_motion(data), controller=one)
        return PlainFit(its, its.until_trained(), replace(fitted, error=its.raw(fitted.packed)))

    laws = [replace(one, adrift=law.adrift, asked=law.asked) for one in known.laws]
    best = _least_left(laws, beside, problem.data.period, problem.disturbance if problem.twin else None)
    best = _on_few_ticks(best, beside, problem.data.period)
    if best.law == problem.controller or best.left > CLEARLY_LESS * fitted.cost:
        return problem
    its = beside(best.law).problem
    data = shifted(its.data, its.data.shift - best.later)
    its = replace(its, data=data, moved=measured_motion(data), rough=None)
    its = replace(its, disturbance=estimate_disturbance(its, fitted.packed))
    its = with_expected_noise(its, fitted.packed)
    one_mass = root if root is not None and its.two_masses(fitted.packed) else fitted.packed
    return with_misfit(with_counts(its, one_mass))


def _question(
    data: Prepared, laws: Sequence[PositionController], model: Packed, policy: Policy
) -> tuple[object, ...]:
    """What is told by a twin, told apart by content."""
    sensed = () if data.sensed is None else (data.sensed,)
    content = digest_of(
        data.reference, data.measured, data.torque, data.recorded_torque, data.feedforward, data.position,
        data.taps, data.grid, model.p, model.on, *sensed,
    )  # fmt: skip
    rest = (
        data.period,
        data.stretches,
        data.blocks,
        data.motion_cutoff,
        data.resolution,
        data.pace,
        data.metadata,
    )
    return *(repr(one) for one in (*laws, policy, *rest)), content


def _faster(law: PositionController, least: int, period: float) -> list[PositionController]:
    """The law with a loop that is so many times as fast as the samples or faster, the slowest first."""
    if law.ticks == 1:
        return [law]
    return [law.on_ticks(count, period) for count in _counts(TIMES, period) if count >= least]


def _counts(times: Sequence[float], period: float) -> list[int]:
    """Ticks of a sample in loops so many times as fast as at `TICK`, the fewest first."""
    return sorted({max(2, round(one * period / TICK)) for one in times})


def plain_fit(data: Prepared, model: Packed, policy: Policy) -> PlainFit:
    problem = new_problem(data, None, policy)
    packed = Packed(model.p.copy(), model.on.copy())
    free = base_free(packed, problem.scales, data.metadata.motion_unit)
    return PlainFit(
        problem, problem.until_trained(), refit(problem, packed, free, problem.correction(packed), 8)
    )


def model_error(data: Prepared, model: DriveModel, policy: Policy = POLICY) -> ModelError:
    """The error of a model on prepared data; of controllers that explain alike the one whose twin leaves least."""
    laws = controllers_of(data, find_controller(data, policy), policy)
    law, _ = told_by_twin(data, laws, model.pack(), policy)
    if law.ticks > 1 and data.repeated:  # of a torque read at some moment, or as the law asks for it
        return error_inside(as_recorded(data, law), law, model, policy)
    # the recorded torque is taken as what acts from each sample to the next: so is a twin's
    return error_inside(data, replace(law, taken=NEXT, asked=0.0), model, policy)


def error_inside(data: Prepared, found: PositionController, model: DriveModel, policy: Policy) -> ModelError:
    """The error of a model on prepared data whose controller is `found`; without a twin where that does not run."""
    problem = new_problem(data, found, policy)
    packed = model.pack()
    no_twin = () if data.steady else (f"No twin: {found.why}.",)
    notes = found.notes if found.usable else no_twin
    if problem.twin and not problem.correction(packed, 1).stable:
        problem = replace(problem, controller=None)
        notes = ("No twin: a simulation of the model with this controller is unstable.",)
    if not problem.twin:
        data, said = without_twin(as_acted(data))
        data = data if data.repeated or data.steady else best_aligned(data, packed)
        problem, notes = new_problem(data, None, policy), (*notes, *said)
    if problem.twin:
        problem = replace(problem, disturbance=estimate_disturbance(problem, packed))
    correction = problem.correction(packed, SIMULATIONS)
    if not correction.stable:
        alone = replace(problem.data, load_in_twin=False)
        problem, correction = replace(problem, data=alone, controller=None), replace(correction, stable=True)
    error = residual(problem.data, packed, problem.moved) - correction.bias
    if not data.repeated and not data.steady:
        problem = replace(problem, weight=without_outlying(problem, error))
    rows = np.asarray(problem.weight > 0)
    return ModelError(problem, error, rows, notes)


def best_aligned(data: Prepared, packed: Packed) -> Prepared:
    """The data with the torque shifted to where this model explains it best."""

    def cost(shift: float) -> float:
        moved = shifted(data, shift)
        return float(np.mean(residual(moved, packed, measured_motion(moved)) ** 2))

    return shifted(data, best_shift(cost, data.shift, data.upsampling)[0])


LAGS = 40
"""Grid rows over which noise may be correlated: 0.2 s."""
QUANTILE = 1.96
"""Of the normal distribution, for an interval of 95 %."""


@dataclass(frozen=True, slots=True)
class NoiseFloor:
    """Estimate of the noise's rms [N m or N], and its interval of 95 %."""

    rms: float
    low: float
    high: float

    @property
    def interval(self) -> tuple[float, float]:
        return self.low, self.high


def noise_floor(problem: Problem, error: Floats, rows: Flags) -> NoiseFloor | None:
    """The floor under the error of repeated experiments, every row alike; None where nothing was repeated.

    Args:
        error: residual on the grid, shape (m,); rows: those that count, shape (m,).
    """
    chunks = [
        chunk
        for block in problem.data.blocks
        if block.repeats > 1
        for chunk in _chunks(block.by_repeat(error), block.by_repeat(rows))
    ]
    if not chunks:
        return None
    variance, freedom, count = np.array(chunks).T
    share = count / count.sum()
    mean = float(share @ variance)
    if mean <= 0.0:
        return NoiseFloor(0.0, 0.0, 0.0)
    spread = math.sqrt(float(np.sum(share**2 * 2.0 * variance**2 / freedom))) / mean
    reach = math.exp(0.5 * QUANTILE * spread)
    rms = math.sqrt(mean)
    return NoiseFloor(rms, rms / reach, rms * reach)


def _chunks(table: Floats, counted: Flags) -> list[tuple[float, float, float]]:
    """Variance over repeats, its degrees of freedom and the rows of every chunk of about a second."""
    kept = counted.all(axis=0)
    found = []
    for part in np.array_split(np.flatnonzero(kept), max(1, int(kept.sum()) // CHUNK)):
        if len(part) < 2:
            continue
        values = table[:, part]
        freedom = len(part) * (len(values) - 1) / _correlated(values - values.mean(axis=0))
        found.append((float(values.var(axis=0, ddof=1).mean()), max(freedom, 1.0), float(values.size)))
    return found


def _correlated(noise: Floats) -> float:
    """1 + 2·Σ r_l², rows that count as one for a variance; `noise` of shape (repeats, rows)."""
    power = float(np.sum(noise**2))
    if power <= 0.0:
        return 1.0
    repeats, size = noise.shape
    lags = range(1, min(LAGS, size - 1) + 1)
    products = np.array([float(np.sum(noise[:, lag:] * noise[:, :-lag])) for lag in lags]) / power
    by_chance = len(lags) / float(size * max(repeats - 1, 1))  # what Σ r_l² of white noise is on average
    beyond: float = max(float(np.sum(products**2)) - by_chance, 0.0)
    return 1.0 + 2.0 * beyond
