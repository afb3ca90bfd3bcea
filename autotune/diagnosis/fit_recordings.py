"""Which way recordings are fitted, and how the result is judged.

The standard programme is analysed experiment by experiment; any other motion is fitted as a whole inside
the twin. What that cannot start (effects beyond friction and ripple, motion one way only, friction of another
curve) or bring to an end is left to the search of `diagnose`, which needs less and promises less.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError, NotEnoughExcitation, RecordingError
from autotune.diagnosis.candidates import no_progress
from autotune.diagnosis.compare import Compared, compare, simulate_closed_loop, torque_residual, unseen_error
from autotune.diagnosis.evidence.evidence import MOST_UNEXPLAINED
from autotune.diagnosis.evidence.torque_path import SURE
from autotune.diagnosis.fit_result import FitResult
from autotune.diagnosis.fitting import fit_model, loose
from autotune.estimation.model_error import CLEARLY_LESS
from autotune.estimation.policy import POLICY
from autotune.identify.dahl import Complexity, judge_complexity
from autotune.identify.estimate import Estimate, Quantity, judge_model
from autotune.identify.first_guess import NoDryFriction, OneDirection
from autotune.identify.fit import HOLDS, STARTS, fit, joined
from autotune.identify.run import EXPERIMENTS, identify_run
from autotune.models.drive_model import DriveModel
from autotune.models.table import effect_kind
from autotune.recordings.axis_sizes import refuse_unlike_axis, sizes, sizes_line
from autotune.recordings.importing.plausible import refuse_other_velocity
from autotune.recordings.recording import Recording
from autotune.recordings.turn_lines import unit_question

HARDLY_ANY = (
    "the model's error is {percent:.0f} % of the torque, so that it explains hardly any of it: a wrong sign or unit, "
    "another axis, or an encoder whose error with the place shakes the axis"
)
FITTED_BESIDE = (
    "the model's error is {percent:.0f} % of the torque: most of that belongs to the place and was fitted beside the "
    "model, which does not hold it; take it in with --effects"
)
LARGE_PART = (
    "the model leaves {percent:.0f} % of the torque (rms) unexplained: what it lacks is in its numbers; "
    "'autotune model diagnose' tells what is missing"
)
HIDDEN = "or what the model leaves hides them, {percent:.0f} % of the torque (rms): {how}"
HIDDEN_FROM = 0.1
"""Of the torque (rms): less of it hides nothing that the motion would show."""

Progress = Callable[[str], None]
USUAL_ACCELERATION = 0.2 * (2.0 * math.pi) ** 2
"""Of the benchmark sine, at its reversals."""
ONE_NUMBER = ("coulomb", "offset")
"""What motion in one direction cannot tell apart."""
OF_SLIDING = ("inertia", "viscous", "coulomb", "offset")
"""What takes up what a model lacks most of."""
CURVED = (
    "Coulomb friction comes out below zero: friction grows faster than in proportion to speed; 'autotune model "
    "diagnose' tells what is missing"
)
NO_END = (
    "a fit of all motion together came to no end: the model lacks what matters most, and takes it for something else. "
    "The values are those of a fit along the measured motion; 'autotune model diagnose' tells what is missing"
)
TOO_SLOW = "not identified: the samples are too slow for the torque; record faster, or move more gently"
COMES_AGAIN = (
    "{percent:.2g} % of the torque (rms) is left in every repeat alike, beside {noise:.2g} % of noise: the model lacks "
    "that, or has another law for it. What is said after ± holds noise, and what seconds of these data disagree by; "
    "what a model lacks may move its numbers by more. 'autotune model diagnose' tells what is missing."
)
USUAL_PRECISION = {"rad": 1e-3, "m": 1e-5}
WORSE_THAN_NONE = 1.0
"""Of the torque's mean square: a model that leaves more is not valid."""
BEYOND_NOISE = 0.25
"""Of the noise's mean square: what is left beyond it from which on the search is asked whether it leaves half."""


