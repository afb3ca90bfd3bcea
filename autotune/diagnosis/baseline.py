"""How a diagnosis begins: controller, noise, and the model as it is, fitted to these recordings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from autotune.core.errors import NotEnoughExcitation
from autotune.diagnosis.candidates import Progress, no_progress
from autotune.diagnosis.evidence import evidence_of
from autotune.estimation.alignment import without_twin
from autotune.estimation.bias_corrected_fit import Level, fit_inside_twin
from autotune.estimation.contact_start import as_rough, fitted_contact
from autotune.estimation.controller import find_controller
from autotune.estimation.controller_torque import loop_note, refuse_answers
from autotune.estimation.data import Prepared
from autotune.estimation.disturbance_estimate import estimate_disturbance
from autotune.estimation.free_parameters import free_of_model
from autotune.estimation.least_squares import Free
from autotune.estimation.policy import POLICY, Policy
from autotune.estimation.problem import (
    Study,
    base_free,
    by_steadiness,
    refit,
    start_study,
    with_expected_noise,
)
from autotune.estimation.residual import smoothed
from autotune.models.drive_model import DriveModel, Packed


def begin(
    data: Prepared,
    model: DriveModel,
    progress: Progress = no_progress,
    simulations: int = 2,
    policy: Policy = POLICY,
) -> tuple[Study, Level, Packed, tuple[str, ...]]:
    """Controller, noise and the fit of the model as it is.

    Raises:
        NotEnoughExcitation: the model cannot be made to fit this axis at all.
    """
    refuse_answers(data, policy)
    found = find_controller(data, policy)
    packed = model.pack()
    notes = found.notes
    if not found.usable:
        data, said = without_twin(data)
        notes = (f"No twin: {found.why}. Confidence is lower.", *said, *loop_note(data, policy))
    study = start_study(data, found, policy)
    progress("fit of the model as it is")
    free = [*base_free(packed, study.scales, data.metadata.motion_unit), *free_of_model(model, study.scales)]
    level = _first_level(replace(study, simulations=simulations), packed, free)
    if level is None and study.twin:
        data, said = without_twin(data)
        notes = ("No twin: a simulation of the model with this controller is unstable or rings.", *said)
        study = start_study(data, None, policy)
        level = _first_level(study, packed, free)
    if level is None:
        raise NotEnoughExcitation(
            "the model does not fit these recordings at all; check that model and recordings are of the "
            "same axis, or fit a new model: autotune model fit"
        )
    study, settled = _aligned(*level)
    _refuse_misfit(study, settled)
    dropped = 1.0 - float(np.mean(study.weight > 0))
    if dropped > 0.0:
        notes = (*notes, f"{100 * dropped:.1f} % of the rows were left out: starts, stops or disturbances.")
    return study, settled, packed, (*notes, *evidence_of(study.data).limits(study))


def _first_level(study: Study, packed: Packed, free: list[Free]) -> tuple[Study, Level] | None:
    start = study.correction(packed, 1)
    if not start.stable:
        start = replace(start, stable=True)
    fitted = refit(study, packed, free, start, 8)
    if not np.isfinite(fitted.cost):
        return None
    evidence = evidence_of(study.data)
    weight = evidence.weights(study, fitted.error)
    if weight is not None:
        study = replace(study, weight=weight)
        fitted = refit(study, fitted.packed, free, start, 4)
        fitted, free = fitted_contact(study, fitted, start, free)
    plain = fitted.cost
    for _ in range(2):
        study = replace(study, disturbance=estimate_disturbance(study, fitted.packed))
        study = as_rough(study, fitted.packed)
        correction = study.correction(fitted.packed, 1)
        if not correction.stable:
            return None
        fitted = refit(study, fitted.packed, free, correction, 4)
    study = with_expected_noise(by_steadiness(study, fitted.error), fitted.packed)
    level = fit_inside_twin(study, fitted.packed, free, 2)
    if study.two_masses(packed):  # with a held bias these fits walk off: the model may be nearer
        as_given = fit_inside_twin(study, packed, free, 2)
        if level is None or (as_given is not None and as_given.fitted.cost < level.fitted.cost):
            level = as_given
    if level is not None and not evidence.repeats and level.fitted.cost > study.policy.twin_worse * plain:
        return None
    return None if level is None else (study, level)


def _aligned(study: Study, level: Level) -> tuple[Study, Level]:
    """Torque and motion of a single recording aligned to this model, and the model fitted again."""
    again = evidence_of(study.data).aligned(study, level)
    if again is study:
        return study, level
    return again, fit_inside_twin(again, level.fitted.packed, list(level.free), 2) or level


def _refuse_misfit(study: Study, level: Level) -> None:
    rows = study.training > 0
    torque = smoothed(study.data, study.data.torque)[rows]
    share = float(np.var(level.fitted.error[rows])) / max(float(np.var(torque)), 1e-300)
    if share > study.policy.misfit:
        raise NotEnoughExcitation(
            f"the model explains only {100 * max(1 - share, 0.0):.0f} % of the torque even after refitting; is the "
            "sign or the unit of the torque wrong, or the model of another axis? Fit a new model with "
            "'autotune model fit', or import the file again with another torque factor"
        )
