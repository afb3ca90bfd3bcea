"""The thesis's adaptation laws on the independent simulated axis."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from autotune.control.adaptation import AdaptationGains, AdaptationResult, AdaptiveFeedforward, Bounds
from autotune.control.feedforward import LugreParameters
from autotune.core.drive import Sample
from autotune.core.errors import ConfigurationError
from autotune_sim.presets import preset
from autotune_sim.servo import Servo, ServoMode, ServoState

PERIOD = 1e-3
START = LugreParameters(
    inertia=6.66e-4,
    viscous=4.13e-3,
    coulomb=0.3,
    stiffness=42.0,
    micro_damping=0.043,
    offset=0.08,
    break_away=0.3,
)


def starting(stiffness: float) -> LugreParameters:
    """Another stiffness with the damping that belongs to it: σ1/σ0 as at rest, 0.112 to 110 N m/rad."""
    return replace(START, stiffness=stiffness, micro_damping=0.112 / 110.0 * stiffness)


def as_sample(state: ServoState) -> Sample:
    feedback = state.torque_demand - state.torque_offset
    return Sample(state.time, state.position_demand, state.position, state.velocity, state.torque_demand,
                  state.torque_actual, state.torque_offset, feedback, state.temperature, 0)  # fmt: skip


def adapt(
    start: LugreParameters,
    seconds: float,
    amplitude: float = 0.2,
    seed: int = 0,
    gains: AdaptationGains | None = None,
    sign: float = 1.0,
    bounds: Bounds | None = None,
    frequency: float = 1.0,
) -> AdaptationResult:
    """Plays the benchmark sine with the adaptive law until it has settled; `sign` −1: a reversed offset."""
    servo = Servo(preset("edm-vertical", seed), seed)
    law = AdaptiveFeedforward(start, bounds or Bounds.around(start), frequency, PERIOD, gains)
    time = np.arange(round(seconds / PERIOD) + 2) * PERIOD
    raw = amplitude * np.minimum(1.0, frequency * time) * np.sin(2 * np.pi * frequency * time)
    r = lfilter([0.2], [1.0, -0.8], raw)
    velocity = (r[2:] - r[:-2]) / (2 * PERIOD)
    acceleration = np.diff(r, 2) / PERIOD**2
    servo.power(True, ServoMode.POSITION)
    origin, previous = servo.position, None
    for k in range(len(velocity)):
        torque = law.step(float(r[k + 1]), float(velocity[k]), float(acceleration[k]), previous)
        previous = as_sample(servo.cycle(origin + float(r[k + 1]), 0.0, 0.0, sign * torque))
        previous = previous._replace(torque_feedback=previous.torque_command - sign * torque)
        if law.settled:
            break
    return law.result()


@pytest.mark.parametrize("stiffness", [18.0, 42.0])
def test_it_converges_to_the_thesis_values_from_any_start(stiffness: float) -> None:
    """31.3 N m/rad, 0.294 N m, 0.0482 N m (Table 6.2, last column), within 15 %; σ1 as there (Table 6.3)."""
    start = replace(START, stiffness=stiffness, micro_damping=0.112 / 31.3 * stiffness)
    found = adapt(start, 60.0)
    assert found.valid, found.reason
    assert found.parameters.stiffness == pytest.approx(31.3, rel=0.15)
    assert found.parameters.coulomb == pytest.approx(0.294, rel=0.15)
    assert found.parameters.offset == pytest.approx(0.0482, rel=0.15)


@pytest.mark.parametrize(
    ("frequency", "amplitude", "farthest"),
    [
        pytest.param(0.1, 0.2, 0.1, marks=pytest.mark.slow),
        pytest.param(0.5, 0.2, 0.1, marks=pytest.mark.slow),
        (1.0, 0.2, 0.1),
        (2.0, 0.2, 0.1),
        (5.0, 0.2, 0.45),
        (10.0, 0.05, 0.45),
        (20.0, 0.02, 0.45),
        (20.0, 0.05, 0.45),
    ],
)
def test_the_laws_end_at_the_same_value_at_every_frequency_and_from_every_start(
    frequency: float, amplitude: float, farthest: float
) -> None:
    """Starts a factor of 4 apart end within 5 %: the laws rest when three periods change less than 1 %.

    Up to 2 Hz they end within 10 % of 36.6 N m/rad. Above, a reversal of √(2 x_s/a) ≈ 10 ms is no longer than
    the loop of 50 Hz takes to answer, and a bristle's damping lasts longer than that of six elements: up
    to 45 % more.
    """
    ends = [
        adapt(starting(stiffness), 35.0 / frequency, amplitude, frequency=frequency)
        for stiffness in (18.0, 42.0, 80.0)
    ]
    for end in ends:
        assert end.valid, end.reason
        assert end.parameters.stiffness == pytest.approx(36.6, rel=farthest)
        assert end.parameters.coulomb == pytest.approx(0.294, rel=0.1)
        assert end.feedback_rms[-1] < 0.95 * end.feedback_rms[1]
    stiffness = [end.parameters.stiffness for end in ends]
    assert max(stiffness) / min(stiffness) < 1.05


@pytest.mark.parametrize("stiffness", [42.0, 80.0])
def test_laws_that_rest_where_the_controller_has_more_to_do_are_not_believed(stiffness: float) -> None:
    """0.2 rad at 10 Hz: a reversal of 5 ms is over before u_PID answers it, and σ0 runs away from the start."""
    found = adapt(starting(stiffness), 6.0, frequency=10.0)
    assert found.frozen
    assert not found.valid
    assert "controller's torque grew" in found.reason
    assert found.parameters.stiffness == pytest.approx(stiffness, rel=0.01)


def test_an_early_freeze_is_named_as_such_and_not_as_too_few_periods() -> None:
    """A reversed torque offset with strong gains: u_PID grows within the first periods."""
    found = adapt(START, 20.0, sign=-1.0, gains=AdaptationGains(0.5, 0.19, 0.6))
    assert found.frozen
    assert len(found.feedback_rms) < 6
    assert found.reason.startswith(f"frozen after {len(found.feedback_rms)} periods")


def test_the_first_period_fades_in_and_is_no_yardstick() -> None:
    """Its u_PID is smaller than any later one's: compared with it, every healthy axis would be frozen."""
    found = adapt(starting(80.0), 6.0, frequency=5.0)
    assert not found.frozen
    assert found.feedback_rms[1] > found.feedback_rms[-1]


