"""How a diagnosis begins: controller, noise, and the model as it is, fitted to these recordings."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from autotune.core.errors import NotEnoughExcitation
from autotune.core.time_limit import limited, while_time
from autotune.diagnosis.candidates import Progress, free_of_model, no_progress
from autotune.diagnosis.evidence import evidence_of
from autotune.diagnosis.evidence.evidence import Evidence
from autotune.diagnosis.evidence.time_driven import without_clocked, without_reading_waves, without_wander
from autotune.diagnosis.evidence.torque_path import (
    LATE_RECORD,
    is_recorded_late,
    recorded_late,
    recorded_otherwise,
    sees_a_row_sooner,
    without_rounding,
)
from autotune.diagnosis.evidence.visibility import loop_note, refuse_answers
from autotune.diagnosis.refits import with_noise_of
from autotune.diagnosis.ripple_orders import MOST_LINES
from autotune.diagnosis.starts import Context
from autotune.diagnosis.wording import left_out_note, unexplained
from autotune.estimation.alignment import acts_after, shifted, without_twin
from autotune.estimation.bias_corrected_fit import ModelFit, fit_inside_twin
from autotune.estimation.contact_start import (
    as_rough,
    damped_as_twins_creep,
    fitted_contact,
    less_after_rests,
    sticking,
    usually_damped,
)
from autotune.estimation.controller import (
    as_acted,
    as_recorded,
    by_sensor_compared,
    controllers_of,
    find_controller,
)
from autotune.estimation.controller_between import AS_MUCH
from autotune.estimation.controller_law import PositionController
from autotune.estimation.controller_unsaid import TOLD_OF_LOOP
from autotune.estimation.data import TRAINING, Prepared
from autotune.estimation.disturbance import STILL
from autotune.estimation.disturbance_estimate import by_certainty, estimate_disturbance, with_expected_noise
from autotune.estimation.least_squares import Free, with_values
from autotune.estimation.model_error import by_chance, told_by_twin
from autotune.estimation.policy import POLICY, Policy
from autotune.estimation.problem import (
    Problem,
    Told,
    base_free,
    by_steadiness,
    new_problem,
    refit,
)
from autotune.estimation.residual import smoothed
from autotune.models import layout
from autotune.models.drive_model import DriveModel, Packed
from autotune.models.torque_ripple import TORQUE_RIPPLE
from autotune.signals.place_terms import columns

NO_TWIN = "No twin: "
UNSTABLE, USELESS = "is unstable or rings", "leaves more of the torque than no simulation does"
LACKS_MOST = "lacks what makes most of the torque, such as gravity"
HEAVY = (
    "Gravity, or a spring, makes most of the torque: beside it inertia and friction leave {:.2g} % of the torque's "
    "variance."
)
TWIN_AFTER_ALL = (
    "A twin left more than none with the model as it was, but less beside what was found: it is used."
)
BY_SENSOR = (
    "Of the two torques in the file 'torque', which was measured, is compared, and not the demand "
    "'torque_command'."
)
AS_ASKED = (
    "Above {:.2g} Hz the model is compared with what the controller, by its law, must have asked for along the "
    "recorded motion, and not with the recorded torque: that was read at one moment of a cycle, or is noisier."
)
LATE_BY = 0.25
"""Rows by which a torque must act late for a twin to be tried with that."""


def begin(
    data: Prepared,
    model: DriveModel,
    progress: Progress = no_progress,
    simulations: int = 2,
    policy: Policy = POLICY,
    contrary: bool = False,
) -> tuple[Problem, ModelFit, Packed, tuple[str, ...]]:
    """Controller, noise and the fit of the model as it is.

    `contrary`: of a torque that may have been recorded a sample late that is taken which this model makes less likely.
    Where time is up (`core.time_limit`) the fit is as good as it is then, and nothing is refused for what it leaves.

    Raises:
        NotEnoughExcitation: the model cannot be made to fit this axis at all.
    """
    with limited(math.inf):
        problem, model_fit, packed, notes = _as_it_is(data, model, progress, simulations, policy)
    problem, settled = while_time(lambda: _aligned(problem, model_fit), (problem, model_fit))
    if LATE_RECORD not in notes:
        problem, settled, said = while_time(
            lambda: _late_record(problem, settled, packed, contrary), (problem, settled, ())
        )
        notes = (*notes, *said)
    problem, settled = while_time(
        lambda: _without_reading_waves(*_without_clocked(problem, settled)), (problem, settled)
    )
    notes = (*notes, *while_time(lambda: _refuse_misfit(problem, settled), ()))
    notes = (*notes, *left_out_note(problem, settled))
    return problem, settled, packed, (*notes, *evidence_of(problem.data).limits(problem))


def _as_it_is(
    data: Prepared, model: DriveModel, progress: Progress, simulations: int, policy: Policy
) -> tuple[Problem, ModelFit, Packed, tuple[str, ...]]:
    """Problem and fit with the torque as it was recorded, the model as it was given, and what is to be said."""
    refuse_answers(data, policy)
    found = find_controller(data, policy)
    packed = model.pack()
    notes: tuple[str, ...] = ()
    if not found.usable:
        data, said = without_twin(as_acted(data))
        no_twin = () if data.steady else (f"{NO_TWIN}{found.why}. Confidence is lower.",)
        notes = (*no_twin, *said, *loop_note(data, policy))
    laws = controllers_of(data, found, policy)
    law, disturbance = told_by_twin(data, laws, packed, policy)
    read = tuple(said for said in data.metadata.remarks if said.startswith(TOLD_OF_LOOP))
    notes = (*law.notes, *read, *notes)
    if law.usable and by_sensor_compared(data, law):
        notes = (*notes, BY_SENSOR)
    told = Told(data, laws) if any(one.within for one in laws) else None
    data, known = as_recorded(data, law), data
    problem = replace(
        new_problem(data, law, policy), simulations=simulations, disturbance=disturbance, told=told
    )
    progress("fit of the model as it is")
    free = [
        *base_free(packed, problem.scales, data.metadata.motion_unit),
        *free_of_model(model, problem.scales),
    ]
    packed = with_values(packed, free, packed.p[[one.slot for one in free]])
    problem, model_fit, without = _fit_as_it_is(problem, known, packed, free)
    notes = without or notes
    if problem.twin and law.asked > 0.0:
        notes = (*notes, AS_ASKED.format(law.asked))
    return problem, model_fit, packed, notes


def notes_after(notes: tuple[str, ...], before: Problem, after: Problem) -> tuple[str, ...]:
    """What was said at the beginning of a diagnosis, as it is where a twin was told beside what was found.

    Or where a torque turned out to be recorded a sample late, or to act a cycle after the row that it was taken to be
    too late for.
    """
    if sees_a_row_sooner(before, after):
        notes = (*notes, LATE_RECORD)
    if after.data.cycles > 0:
        notes = tuple(note for note in notes if note != LATE_RECORD)
    if before.twin or not after.twin:
        return notes
    return (*(note for note in notes if not note.startswith(NO_TWIN)), TWIN_AFTER_ALL)


def _fit_as_it_is(
    problem: Problem, known: Prepared, packed: Packed, free: list[Free]
) -> tuple[Problem, ModelFit, tuple[str, ...]]:
    """The model as it is, fitted inside the twin or, where none can be had, without one; and what is to be said then.

    `known` is the data with the torque as it was recorded.

    Raises:
        NotEnoughExcitation: the model cannot be made to fit at all.
    """
    law = problem.controller
    fitted = _first_fit(problem, packed, free)
    if isinstance(fitted, str) and problem.twin and law is not None and law.within:
        # what counts make may be where the twin, off by parts of one, does not expect it
        again = _first_fit(replace(problem, controller=replace(law, adrift=True)), packed, free)
        fitted = fitted if isinstance(again, str) else again
    notes: tuple[str, ...] = ()
    if isinstance(fitted, str) and (late := _recorded_late(problem)) is not None:
        again = _first_fit(late, usually_damped(packed), free)
        fitted, notes = (fitted, ()) if isinstance(again, str) else (again, (LATE_RECORD,))
    if not isinstance(fitted, str):
        given = float(packed.p[layout.COULOMB])
        if _astray(*fitted, given):
            # a plain fit has what belongs to the place beside the model: its friction is no more than that
            fitted = LACKS_MOST
            free = [replace(one, upper=given) if one.slot == layout.COULOMB else one for one in free]
    if isinstance(fitted, str) and problem.twin and (moved := _as_it_acts(problem)) is not None:
        again = _first_fit(moved, packed, free)
        fitted = fitted if isinstance(again, str) else again
    if isinstance(fitted, str) and problem.twin and law is not None:
        data, said = without_twin(as_recorded(known, replace(law, asked=0.0)))
        notes = (f"{NO_TWIN}a simulation of the model with this controller {fitted}.", *said)
        problem = replace(new_problem(data, None, problem.policy), rough=law, told=problem.told)
        fitted = _first_fit(problem, packed, free)
    if isinstance(fitted, str):
        raise NotEnoughExcitation(
            "the model does not fit these recordings at all; check that model and recordings are of the "
            "same axis, or fit a new model: autotune model fit"
        )
    return *fitted, notes


def _as_it_acts(problem: Problem) -> Problem | None:
    """The problem with its torque as late as it acts along the motion; None where that is its row, or later than a
    row, as no moment of recording is. An exact law tells itself when the torque acts.
    """
    data, law = problem.data, problem.controller
    if not data.repeated or (law is not None and law.exact):
        return None
    rows = acts_after(data)
    if not LATE_BY < rows <= 1.0:
        return None
    return _begun_anew(problem, shifted(data, -2.0 * rows * data.upsampling), law)


def _begun_anew(problem: Problem, data: Prepared, law: PositionController | None) -> Problem:
    """The problem of other data and another law, before anything is known about noise."""
    again = new_problem(data, law, problem.policy)
    return replace(again, simulations=problem.simulations, told=problem.told)


def _first_fit(problem: Problem, packed: Packed, free: list[Free]) -> tuple[Problem, ModelFit] | str:
    """Problem and fit, or what a simulation of the model with this controller does, that it is of no use."""
    start = problem.correction(packed, 1)
    if not start.stable:
        start = replace(start, stable=True)
    fitted = refit(problem, packed, free, start, 8)
    if not np.isfinite(fitted.cost):
        return UNSTABLE
    evidence = evidence_of(problem.data)
    weight = evidence.weights(problem, fitted.error)
    if weight is not None:
        problem = replace(problem, weight=weight)
        fitted = refit(problem, fitted.packed, free, start, 4)
        fitted, free = fitted_contact(problem, fitted, start, free)
    plain = fitted.cost
    for _ in range(2 if problem.disturbance is STILL else 1):
        problem = replace(problem, disturbance=estimate_disturbance(problem, fitted.packed))
        problem = as_rough(problem, fitted.packed)
        correction = problem.correction(fitted.packed, 1)
        if not correction.stable:
            return UNSTABLE
        fitted = refit(problem, fitted.packed, free, correction, 4)
    problem = by_certainty(problem, fitted.packed)
    problem = less_after_rests(by_steadiness(problem, fitted.error), fitted)
    problem = with_expected_noise(problem, fitted.packed)
    model_fit = fit_inside_twin(problem, fitted.packed, free, 2)
    if problem.two_masses(packed):  # with a held bias these fits walk off: the model may be nearer
        as_given = fit_inside_twin(problem, packed, free, 2)
        if model_fit is None or (as_given is not None and as_given.fitted.cost < model_fit.fitted.cost):
            model_fit = as_given
    if model_fit is None:
        return UNSTABLE
    if _worse_than_none(problem, evidence, model_fit, plain):
        return USELESS
    return _sticking(*_damped(problem, model_fit))


def _damped(problem: Problem, model_fit: ModelFit) -> tuple[Problem, ModelFit]:
    """The fit with damping by which its twins creep as the axis does, and these disturbed as much as it is then."""
    again = damped_as_twins_creep(problem, model_fit)
    if again is model_fit:
        return problem, model_fit
    return with_noise_of(problem, again)


def _sticking(problem: Problem, model_fit: ModelFit) -> tuple[Problem, ModelFit]:
    """Problem and fit without rows at rest, where the axis sticks without presliding; else as they are."""
    without, starts = sticking(problem, model_fit.fitted.packed)
    best, least = (
        model_fit,
        problem.policy.clearly_less * without.mean_square(model_fit.fitted.error, TRAINING),
    )
    for start in starts:
        found = fit_inside_twin(without, start, list(model_fit.free), 3)
        if found is not None and found.fitted.cost < least:
            best, least = found, found.fitted.cost
    if best is model_fit:
        return problem, model_fit
    if not problem.twin:
        return without, best
    packed = best.fitted.packed
    without = replace(without, disturbance=estimate_disturbance(without, packed))
    again = fit_inside_twin(without, packed, list(best.free), 2)
    return with_expected_noise(without, packed), again or best


def _worse_than_none(problem: Problem, evidence: Evidence, model_fit: ModelFit, plain: float) -> bool:
    """Whether a twin makes it worse; `plain` is the cost before it was shaken.

    Where the drive works between the samples, what the twin makes of a coarse encoder's counts may be other than what
    the drive makes of them. Then it must explain as much as no twin at all: what an effect leaves that is missing
    drowns what either takes out.
    """
    cost = model_fit.fitted.cost
    law = problem.controller
    if evidence.repeats and not (law is not None and law.within):
        return False
    without = replace(problem, controller=None)
    free = list(model_fit.free)
    none = refit(without, model_fit.fitted.packed, free, without.correction(model_fit.fitted.packed)).cost
    if not evidence.repeats:
        return cost > problem.policy.twin_worse * min(plain, none)
    if law is not None and not law.adrift:  # where counts are averaged their chance is no excuse
        cost -= by_chance(problem, model_fit.correction)
    return cost > AS_MUCH * none


def _aligned(problem: Problem, model_fit: ModelFit) -> tuple[Problem, ModelFit]:
    """Torque and motion aligned to this model, and the model fitted again.

    What a demand goes through before it acts was taken for a disturbance, and the twin shaken by it.
    """
    evidence = evidence_of(problem.data)
    told, here = without_rounding(problem, model_fit), model_fit
    if told is not problem:
        fitted = refit(told, here.fitted.packed, list(here.free), here.correction, 2)
        here = replace(here, fitted=fitted)
    again = evidence.aligned(told, here)
    if again is problem:
        return problem, model_fit
    found = fit_inside_twin(again, here.fitted.packed, list(here.free), 2) or here
    # what is missing may look like a lag in what is compared; the twin's loop is not so late then
    least = problem.policy.clearly_less * found.fitted.cost
    if told is problem and again.data.lag > 0.0 and model_fit.fitted.cost < least:
        return problem, model_fit
    if not evidence.repeats:
        return again, found
    if told is not problem or again.data.cycles > 0 or again.data.lag > 0.0:
        again, found = with_noise_of(again, found)
    other = recorded_otherwise(again, found)
    return (again, found) if other is None else with_noise_of(*other)


def _recorded_late(problem: Problem) -> Problem | None:
    """`recorded_late`, before anything is known about noise."""
    late = recorded_late(problem)
    return None if late is None else _begun_anew(problem, late.data, late.controller)


def _late_record(
    problem: Problem, model_fit: ModelFit, packed: Packed, contrary: bool
) -> tuple[Problem, ModelFit, tuple[str, ...]]:
    """Problem and fit with the torque taken as recorded a sample late, where the model says so, and a sentence on it.

    Or, `contrary`, where it does not.

    A law that sees everything a sample late, and one that does not whose torque is read when the next one is due,
    leave the same columns. Only what the axis does tells them apart: the loop of the first is the slower one.

    Both are fitted by the same way from the model as it was given (`packed`), which may have been fitted in the wrong
    loop itself: a contact that makes up for that is the bias of its twin, which a fit holds, and damped by nothing.
    """
    again = _recorded_late(problem)
    if again is None:
        return problem, model_fit, ()
    found = _first_fit(again, usually_damped(packed), list(model_fit.free))
    if isinstance(found, str):
        return problem, model_fit, ()
    again, other = _aligned(*with_noise_of(*found))
    late = is_recorded_late(problem, model_fit.fitted, again, other.fitted) is not contrary
    return (again, other, (LATE_RECORD,)) if late else (problem, model_fit, ())


def _without_clocked(problem: Problem, model_fit: ModelFit) -> tuple[Problem, ModelFit]:
    """Problem and fit without torques that follow the clock, and a level that wanders."""
    while True:
        left = problem, model_fit.fitted.packed, model_fit.fitted.error
        again = without_wander(*left) or without_clocked(*left)
        if again is None:
            return problem, model_fit
        other = fit_inside_twin(again, model_fit.fitted.packed, list(model_fit.free), 2)
        if other is None or other.fitted.cost > model_fit.fitted.cost:
            return problem, model_fit
        problem, model_fit = again, other


def _without_reading_waves(problem: Problem, model_fit: ModelFit) -> tuple[Problem, ModelFit]:
    """Problem and fit without what the encoder's interpolation adds to the motion."""
    again = without_reading_waves(problem, model_fit)
    if again is None:
        return problem, model_fit
    other = fit_inside_twin(again, model_fit.fitted.packed, list(model_fit.free), 2)
    if other is None or other.fitted.cost > model_fit.fitted.cost:
        return problem, model_fit
    return _aligned(again, other)


