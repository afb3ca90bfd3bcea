"""Stage `diagnose`: what the identified model lacks, by the evidence of this run, and the richer model.

The experiments of the run are what is fitted; a trajectory of another kind, played twice, only gates, so
that a name can be confirmed. Diagnosis and richer model are those that `autotune model diagnose` and
`autotune model add` find in the same recordings.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from autotune.control.model_feedforward import left_out
from autotune.core.errors import AutotuneError, ConfigurationError
from autotune.core.units import torque_symbol
from autotune.diagnosis.compare import compare
from autotune.diagnosis.verdict import Diagnosis, diagnose
from autotune.experiments.deciding import deciding
from autotune.experiments.diagnosis import confirmation
from autotune.experiments.experiment import Experiment
from autotune.experiments.runner import Programme
from autotune.models.drive_model import DriveModel
from autotune.models.model_file import write_model
from autotune.models.reversal_memory import REVERSAL_MEMORY
from autotune.models.total_friction import stiffness_at_rest
from autotune.recordings.files import read_recording
from autotune.recordings.recording import Recording
from autotune.tuning.found_model import FoundModel, found_model, torque_late
from autotune.tuning.question import rivals_of
from autotune.tuning.session import Session

SECONDS = 8.0  # of the confirming trajectory, at most
SEED = 7
RECORDING, DECISION = "confirmation", "decision"
SHAKEN_AT = 10.0
"""Hz: about where axes hunt; a disturbance with a memory counts as the white one that is as dense there."""


@dataclass(frozen=True, slots=True)
class Diagnosed:
    """The verdict and what became of the model.

    Attributes:
        verdict: `named`, `none`, `unknown`, `ambiguous`, or `failed` where the recordings allow none.
        effects: strongest first; `confidence`: `confirmed`, `suspected` or None.
        error_rms, relative_error: of the identified model on the experiments, as `model compare` finds them.
        error_before, error_after, noise_floor_rms: torque, on data not used for the fit [N m or N].
        disturbance: what shakes the axis, as white noise from sample to sample [N m or N]; None without a twin.
        torque_late: by how much the torque follows its demand later than it is held [s]; None where the recordings may
            be late themselves, or without a twin. A lag that the model names is beside it.
        unseen: in words, which data those are.
        candidates: list of {effect, gain, accepted, why}.
        confusable: sets of effects that these data cannot tell apart.
        stiffness: at rest, of the model with its effects; None without a richer model.
        model: with the named effects and the laws of the base that were found, fitted together; None without either.
        not_fed_forward: effects of the model that a feedforward does not play, and why.
    """

    verdict: str
    effects: tuple[str, ...] = ()
    confidence: str | None = None
    error_rms: float | None = None
    relative_error: float | None = None
    error_before: float | None = None
    error_after: float | None = None
    noise_floor_rms: float | None = None
    disturbance: float | None = None
    torque_late: float | None = None
    unseen: str = ""
    candidates: tuple[Mapping[str, Any], ...] = ()
    confusable: tuple[tuple[str, ...], ...] = ()
    next_experiment: str | None = None
    twin: bool = False
    stiffness: float | None = None
    model: DriveModel | None = None
    not_fed_forward: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def diagnose_stage(
    session: Session, recording: Recording, model: DriveModel, reserve: float, *, decide: bool = False
) -> Diagnosed:
    """Confirms, diagnoses, and adds what is named to `model.toml`.

    Args:
        recording: of the experiments.
        model: as identified.
        reserve: machine time that the later stages need [s].
        decide: where the verdict leaves something open, the experiment that decides is played, and diagnosed anew.

    A model without a diagnosis is as good as before: what fails here is told, and the run goes on.
    """
    session.begin("diagnose", 2.0 * SECONDS)
    recordings = [recording]
    note = ""
    programme = confirming(session, reserve)
    if RECORDING in session.written:  # of the run that is taken up
        recordings.append(read_recording(session.written[RECORDING]))
    elif programme:
        recordings.append(session.play(RECORDING, programme)[0])
    else:
        note = "No second trajectory was played (limits or machine time): what is named is only suspected."
    error_rms, relative_error = error_as_given(recording, model)
    found = _found(session, recordings, model)
    if decide:
        found = _decided(session, recordings, model, found, reserve)
    found = replace(found, error_rms=error_rms, relative_error=relative_error)
    if found.verdict == "failed":
        return found
    if found.model is not None:
        write_model(found.model, session.directory / "model.toml")
    return found if not note else _noted(found, note)


def _found(session: Session, recordings: Sequence[Recording], model: DriveModel) -> Diagnosed:
    when = session.clock().isoformat(timespec="seconds")
    try:
        return found_in(recordings, model, when, session.directory.name)
    except (AutotuneError, np.linalg.LinAlgError) as error:
        return Diagnosed("failed", notes=(f"No diagnosis: {error}",))


def _decided(
    session: Session, recordings: Sequence[Recording], model: DriveModel, found: Diagnosed, reserve: float
) -> Diagnosed:
    """The diagnosis with the experiment that `found` asks for, where it asks and there is time and room for it."""
    rivals = rivals_of(asdict(found)) if found.verdict != "failed" else None
    if rivals is None:
        return found
    if DECISION in session.written:  # of the run that is taken up
        decision = read_recording(session.written[DECISION])
    else:
        programme = _fitting(session, lambda: deciding(session.motion, rivals, _random()), reserve)
        if not programme:
            return _noted(
                found, "The verdict is in doubt; limits or machine time leave no room to decide it."
            )
        session.reporter.say(
            f"In doubt: {', '.join(rivals) or 'what is missing'}; the deciding experiment is played."
        )
        decision = session.play(DECISION, programme)[0]
    decided = _found(session, [*recordings, decision], model)
    return found if decided.verdict == "failed" else decided


def error_as_given(recording: Recording, model: DriveModel) -> tuple[float | None, float | None]:
    """Error and relative error of the identified model on the experiments; None where they allow none."""
    try:
        compared = compare([recording], model)
    except (AutotuneError, np.linalg.LinAlgError):
        return None, None
    return compared.error_rms, compared.relative_error


def confirming(session: Session, reserve: float) -> tuple[Experiment, ...]:
    """The trajectory that confirms; empty where limits or machine time do not allow it."""
    return _fitting(session, lambda: confirmation(session.motion, SECONDS, _random()), reserve)


def _fitting(
    session: Session, build: Callable[[], tuple[Experiment, ...]], reserve: float
) -> tuple[Experiment, ...]:
    """The experiments, or none where limits or machine time do not allow them."""
    try:
        experiments = build()
        Programme(experiments, session.limits, session.budget.left - reserve).check(session.loop.period)
    except ConfigurationError:
        return ()
    return experiments


def _random() -> np.random.Generator:
    return np.random.default_rng(SEED)


def found_in(recordings: Sequence[Recording], model: DriveModel, when: str, source: str) -> Diagnosed:
    """Verdict and richer model, as `autotune model diagnose` finds them in the same recordings.

    Args:
        when, source: for the model's history.

    Raises:
        AutotuneError: recordings that allow no diagnosis.
    """
    diagnosis = diagnose(recordings, model)
    candidates = tuple(
        {"effect": c.effect, "gain": c.gain, "accepted": c.accepted, "why": c.why}
        for c in diagnosis.candidates
    )
    floor = diagnosis.noise_floor_rms
    diagnosed = Diagnosed(
        diagnosis.verdict,
        diagnosis.effects,
        diagnosis.confidence,
        noise_floor_rms=floor if math.isfinite(floor) else None,
        disturbance=_disturbance(diagnosis),
        torque_late=torque_late(diagnosis),
        candidates=candidates,
        confusable=tuple(tuple(rivals) for rivals in diagnosis.confusable),
        next_experiment=diagnosis.next_experiment,
        twin=diagnosis.twin,
        notes=diagnosis.notes,
    )
    found = found_model(diagnosis, model, when, source) if diagnosis.effects or diagnosis.base else None
    return diagnosed if found is None else _with_model(diagnosed, found, model)


def _disturbance(diagnosis: Diagnosis) -> float | None:
    problem = diagnosis.problem
    if problem is None or not problem.twin:
        return None
    return problem.disturbance.level_at(SHAKEN_AT, problem.data.period)


def _with_model(diagnosed: Diagnosed, found: FoundModel, model: DriveModel) -> Diagnosed:
    stiffness = stiffness_at_rest(found.model)
    sentence = _told(diagnosed, found.error_before, found.error_after, stiffness, model.motion_unit)
    return replace(
        diagnosed,
        notes=(sentence, *diagnosed.notes),
        error_before=found.error_before,
        error_after=found.error_after,
        noise_floor_rms=diagnosed.noise_floor_rms if found.noise_floor_rms is None else found.noise_floor_rms,
        unseen=found.unseen,
        stiffness=stiffness,
        model=found.model,
        not_fed_forward=left_out(found.model),
    )


def _told(found: Diagnosed, before: float, after: float, stiffness: float, motion_unit: str) -> str:
    torque = torque_symbol(motion_unit)
    missing = (
        f"{', '.join(found.effects)} ({found.confidence})" if found.effects else "another law of its base"
    )
    text = (
        f"Missing in the identified model: {missing}. With it the torque error "
        f"on data not used for the fit falls from {before:.3g} to {after:.3g} {torque}"
    )
    if REVERSAL_MEMORY.name in found.effects:
        text += (
            f", and one number is the stiffness at rest: {stiffness:.4g} {torque}/{motion_unit}, that of all elastic "
            "elements together"
        )
    return text + "."


def _noted(found: Diagnosed, note: str) -> Diagnosed:
    return replace(found, notes=(note, *found.notes))
