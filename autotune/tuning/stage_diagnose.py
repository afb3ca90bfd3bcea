"""Stage `diagnose`: what the identified model lacks, by the evidence of this run, and the richer model.

The experiments of the run are what is fitted; a trajectory of another kind, played twice, only gates, so
that a name can be confirmed. Presliding stays out: it is measured in torque mode, where no twin of the
closed loop can be made. The strokes of the steady state are single experiments here, as they differ in
speed; taken for repeats of one another they made every difference between speeds look like noise.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from autotune.control.model_feedforward import left_out
from autotune.core.errors import AutotuneError, ConfigurationError
from autotune.diagnose.compare import compare
from autotune.diagnose.fitting import held_out_errors, updated_model
from autotune.diagnose.refits import without_effect
from autotune.diagnose.resolved_memory import resolved, stiffness_at_rest
from autotune.diagnose.verdict import Diagnosis, diagnose
from autotune.estimation.bias_corrected_fit import Level
from autotune.estimation.problem import Study
from autotune.experiments.diagnosis import confirmation
from autotune.experiments.experiment import Experiment
from autotune.experiments.path import CONDITIONING
from autotune.experiments.runner import Programme
from autotune.models.drive_model import DriveModel, HistoryEntry
from autotune.models.model_file import write_model
from autotune.models.reversal_memory import REVERSAL_MEMORY
from autotune.recordings.files import read_recording
from autotune.recordings.recording import Recording, Segment
from autotune.tuning.session import Session

SECONDS = 8.0  # of the confirming trajectory, at most
SEED = 7
RECORDING = "confirmation"
_LEFT_OUT = "presliding"
_STROKES = "steady_state"
_REPEATED = "dahl"
REPEATS = 2


@dataclass(frozen=True, slots=True)
class Diagnosed:
    """The verdict and what became of the model.

    Attributes:
        verdict: `named`, `none`, `unknown`, `ambiguous`, or `failed` where the recordings allow none.
        effects: strongest first; `confidence`: `confirmed`, `suspected` or None.
        error_rms, relative_error: of the identified model on the experiments, as `model compare` finds them.
        error_before, error_after, noise_floor_rms: torque, on data not used for the fit [N m or N].
        unseen: in words, which data those are.
        candidates: list of {effect, gain, accepted, why}.
        stiffness: at rest, of the model with its effects; None without a richer model.
        model: with the named effects, fitted together; None where nothing is named.
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
    unseen: str = ""
    candidates: tuple[Mapping[str, Any], ...] = ()
    next_experiment: str | None = None
    twin: bool = False
    stiffness: float | None = None
    model: DriveModel | None = None
    not_fed_forward: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def diagnose_stage(session: Session, recording: Recording, model: DriveModel, reserve: float) -> Diagnosed:
    """Confirms, diagnoses, and adds what is named to `model.toml`.

    Args:
        recording: of the experiments.
        model: as identified.
        reserve: machine time that the later stages need [s].

    A model without a diagnosis is as good as before: what fails here is told, and the run goes on.
    """
    session.begin("diagnose", 2.0 * SECONDS)
    recordings = [fitted_part(recording)]
    note = ""
    programme = confirming(session, reserve)
    if RECORDING in session.written:  # of the run that is taken up
        recordings.append(read_recording(session.written[RECORDING]))
    elif programme:
        recordings.append(session.play(RECORDING, programme)[0])
    else:
        note = "No second trajectory was played (limits or machine time): what is named is only suspected."
    error_rms, relative_error = error_as_given(recording, model)
    try:
        found = _found(session, recordings, model)
    except (AutotuneError, np.linalg.LinAlgError) as error:
        found = Diagnosed("failed", notes=(f"No diagnosis: {error}",))
    found = replace(found, error_rms=error_rms, relative_error=relative_error)
    if found.verdict == "failed":
        return found
    if found.model is not None:
        write_model(found.model, session.directory / "model.toml")
    return found if not note else _noted(found, note)


def error_as_given(recording: Recording, model: DriveModel) -> tuple[float | None, float | None]:
    """Error and relative error of the identified model on the experiments; None where they allow none."""
    try:
        compared = compare([recording], model)
    except (AutotuneError, np.linalg.LinAlgError):
        return None, None
    return compared.error_rms, compared.relative_error


def confirming(session: Session, reserve: float) -> tuple[Experiment, ...]:
    """The trajectory that confirms; empty where limits or machine time do not allow it."""
    experiments = confirmation(session.motion, SECONDS, np.random.default_rng(SEED))
    programme = Programme(experiments, session.limits, session.budget.left - reserve)
    try:
        programme.check(session.loop.period)
    except ConfigurationError:
        return ()
    return experiments


