"""How torque and position belong together in time: how a torque was recorded, how late it acts, what of that is a lag.

That is a property of the measurement chain: a torque is recorded as it is at the sample, or as its mean over the cycle
before or after it, and a current loop follows its demand some tenths of a millisecond late. So much delay is a nuisance
of every fit inside a twin and never an effect; more is a torque that lags.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.arrays import Floats
from autotune.diagnosis.refits import settled_in, with_noise_of
from autotune.diagnosis.starts import varying
from autotune.estimation.alignment import (
    BESIDE,
    CURRENT_LOOP,
    a_row_sooner,
    acting_later,
    acts_after,
    behind_current_loop,
    best_shift,
    shifted,
)
from autotune.estimation.bias_corrected_fit import ModelFit, fit_inside_twin
from autotune.estimation.controller import as_wanted, recorded_again, recorded_late_by
from autotune.estimation.controller_law import BEFORE, NEXT, PositionController
from autotune.estimation.data import TRAINING, Prepared, repeats_alike
from autotune.estimation.least_squares import CORRELATED, Fitted, followed, standard_errors
from autotune.estimation.problem import Problem, refit
from autotune.estimation.residual import acted, measured_motion, smoothed
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.start_values import Vary
from autotune.models.torque_lag import IS_LATE, STAGES, STEEPNESS, TIME_CONSTANT, TORQUE_LAG
from autotune.signals.line_search import lowest

MOST_LATE, FINE_LATE = 4.0, 0.01
"""Of that: how far a lag is looked for, and what it is found to."""
FINE_SHIFT = 2e-5
"""s, what a delay is found to."""
CYCLES = (1, 2, 3)
"""Whole cycles by which a demand may act later than it is recorded: what a bus and a drive's input take."""
CHAIN = (-1.0, 1.0)
"""Samples by which a torque may be recorded late where it was not held from each sample to the next; and by which it
may act later than it is recorded, as what is computed within a cycle and sent acts within the next."""
FILTERED = 2e-3
"""s, by which a torque may be recorded later still, by the filter of its reading. No axis answers before it is asked:
no effect has this sign."""
AS_A_WHOLE = STAGES / (STAGES + 1.0)
"""Steepness of a lag all of whose stages are alike."""
SETTLED = 4
"""Steps of a fit after torque and motion were moved."""
WORTH_ALIGNING = 0.998
"""Of the mean square: what must be left at most for a shift of torque against motion to count."""
CLEARLY_LESS = 0.98
"""Of the mean square: what another delay must leave at most to be taken for it; what else a model lacks bends both."""
HALF_A_ROW = 0.5
"""Rows of a file by which a torque acts sooner than its own that acts nearer to the one before."""
SURE = 2.0
"""Standard errors by which a lag must be longer than a current loop's to be more, and differ from another one."""
LATE_RECORD = "The torque is taken as recorded a sample late: so the axis answers to it."
SPLITS = (0.1, 0.4, 0.8)
"""Of an ordinary current loop's lag: what a fit begins with of it behind a dead time."""
ROUNDING = 1e-9
"""Of what torque and acceleration suggest: inertia that is above its bound by no more has been taken there."""


def without_chain(problem: Problem, model_fit: ModelFit) -> Problem:
    """The problem with the delay of torque against motion taken out, as far as the measurement chain can have it.

    A law that explains the demand to rounding works at the samples: its torque is held until the next, comes whole
    cycles later, and behind a current loop. Any other torque may be recorded at another moment too: it is moved. A
    model that was fitted before has taken over a part of a delay of cycles: the rest is found beside the model after.
    The axis ran in its loop: a delay with which the twin's would be unstable, where it was not, is none of the axis.
    Nor is one in whose place a lag in the loop leaves clearly less, or beside which the axis has no inertia.
    """
    again = _moved_once(problem, model_fit)
    if again is problem:
        return problem
    fitted = refit(again, model_fit.fitted.packed, list(model_fit.free), model_fit.correction, SETTLED)
    if _weightless(fitted):
        return problem
    moved = _moved_once(again, replace(model_fit, fitted=fitted))
    settled = replace(model_fit, fitted=fitted)
    if not moved.correction(fitted.packed, 1).stable or _lags_in_loop(problem, moved, settled):
        return problem
    return moved


