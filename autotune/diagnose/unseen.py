"""The error of a model on data that its fit never saw.

Where the recordings have a veto or a test trajectory, nothing was fitted to those. Elsewhere each experiment is
held out in turn: a refit of all the others, linearised round the model, predicts it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.arrays import Floats
from autotune.diagnose.compare import Compared
from autotune.estimation.cross_validation import held_out
from autotune.estimation.data import TEST, TRAINING, VETO
from autotune.estimation.free_parameters import free_of_model
from autotune.estimation.least_squares import fit
from autotune.estimation.noise_floor import NoiseFloor, noise_floor
from autotune.estimation.problem import Study, base_free
from autotune.estimation.residual import residual
from autotune.models.drive_model import DriveModel, Packed

EACH_IN_TURN = "each experiment held out in turn"


@dataclass(frozen=True, slots=True)
class UnseenError:
    """Rms of the torque error [N m or N], the floor under it (None where unknown), and on which data."""

    rms: float
    floor: NoiseFloor | None
    data: str


def roles_unseen(study: Study) -> list[str]:
    """Which of the roles that are never fitted the recordings have."""
    return [role for role in (VETO, TEST) if study.has(role)]


def floor_of_unseen(study: Study, error: Floats) -> NoiseFloor | None:
    """The floor on the repeated rows that were not fitted, else on those that were."""
    counted = study.weight > 0
    unseen = noise_floor(study, error, counted & study.data.role(VETO, TEST))
    return unseen or noise_floor(study, error, counted & study.data.role(TRAINING))


def unseen_error(result: Compared, model: DriveModel) -> UnseenError:
    """What `compare` found, on the data that the model's fit has not seen."""
    study, error = result.study, result.error
    floor = floor_of_unseen(study, error)
    if roles := roles_unseen(study):
        rows = result.rows & study.data.role(*roles)
        return UnseenError(math.sqrt(float(np.mean(error[rows] ** 2))), floor, " and ".join(roles))
    total = held_out(study, error, _sensitivities(study, model, error)).total
    return UnseenError(math.sqrt(total / max(float(study.training.sum()), 1.0)), floor, EACH_IN_TURN)


def _sensitivities(study: Study, model: DriveModel, error: Floats) -> Floats:
    """Columns of the residual's change with the model's parameters, shape (m, parameters)."""
    packed = model.pack()
    inside = Packed(packed.p.copy(), packed.on)
    free = [*base_free(inside, study.scales, model.motion_unit), *free_of_model(model, study.scales)]
    free = [replace(one, lower=min(one.lower, packed.p[one.slot])) for one in free]
    bias = residual(study.data, packed, study.moved) - error
    return fit(study.data, study.moved, packed, free, bias, study.training, iterations=0).jacobian
