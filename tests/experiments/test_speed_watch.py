"""Speed by the encoder itself, from the first cycle on."""

from __future__ import annotations

import pytest

from autotune.experiments.speed_watch import SpeedWatch
from tests.experiments.support import axis

H = 1e-3
AXIS = axis()


def cycles_until_stopped(stood: int, acceleration: float) -> int:
    """How many cycles of a motion from rest pass, after the axis stood for some."""
    watch = SpeedWatch(AXIS.limits, H, AXIS.position_resolution)
    watch.begin(0.5, H)
    for _ in range(stood):
        assert not watch.check(0.5, 0.0, H, 2 * H)
    for k in range(1, 1000):
        time = k * H
        if watch.check(0.5 + 0.5 * acceleration * time * time, acceleration * time, H, 2 * H):
            return k
    raise AssertionError("the axis was never stopped")


@pytest.mark.parametrize("acceleration", [-3000.0, 2000.0, 4500.0, -10_000.0, 35_000.0])
def test_an_axis_is_watched_as_closely_in_its_first_cycles_as_later(acceleration: float) -> None:
    assert cycles_until_stopped(0, acceleration) == cycles_until_stopped(24, acceleration)