def _weightless(fitted: Fitted) -> bool:
    """Whether a fit has taken all inertia from its axis: that is none, and no step of a twin follows it."""
    inertia = [one for one in fitted.free if one.slot == layout.INERTIA]
    return any(fitted.packed.p[one.slot] - one.lower <= ROUNDING * one.scale for one in inertia)


def _lags_in_loop(problem: Problem, moved: Problem, model_fit: ModelFit) -> bool:
    """Whether a torque that was moved by more than a current loop is late lags in its loop instead.

    Along the measured motion the one is as good as the other, and the bias that is held there is that of a loop without
    any. In the twin they differ: rows that were written late delay no loop, a bus does not bend the torque, and a lag
    does both. It must leave clearly less there, and be no current loop's beyond doubt.
    """
    late = moved.data.period * (moved.data.late - problem.data.late) + moved.data.lag - problem.data.lag
    packed = model_fit.fitted.packed
    if not problem.twin or packed.on[IS_LATE] or problem.two_masses(packed) or late <= CURRENT_LOOP:
        return False
    lags = _behind_lag(problem, model_fit, late)
    if lags is None or not _is_long(problem, lags):
        return False
    here = settled_in(moved, model_fit)
    return here is not None and lags.fitted.cost < CLEARLY_LESS * here[1].fitted.cost


def lag_in_loop(problem: Problem, model_fit: ModelFit) -> tuple[Problem, ModelFit] | None:
    """Problem and model with a lag of the loop where no way of recording the torque leaves as little without one.

    A drive's torque that was read half a sample later, with a velocity filter that is as much slower, has the same
    columns below the compared frequency. Which of them it was is told by what a twin leaves whose axis acts at once: a
    lag is made up for by the way of recording, and what is left of it is moved, or ordinary. So is that of a host whose
    torque was read a sample late, by a host that is a sample slower. Beside what was found each way is fitted with a
    lag of its loop: rows delay no loop, and a filter of the velocity delays no stiffness.

    None where nothing could be as late in any way, where none with a lag that is longer than a current loop's leaves
    clearly less than the model as it is and each way behind an ordinary one, between two masses, or where a lag is
    not among the effects that are asked about.
    """
    packed = model_fit.fitted.packed
    sought = TORQUE_LAG in problem.candidates
    if not (problem.twin and sought) or packed.on[IS_LATE] or problem.two_masses(packed):
        return None
    ways = _ways_of_recording(problem)
    least, found = CLEARLY_LESS * model_fit.fitted.cost, None
    for way, late in sorted(ways, key=lambda one: one[1], reverse=True):
        if late <= CURRENT_LOOP and found is None:
            break
        fit = _behind_lag(way, model_fit, max(late, FINE_SHIFT))
        if fit is None:
            continue
        if not _is_long(way, fit):
            least = min(least, CLEARLY_LESS * fit.fitted.cost)
        elif found is None or fit.fitted.cost < found[1].fitted.cost:
            found = way, fit
    return found if found is not None and found[1].fitted.cost < least else None


def cycles_in_place(problem: Problem, lags: ModelFit) -> list[tuple[Problem, ModelFit]]:
    """Problem and model with whole cycles, and an ordinary lag behind them, in the place of a lag of the model.

    Whole cycles are asked along the measured motion, under a bias that is held, and before other effects are known; a
    second mass moves in the twin only. So a record that was taken to be a sample late has its sample back as a lag
    beside what was found: in the twin the one is asked for the other.
    """
    data, packed = problem.data, lags.fitted.packed
    cycle = data.upsampling * data.period
    late = cycle * data.cycles + data.lag + float(packed.p[TIME_CONSTANT])
    found = []
    for count in {int(late / cycle), round(late / cycle)} & set(CYCLES):
        rest, more = max(late - count * cycle, 0.0), count - data.cycles
        if rest > CURRENT_LOOP or more <= 0:
            continue
        later = _acting_later(data, data.upsampling * more, count)
        again = _later_by(problem, more, behind_current_loop(later, rest))
        fit = _fit_without_lag(again, lags)
        if fit is not None:
            left = _left(again, fit, again.data)
            error = _error_of_lag(again, fit, _Late(again.data, left, _cost(again, left)))
            found.append((replace(again, data=replace(again.data, lag_error=error)), fit))
    return found