def fitted_part(recording: Recording) -> Recording:
    """The position-controlled experiments; each stroke of the steady state by a name of its own.

    Every second speed and two repeats of Dahl's curve say as much as all of them, in half the time.
    """
    segments = recording.segments()
    out = [i for i, segment in enumerate(segments) if segment.experiment == _LEFT_OUT]
    keep = np.ones(len(recording), dtype=np.bool_)
    if out:  # with the relaxing before and the way back after it, which are partly in torque mode
        for segment in segments[max(out[0] - 1, 0) : out[-1] + 2]:
            keep[segment.rows] = False
    for i in _spare(recording, segments):
        keep[segments[i].rows] = False
        if i > 0 and segments[i - 1].experiment == CONDITIONING:
            keep[segments[i - 1].rows] = False
    kept = recording.rows(keep)
    names = kept.experiment.astype(f"<U{max(kept.experiment.dtype.itemsize // 4, len(_STROKES) + 5)}")
    for segment in kept.segments():
        if segment.experiment == _STROKES:
            names[segment.rows] = f"{_STROKES}/{segment.repeat}"
    return Recording(kept.metadata, kept.floats, names, kept.repeat, kept.missed)


def _spare(recording: Recording, segments: Sequence[Segment]) -> list[int]:
    """Segments that are not needed: pairs of strokes (there and back) at every second speed, spare repeats."""
    strokes = [i for i, segment in enumerate(segments) if segment.experiment == _STROKES]
    ordered = sorted(strokes, key=lambda i: -_speed(recording, segments[i]))
    spare = [i for place, i in enumerate(ordered) if place // 2 % 2 == 1]
    return spare + [i for i, s in enumerate(segments) if s.experiment == _REPEATED and s.repeat >= REPEATS]


def _speed(recording: Recording, segment: Segment) -> float:
    position = recording["position"][segment.rows]
    return abs(float(position[-1] - position[0])) / len(position)


def _found(session: Session, recordings: list[Recording], model: DriveModel) -> Diagnosed:
    diagnosis = diagnose(recordings, model)
    candidates = tuple(
        {"effect": c.effect, "gain": c.gain, "accepted": c.accepted, "why": c.why}
        for c in diagnosis.candidates
    )
    floor = diagnosis.noise_floor_rms
    told = Diagnosed(
        diagnosis.verdict,
        diagnosis.effects,
        diagnosis.confidence,
        noise_floor_rms=floor if math.isfinite(floor) else None,
        candidates=candidates,
        next_experiment=diagnosis.next_experiment,
        twin=diagnosis.twin,
        notes=diagnosis.notes,
    )
    if diagnosis.verdict != "named" or diagnosis.study is None or diagnosis.level is None:
        return told
    return _with_model(session, told, diagnosis, model)


def _with_model(session: Session, told: Diagnosed, diagnosis: Diagnosis, model: DriveModel) -> Diagnosed:
    study, root, level = diagnosis.study, diagnosis.root, diagnosis.level
    if study is None or root is None or level is None:
        return told
    finer = resolved(study, level)
    final = finer or level
    stairs = _stairs(study, root, level, diagnosis.effects)
    if finer is not None:
        stairs.append((f"{REVERSAL_MEMORY.name} resolved", level, finer))
    before, after, floor, unseen = held_out_errors(study, root, final)
    richer = updated_model(model, study, final.fitted)
    when, source = session.clock().isoformat(timespec="seconds"), session.directory.name
    for action, lower, upper in stairs:
        error_before, error_after, noise, which = held_out_errors(study, lower, upper)
        noise_known = noise if math.isfinite(noise) else None
        entry = HistoryEntry(when, action, source, error_before, error_after, noise_known, which)
        richer = richer.with_history(entry)
    stiffness = stiffness_at_rest(richer)
    return replace(
        told,
        notes=(_told(told, before, after, stiffness, model.motion_unit), *told.notes),
        error_before=before,
        error_after=after,
        noise_floor_rms=floor if math.isfinite(floor) else told.noise_floor_rms,
        unseen=unseen,
        stiffness=stiffness,
        model=richer,
        not_fed_forward=left_out(richer),
    )


def _told(found: Diagnosed, before: float, after: float, stiffness: float, motion_unit: str) -> str:
    torque = "N m" if motion_unit == "rad" else "N"
    text = (
        f"Missing in the identified model: {', '.join(found.effects)} ({found.confidence}). With it the torque error "
        f"on data not used for the fit falls from {before:.3g} to {after:.3g} {torque}"
    )
    if REVERSAL_MEMORY.name in found.effects:
        text += (
            f", and one number is the stiffness at rest: {stiffness:.4g} {torque}/{motion_unit}, that of all elastic "
            "elements together"
        )
    return text + "."


def _stairs(
    study: Study, root: Level, level: Level, effects: tuple[str, ...]
) -> list[tuple[str, Level, Level]]:
    """One step down for each effect, strongest first; all in one where a step between is not stable."""
    levels = [level]
    for effect in reversed(effects[1:]):
        less = without_effect(study, root, levels[0], effect)
        if less is None:
            return [("+ " + ", ".join(effects), root, level)]
        levels.insert(0, less.level)
    every = [root, *levels]
    return [
        (f"+ {effect}", lower, upper)
        for effect, (lower, upper) in zip(effects, itertools.pairwise(every), strict=True)
    ]


def _noted(found: Diagnosed, note: str) -> Diagnosed:
    return replace(found, notes=(note, *found.notes))
