"""The torque error of a model as it is, nothing fitted: the one statement that fit, compare and diagnose make.

The residual is corrected by a twin where a controller is known, so that the measurement chain is not blamed on
the model. A single recording without one is aligned to the model first, and single events are left out.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.estimation.alignment import best_shift, shifted, without_twin
from autotune.estimation.controller import find_controller
from autotune.estimation.data import Prepared
from autotune.estimation.disturbance_estimate import estimate_disturbance
from autotune.estimation.policy import POLICY, Policy
from autotune.estimation.problem import Study, start_study, without_outlying
from autotune.estimation.residual import measured_motion, residual, smoothed
from autotune.models.drive_model import DriveModel, Packed

SIMULATIONS = 3
"""Of the twin: its bias is their mean."""


@dataclass(frozen=True, slots=True)
class ModelError:
    """What a model leaves of the torque; arrays of shape (m,), on the grid of `study.data`.

    Attributes:
        rows: that count.
        notes: in words, why there is no twin.
    """

    study: Study
    error: Floats
    rows: Flags
    notes: tuple[str, ...]

    @property
    def torque(self) -> Floats:
        """The demand in the same bands, rows that count only [N m or N]."""
        return smoothed(self.study.data, self.study.data.torque)[self.rows]

    @property
    def error_rms(self) -> float:
        return float(np.sqrt(np.mean(self.error[self.rows] ** 2)))

    @property
    def relative_error(self) -> float:
        """Over the rms of the torque."""
        return self.error_rms / math.sqrt(max(float(np.mean(self.torque**2)), 1e-300))


def model_error(data: Prepared, model: DriveModel, policy: Policy = POLICY) -> ModelError:
    """The error of a model on prepared data."""
    found = find_controller(data, policy)
    study = start_study(data, found, policy)
    packed = model.pack()
    notes = found.notes if found.usable else (f"No twin: {found.why}.",)
    if study.twin and not study.correction(packed, 1).stable:
        study = replace(study, controller=None)
        notes = ("No twin: a simulation of the model with this controller is unstable.",)
    if not study.twin:
        data, said = without_twin(data)
        data = data if data.repeated or data.steady else best_aligned(data, packed)
        study, notes = start_study(data, None, policy), (*notes, *said)
    raw = residual(data, packed, study.moved)
    if study.twin:
        study = replace(study, disturbance=estimate_disturbance(study, packed))
    correction = study.correction(packed, SIMULATIONS)
    if not correction.stable:
        study, correction = replace(study, controller=None), replace(correction, stable=True)
    error = raw - correction.bias
    if not data.repeated and not data.steady:
        study = replace(study, weight=without_outlying(study, error))
    rows = np.asarray(study.weight > 0)
    return ModelError(study, error, rows, notes)


def best_aligned(data: Prepared, packed: Packed) -> Prepared:
    """The data with the torque shifted to where this model explains it best."""

    def cost(shift: float) -> float:
        moved = shifted(data, shift)
        return float(np.mean(residual(moved, packed, measured_motion(moved)) ** 2))

    return shifted(data, best_shift(cost, data.shift, data.upsampling)[0])
