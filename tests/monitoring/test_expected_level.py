"""The daily check compares measured friction with all that the committed model says, elements included."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.identify.characteristic import Points
from autotune.models.drive_model import base_model
from autotune.models.table import EFFECTS
from autotune.monitoring.check_figures import expected_level

BASE = {
    "inertia": 1e-3,
    "viscous": 0.01,
    "coulomb": 0.3,
    "stiffness": 50.0,
    "micro_damping": 0.05,
    "offset": 0.1,
}


def test_elastic_elements_are_friction_like_the_bristle() -> None:
    speed = np.array([-2.0, -1.0, 1.0, 2.0])
    points = Points(speed, np.zeros(4), np.ones(4))
    whole = base_model(BASE)
    memory = EFFECTS["reversal_memory"].make(
        {"displacement_1": 1e-3, "torque_1": 0.12, "displacement_2": 1e-2, "torque_2": 0.08}
    )
    resolved = base_model(BASE | {"coulomb": 0.1}).with_effect(memory)
    assert expected_level(whole, points) == pytest.approx(0.315)
    assert expected_level(resolved, points) == pytest.approx(expected_level(whole, points))