def test_the_end_is_found_and_the_controller_has_less_to_do() -> None:
    found = adapt(START, 100.0)
    assert found.settled
    assert 10 < found.time[-1] < 40
    assert found.feedback_rms[-1] < 0.7 * found.feedback_rms[0]


def test_a_sine_too_small_for_sliding_gives_no_valid_result() -> None:
    found = adapt(START, 25.0, amplitude=1e-3)
    assert not found.valid
    assert "too small" in found.reason


def test_a_reversed_torque_offset_freezes_or_hits_a_bound_and_is_never_valid() -> None:
    found = adapt(START, 40.0, sign=-1.0)
    assert not found.valid
    low, high = Bounds.around(START).coulomb
    assert low <= found.parameters.coulomb <= high


def test_the_end_without_enough_periods_is_said() -> None:
    found = adapt(START, 4.0)
    assert not found.valid
    assert "whole periods" in found.reason


def test_parameters_stay_within_their_bounds() -> None:
    narrow = Bounds((40.0, 44.0), (0.29, 0.31), (0.07, 0.09))
    found = adapt(START, 30.0, bounds=narrow)
    assert np.all((found.history[:, 0] >= 40.0) & (found.history[:, 0] <= 44.0))
    assert np.all((found.history[:, 1] >= 0.29) & (found.history[:, 1] <= 0.31))
    assert not found.valid
    assert "bound" in found.reason


def test_what_cannot_be_a_frequency_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="frequency"):
        AdaptiveFeedforward(START, Bounds.around(START), 0.0, PERIOD)
    assert math.isfinite(START.stiffness)