def dead_time_in_place(problem: Problem, lags: ModelFit, most: int = 1) -> tuple[Problem, ModelFit] | None:
    """Problem and model with a dead time of `most` rows or less, and an ordinary lag behind it, in the place of a lag.

    A host's demand is computed, sent and taken in while its row lasts, and acts in the midst of it or with the next.
    The law that sees everything as much later asks for the mean of what acts over each row, so that the twin's loop is
    as late. A dead time delays and does not bend; a lag bends. Each split between the two is fitted with what is left
    of the lag free; the best.

    None where a torque is not held from each row to the next, or where so many rows and an ordinary current loop are
    not all that is late.
    """
    data, law = problem.data, problem.controller
    if law is None or law.ticks > 1 or law.part_late > 0.0 or not problem.twin:
        return None
    longest = most * data.upsampling * data.period
    late = data.lag + float(lags.fitted.packed.p[TIME_CONSTANT])
    found = []
    for dead in sorted({min(max(late - share * CURRENT_LOOP, 0.0), longest) for share in SPLITS} - {0.0}):
        again = _after_dead_time(problem, dead / data.period)
        fit = _behind_lag(again, _without_lag(lags), max(late - dead, FINE_SHIFT))
        if fit is not None and not _is_long(again, fit):
            found.append((again, fit))
    best = min(found, key=lambda one: one[1].fitted.cost, default=None)
    return None if best is None else _taken_out(*best)


def _after_dead_time(problem: Problem, rows: float) -> Problem:
    """The problem with its torque acting so many rows of the raster later, at once where it does; so is its loop."""
    law, whole = problem.controller, int(rows)
    if law is None:
        return problem
    delays = law.reference_delay + whole, law.position_delay + whole
    law = replace(law, reference_delay=delays[0], position_delay=delays[1], part_late=rows - whole)
    data = acting_later(problem.data, rows - whole)
    late = _fed_later(_acting_later(data, whole, problem.data.cycles), whole)
    return _with(replace(problem, controller=law), late)


def recorded_otherwise(problem: Problem, model_fit: ModelFit) -> tuple[Problem, ModelFit] | None:
    """Problem and model with the torque recorded in another way, where that leaves clearly less in the twin.

    How a drive's torque was recorded is told by twins that act at once, moved by an ordinary current loop's lag at
    most; what is later is found behind that. A reading half a sample sooner or later makes up for a part of what is
    late. So where it turned out later, each way is fitted as late as it comes to be, the twin's loop with it: whole
    cycles, and an ordinary lag behind them. Beside them stands a lag of several stages, as a running mean bends so.

    None where nothing was that late, where no other way leaves clearly less, or a longer lag does: it is an effect
    (`lag_in_loop`).
    """
    data, law, packed = problem.data, problem.controller, model_fit.fitted.packed
    known = data.cycles == 0 and data.period * data.late <= CURRENT_LOOP
    if (
        law is None
        or known
        or not _loops_between(problem)
        or packed.on[IS_LATE]
        or problem.two_masses(packed)
    ):
        return None
    trials = [
        (again, fit)
        for way, late in _ways_of_recording(problem)
        for again, steep in [*((one, 0.0) for one in _cycles_near(way, late)), (way, AS_A_WHOLE)]
        if (fit := _behind_lag(again, model_fit, max(late - _cycles_of(again.data), FINE_SHIFT), steep))
    ]
    usual = [one for one in trials if not _is_long(*one)]
    least = min((one[1].fitted.cost for one in trials), default=np.inf)
    again, fit = min(usual, key=lambda one: one[1].fitted.cost, default=(problem, model_fit))
    other = again.controller is not None and again.controller.taken != law.taken
    if not other or least < CLEARLY_LESS * fit.fitted.cost:
        return None
    return _taken_out(again, fit) if fit.fitted.cost < CLEARLY_LESS * model_fit.fitted.cost else None


def _taken_out(problem: Problem, lags: ModelFit) -> tuple[Problem, ModelFit] | None:
    """Problem and model with the model's lag, as of a current loop, taken out of the torque."""
    lag = float(lags.fitted.packed.p[TIME_CONSTANT])
    error = float(standard_errors(lags.fitted, problem.training)[-1])
    there = _with(
        problem, replace(behind_current_loop(problem.data, min(lag, CURRENT_LOOP)), lag_error=error)
    )
    fit = _fit_without_lag(there, lags)
    return None if fit is None else (there, fit)


