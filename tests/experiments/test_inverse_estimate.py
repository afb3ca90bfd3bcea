"""What slides the axis and how heavy it is, from what a drive tells."""

from __future__ import annotations

import math

import pytest

from autotune.experiments.inverse_estimate import InverseEstimate
from tests.experiments.support import axis

AXIS = axis()
H, COUNT = AXIS.cycle, AXIS.position_resolution
INERTIA = 6.66e-4


def test_a_direction_that_has_only_bent_its_junctions_has_not_slid() -> None:
    """Regression: 0.46 s after its first motion a sound axis was held to a torque that had only bent it."""
    estimate = InverseEstimate(AXIS.limits, H, COUNT)
    position = 0.0
    for k in range(600):
        position += -5e-5 if k < 100 else 1e-3
        estimate.add(position, -0.02 if k < 100 else 0.5, H)
    assert estimate.inverse.up == pytest.approx(0.5)
    assert estimate.inverse.down is None
    for _ in range(600):
        position -= 1e-3
        estimate.add(position, -0.4, H)
    assert estimate.inverse.down == pytest.approx(-0.4, abs=0.05)


def test_what_slides_the_axis_is_not_forgotten_while_it_is_only_bent() -> None:
    """Regression: 1 300 reversals in presliding made the torque that slides a sound axis next to nothing."""
    estimate = InverseEstimate(AXIS.limits, H, COUNT)
    position = 0.0
    for k in range(4000):
        way = 1.0 if k // 400 % 2 else -1.0
        position += 1e-3 * way
        estimate.add(position, 0.3 * way, H)
    for k in range(20_000):
        way = 1.0 if k // 40 % 2 else -1.0
        position += 5e-5 * way
        estimate.add(position, 0.02 * way, H)
    assert estimate.inverse.up == pytest.approx(0.3, rel=0.1)
    assert estimate.inverse.down == pytest.approx(-0.3, rel=0.1)


def test_the_first_fast_window_of_an_axis_whose_friction_falls_with_speed_claims_no_inertia_alone() -> None:
    """Regression: one solution called a sound axis too heavy for its deceleration, the next one did not."""
    estimate = InverseEstimate(AXIS.limits, H, COUNT)
    position, alone, claimed = 0.0, 0.0, 0.0
    slow = 2.0 * math.pi * 0.5
    strokes = [(math.sin(slow * k * H), slow * math.cos(slow * k * H)) for k in range(6000)]
    start = [(-0.2 * k, -200.0 if k < 30 else 0.0) for k in (*range(30), *[30] * 270)]
    for velocity, acceleration in (*strokes, *start):
        position += velocity * H
        friction = math.copysign(max(0.5 - 0.35 * abs(velocity), 0.3 if velocity < -1.0 else 0.0), velocity)
        estimate.add(round(position / COUNT) * COUNT, INERTIA * acceleration + friction, H)
        inverse = estimate.inverse
        if inverse.inertia is not None:
            alone = max(alone, 2.0 * inverse.inertia - inverse.heaviest)
        claimed = max(claimed, inverse.lightest)
    assert alone > 3.0 * INERTIA
    assert claimed < INERTIA