def fit_recordings(
    recordings: Sequence[Recording],
    *,
    effects: Sequence[str] = (),
    precision: float | None = None,
    progress: Progress = no_progress,
) -> FitResult:
    """Fits a model and judges how much model the axis needs for `precision` [rad or m].

    Raises:
        RecordingError, NotEnoughExcitation: what is wrong with the data, or with their units, in a sentence.
        ConfigurationError: an unknown effect, one named twice, a precision that is none.
    """
    for effect in effects:
        effect_kind(effect)
        if list(effects).count(effect) > 1:
            raise ConfigurationError(f"effect {effect!r} is named twice in --effects; name it once")
    if precision is not None and not 0.0 < precision < math.inf:
        raise ConfigurationError(f"--precision is {precision:g}; it must be a finite number above 0")
    whole = joined(recordings)
    refuse_other_velocity(whole, "the recording")
    questions = refuse_unlike_axis(whole)
    result, compared = _behind_the_chain(
        _fitted(whole, effects, progress), whole, recordings, effects, progress
    )
    model = result.model
    if model is None:
        return replace(result, notes=(*questions, *result.notes), questions=tuple(questions))
    result = _with_intervals(_with_units_judged(result, model, whole), model)
    rows = sum(len(part) for part in recordings)
    if len(whole) < rows:
        said = f"of {rows} rows {len(whole)} were fitted, in stretches spread evenly: more would tell little more"
        result = replace(result, notes=(*result.notes, said))
    complexity = _complexity(result, precision, whole)
    steady = result.method == "speed_curve"  # points of a curve are no motion
    loop = None if steady else simulate_closed_loop(whole, model)
    return _with_error(replace(result, complexity=complexity, loop=loop), compared)


def _with_units_judged(result: FitResult, model: DriveModel, whole: Recording) -> FitResult:
    """The fit with its sizes stated, questions about units asked, and not valid where it is of no axis."""
    impossible, questions = judge_model(model, whole, result.not_identified)
    questions += [question] if (question := unit_question(whole)) else []
    stated = sizes_line(whole, None if "inertia" in result.not_identified else model["inertia"])
    result = replace(result, notes=(*questions, stated, *result.notes), questions=tuple(questions))
    if not impossible:
        return result
    reason = f"this is no axis: {impossible}"
    return replace(result, estimate=replace(result.estimate, valid=False, reason=reason))


def _with_intervals(result: FitResult, model: DriveModel) -> FitResult:
    """The fit with the intervals that the model's standard errors make, of parameters that have none yet."""
    known = {
        name: Quantity(value.value, value.standard_error)
        for name, value in model.parameters.items()
        if value.standard_error is not None and name not in result.not_identified
    }
    parameters = {**known, **result.estimate.parameters}
    return replace(result, estimate=replace(result.estimate, parameters=parameters))


def _complexity(result: FitResult, precision: float | None, whole: Recording) -> Complexity | None:
    """The verdict for reversals as the recording has them; as the benchmark has them for the programme."""
    metadata = whole.metadata
    recorded = sizes(whole).acceleration if result.found is None else 0.0
    known = {name: quantity for name, quantity in result.estimate.parameters.items() if quantity.identified}
    wanted = precision if precision is not None else USUAL_PRECISION[metadata.motion_unit]
    dahl = result.found.dahl if result.found is not None else None
    reversal = dahl.reversal if dahl is not None else None
    return judge_complexity(known, wanted, recorded or USUAL_ACCELERATION, metadata, reversal)


def _fitted(whole: Recording, effects: Sequence[str], progress: Progress) -> FitResult:
    standard = sum(name in whole.experiment for name in EXPERIMENTS) >= 2
    if standard and not effects:
        progress("fit of the standard programme")
        result = _by_experiments(whole)
        return result if result.model is not None else _of_like_names(whole, result, progress)
    return _together(whole, effects, progress)