def _fit_without_lag(problem: Problem, lags: ModelFit) -> ModelFit | None:
    """The model without its lag, fitted inside the twin; None where that is unstable."""
    bare = _without_lag(lags)
    return fit_inside_twin(problem, bare.fitted.packed, list(bare.free), 2, bare.effects)


def _without_lag(lags: ModelFit) -> ModelFit:
    """The model without its lag, all else as it was fitted beside it."""
    p, on = lags.fitted.packed.p.copy(), lags.fitted.packed.on.copy()
    p[[TIME_CONSTANT, STEEPNESS]], on[IS_LATE] = 0.0, False
    free = tuple(one for one in lags.free if one.slot not in (TIME_CONSTANT, STEEPNESS))
    effects = tuple(effect for effect in lags.effects if effect != TORQUE_LAG.name)
    return replace(lags, fitted=replace(lags.fitted, packed=Packed(p, on), free=free), effects=effects)


def _cycles_near(problem: Problem, late: float) -> list[Problem]:
    """The problem with its torque so many whole cycles later as come next to a lag [s], none among them."""
    data = problem.data
    whole = int(late / (data.upsampling * data.period))
    found = []
    for count in sorted({whole - 1, whole, whole + 1} & {0, *CYCLES}):
        later = _acting_later(data, data.upsampling * count, count)
        found.append(_with(problem, later) if count > 0 else problem)
    return found


def _acting_later(data: Prepared, rows: float, cycles: int) -> Prepared:
    """The data with their torque acting so many rows later, and whole cycles taken out by that."""
    return replace(shifted(data, data.shift - 2.0 * rows), cycles=cycles)


def _cycles_of(data: Prepared) -> float:
    """Whole cycles that were taken out [s]."""
    return data.upsampling * data.period * data.cycles


def _ways_of_recording(problem: Problem) -> list[tuple[Problem, float]]:
    """The problem with its torque acting at once, in each way in which it may have been recorded, and the lag [s] that
    is expected there, by how late the torque is as it is now."""
    data, law = problem.data, problem.controller
    prompt = _with_cycles_again(problem)
    at_once = 2.0 if _is_read_late(law) else data.shift + 2.0 * data.late
    prompt = _with(prompt, shifted(prompt.data, at_once))
    late = 0.5 * data.period * (at_once - data.shift) + data.lag
    ways = [(prompt, late)]
    read_late = recorded_late(prompt)
    if read_late is not None:
        ways.append((read_late, late + data.period))
    told = problem.told
    if law is None or told is None or law.ticks == 1:
        return ways
    known = {law.taken}
    for one in told.laws:
        if one.ticks == 1 or one.taken in known or (one.sensed, one.demanded) != (law.sensed, law.demanded):
            continue
        known.add(one.taken)
        other = replace(one, adrift=law.adrift, asked=law.asked)
        other = replace(other.on_ticks(max(one.ticks, law.ticks), data.period), own_ticks=law.own_ticks)
        columns = recorded_again(data, told.data, other)
        later = 0.5 * data.period * (recorded_late_by(one) - recorded_late_by(law))
        ways.append((_with(replace(prompt, controller=other), columns), late + later))
    return ways


def recorded_late(problem: Problem) -> Problem | None:
    """The problem with the torque recorded a sample late and a law that sees all as much sooner, where it may be so."""
    law = problem.controller
    if law is None or law.taken != NEXT or min(law.reference_delay, law.position_delay) < 1:
        return None
    if problem.data.cycles > 0:  # it acts later than it was recorded, and the law's delay is that
        return None
    sooner = replace(law.sooner(), taken=BEFORE, why="")  # once: nothing reads it two samples late
    return _with(replace(problem, controller=sooner), a_row_sooner(problem.data))


def _is_read_late(law: PositionController | None) -> bool:
    """Whether a torque of the samples is taken as recorded a sample late: it acts at once a row before its own."""
    return law is not None and law.ticks == 1 and law.taken == BEFORE


def sees_a_row_sooner(before: Problem, after: Problem) -> bool:
    """Whether a torque that was taken at its own row `before` is taken as recorded a sample late."""
    late, law = recorded_late(before), after.controller
    return late is not None and law is not None and law.exact and after.data.shift == late.data.shift


