"""Adding an effect to a model: joint refit with it, before and after on data that the fit never saw."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from autotune.core.errors import NotEnoughExcitation
from autotune.diagnose.baseline import begin
from autotune.diagnose.candidates import Progress, no_progress
from autotune.diagnose.compare import EACH_IN_TURN, check_same_axis, floor_of_unseen, roles_unseen
from autotune.diagnose.evidence.kinds import evidence_of
from autotune.diagnose.refits import inside_twin
from autotune.diagnose.screening import screen
from autotune.diagnose.terms import without_insignificant_terms
from autotune.estimation.bandwidth import prepared_for
from autotune.estimation.bias_corrected_fit import Level, settle
from autotune.estimation.free_parameters import model_from
from autotune.estimation.least_squares import Fitted, standard_errors
from autotune.estimation.policy import POLICY, Policy
from autotune.estimation.problem import Study
from autotune.models.drive_model import DriveModel, HistoryEntry, Packed
from autotune.models.table import effect_kind
from autotune.recordings.recording import Recording


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
    effect_kind(effect)
    check_same_axis(model, recordings)
    study, root, nominal, notes = begin(prepared_for(recordings, policy), model, progress, policy=policy)
    progress(f"refit with {effect}")
    study, root, level = grown(study, root, nominal, effect, model)
    before, after, floor, unseen = held_out_errors(study, root, level)
    improved = updated_model(model, study, level.fitted)
    known_floor = floor if math.isfinite(floor) else None
    entry = HistoryEntry(when, f"+ {effect}", source, before, after, known_floor, unseen)
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
        again = evidence_of(study.data).aligned(study, level)
        if again is study:
            break
        study = again
        root = settle(study, root.fitted.packed, list(root.free), 2) or root
        level = settle(study, level.fitted.packed, list(level.free), 3, level.effects) or level
    return study, root, without_insignificant_terms(study, level)


def _with_effect(study: Study, root: Level, nominal: Packed, effect: str, model: DriveModel) -> Level:
    """The model with the effect, at its best.

    Raises:
        NotEnoughExcitation: the data do not allow it, or the twin becomes unstable.
    """
    screened = screen(study, evidence_of(study.data), root, nominal, effect)
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
    floor = floor_of_unseen(study, after.fitted.error)
    noise = floor.rms if floor is not None else math.nan
    if roles := roles_unseen(study):
        rows = study.data.role(*roles)
        errors = [float(np.sqrt(np.mean(x.fitted.error[rows] ** 2))) for x in (before, after)]
        return errors[0], errors[1], noise, " and ".join(roles)
    count = max(float(study.training.sum()), 1.0)
    errors = [math.sqrt(x.unseen.total / count) for x in (before, after)]
    return errors[0], errors[1], noise, EACH_IN_TURN


def _why_not(effect: str, model: DriveModel) -> str:
    kind = effect_kind(effect)
    if model.motion_unit != "rad" and kind.rotary_only:
        return "it belongs to axes that turn"
    return kind.no_start_means