def _of_like_names(whole: Recording, programme: FitResult, progress: Progress) -> FitResult:
    """All motion fitted together, of a recording whose experiments have names of the standard programme only by chance.

    Anybody calls an experiment 'presliding'. What the programme's own estimators want of it is told where that fails
    too.
    """
    try:
        result = _together(whole, (), progress)
    except (RecordingError, NotEnoughExcitation):
        return programme
    return result if result.valid else programme


def _together(whole: Recording, effects: Sequence[str], progress: Progress) -> FitResult:
    """A fit of all motion together; a search's where that fit does not know an effect, or comes to no end."""
    if all(effect in STARTS for effect in effects):
        progress("fit of all motion together")
        try:
            result = fit(whole, effects)
        except OneDirection as reason:
            return _by_search(whole, effects, (f"{reason}; coulomb is the sum of both here",), progress)
        except NoDryFriction:
            if (other := _searched(whole, effects, CURVED, ONE_NUMBER[:1], progress)) is None:
                raise
            return other
        astray = not (result.valid or result.converged)
        if astray and (other := _searched(whole, effects, NO_END, OF_SLIDING, progress)) is not None:
            return other
        method = "speed_curve" if result.steady_state is not None else "twin"
        model = _with_errors(result.model, result.estimate)
        return FitResult(model, method, result.estimate, result.estimate.notes, steady=result.steady_state)
    return _by_search(whole, effects, (), progress)


def _by_experiments(whole: Recording) -> FitResult:
    found = identify_run(whole)
    joint = found.joint
    if found.model is None:
        reasons = "; ".join(f"{e.source}: {e.reason}" for e in found.estimates.values() if not e.valid)
        reason = f"{joint.reason} ({reasons})" if reasons else joint.reason
        return FitResult(
            None, "programme", replace(joint, valid=False, reason=reason), found.notes, found=found
        )
    return FitResult(found.model, "programme", joint, found.notes, found=found, steady=found.steady_state)


def _searched(
    whole: Recording, effects: Sequence[str], why: str, untold: Sequence[str], progress: Progress
) -> FitResult | None:
    """The search's model, where a fit of all motion together has none; None where the search has none either.

    `untold` are parameters that it cannot know: they have no standard error, and need none.
    """
    try:
        result = _by_search(whole, effects, (why,), progress, untold)
    except NotEnoughExcitation:
        return None
    known = result.valid or ("inertia" not in untold and result.model is not None and not loose(result.model))
    if not known:
        return None
    return replace(result, estimate=replace(result.estimate, valid=True, reason=why))


def _by_search(
    whole: Recording,
    effects: Sequence[str],
    notes: tuple[str, ...],
    progress: Progress,
    one_number: Sequence[str] = ONE_NUMBER,
) -> FitResult:
    """The search's model; with `notes` on it some of its parameters are not known by themselves."""
    result = fit_model([whole], effects, progress)
    reason = "; ".join(text for text in (result.reason, *notes) if text)
    model = result.model
    unknown: dict[str, Quantity] = {}
    if notes:
        model, unknown = _without_error(model, one_number, notes[0])
    if result.untold:
        model, more = _without_error(model, result.untold, TOO_SLOW)
        unknown |= more
    estimate = Estimate(
        "search", unknown, result.valid, reason, result.relative_error, tuple(result.notes) + notes
    )
    return FitResult(model, "search", estimate, estimate.notes)


def _without_error(
    model: DriveModel, names: Sequence[str], why: str
) -> tuple[DriveModel, dict[str, Quantity]]:
    """The model with parameters that are not known."""
    base = dict(model.base)
    unknown = {}
    for name in names:
        base[name] = replace(base[name], standard_error=None)
        unknown[name] = Quantity(model[name], math.inf, identified=False, note=why)
    return replace(model, base=base), unknown