def is_recorded_late(problem: Problem, prompt: Fitted, late: Problem, fitted: Fitted) -> bool:
    """Whether a torque was recorded a sample late, of one model that was fitted without that and with it.

    From a reading to the torque that answers it a loop takes as long as the law sees all late, and the torque acts
    after its row. A record that is late by a row has a law as late, and acts a row before its own: the loop is prompt.
    So where the torque acts at its row, also once it was moved away from there, the record is not late. Where it acts
    a row sooner already as it was told, it is late: what a model lacks may leave less in either loop, and only a fit
    that leaves half of what a late record does says the contrary. Behind an exact law it stays where it was begun, and
    inertia and friction tell; as much says the contrary there. In any case no more than a prompt current loop is late
    of a late record, which would make up for one that was not.
    """
    if (
        late.data.cycles > 0
        or late.data.lag >= CURRENT_LOOP
        or late.data.late > -HALF_A_ROW * late.data.upsampling
    ):
        return False
    law = problem.controller
    here = problem.policy.partly if law is not None and law.exact else CLEARLY_LESS
    least = 1.0 / problem.policy.partly if _acts_a_row_sooner(problem) else here
    return all(
        one.mean_square(fitted.error, TRAINING) <= least * one.mean_square(prompt.error, TRAINING)
        for one in (problem, late)
    )


def _acts_a_row_sooner(problem: Problem) -> bool:
    """Whether the torque acts nearer to the row before its own than to it, by how it moves the axis."""
    data, law = problem.data, problem.controller
    rows = acts_after(data) if law is not None and law.exact else data.late / data.upsampling
    return rows <= -HALF_A_ROW


def _behind_lag(
    problem: Problem, model_fit: ModelFit, late: float, steepness: float = 0.0
) -> ModelFit | None:
    """The model with a lag, fitted inside the twin from so long a one [s]; None where the twin is unstable.

    `steepness`: share of it in further stages.
    """
    packed = model_fit.fitted.packed
    p, on = packed.p.copy(), packed.on.copy()
    p[TIME_CONSTANT], p[STEEPNESS], on[IS_LATE] = late, steepness, True
    free = [*model_fit.free, varying(TORQUE_LAG, "time_constant", Vary(late, late))]
    return fit_inside_twin(problem, Packed(p, on), free, 2, (*model_fit.effects, TORQUE_LAG.name))


def is_longer(problem: Problem, left: Floats, lag: float, error: float) -> bool:
    """Whether a lag [s] with that standard error, which leaves `left`, is longer than an ordinary current loop's.

    When a host's torque acts is known by its law: beyond doubt will do. Behind a drive's own loop it is known by how
    that was fitted, over many rows to microseconds: there an ordinary one must leave more by what would say of itself
    that something is missing.
    """
    beyond = lag - CURRENT_LOOP
    if beyond <= SURE * error or not _loops_between(problem):
        return beyond > SURE * error
    rows = problem.training > 0
    square = float(np.mean(left[rows] ** 2))
    more = CORRELATED * square * beyond**2 / rows.sum()
    return bool(more > problem.policy.structure_part * _noise(problem, left) * error**2)


def _noise(problem: Problem, left: Floats) -> float:
    """Variance of what an error's repeats do not share, no more than all of it [(N m)²]."""
    return float(np.fmin(problem.noise_variance(left, TRAINING), np.mean(left[problem.training > 0] ** 2)))


def _is_long(problem: Problem, lags: ModelFit) -> bool:
    """Whether the lag that was freed last is longer than an ordinary current loop's."""
    fitted = lags.fitted
    error = float(standard_errors(fitted, problem.training)[-1])
    return is_longer(problem, fitted.error, float(fitted.packed.p[TIME_CONSTANT]), error)


def without_rounding(problem: Problem, model_fit: ModelFit) -> Problem:
    """The problem with the demand as its controller computed it, where the axis answers to that; else as it is.

    A drive may compute with the demand that it was given, or with one that is rounded as it is recorded: the model
    leaves less of that which acted.
    """
    law = problem.controller
    if law is None or model_fit.fitted.packed.on[IS_LATE]:
        return problem
    data = as_wanted(problem.data, law)
    if data is problem.data:
        return problem
    here, there = (_cost(problem, _left(problem, model_fit, one)) for one in (problem.data, data))
    return _with(problem, data) if there < WORTH_ALIGNING * here else problem


