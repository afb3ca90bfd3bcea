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
    micro_damping=0.05,
    offset=0.08,
    break_away=0.3,
)


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
) -> AdaptationResult:
    """Plays the benchmark sine with the adaptive law until it has settled; `sign` −1: a reversed offset."""
    servo = Servo(preset("edm-vertical", seed), seed)
    law = AdaptiveFeedforward(start, bounds or Bounds.around(start), 1.0, PERIOD, gains)
    time = np.arange(round(seconds / PERIOD) + 2) * PERIOD
    raw = amplitude * np.minimum(1.0, time) * np.sin(2 * np.pi * time)
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
    """31.3 N m/rad, 0.294 N m, 0.0482 N m (Table 6.2, last column), within 15 %."""
    found = adapt(replace(START, stiffness=stiffness), 60.0)
    assert found.valid, found.reason
    assert found.parameters.stiffness == pytest.approx(31.3, rel=0.15)
    assert found.parameters.coulomb == pytest.approx(0.294, rel=0.15)
    assert found.parameters.offset == pytest.approx(0.0482, rel=0.15)


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
