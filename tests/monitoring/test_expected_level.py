"""The daily check compares measured friction with all that the committed model says, elements included."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.identify.steady_state import Points
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


SPEED = np.array([-2.0, -1.0, 1.0, 2.0])
TURN = np.linspace(0.0, 2.0 * np.pi, 64, endpoint=False)


@pytest.mark.parametrize(
    ("effect", "values", "more"),
    [
        ("stribeck", {"break_away": 0.4, "stribeck_velocity": 1.0, "stribeck_exponent": 1.0},
         0.05 * (np.exp(-1.0) + np.exp(-2.0))),
        ("nonlinear_viscous", {"torque": 0.05, "exponent": 2.0, "knee": 1e-3}, 0.125),
        ("nonlinear_viscous", {"torque": 0.0, "exponent": 1.0, "knee": 1e-3,
                               "film_1": 0.1, "film_speed_1": 1e-3}, 0.1),
        ("direction_asymmetry", {"coulomb": 0.1, "viscous": 0.005}, 0.0),
        ("position_dependent_friction", {"height": 0.0, "centre": 0.0, "width": 1.0, "order": 1.0,
                                         "sin": 0.3, "cos": 0.4}, 0.0),
    ],
)  # fmt: skip
def test_every_effect_on_friction_at_speed_counts(effect: str, values: dict[str, float], more: float) -> None:
    """Regression: without them the level was up to a quarter off, which is drift of an axis that is as it was."""
    model = base_model(BASE).with_effect(EFFECTS[effect].make(values))
    points = Points(SPEED, np.zeros(4), np.ones(4))
    assert expected_level(model, points, TURN) == pytest.approx(0.315 + more, rel=0.01)