def _moved_once(problem: Problem, model_fit: ModelFit) -> Problem:
    law = problem.controller
    if law is not None and law.exact:
        return _without_current_loop(problem, model_fit)
    data = problem.data
    if data.cycles > 0:
        return _without_cycles(problem, model_fit)
    if data.lag > 0.0:  # of the loop, as its twin told (`late_anew`)
        return problem
    errors: dict[float, float] = {}

    def cost(shift: float) -> float:
        if shift not in errors:
            errors[shift] = _cost(problem, _left(problem, model_fit, shifted(data, shift)))
        return errors[shift]

    best, lowest_cost = best_shift(cost, data.shift, step=min(0.1, FINE_SHIFT * 2.0 / data.period))
    if best == data.shift or lowest_cost > WORTH_ALIGNING * cost(data.shift):
        return problem
    earliest, latest = -np.inf, np.inf
    if law is not None:
        early, late = CHAIN
        earliest, latest = 2.0 * (early - BESIDE / data.period), 2.0 * (late + FILTERED / data.period)
    if best < earliest:
        later = _without_cycles(problem, model_fit)
        if later is not problem:
            return later
        return _moved_to(problem, model_fit, earliest, (cost(data.shift), lowest_cost))
    return problem if best > latest else _with(problem, shifted(data, best))


def _moved_to(problem: Problem, model_fit: ModelFit, shift: float, costs: tuple[float, float]) -> Problem:
    """The problem with its torque moved so far at most, where what a longer way would take off says nothing by itself.

    No way of recording ends at a number that is known to microseconds (`is_longer`). `costs`: of the torque as it is,
    and moved as far as is best.
    """
    moved = shifted(problem.data, shift)
    left = _left(problem, model_fit, moved)
    cost, (here, least) = _cost(problem, left), costs
    spare = problem.policy.structure_part * _noise(problem, left) * float(np.sum(problem.training))
    return _with(problem, moved) if cost - least <= spare and cost <= WORTH_ALIGNING * here else problem


def late_anew(problem: Problem, model_fit: ModelFit) -> tuple[Problem, ModelFit] | None:
    """Problem and model with what the demand goes through found anew, from a torque that acts at once.

    How late it acts was found beside a model that lacked an effect, and by torques under a bias that was held; but the
    twin's loop is so late, too, and near the limit of stability a tenth of a millisecond rules what it leaves. Behind a
    loop between the samples the torque was moved, as if it had been recorded at another moment. That delays no loop;
    here it is a lag of the loop. None where nothing is late, or the twin is unstable; whole cycles behind such a loop
    stay.
    """
    prompt = None if model_fit.fitted.packed.on[IS_LATE] else _at_once(problem)
    here = None if prompt is None else settled_in(prompt, model_fit)
    if prompt is None or here is None:
        return None
    again = _lag_in_loop(*here) if _loops_between(prompt) else without_chain(*here)
    late = None if again is prompt else settled_in(again, here[1])
    if late is None or late[1].fitted.cost > here[1].fitted.cost:
        return here
    return with_noise_of(*late) if problem.data.repeated else late


def _at_once(problem: Problem) -> Problem | None:
    """The problem with its torque acting as it was recorded; None where it does so already."""
    data = problem.data
    if _loops_between(problem):
        moved = data.late > 0.0 and data.cycles == 0
        return _with(problem, shifted(data, data.shift + 2.0 * data.late)) if moved else None
    if data.cycles > 0:
        return _with_cycles_again(problem)
    return _with(problem, shifted(data, data.shift)) if data.lag > 0.0 else None


def _lag_in_loop(problem: Problem, model_fit: ModelFit) -> Problem:
    """The torque behind the lag that explains it best, whatever its length; so is the twin's."""
    best = _late_by(problem, model_fit, 0)
    return _with(problem, replace(best.data, lag_error=_error_of_lag(problem, model_fit, best)))


def without_long_lag(problem: Problem, model_fit: ModelFit) -> Problem:
    """The problem of `late_anew` with its torque as recorded, where its lag is longer than an ordinary current loop's.

    That is an effect, and none of the chain.
    """
    data = problem.data
    if not is_longer(problem, model_fit.fitted.error, data.lag, data.lag_error):
        most = min(data.lag, CURRENT_LOOP)
        return _with(problem, replace(behind_current_loop(data, most), lag_error=data.lag_error))
    return _with(problem, shifted(data, data.shift))