def _left_beside_place(problem: Problem) -> float:
    """Share of the torque's variance that inertia, friction and gravity (linear axes: a spring) leave together.

    Infinite where inertia or friction comes out below zero: the torque has the wrong sign, or is of another axis.
    """
    data, rows = problem.data, problem.training > 0
    q = data.position - float(np.mean(data.position))
    place = [np.sin(q), np.cos(q)] if data.metadata.motion_unit == "rad" else [q]
    parts = [data.acceleration, np.sign(data.velocity), data.velocity, np.ones(len(q)), *place]
    table = np.column_stack([smoothed(data, np.ascontiguousarray(part)) for part in parts])[rows]
    torque = smoothed(data, data.torque)[rows]
    table = table / np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    found = np.linalg.lstsq(table, torque, rcond=1e-10)[0]
    if min(found[0], found[1]) <= 0.0:
        return math.inf
    return float(np.var(torque - table @ found)) / max(float(np.var(torque)), 1e-300)


def _astray(problem: Problem, model_fit: ModelFit, given: float) -> bool:
    """Whether a fit inside the twin is of no use although the twin is: it took a load for friction.

    Friction that takes up a load ends as a spring, its level above any torque that was recorded, which no axis that
    slid has: a twin with it goes another way than the axis. `given` is the level of the model as it was given [N m].
    """
    data = problem.data
    peak = float(np.max(np.abs(data.torque[data.grid])))
    return problem.twin and given <= peak < float(model_fit.fitted.packed.p[layout.COULOMB])


