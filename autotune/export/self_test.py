"""The self-test vector: a short motion, and the torque that the Python feedforward plays along it.

The first half is small, so that the contact bends and turns; the second half slides, reverses and waves.
"""

from __future__ import annotations

import math

import numpy as np

from autotune.control.model_feedforward import ModelFeedforward, fed_forward
from autotune.core.arrays import Floats
from autotune.models import layout
from autotune.models.drive_model import DriveModel
from autotune.models.reversal_memory import REMEMBERS, longest_displacement
from autotune.models.stribeck import FALLS

SAMPLES = 96


def self_test_rows(model: DriveModel, period: float) -> Floats:
    """Position, velocity, acceleration and torque by sample; shape (SAMPLES, 4)."""
    time = np.arange(SAMPLES) * period
    small = presliding_travel(model)
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


def presliding_travel(model: DriveModel) -> float:
    """Travel in which the contact bends before it slides [motion unit]."""
    packed = fed_forward(model).pack()
    level = max(
        float(packed.p[layout.COULOMB]), float(packed.p[layout.BREAK_AWAY] if packed.on[FALLS] else 0.0)
    )
    elements = longest_displacement(packed.p) if packed.on[REMEMBERS] else 0.0
    return max(level / float(packed.p[layout.STIFFNESS]), elements, 1e-9)