def _with_errors(model: DriveModel, estimate: Estimate) -> DriveModel:
    """The model with the standard errors of the estimate: those allow for colour and for what is systematic."""
    errors = {
        name: quantity.standard_error
        for name, quantity in estimate.parameters.items()
        if name in model.parameters and math.isfinite(quantity.standard_error)
    }
    return model.with_values({name: model[name] for name in errors}, errors)


def _behind_the_chain(
    result: FitResult,
    whole: Recording,
    recordings: Sequence[Recording],
    effects: Sequence[str],
    progress: Progress,
) -> tuple[FitResult, Compared | None]:
    """The fit and how its model compares, with the torque as late as it acts, where that leaves less or must be so.

    A fit of all motion together takes the torque as it was recorded, and its loop as one of the rows: behind an
    ordinary current loop, a reading that is late, or a drive that works between the rows, viscosity, friction and
    damping make up for what it does not know. The search has it as a nuisance. It fits nothing beside the model: where
    the first fit did, that stays. Of a record that is late the first fit was made in a loop that is none of the axis's:
    what it leaves less is no merit.

    Where nothing is late the search must leave half of what the first fit leaves beyond noise: no missing effect's part
    falls so, whose share in the parameters differs little between the two.
    """
    first = result.model
    compared = None if first is None else compared_or_none(recordings, first)
    if first is None or compared is None or result.method != "twin" or _beside(result):
        return result, compared
    data = compared.problem.data
    late = data.lag > SURE * data.lag_error or data.late != 0.0 or data.cycles > 0
    in_doubt = compared.late_record or (
        compared.twin and data.repeated and (late or _beyond_noise(compared) > 0.0)
    )
    if not in_doubt:
        return result, compared
    other = _by_search(whole, effects, (), progress)
    its = None if other.model is None else compared_or_none(recordings, other.model)
    if its is None or not other.valid or not _leaves_less(its, compared, late):
        return result, compared
    return _as_sure_of_inertia(other, first), its


def _as_sure_of_inertia(found: FitResult, first: DriveModel) -> FitResult:
    """The search's fit with an inertia that is no surer than by how much the first fit's differs.

    Rows in step with a drive's loop show a torque that is not the mean of the row's, and what that does to the inertia
    (3 % of it, at 30 standard errors) differs between torques as they were read and as a law asks for them.
    """
    model = found.model
    if model is None or (told := model.parameters["inertia"].standard_error) is None:
        return found
    error = max(told, abs(model["inertia"] - first["inertia"]))
    return replace(found, model=model.with_values({"inertia": model["inertia"]}, {"inertia": error}))


def _leaves_less(its: Compared, first: Compared, late: bool) -> bool:
    """Whether the search's model leaves so much less than the first fit's that it is the axis's."""
    if first.late_record:
        return bool(its.error_rms <= POLICY.partly**-0.5 * first.error_rms)
    if late:
        return its.error_rms <= CLEARLY_LESS * first.error_rms
    return its.error_rms**2 - first.noise_floor_rms**2 <= POLICY.partly * _beyond_noise(first)


def _beyond_noise(compared: Compared) -> float:
    """Mean square of what a model leaves beyond noise [(N m)²]; 0 where that is not clear."""
    noise = compared.noise_floor_rms**2
    left = compared.error_rms**2 - noise
    return left if left > BEYOND_NOISE * noise else 0.0


def _beside(result: FitResult) -> bool:
    """Whether torque that belongs to the place was fitted beside the model, which does not hold it."""
    return any(note.startswith(HOLDS) for note in result.notes)


