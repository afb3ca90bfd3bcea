"""Motions that repeat themselves, and those that do not."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.signals.periodic import periodic

PERIOD = 5e-3
TIME = np.arange(0.0, 30.0, PERIOD)


def waves(hertz: float) -> np.ndarray:
    """Three waves of one base frequency, as robots are excited."""
    return sum(a * np.sin(2.0 * np.pi * k * hertz * TIME + k) for a, k in ((1.0, 1), (0.4, 3), (0.2, 7)))


@pytest.mark.parametrize("seconds", [0.0, 1.0, 3.0])
def test_a_motion_that_comes_up_from_rest_repeats_itself_all_the_same(seconds: float) -> None:
    rise = np.clip(TIME / seconds, 0.0, 1.0) if seconds else 1.0
    fall = np.clip((TIME[-1] - TIME) / seconds, 0.0, 1.0) if seconds else 1.0
    found = periodic(waves(0.25) * rise * fall, 100, PERIOD)
    assert found is not None
    assert found.samples * PERIOD == pytest.approx(4.0, rel=1e-3)
    assert (found.start, found.stop) == (100, 100 + len(TIME))


def test_a_motion_that_is_made_once_does_not() -> None:
    steps = np.repeat(np.random.default_rng(3).standard_normal(30), len(TIME) // 30)
    assert periodic(np.cumsum(steps), 0, PERIOD) is None
    assert periodic(waves(0.25) * np.exp(-TIME / 10.0), 0, PERIOD) is None
