"""What becomes of the damping in presliding when a diagnosis leads to a model."""

from __future__ import annotations

import math

import pytest

from autotune.models.drive_model import base_model
from autotune.models.reversal_memory import REVERSAL_MEMORY
from autotune.models.torque_lag import TORQUE_LAG
from autotune.tuning.found_model import _by_lag
from tests.support.axes import NOMINAL


def test_a_lag_that_is_not_named_is_in_the_error_of_the_identified_damping() -> None:
    memory = REVERSAL_MEMORY.make({"displacement_1": 1e-3, "torque_1": 0.05})
    given = base_model(NOMINAL, {"micro_damping": 0.02})
    assert _by_lag(given.with_effect(memory), given) == 0.02
    assert _by_lag(given.with_effect(memory), base_model(NOMINAL)) == 0.0


@pytest.mark.parametrize("late", [5e-4, 2e-3])
def test_a_named_lag_may_be_a_stage_or_a_dead_time(late: float) -> None:
    """By the damping that turns the stiffness at rest by the difference of their phases, at the resonance at rest."""
    model = base_model(NOMINAL, {"micro_damping": 0.02})
    rate = math.sqrt(NOMINAL["stiffness"] / NOMINAL["inertia"])
    delay, stage = complex(0.0, -rate * late), 1.0 / complex(1.0, rate * late)
    turned = abs(delay.imag) - abs(math.atan2(stage.imag, stage.real))
    late_model = model.with_effect(TORQUE_LAG.make({"time_constant": late}))
    assert _by_lag(late_model, model) == pytest.approx(turned * NOMINAL["stiffness"] / rate)
