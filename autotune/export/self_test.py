"""The self-test vector: a short motion, and the torque that the Python feedforward plays along it.

The first half is small, so that the contact bends and turns; the second half slides, reverses and waves.
"""

from __future__ import annotations

import math

import numpy as np

from autotune.control.model_feedforward import ModelFeedforward, fed_forward
from autotune.core.arrays import Floats
from autotune.models.drive_model import DriveModel

SAMPLES = 96


def self_test_rows(model: DriveModel, period: float) -> Floats:
    """Position, velocity, acceleration and torque by sample; shape (SAMPLES, 4)."""
    time = np.arange(SAMPLES) * period
    small = _presliding_travel(model)
    late = np.arange(SAMPLES) >= SAMPLES // 2
    size = np.where(late, 30.0 * small, 0.7 * small)
    rates = np.array([2.0, 3.3]) * 2.0 * math.pi / (SAMPLES * period)
    phases = np.array([0.3, 1.1])
    angle = np.outer(time, rates) + phases
    position = size * np.sum(np.sin(angle), axis=1)
    velocity = size * (np.cos(angle) @ rates)
    acceleration = -size * (np.sin(angle) @ rates**2)
    law = ModelFeedforward(model, period)
    rows = zip(position, velocity, acceleration, strict=True)
    torque = [law.step(float(q), float(v), float(a), None) for q, v, a in rows]
    return np.column_stack([position, velocity, acceleration, torque])


def _presliding_travel(model: DriveModel) -> float:
    """Travel in which the contact bends before it slides [motion unit]."""
    parameters = fed_forward(model).parameters
    elements = [v.value for name, v in parameters.items() if name.startswith("reversal_memory.displacement")]
    return max(parameters["coulomb"].value / parameters["stiffness"].value, *elements, 1e-9)
