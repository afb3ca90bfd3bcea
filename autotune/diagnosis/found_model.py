"""The model that a diagnosis leads to: with the named effects, fitted together, reversal memory resolved.

One way for `autotune run` and for `DiagnosisResult.found_model`, so that one recording has one answer.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from autotune.core.errors import AutotuneError
from autotune.diagnosis.compare import roles_unseen
from autotune.diagnosis.fitting import held_out_errors, updated_model
from autotune.diagnosis.free_shape import resolved
from autotune.diagnosis.refits import without_effect
from autotune.diagnosis.verdict import Diagnosis
from autotune.estimation.bias_corrected_fit import ModelFit, twinned
from autotune.estimation.data import TRAINING
from autotune.estimation.problem import Problem
from autotune.identify.fit import joined
from autotune.identify.refinement import AtRest, damping_of_elements
from autotune.models.drive_model import DriveModel, HistoryEntry, Packed, surface_parameter
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
    richer = updated_model(model, problem, final.fitted)
    damped = _with_damping(diagnosis, final, richer, model)
    if damped is not None:
        final, richer = damped
        steps[-1] = (*steps[-1][:2], final)
    before, after, floor, unseen = held_out_errors(problem, root, final)
    for action, lower, upper in steps:
        richer = richer.with_history(_entry(problem, lower, upper, (when, action, source)))
    return FoundModel(richer, before, after, floor if math.isfinite(floor) else None, unseen)


def _with_damping(
    diagnosis: Diagnosis, final: ModelFit, richer: DriveModel, given: DriveModel
) -> tuple[ModelFit, DriveModel] | None:
    """The model with the damping in presliding shared by its bristle and elements; None where nothing tells it.

    The fit of a diagnosis looks at torque below the frequencies of presliding, which small motion at rest has. It must
    not cost what the fit has gained.
    """
    problem = diagnosis.problem
    if problem is None or REVERSAL_MEMORY.name not in richer or not diagnosis.recordings:
        return None
    try:
        found = damping_of_elements(richer, joined(diagnosis.recordings), torque_late(diagnosis) or 0.0)
    except (AutotuneError, np.linalg.LinAlgError):
        return None
    if found is None:
        return None
    packed = Packed(final.fitted.packed.p.copy(), final.fitted.packed.on)
    for name, value in found.values.items():
        packed.p[surface_parameter(name).slot] = value.value
    place = twinned(problem, packed)
    if place is None:
        return None
    rows = problem.data.role(*(roles_unseen(problem) or (TRAINING,)))
    was, now = (float(np.mean(error[rows] ** 2)) for error in (final.fitted.error, place.error))
    if now > (1.0 + problem.policy.least_gain) * was:
        return None
    fitted = replace(final.fitted, packed=packed, error=place.error, cost=place.cost)
    return replace(final, fitted=fitted, correction=place.correction), _named(richer, found, given)


def _named(richer: DriveModel, found: AtRest, given: DriveModel) -> DriveModel:
    """The model with what was found; what a lag of the torque may have added to it is in the `given` one's interval."""
    lag = given.base["micro_damping"].standard_error or 0.0
    memory = next(effect for effect in richer.effects if effect.kind is REVERSAL_MEMORY)
    values = {**memory.values, "damping": found.elements}
    base = MappingProxyType({**richer.base, "micro_damping": found.bristle})
    effects = tuple(
        replace(effect, values=MappingProxyType(values)) if effect is memory else effect
        for effect in richer.effects
    )
    return replace(richer, base=base, effects=effects, damping_error=math.hypot(found.error, lag))


def torque_late(diagnosis: Diagnosis) -> float | None:
    """By how much the torque follows its demand later than it is held [s], beside a lag that the model names.

    None where the recordings may be late themselves, or without a twin.
    """
    problem = diagnosis.problem
    if problem is None or not problem.twin or problem.controller is None or not problem.controller.exact:
        return None
    return max(-0.5 * problem.data.shift * problem.data.period, 0.0)


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