def _without_cycles(problem: Problem, model_fit: ModelFit) -> Problem:
    """The torque of a law that is not exact, later than any moment of recording: whole cycles, as behind a bus.

    What is later by less was moved, or is a lag; nothing is moved beside whole cycles.
    """
    if model_fit.fitted.packed.on[IS_LATE] or problem.controller is None:
        return problem
    trials = [_late_by(problem, model_fit, count) for count in (0, *CYCLES)]
    return _ordinary(problem, model_fit, trials, trials[1:])


@dataclass(frozen=True, slots=True)
class _Late:
    """Data with the torque some cycles and a current loop's lag later, and the error and cost that this leaves.

    `shared`: by what repeats share alone.
    """

    data: Prepared
    rest: Floats
    cost: float
    shared: bool = False


def _without_current_loop(problem: Problem, model_fit: ModelFit) -> Problem:
    """The torque as it acts: whole cycles after its demand, where a bus takes them, and behind the current loop.

    The law of a torque that acts so many cycles later sees everything as late: so the twin's loop has the phase of the
    axis's. The problem as it is where an ordinary current loop is not all that is late. A lag of a cycle bends the
    torque as a delay of a cycle does not: where it explains clearly more, it is no delay.
    """
    if model_fit.fitted.packed.on[IS_LATE]:
        return problem
    plain = _late_by(problem, model_fit, 0)
    whole = int(plain.data.lag / (problem.data.upsampling * problem.data.period))
    trials = [plain, *(_late_by(problem, model_fit, count) for count in {whole, whole + 1} & set(CYCLES))]
    return _ordinary(problem, model_fit, trials, trials)


def _ordinary(
    problem: Problem, model_fit: ModelFit, trials: Sequence[_Late], known: Sequence[_Late]
) -> Problem:
    """The problem with the best of those `known` from any drive taken out, where no other trial explains clearly more.

    Cycles that were taken out come back where a lag turns out to be none: the running mean of a demand bends less than
    one stage does, as several stages do.
    """
    usual = [one for one in known if _is_current_loop(problem, model_fit, one)]
    if not usual:
        return problem
    best = min(usual, key=lambda one: one.cost)
    if best.data.cycles > 0 and sees_late(problem):
        lag = min(one.cost for one in trials if one.data.cycles == 0)
        if best.cost > CLEARLY_LESS * lag:
            return _with_cycles_again(problem)
    least = min(one.cost for one in trials)
    if best.data.cycles > 0:
        steep = _late_by(problem, model_fit, 0, STAGES)
        least = least if _is_current_loop(problem, model_fit, steep, STAGES) else min(least, steep.cost)
    if least < CLEARLY_LESS * best.cost:
        return _with_cycles_again(problem)
    here = _cost(problem, _left(problem, model_fit, problem.data))
    if best.cost > WORTH_ALIGNING * here:
        return problem
    error = _error_of_lag(problem, model_fit, best)
    data = replace(behind_current_loop(best.data, min(best.data.lag, CURRENT_LOOP)), lag_error=error)
    return _later_by(problem, data.cycles - problem.data.cycles, data)


def sees_late(problem: Problem) -> bool:
    """Whether a host's law sees positions late beside the cycles that were taken out: its rows tell when it acts.

    From a reading to the torque that answers it takes whole cycles. A host that writes a torque as it is computed has a
    law that sees its rows, and a torque that acts later; one that writes it as it acts has a law that sees all late.
    """
    law, data = problem.controller, problem.data
    return law is not None and law.ticks == 1 and law.position_delay > data.upsampling * data.cycles


def _with_cycles_again(problem: Problem) -> Problem:
    """The problem without cycles taken out; itself where there were none."""
    data = problem.data
    if data.cycles == 0:
        return problem
    prompt = shifted(data, data.shift + 2.0 * data.upsampling * data.cycles)
    return _later_by(problem, -data.cycles, prompt)


def _later_by(problem: Problem, cycles: int, data: Prepared) -> Problem:
    """The problem with data whose torque acts so many cycles later: its controller sees everything as late, and what
    was added to its torque comes as late; between the samples the twin sees to it."""
    law, later = problem.controller, problem.data.upsampling * cycles
    if law is None or later == 0 or _loops_between(problem):
        return _with(problem, data)
    delays = law.reference_delay + later, law.position_delay + later
    law = replace(law, reference_delay=delays[0], position_delay=delays[1])
    return _with(replace(problem, controller=law), _fed_later(data, later))


