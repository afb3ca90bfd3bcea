"""Models fitted to any recordings: a first one, without knowing which experiments were made, and effects added to it.

The first: inertia, viscous and Coulomb friction and offset by least squares on motion and torque; stiffness from the
best of several presliding distances; then everything together inside the twin. An effect: a joint fit with it, with
the error before and after on data that no fit ever saw.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.arrays import Flags, Floats, Integers
from autotune.core.errors import NotEnoughExcitation
from autotune.diagnosis.baseline import begin
from autotune.diagnosis.candidates import Progress, model_from, no_progress
from autotune.diagnosis.compare import EACH_IN_TURN, check_same_axis, floor_of_unseen, roles_unseen
from autotune.diagnosis.contact_laws import resolved
from autotune.diagnosis.evidence import evidence_of
from autotune.diagnosis.refits import inside_twin, is_chance, without_insignificant_terms
from autotune.diagnosis.ripple_orders import MOST_LINES, with_whole_orders
from autotune.diagnosis.screening import screen
from autotune.diagnosis.wording import torque_path_notes
from autotune.estimation.bandwidth import prepared_for, prepared_to_fit
from autotune.estimation.bias_corrected_fit import ModelFit, fit_inside_twin
from autotune.estimation.contact_start import LEAST_ROWS, BaseTold, begun_contact, inertia_between_torques
from autotune.estimation.data import TRAINING, Prepared, prepare
from autotune.estimation.least_squares import Fitted, covariance, standard_errors
from autotune.estimation.policy import POLICY, Policy
from autotune.estimation.problem import Problem, new_problem
from autotune.estimation.residual import smoothed
from autotune.models import layout
from autotune.models.drive_model import DriveModel, HistoryEntry, Packed, base_model
from autotune.models.table import effect_kind
from autotune.models.total_friction import friction_parts, stiffness_parts
from autotune.recordings.recording import Recording
from autotune.signals.normal_equations import BLOCK_SECONDS, Part, assemble
from autotune.signals.place_terms import LEAST_GAIN, columns, find_lines, held_out_error

WAVE_ROWS, MOST_ORDER = 6000, 400.0
"""Rows in which waves over position are looked for before anything is fitted, and the largest order."""
POOR = 0.2
"""Relative error above which a user is told of it."""
TORQUES_DIFFER = 0.01
"""Of the inertia, by which two torques must differ for a user to be told of it."""
WITHIN_A_CYCLE = (
    "By the torque's sensor the inertia is {:.2g} % {} than by the demand. Within a cycle a drive's torque changes "
    "with the acceleration where its position loop works less often than its velocity loop, and what is read at one "
    "moment of the cycle has a part of it. So the inertia is known to ±{:.2g} % (1σ) only: record the mean of the "
    "torque over the cycle, or take the inertia from the drawing."
)
OF_MOTION = ("inertia", "viscous", "stiffness", "micro_damping")
"""What only quick motion tells: not samples that are too slow for the torque."""


@dataclass(frozen=True, slots=True)
class FittedModel:
    """A fitted model and whether it may be used; `untold` are parameters that samples so slow cannot tell."""

    model: DriveModel
    valid: bool
    reason: str
    relative_error: float
    notes: tuple[str, ...] = ()
    untold: tuple[str, ...] = ()


def fit_model(
    recordings: Sequence[Recording],
    effects: Sequence[str] = (),
    progress: Progress = no_progress,
    policy: Policy = POLICY,
) -> FittedModel:
    """Base model, and effects on top in the order given.

    Raises:
        RecordingError, ConfigurationError, NotEnoughExcitation: recordings that cannot be used.
    """
    data = prepared_for(recordings, policy)
    start = starting_model(data, policy)
    if data.steady:
        # constant speeds tell nothing about inertia and presliding; the noise on them a little
        rough = starting_model(prepare(recordings), policy)
        start = start.with_values({name: rough[name] for name in ("inertia", "stiffness", "micro_damping")})
    problem, model_fit, nominal, notes = begin(data, start, progress, policy=policy)
    for effect in effects:
        progress(f"refit with {effect}")
        problem, _, model_fit = grown(problem, model_fit, nominal, effect, start)
    notes = (*notes, *torque_path_notes(problem.data, problem.controller))
    errors = _standard_errors(problem, model_fit.fitted)
    errors, said = _between_torques(problem, data, model_fit.fitted, errors)
    notes = (*notes, *said)
    model = model_from(start, model_fit.fitted.packed, model_fit.fitted.free, errors)
    relative = relative_error(problem, model_fit)
    reason = _reason(model, policy)
    if not reason and relative > POOR:
        notes = (
            *notes,
            f"The base model leaves {100 * relative:.0f} % of the torque unexplained, a part of which is in "
            "its parameters and not in their standard errors; 'autotune model diagnose' tells what is missing.",
        )
    if data.steady:
        notes = (*notes, "Only the curve over constant speeds was fitted; inertia and stiffness are rough.")
    if problem.scales.one_way:
        notes = (
            *notes,
            "The axis moved one way only: offset and Coulomb friction are one number; it is "
            "given as Coulomb friction.",
        )
    untold = OF_MOTION if evidence_of(problem.data).limits(problem) else ()
    return FittedModel(model, not reason, reason, relative, notes, untold)


def _standard_errors(problem: Problem, fitted: Fitted) -> Floats:
    """Of the free parameters, in their units, shape (k,): at least what seconds disagree by.

    What a model lacks is no noise that rows a few apart would average; left out second by second, it says how much of
    it each parameter takes (`normal_equations`). It comes again with each repeat of an experiment: these seconds are
    one.
    """
    data, plain = problem.data, standard_errors(fitted, problem.training)
    if data.steady:
        return plain
    seconds = float(np.median(np.diff(data.grid[:50]))) * data.period
    block = max(1, round(BLOCK_SECONDS * data.pace / seconds))
    root = np.sqrt(problem.training)
    error, columns = root * fitted.error, root[:, None] * fitted.jacobian
    variance = float(np.mean(error[root > 0] ** 2))
    parts = [
        Part(error[rows], columns[rows], columns[rows], block * repeats, 1.0 / max(variance, 1e-300))
        for rows, repeats in _rows_of_like_moments(problem)
    ]
    spread = np.sqrt(np.maximum(np.diag(assemble(parts).covariance), 0.0)) * fitted.scales
    return np.asarray(np.maximum(plain, spread))


def _rows_of_like_moments(problem: Problem) -> Iterator[tuple[Integers, int]]:
    """Rows that were fitted, those of one moment of all repeats side by side, and how many repeats there are."""
    data, fitted = problem.data, problem.training > 0
    alone = fitted.copy()
    for block in data.blocks:
        if block.repeats > 1:
            rows = block.by_repeat(np.arange(len(data.grid))).T.ravel()
            alone[block.rows] = False
            if fitted[rows].any():
                yield rows[fitted[rows]], block.repeats
    if alone.any():
        yield np.flatnonzero(alone), 1


def _between_torques(
    problem: Problem, data: Prepared, fitted: Fitted, errors: Floats
) -> tuple[Floats, tuple[str, ...]]:
    """Standard errors with what demand and sensor disagree by about the inertia, and what is to be said of it.

    Anything from the one to the other is as likely. A demand that an exact law explains is held from row to row: there
    is nothing within a row.
    """
    law = problem.controller
    within = math.nan if data.steady or (law is not None and law.exact) else inertia_between_torques(data)
    place = next((i for i, one in enumerate(fitted.free) if one.slot == layout.INERTIA), None)
    if not math.isfinite(within) or place is None:
        return errors, ()
    apart, errors = within / fitted.values[place], errors.copy()
    doubt = abs(apart) / math.sqrt(12.0)
    errors[place] = math.hypot(errors[place], doubt * fitted.values[place])
    which = "less" if apart < 0.0 else "more"
    said = WITHIN_A_CYCLE.format(100.0 * abs(apart), which, 100.0 * doubt)
    return errors, (said,) if abs(apart) >= TORQUES_DIFFER else ()


def relative_error(problem: Problem, model_fit: ModelFit) -> float:
    """Norm of the residual over norm of the torque, on what was fitted."""
    rows = problem.training > 0
    torque = smoothed(problem.data, problem.data.torque)[rows]
    return float(np.linalg.norm(model_fit.fitted.error[rows]) / max(float(np.linalg.norm(torque)), 1e-300))


def starting_model(data: Prepared, policy: Policy = POLICY) -> DriveModel:
    """Rough base parameters from least squares.

    Raises:
        NotEnoughExcitation: inertia or friction cannot be told from the motion.
    """
    problem = new_problem(data, None)
    told = BaseTold.of(data)
    _refuse_untold(data, told, problem.scales.one_way, policy)
    meta = data.metadata
    packed = begun_contact(problem, told.values(problem.scales.one_way)).p
    values = {name: float(packed[slot]) for slot, name in enumerate(layout.BASE)}
    return base_model(values, None, meta.motion_unit, meta.axis, meta.fingerprint, meta.torque_unit)


def _refuse_untold(data: Prepared, told: BaseTold, one_way: bool, policy: Policy) -> None:
    """Raises NotEnoughExcitation where inertia or friction cannot be told from the motion."""
    if told.rows.sum() < LEAST_ROWS:
        raise NotEnoughExcitation("the axis hardly moves in these recordings; record longer, faster motion")
    values, table, target = told.found, told.table, told.target
    if values["inertia"] > 0.0 or _waves_instead(data, told.rows, table, target):
        return
    part = float(np.std(values["inertia"] * table[:, 0]) / max(float(np.std(target)), 1e-300))
    if part <= policy.wrong_sign:
        return
    speeds = data.velocity[data.grid[data.role(TRAINING)]]
    friction = values["coulomb"] + (values["offset"] * np.sign(speeds.mean()) if one_way else 0.0)
    why = "its sign is wrong, or it is not the torque of this motion. Import again with a factor of -1"
    if friction > 0.0:  # which a torque of the wrong sign would have below zero too
        why = (
            "friction has the right sign, so that is not turned: torque or motion is filtered or late against "
            "the other, or torque waves with the place make the axis speed up and slow down. Record both "
            "unfiltered, and quicker changes of speed"
        )
    raise NotEnoughExcitation(
        f"the torque falls where the axis accelerates (inertia {values['inertia']:.3g}): {why}"
    )


def _waves_instead(data: Prepared, rows: Flags, table: Floats, target: Floats) -> bool:
    """Whether waves over position are why the torque falls where the axis accelerates: cogging at constant speed."""
    scale = 1.0 if data.metadata.motion_unit == "rad" else 2.0 * math.pi
    position, every = data.position[data.grid[rows]], math.ceil(len(target) / WAVE_ROWS)
    friction = table[::every, 2:]
    lines = find_lines(position[::every], target[::every], friction, scale, MOST_LINES, MOST_ORDER)
    if not lines:
        return False
    waves = columns(position, [line.order for line in lines], scale)
    parts = [(table[:, 2:], target), (np.hstack([table[:, 2:], waves]), target)]
    without, beside = (held_out_error([part]) for part in parts)
    return beside <= (1.0 - LEAST_GAIN) * without


def loose(model: DriveModel, policy: Policy = POLICY) -> list[str]:
    """Of inertia and Coulomb friction what is known so little that the model may not be used."""
    return [
        name
        for name in ("inertia", "coulomb")
        if (error := model.base[name].standard_error) is not None and error > policy.fit_loose * model[name]
    ]


def _reason(model: DriveModel, policy: Policy) -> str:
    if names := loose(model, policy):
        return f"{', '.join(names)} cannot be told from these recordings; record the whole programme"
    return ""


@dataclass(frozen=True, slots=True)
class Added:
    """A model with one effect more, and how far the error fell.

    Attributes:
        error_before, error_after, noise_floor_rms: rms on data not used for the fit [N m or N].
        unseen: in words, which data those are.
    """

    model: DriveModel
    error_before: float
    error_after: float
    noise_floor_rms: float
    unseen: str
    notes: tuple[str, ...] = ()


def add_effect(
    effect: str,
    recordings: Sequence[Recording],
    model: DriveModel,
    when: str,
    source: str,
    progress: Progress = no_progress,
    policy: Policy = POLICY,
) -> Added:
    """Refits the model with an effect.

    Args:
        when, source: for the model's history: the time, and what the data were.

    Raises:
        ConfigurationError: no such effect, or a model of another axis.
        NotEnoughExcitation: these data cannot say anything about the effect.
    """
    effect_kind(effect).refuse_unit(model.motion_unit)
    check_same_axis(model, recordings)
    problem, root, nominal, notes = begin(prepared_to_fit(recordings, policy), model, progress, policy=policy)
    progress(f"refit with {effect}")
    problem, root, model_fit = grown(problem, root, nominal, effect, model)
    model_fit = resolved(problem, model_fit) or model_fit
    before, after, floor, unseen = held_out_errors(problem, root, model_fit)
    improved = updated_model(model, problem, model_fit.fitted)
    if is_chance(problem, model_fit, effect_kind(effect)):
        notes = (*notes, f"{effect} is no more than chance makes of noise in these data; leave it out.")
    known_floor = floor if math.isfinite(floor) else None
    entry = HistoryEntry(when, f"+ {effect}", source, before, after, known_floor, unseen)
    return Added(improved.with_history(entry), before, after, floor, unseen, notes)


def grown(
    problem: Problem, root: ModelFit, nominal: Packed, effect: str, model: DriveModel
) -> tuple[Problem, ModelFit, ModelFit]:
    """The model without and with an effect, and the problem, whose columns may have been aligned anew.

    Raises:
        NotEnoughExcitation: the data do not allow it, or the twin becomes unstable.
    """
    model_fit = _with_effect(problem, root, nominal, effect, model)
    for _ in range(4):
        again = evidence_of(problem.data).aligned(problem, model_fit)
        if again is problem:
            break
        problem = again
        root = fit_inside_twin(problem, root.fitted.packed, list(root.free), 2) or root
        model_fit = (
            fit_inside_twin(problem, model_fit.fitted.packed, list(model_fit.free), 3, model_fit.effects)
            or model_fit
        )
    return problem, root, with_whole_orders(problem, without_insignificant_terms(problem, model_fit))


def _with_effect(
    problem: Problem, root: ModelFit, nominal: Packed, effect: str, model: DriveModel
) -> ModelFit:
    """The model with the effect, at its best.

    Raises:
        NotEnoughExcitation: the data do not allow it, or the twin becomes unstable.
    """
    screened = screen(problem, evidence_of(problem.data), root, nominal, effect)
    if screened is None:
        raise NotEnoughExcitation(
            f"these recordings cannot say anything about {effect}: {effect_kind(effect).why_no_start}. "
            f"It would look like this: {effect_kind(effect).looks_like}"
        )
    refitted = inside_twin(problem, root, root, screened)
    if refitted is None:
        raise NotEnoughExcitation(
            f"with {effect} the simulated axis becomes unstable on these recordings; record the programme "
            "'diagnosis' once more, or add another effect first"
        )
    return refitted.model_fit


def updated_model(model: DriveModel, problem: Problem, fitted: Fitted) -> DriveModel:
    """The model with fitted values, effects and standard errors, those of its sums too."""
    spread = covariance(fitted, problem.training)
    found = model_from(model, fitted.packed, fitted.free, np.sqrt(np.maximum(np.diag(spread), 0.0)))
    spread = _within_bounds(spread, fitted)
    return replace(
        found,
        friction_error=_error_of_sum(spread, fitted, dict.fromkeys(friction_parts(found), 1.0)),
        stiffness_error=_error_of_sum(spread, fitted, stiffness_parts(found)),
    )


def _within_bounds(spread: Floats, fitted: Fitted) -> Floats:
    """A covariance (k, k) beside what the bounds say: an element's torque is not below 0, so it is not less known than
    by its own size. Linearised, elements that lie close together trade far more than they carry.
    """
    lower = np.array([one.lower for one in fitted.free])
    room = np.maximum(fitted.values - lower, 1e-6 * fitted.scales)
    known = spread / np.outer(room, room)
    return np.asarray(np.linalg.solve(np.eye(len(room)) + known, known) * np.outer(room, room))


def _error_of_sum(spread: Floats, fitted: Fitted, slopes: Mapping[str, float]) -> float | None:
    """Standard error of what changes by so much with each free parameter; None where none of them was free."""
    along = np.array([slopes.get(one.name, 0.0) for one in fitted.free])
    return math.sqrt(max(float(along @ spread @ along), 0.0)) if np.any(along) else None


def held_out_errors(problem: Problem, before: ModelFit, after: ModelFit) -> tuple[float, float, float, str]:
    """Rms before and after, noise floor, and on which data: veto and test, else held-out experiments."""
    floor = floor_of_unseen(problem, after.fitted.error)
    noise = floor.rms if floor is not None else math.nan
    if roles := roles_unseen(problem):
        rows = problem.data.role(*roles)
        errors = [float(np.sqrt(np.mean(x.fitted.error[rows] ** 2))) for x in (before, after)]
        return errors[0], errors[1], noise, " and ".join(roles)
    count = max(float(problem.training.sum()), 1.0)
    errors = [math.sqrt(x.unseen.total / count) for x in (before, after)]
    return errors[0], errors[1], noise, EACH_IN_TURN
