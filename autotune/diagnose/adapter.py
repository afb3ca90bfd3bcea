"""Which way a recording is analysed: the standard programme, the diagnosis programme, or one trajectory."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from autotune.core.errors import NotEnoughExcitation
from autotune.core.recording import Recording, concatenate
from autotune.diagnose.adding import Added, add_effect
from autotune.diagnose.compare import check_same_axis, compare
from autotune.diagnose.fitting import fit_model
from autotune.diagnose.verdict import Diagnosis, diagnose
from autotune.identify.run import EXPERIMENTS, identify_run
from autotune.models.drive_model import DriveModel
from autotune.models.table import effect_kind

Progress = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class FitResult:
    """A model from recordings, and what to say about it; `floor` None where nothing was repeated."""

    model: DriveModel | None
    valid: bool
    reason: str
    relative_error: float
    error_rms: float | None
    floor: float | None
    notes: tuple[str, ...] = ()


def fit_recordings(recordings: Sequence[Recording], effects: Sequence[str], progress: Progress) -> FitResult:
    """Fits a model: by the standard programme's experiments where they are there, else by all motion."""
    for effect in effects:
        effect_kind(effect)
    joined = concatenate(recordings)
    standard = sum(name in joined.experiment for name in EXPERIMENTS) >= 2
    if standard and not effects:
        return _by_experiments(joined, progress)
    result = fit_model(recordings, effects, progress)
    return _with_error(
        result.model, recordings, result.valid, result.reason, result.relative_error, result.notes
    )


def _by_experiments(recording: Recording, progress: Progress) -> FitResult:
    progress("fit of the standard programme")
    found = identify_run(recording)
    joint = found.joint
    if found.model is None:
        reasons = "; ".join(f"{e.source}: {e.reason}" for e in found.estimates.values() if not e.valid)
        reason = f"{joint.reason} ({reasons})" if reasons else joint.reason
        return FitResult(None, False, reason, math.nan, None, None, found.notes)
    return _with_error(found.model, [recording], joint.valid, joint.reason, joint.relative_error, found.notes)


def _with_error(
    model: DriveModel,
    recordings: Sequence[Recording],
    valid: bool,
    reason: str,
    relative: float,
    notes: tuple[str, ...],
) -> FitResult:
    try:
        compared = compare(recordings, model)
    except NotEnoughExcitation:
        return FitResult(model, valid, reason, relative, None, None, notes)
    floor = compared.noise_floor_rms if math.isfinite(compared.noise_floor_rms) else None
    relative = relative if math.isfinite(relative) else compared.relative_error
    return FitResult(model, valid, reason, relative, compared.error_rms, floor, notes)


def diagnose_recordings(recordings: Sequence[Recording], model: DriveModel, progress: Progress) -> Diagnosis:
    """The verdict on a model."""
    check_same_axis(model, recordings)
    return diagnose(recordings, model, progress)


def add_to_model(
    effect: str,
    recordings: Sequence[Recording],
    model: DriveModel,
    when: str,
    source: str,
    progress: Progress,
) -> Added:
    """The model with one effect more."""
    return add_effect(effect, recordings, model, when, source, progress)
