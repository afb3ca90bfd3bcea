"""The model that a diagnosis leads to: with the named effects, fitted together, reversal memory resolved.

One way for `autotune run` and for `DiagnosisResult.found_model`, so that one recording has one answer.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

from autotune.diagnosis.fitting import held_out_errors, updated_model
from autotune.diagnosis.free_shape import resolved
from autotune.diagnosis.refits import without_effect
from autotune.diagnosis.verdict import Diagnosis
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.problem import Problem
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
    problem, root, model_fit = diagnosis.problem, diagnosis.root, diagnosis.model_fit
    if diagnosis.verdict != "named" or problem is None or root is None or model_fit is None:
        return None
    fine = resolved(problem, model_fit)
    final = fine or model_fit
    steps = _steps(problem, root, model_fit, diagnosis.effects)
    if fine is not None:
        steps.append((f"{REVERSAL_MEMORY.name} resolved", model_fit, fine))
    before, after, floor, unseen = held_out_errors(problem, root, final)
    richer = updated_model(model, problem, final.fitted)
    for action, lower, upper in steps:
        richer = richer.with_history(_entry(problem, lower, upper, (when, action, source)))
    return FoundModel(richer, before, after, floor if math.isfinite(floor) else None, unseen)


def _entry(problem: Problem, before: ModelFit, after: ModelFit, step: tuple[str, str, str]) -> HistoryEntry:
    """A step of the history; `step`: when, what, from which data."""
    error_before, error_after, noise, unseen = held_out_errors(problem, before, after)
    return HistoryEntry(*step, error_before, error_after, noise if math.isfinite(noise) else None, unseen)


def _steps(
    problem: Problem, root: ModelFit, model_fit: ModelFit, effects: tuple[str, ...]
) -> list[tuple[str, ModelFit, ModelFit]]:
    """One step down for each effect, strongest first; all in one where a step between is not stable."""
    model_fits = [model_fit]
    for effect in reversed(effects[1:]):
        less = without_effect(problem, root, model_fits[0], effect)
        if less is None:
            return [("+ " + ", ".join(effects), root, model_fit)]
        model_fits.insert(0, less.model_fit)
    every = [root, *model_fits]
    return [
        (f"+ {effect}", lower, upper)
        for effect, (lower, upper) in zip(effects, itertools.pairwise(every), strict=True)
    ]