def _fed_later(data: Prepared, rows: int) -> Prepared:
    """The data with the recorded feedforward so many rows later in each stretch, as the torque that it is a part of."""
    fed = data.feedforward.copy()
    for stretch in data.stretches:
        at = np.arange(stretch.start, stretch.stop) - rows
        fed[stretch.rows] = data.feedforward[np.clip(at, stretch.start, stretch.stop - 1)]
    return replace(data, feedforward=fed)


def _loops_between(problem: Problem) -> bool:
    """Whether a loop was found that works between the samples."""
    return problem.controller is not None and problem.controller.ticks > 1


def _is_current_loop(problem: Problem, model_fit: ModelFit, late: _Late, stages: int = 1) -> bool:
    """Whether a lag is not longer than that of an ordinary current loop."""
    error = _error_of_lag(problem, model_fit, late, stages)
    return not is_longer(problem, late.rest, late.data.lag, error)


def _late_by(problem: Problem, model_fit: ModelFit, cycles: int, stages: int = 1) -> _Late:
    """The best lag behind so many cycles, of so many stages.

    A demand that answers to an encoder's noise is smoothed by a lag, and leaves less of the noise that was read with
    the motion: behind a coarse encoder a torque that acted at once was told to lag by 0.3 ms. Where what repeats share
    says another lag, beyond doubt, it is that.
    """
    data = problem.data
    already = data.late if _loops_between(problem) else data.upsampling * data.cycles
    prompt = _acting_later(data, data.upsampling * cycles - already, cycles)

    def late(lag: float) -> _Late:
        moved = behind_current_loop(prompt, lag, stages)
        rest = _left(problem, model_fit, moved)
        return _Late(moved, rest, _cost(problem, rest))

    most = MOST_LATE * CURRENT_LOOP + max(CYCLES) * data.upsampling * data.period
    whole = late(lowest(lambda lag: late(lag).cost, (0.0, most), FINE_LATE * CURRENT_LOOP))
    if not (data.repeated and repeats_alike(data)):
        return whole

    def again(lag: float) -> float:
        found = late(lag)
        return found.cost - _not_shared(problem, problem.training, found.rest)

    alone = replace(late(lowest(again, (0.0, most), FINE_LATE * CURRENT_LOOP)), shared=True)
    error = _error_of_lag(problem, model_fit, alone, stages)
    return alone if abs(whole.data.lag - alone.data.lag) > SURE * error else whole


def _error_of_lag(problem: Problem, model_fit: ModelFit, found: _Late, stages: int = 1) -> float:
    """Standard error [s]."""
    step = FINE_LATE * CURRENT_LOOP
    longer = _left(problem, model_fit, behind_current_loop(found.data, found.data.lag + step, stages))
    rows = problem.training > 0
    slope = np.where(rows, longer - found.rest, 0.0) / step
    square = float(slope @ slope)
    if found.shared:
        square -= _not_shared(problem, np.ones(len(slope)), slope)
    return float(np.sqrt(CORRELATED * np.mean(found.rest[rows] ** 2) / max(square, 1e-300)))


def _with(problem: Problem, data: Prepared) -> Problem:
    return replace(problem, data=data, moved=measured_motion(data))


def _left(problem: Problem, model_fit: ModelFit, moved: Prepared) -> Floats:
    """Error with the torque moved and all parameters fitted again, linearised, shape (m,)."""
    change = moved.torque - problem.data.torque
    error = model_fit.fitted.error + smoothed(problem.data, acted(change))
    return followed(model_fit.fitted.jacobian, error, problem.training)


def _cost(problem: Problem, left: Floats) -> float:
    """Of the training rows."""
    return float(np.sum(problem.training * left**2))


def _not_shared(problem: Problem, weights: Floats, error: Floats) -> float:
    """Of the weighted sum of squares of the training what differs from repeat to repeat; arrays of shape (m,)."""
    return sum(
        float(block.by_repeat(weights).sum(axis=0) @ block.by_repeat(error).var(axis=0, ddof=1))
        for block in problem.data.blocks
        if block.role == TRAINING and block.repeats > 1
    )
