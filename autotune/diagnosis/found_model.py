"""The model that a diagnosis leads to: with the named effects, fitted together, reversal memory resolved.

One way for `autotune run` and for `DiagnosisResult.found_model`, so that one recording has one answer.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

from autotune.diagnosis.fitting import held_out_errors, updated_model
from autotune.diagnosis.refits import without_effect
from autotune.diagnosis.resolved_memory import resolved
from autotune.diagnosis.verdict import Diagnosis
from autotune.estimation.bias_corrected_fit import Level
from autotune.estimation.problem import Study
from autotune.models.drive_model import DriveModel, HistoryEntry
from autotune.models.reversal_memory import REVERSAL_MEMORY


@dataclass(frozen=True, slots=True)
class FoundModel:
    """A model with what was named, and how far the error fell.

    Attributes:
        error_before, error_after, noise_floor_rms: rms on data not used for the fit [N m or N].
        unseen: in words, which data those are.
    """

    model: DriveModel
    error_before: float
    error_after: float
    noise_floor_rms: float | None
    unseen: str


def found_model(diagnosis: Diagnosis, model: DriveModel, when: str, source: str) -> FoundModel | None:
    """The richer model, its history step by step; None where nothing is named.

    Args:
        model: as it was given to the diagnosis.
        when, source: for the model's history: the time, and what the data were.
    """
    study, root, level = diagnosis.study, diagnosis.root, diagnosis.level
    if diagnosis.verdict != "named" or study is None or root is None or level is None:
        return None
    fine = resolved(study, level)
    final = fine or level
    steps = _steps(study, root, level, diagnosis.effects)
    if fine is not None:
        steps.append((f"{REVERSAL_MEMORY.name} resolved", level, fine))
    before, after, floor, unseen = held_out_errors(study, root, final)
    richer = updated_model(model, study, final.fitted)
    for action, lower, upper in steps:
        richer = richer.with_history(_entry(study, lower, upper, (when, action, source)))
    return FoundModel(richer, before, after, floor if math.isfinite(floor) else None, unseen)


def _entry(study: Study, before: Level, after: Level, step: tuple[str, str, str]) -> HistoryEntry:
    """A step of the history; `step`: when, what, from which data."""
    error_before, error_after, noise, unseen = held_out_errors(study, before, after)
    return HistoryEntry(*step, error_before, error_after, noise if math.isfinite(noise) else None, unseen)


def _steps(
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