def _refuse_misfit(problem: Problem, model_fit: ModelFit) -> tuple[str, ...]:
    """A sentence on the place where that is most of what the model leaves: gravity, a spring, waves.

    Raises:
        NotEnoughExcitation: the model leaves nearly all of the torque, and the place does not explain it either.
    """
    share = unexplained(problem, model_fit)
    if share <= problem.policy.misfit:
        return ()
    context = Context(problem, model_fit.fitted, model_fit.fitted.packed)
    thin, orders = context.thinned(), context.orders_in_residual(MOST_LINES)
    waves = columns(problem.data.position[problem.data.grid[thin.rows]], orders, context.angle)
    explained = thin.share(waves) if orders else 0.0
    if share * (1.0 - explained) > problem.policy.misfit:
        if (left := _left_beside_place(problem)) <= problem.policy.misfit:
            return (HEAVY.format(100.0 * left),)
        raise NotEnoughExcitation(
            f"the model explains only {100 * max(1 - share, 0.0):.0f} % of the torque even after refitting; is the "
            "sign or the unit of the torque wrong, or the model of another axis? Fit a new model with "
            "'autotune model fit', or import the file again with another torque factor"
        )
    found = ", ".join(f"{order:.4g}" for order in orders)
    return (
        f"The model explains {100 * max(1 - share, 0.0):.0f} % of the torque; waves over position, as cogging makes "
        f"them, {100 * explained:.0f} % of the rest (orders {found}): 'autotune model add {TORQUE_RIPPLE.name}'.",
    )
