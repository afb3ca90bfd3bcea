"""The feedforward solves (5.2), (5.3) exactly for constant velocity, at any speed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.control.feedforward import FixedFeedforward, LugreParameters, feedforward_along
from autotune.core.errors import ConfigurationError

THESIS = LugreParameters(
    inertia=6.66e-4,
    viscous=4.13e-3,
    coulomb=0.294,
    stiffness=31.6,
    micro_damping=0.112,
    offset=0.0482,
    break_away=0.294,
)


def test_steady_sliding_costs_coulomb_viscous_and_offset() -> None:
    torque = feedforward_along(THESIS, np.full(2000, 2.0), np.zeros(2000), 1e-3)
    assert torque[-1] == pytest.approx(0.294 + 2.0 * 4.13e-3 + 0.0482, rel=1e-6)


def test_steady_slow_sliding_with_a_dip_costs_the_break_away_torque() -> None:
    dip = replace(THESIS, break_away=0.4, stribeck_velocity=0.3)
    slow = feedforward_along(dip, np.full(150_000, 1e-3), np.zeros(150_000), 1e-3)[-1] - THESIS.offset
    assert slow == pytest.approx(0.4, rel=1e-3)


def test_presliding_is_a_spring() -> None:
    velocity = np.full(10, 1e-3)
    torque = feedforward_along(THESIS, velocity, np.zeros(10), 1e-3)
    slope = (torque[9] - torque[4]) / (5 * 1e-3 * 1e-3)
    assert slope == pytest.approx(31.6, rel=0.01)


def test_it_agrees_with_a_fine_integration_of_the_differential_equation() -> None:
    """RK-free check: explicit Euler with 1/200 of the step on a slow sine, where it is accurate."""
    time = np.arange(1000) * 1e-3
    velocity, acceleration = 0.3 * np.cos(2 * np.pi * time), -0.3 * 2 * np.pi * np.sin(2 * np.pi * time)
    torque = feedforward_along(THESIS, velocity, acceleration, 1e-3)
    z, reference = 0.0, np.empty(1000)
    for k in range(1000):
        saturation = 0.294 / 31.6
        rate = velocity[k] - abs(velocity[k]) / saturation * z
        reference[k] = 6.66e-4 * acceleration[k] + 4.13e-3 * velocity[k] + 31.6 * z + 0.112 * rate + 0.0482
        for _ in range(200):
            z += 5e-6 * (velocity[k] - abs(velocity[k]) / saturation * z)
    np.testing.assert_allclose(torque, reference, atol=2e-4)


@given(st.lists(st.floats(-1e4, 1e4), min_size=1, max_size=60), st.floats(1e-4, 4e-3))
def test_friction_is_bounded_for_any_reference(speeds: list[float], period: float) -> None:
    """Fact 5.1: |σ0 z| never exceeds the break-away torque, however rough the reference."""
    velocity = np.array(speeds)
    bare = replace(THESIS, inertia=0.0, viscous=0.0, micro_damping=0.0, offset=0.0)
    torque = feedforward_along(bare, velocity, np.zeros(len(speeds)), period)
    assert np.all(np.abs(torque) <= 0.294 * (1 + 1e-9))


def test_stepping_gives_the_same_as_a_whole_reference() -> None:
    velocity = np.sin(np.arange(500) * 0.02)
    law = FixedFeedforward(THESIS, 1e-3)
    law.prepare()
    steps = [law.step(0.0, float(v), 0.0, None) for v in velocity]
    np.testing.assert_array_equal(steps, feedforward_along(THESIS, velocity, np.zeros(500), 1e-3))


@pytest.mark.parametrize(
    "change", [{"stiffness": 0.0}, {"coulomb": -0.1}, {"inertia": float("nan")}, {"break_away": 0.0}]
)
def test_impossible_parameters_are_refused(change: dict[str, float]) -> None:
    with pytest.raises(ConfigurationError):
        replace(THESIS, **change)