def _with_error(result: FitResult, compared: Compared | None) -> FitResult:
    """The error of the model as `compare` measures it, where it can.

    A heavy load makes most of a joint's torque: what was fitted beside the model tells whether the rest is an axis. A
    model that leaves more than the torque is worse than none, whatever was fitted beside it.
    """
    if result.model is None or compared is None:
        return result
    estimate = replace(result.estimate, relative_error=compared.relative_error)
    share = compared.relative_error**2
    if share > (POLICY.misfit if result.method in ("programme", "twin") else WORSE_THAN_NONE):
        beside = _beside(result)
        why = (FITTED_BESIDE if beside else HARDLY_ANY).format(percent=100.0 * compared.relative_error)
        reason = "; ".join(filter(None, (estimate.reason, why)))
        known = beside and share <= WORSE_THAN_NONE and result.estimate.relative_error**2 <= POLICY.misfit
        estimate = replace(estimate, valid=estimate.valid and known, reason=reason)
    elif estimate.valid and (left := _missing(compared)):
        estimate = replace(estimate, reason="; ".join(filter(None, (estimate.reason, left))))
    if hidden := _hidden(estimate, compared):
        estimate = replace(estimate, reason=f"{estimate.reason}; {hidden}")
    return replace(
        result,
        estimate=estimate,
        notes=(*result.notes, *_comes_again(compared)),
        refinement_relative_error=result.estimate.relative_error,
        error_rms=compared.error_rms,
        unseen=unseen_error(compared, result.model),
    )


def _missing(compared: Compared) -> str:
    """Said of a model that leaves so much that its numbers stand for something else; "" where it is noise."""
    if compared.relative_error**2 <= MOST_UNEXPLAINED or _is_noise(compared):
        return ""
    return LARGE_PART.format(percent=100.0 * compared.relative_error)


def _comes_again(compared: Compared) -> tuple[str, ...]:
    """Said of what repeats have alike and the model does not explain; nothing where that is not clear.

    With nothing missing, on a contact by Dahl's law, viscous friction was 15 % off, nine of its standard errors (65th
    outsider, 4): all strokes are off alike, so that no second contradicts, and what was left was 1.3 times the noise.
    """
    left = _beyond_noise(compared) if compared.problem.data.repeated else 0.0
    if left == 0.0 or _missing(compared):
        return ()
    percent = 100.0 * compared.relative_error / compared.error_rms
    return (COMES_AGAIN.format(percent=percent * math.sqrt(left), noise=percent * compared.noise_floor_rms),)


def _hidden(estimate: Estimate, compared: Compared) -> str:
    """Said beside the motion that would show a parameter, where what the model leaves may hide it; "" else."""
    unknown = any(not quantity.identified for quantity in estimate.parameters.values())
    if not (unknown and estimate.reason) or compared.relative_error <= HIDDEN_FROM or _is_noise(compared):
        return ""
    how = (
        "'autotune model diagnose' tells whether something is missing"
        if estimate.valid
        else "'autotune model diagnose' without --model tells whether something is missing, --effects takes it in"
    )
    return HIDDEN.format(percent=100.0 * compared.relative_error, how=how)


def _is_noise(compared: Compared) -> bool:
    """Whether most of what a model leaves is noise, by what repeats do not share."""
    noise = compared.noise_floor_rms / compared.error_rms if compared.error_rms > 0.0 else math.nan
    return noise**2 > 0.5


def compared_or_none(recordings: Sequence[Recording], model: DriveModel) -> Compared | None:
    """`compare`; None where the recordings are too poor for it."""
    try:
        return compare(recordings, model)
    except NotEnoughExcitation:
        return None


def model_torque(recording: Recording, model: DriveModel) -> Floats:
    """What the model says for every row [N m or N]: the measured torque less the residual; nan in gaps."""
    residual = torque_residual(recording, model)
    predicted = np.full(len(recording), math.nan)
    edges = np.flatnonzero(np.diff(residual.row) > 4 * np.median(np.diff(residual.row))) + 1
    for rows, values in zip(
        np.split(residual.row, edges), np.split(residual.torque - residual.error, edges), strict=True
    ):
        every = np.arange(rows[0], rows[-1] + 1)
        predicted[every] = np.interp(every, rows, values)
    return predicted
