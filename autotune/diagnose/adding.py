"""Adding an effect to a model: joint refit with it, before and after on data that the fit never saw."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from autotune.core.errors import NotEnoughExcitation
from autotune.core.recording import Recording
from autotune.diagnose.bandwidth import prepared_for
from autotune.diagnose.beginning import begin, quiet
from autotune.diagnose.compare import check_same_axis
from autotune.diagnose.fit import Fitted, standard_errors
from autotune.diagnose.model_values import model_from
from autotune.diagnose.prepared import TEST, TRAINING, VETO
from autotune.diagnose.search import Progress, inside_twin, realigned, screen
from autotune.diagnose.settling import Level, settle
from autotune.diagnose.study import Study
from autotune.models.drive_model import DriveModel, HistoryEntry, Packed
from autotune.models.table import effect_kind


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
    progress: Progress = quiet,
) -> Added:
    """Refits the model with an effect.

    Args:
        when, source: for the model's history: the time, and what the data were.

    Raises:
        ConfigurationError: no such effect, or a model of another axis.
        NotEnoughExcitation: these data cannot say anything about the effect.
    """
    effect_kind(effect)
    check_same_axis(model, recordings)
    study, root, nominal, notes = begin(prepared_for(recordings), model, progress)
    progress(f"refit with {effect}")
    study, root, level = grown(study, root, nominal, effect, model)
    before, after, floor, unseen = held_out_errors(study, root, level)
    improved = updated_model(model, study, level.fitted)
    entry = HistoryEntry(when, f"+ {effect}", source, before, after, floor if math.isfinite(floor) else None)
    return Added(improved.with_history(entry), before, after, floor, unseen, notes)


def grown(
    study: Study, root: Level, nominal: Packed, effect: str, model: DriveModel
) -> tuple[Study, Level, Level]:
    """The model without and with an effect, and the study, whose columns may have been aligned anew.

    Raises:
        NotEnoughExcitation: the data do not allow it, or the twin becomes unstable.
    """
    level = _with_effect(study, root, nominal, effect, model)
    for _ in range(4):
        again = realigned(study, level)
        if again is study:
            break
        study = again
        root = settle(study, root.fitted.packed, list(root.free), 2) or root
        level = settle(study, level.fitted.packed, list(level.free), 3, level.effects) or level
    return study, root, level


def _with_effect(study: Study, root: Level, nominal: Packed, effect: str, model: DriveModel) -> Level:
    """The model with the effect, at its best.

    Raises:
        NotEnoughExcitation: the data do not allow it, or the twin becomes unstable.
    """
    screened = screen(study, root, nominal, effect)
    if screened is None:
        raise NotEnoughExcitation(
            f"these recordings cannot say anything about {effect}: {_why_not(effect, model)}. "
            f"It would look like this: {effect_kind(effect).looks_like}"
        )
    refitted = inside_twin(study, root, root, screened)
    if refitted is None:
        raise NotEnoughExcitation(
            f"with {effect} the simulated axis becomes unstable on these recordings; record the programme "
            "'diagnosis' once more, or add another effect first"
        )
    return refitted.level


def updated_model(model: DriveModel, study: Study, fitted: Fitted) -> DriveModel:
    """The model with fitted values, effects and standard errors."""
    return model_from(model, fitted.packed, fitted.free, standard_errors(fitted, study.training))


def held_out_errors(study: Study, before: Level, after: Level) -> tuple[float, float, float, str]:
    """Rms before and after, noise floor, and on which data: veto and test, else held-out experiments."""
    roles = [role for role in (VETO, TEST) if study.has(role)]
    if roles:
        rows = study.data.role(*roles)
        errors = [float(np.sqrt(np.mean(x.fitted.error[rows] ** 2))) for x in (before, after)]
        noise = study.noise_variance(after.fitted.error, VETO)
        if not math.isfinite(noise):
            noise = study.noise_variance(after.fitted.error, TRAINING)
        return (
            errors[0],
            errors[1],
            math.sqrt(noise) if math.isfinite(noise) else math.nan,
            " and ".join(roles),
        )
    count = max(float(study.training.sum()), 1.0)
    errors = [math.sqrt(x.unseen.total / count) for x in (before, after)]
    noise = study.noise_variance(after.fitted.error, TRAINING)
    floor = math.sqrt(noise) if math.isfinite(noise) else math.nan
    return errors[0], errors[1], floor, "each experiment held out in turn"


def _why_not(effect: str, model: DriveModel) -> str:
    if model.motion_unit != "rad" and effect in ("gravity_imbalance", "encoder_eccentricity"):
        return "it belongs to axes that turn"
    if effect == "torque_ripple":
        return (
            "no torque that repeats with position stands out, or the travel is below one and a half periods"
        )
    return "there is nothing in the motion to start a fit from"
