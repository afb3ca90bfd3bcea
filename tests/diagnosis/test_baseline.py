"""Which of two torque columns a diagnosis begins with."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from autotune.diagnosis.baseline import quieter_torque
from autotune.estimation.bandwidth import prepared_to_fit
from autotune.estimation.controller import PositionController

LAW = PositionController(1.0, 0.1, explained=0.998, source="identified", in_band=True)


@pytest.mark.parametrize(
    ("in_band", "shaken", "sensed"), [(True, 5e-3, True), (True, 0.0, False), (False, 5e-3, False)]
)
def test_the_sensors_torque_is_taken_where_the_drives_loop_shakes_its_demand_between_the_samples(
    short, in_band: bool, shaken: float, sensed: bool
) -> None:
    data = prepared_to_fit([short])
    noise = np.random.default_rng(2).normal(0.0, 1.0, len(data.torque))
    demand = data.torque + shaken * noise
    data = replace(data, torque=demand, recorded_torque=demand, sensed=data.torque + 1e-3 * noise[::-1])
    found = quieter_torque(data, replace(LAW, in_band=in_band))
    assert np.array_equal(found.torque, data.sensed if sensed else demand)
