"""What a sidecar makes of a master's set points."""

from __future__ import annotations

import math

import numpy as np
import pytest

from autotune.control.set_points import POINTS, WINDOW, Cadence, MotionEstimate, SetPointWatch
from tests.drivers.simulator import axis_of

PERIOD = 1e-3
COUNT = 2.0 * math.pi / 50000
LIMITS = axis_of().limits
INERTIA = 6.7e-4


def watch() -> SetPointWatch:
    return SetPointWatch(LIMITS, PERIOD, COUNT, INERTIA)


def test_motion_of_a_parabola_has_no_delay() -> None:
    estimate = MotionEstimate(PERIOD)
    time = PERIOD * np.arange(POINTS + 5)
    motions = [estimate.step(3.0 + 2.0 * t + 5.0 * t * t) for t in time]
    assert motions[POINTS - 2] is None
    last = motions[-1]
    assert last is not None
    assert last.velocity == pytest.approx(2.0 + 10.0 * time[-1], rel=1e-9)
    assert last.acceleration == pytest.approx(10.0, rel=1e-6)


def test_counts_leave_little_in_velocity_and_acceleration() -> None:
    estimate = MotionEstimate(PERIOD)
    wrong = []
    for k in range(2000):
        t = k * PERIOD
        place = 0.2 * math.sin(2.0 * math.pi * t)
        motion = estimate.step(round(place / COUNT) * COUNT)
        if motion is not None:
            exact = 2.0 * math.pi * 0.2 * math.cos(2.0 * math.pi * t)
            wrong.append((motion.velocity - exact, motion.acceleration + (2.0 * math.pi) ** 2 * place))
    velocity, acceleration = np.std(wrong, axis=0)
    # 0.0133 q/(√12 T²) = 0.48 rad/s², and the jerk's; a difference of two counts would be 126
    assert 0.1 < acceleration < 1.5
    assert velocity < 0.01


def test_a_motion_within_the_limits_is_plausible() -> None:
    seen = watch()
    for k in range(1000):
        place = 0.2 * math.sin(2.0 * math.pi * k * PERIOD)
        assert seen.see(round(place / COUNT) * COUNT) == ""


@pytest.mark.parametrize(
    ("positions", "word"),
    [
        ((0.0, math.nan), "nan"),
        ((0.0, LIMITS.position_max + 0.001), "outside"),
        ((0.0, 1.2 * LIMITS.speed * PERIOD), "jump"),
        ((0.0, 0.0, 0.9 * LIMITS.speed * PERIOD), "jump in speed"),
    ],
)
def test_set_points_that_no_axis_follows(positions: tuple[float, ...], word: str) -> None:
    seen = watch()
    assert word in [seen.see(position) for position in positions][-1]


@pytest.mark.parametrize(("targets", "word"), [(1, ""), (2, "two masters"), (0, "silent")])
def test_set_points_are_counted_against_sync(targets: int, word: str) -> None:
    cadence = Cadence()
    said = []
    for _ in range(WINDOW):
        for _ in range(targets):
            cadence.target()
        said.append(cadence.sync())
    assert said[:-1] == [""] * (WINDOW - 1)
    assert (word in said[-1]) if word else not said[-1]
