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
from autotune.diagnosis.base_laws import BASE_LAWS
from autotune.diagnosis.compare import roles_unseen
from autotune.diagnosis.contact_laws import resolved
from autotune.diagnosis.fitting import held_out_errors, updated_model
from autotune.diagnosis.refits import without_effect
from autotune.diagnosis.verdict import Diagnosis
from autotune.estimation.bias_corrected_fit import ModelFit, fit_inside_twin
from autotune.estimation.data import TRAINING
from autotune.estimation.problem import Problem
from autotune.identify.fit import joined
from autotune.identify.refinement import (
    AtRest,
    damping_in_small_motion,
    damping_of_elements,
)
from autotune.models.drive_model import DriveModel, HistoryEntry, Packed, surface_parameter
from autotune.models.reversal_memory import REMEMBERS, REVERSAL_MEMORY
from autotune.models.torque_lag import TORQUE_LAG
from autotune.models.total_friction import ELEMENTS_DAMPING, stiffness_at_rest, stiffness_of_elements


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
    """The richer model, its history step by step; None where nothing is named and no law of the base was found.

    Args:
        model: as it was given to the diagnosis.
        when, source: for the model's history: the time, and what the data were.
    """
    problem, root, model_fit = diagnosis.problem, diagnosis.root, diagnosis.model_fit
    if problem is None or root is None or model_fit is None:
        return None
    if diagnosis.verdict != "named":
        return (
            _of_base(diagnosis, problem, root, model, (when, source)) if diagnosis.verdict == "none" else None
        )
    fine = resolved(problem, model_fit)
    final = fine or model_fit
    steps = _steps(problem, root, model_fit, diagnosis.effects)
    if fine is not None:
        steps.append((f"{REVERSAL_MEMORY.name} resolved", model_fit, fine))
    richer = updated_model(model, problem, final.fitted)
    if damped := _damping_if_told(diagnosis, final, model):
        final, richer = damped
        steps[-1] = (*steps[-1][:2], final)
    before, after, floor, unseen = held_out_errors(problem, root, final)
    for action, lower, upper in steps:
        richer = richer.with_history(_entry(problem, lower, upper, (when, action, source)))
    return FoundModel(richer, before, after, floor if math.isfinite(floor) else None, unseen)


def _of_base(
    diagnosis: Diagnosis, problem: Problem, root: ModelFit, model: DriveModel, told: tuple[str, str]
) -> FoundModel | None:
    """The model with laws of its base that were found where nothing else is missing; None where there are none.

    `told`: when, from which data.
    """
    if not diagnosis.base:
        return None
    less, given = root, model.pack()
    for law in BASE_LAWS:
        if law.new(root.fitted.packed, given):
            less = law.removed(problem, less) or less
    before, after, floor, unseen = held_out_errors(problem, less, root)
    step = (told[0], "another law of the base", told[1])
    richer = updated_model(model, problem, root.fitted).with_history(_entry(problem, less, root, step))
    return FoundModel(richer, before, after, floor if math.isfinite(floor) else None, unseen)


def _damping_if_told(
    diagnosis: Diagnosis, final: ModelFit, given: DriveModel
) -> tuple[ModelFit, DriveModel] | None:
    """As `_with_damping`; None, too, where the recordings are of a kind that such a fit cannot be made of."""
    try:
        return _with_damping(diagnosis, final, given)
    except (AutotuneError, np.linalg.LinAlgError):
        return None


def _with_damping(
    diagnosis: Diagnosis, final: ModelFit, given: DriveModel
) -> tuple[ModelFit, DriveModel] | None:
    """The fit with its damping in presliding shared by bristle and elements, and its model; None where nothing tells.

    The fit of a diagnosis looks at torque below the frequencies of presliding, which small motion at rest has. What it
    has put into stiffness for want of damping is fitted again; on unseen data that must not be worse.
    """
    problem = diagnosis.problem
    if problem is None or not diagnosis.recordings or not final.fitted.packed.on[REMEMBERS]:
        return None
    recording, late = joined(diagnosis.recordings), torque_late(diagnosis) or 0.0
    model = updated_model(given, problem, final.fitted)
    alike = stiffness_of_elements(model) / stiffness_at_rest(model)
    found = damping_in_small_motion(model, recording, late, alike)
    settled = _settled(problem, final, found)
    if found is None or settled is None:
        return None
    model = updated_model(given, problem, settled.fitted)
    found = damping_of_elements(model, recording, late, found.whole)
    settled = _settled(problem, settled, found)
    if found is None or settled is None:
        return None
    rows = problem.data.role(*(roles_unseen(problem) or (TRAINING,)))
    was, now = (float(np.mean(one.fitted.error[rows] ** 2)) for one in (final, settled))
    if now > (1.0 + problem.policy.least_gain) * was:
        return None
    return settled, _named(updated_model(given, problem, settled.fitted), found, given)


def _settled(problem: Problem, before: ModelFit, found: AtRest | None) -> ModelFit | None:
    """The fit with this damping held; None where the twin is unstable with it."""
    if found is None:
        return None
    packed = Packed(before.fitted.packed.p.copy(), before.fitted.packed.on)
    for name, value in found.values.items():
        packed.p[surface_parameter(name).slot] = value.value
    free = [one for one in before.free if one.name not in found.values]
    return fit_inside_twin(problem, packed, free, 2, before.effects)


def _named(model: DriveModel, found: AtRest, given: DriveModel) -> DriveModel:
    """The model with the errors of its damping."""
    values = found.values
    base = MappingProxyType({**model.base, "micro_damping": values["micro_damping"]})
    memory = model.effect(REVERSAL_MEMORY)
    own = MappingProxyType({**memory.values, "damping": values[ELEMENTS_DAMPING]})
    effects = tuple(replace(one, values=own) if one is memory else one for one in model.effects)
    return replace(
        model, base=base, effects=effects, damping_error=math.hypot(found.error, _by_lag(model, given))
    )


def _by_lag(model: DriveModel, given: DriveModel) -> float:
    """By how much a lag of the torque may move a damping at rest [N m s/rad]; not named, that is in the `given` one's.

    A named one may be a stage or a dead time: their phases at the resonance at rest differ by ωτ − arctan ωτ.
    """
    if TORQUE_LAG.name not in model:
        return given.base["micro_damping"].standard_error or 0.0
    stiffness = stiffness_at_rest(model)
    rate = math.sqrt(stiffness / model["inertia"])
    turn = rate * model[TORQUE_LAG.surface("time_constant")]
    return stiffness / rate * (turn - math.atan(turn))


def torque_late(diagnosis: Diagnosis) -> float | None:
    """By how much the torque follows its demand later than it is held [s], beside a lag that the model names.

    None where the recordings may be late themselves, or without a twin.
    """
    problem = diagnosis.problem
    if problem is None or not problem.twin or problem.controller is None or not problem.controller.exact:
        return None
    return max(-0.5 * problem.data.shift * problem.data.period, 0.0) + problem.data.lag


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
