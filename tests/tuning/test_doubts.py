"""Axes that must not be tuned are told apart from sound ones by the benchmark itself."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.recordings.recording import Metadata, Recording
from autotune.tuning.unfit_axes import (
    NotTunable,
    load_change,
    oscillation,
    refuse_changing_load,
    refuse_what_cannot_be_tuned,
    unrepeatable,
)
from tests.support.refusals import refusal

PERIODS = 6
RESOLUTION = 2.0 * np.pi / 50_000
TIME = np.arange(PERIODS * 1000) * 1e-3


def recording(error: Floats, load: Floats | float = 0.0, seed: int = 1, noise: float = 1e-4) -> Recording:
    """A sine with quadrant glitches, an additional error and an additional torque."""
    rng = np.random.default_rng(seed)
    reference = 0.2 * np.sin(2 * np.pi * TIME)
    glitch = 2e-3 * np.exp(-(((TIME % 0.5) - 0.27) ** 2) / 4e-4)
    whole = glitch + error + noise * rng.standard_normal(len(TIME))
    torque = 0.3 * np.sign(np.cos(2 * np.pi * TIME)) + 0.01 * rng.standard_normal(len(TIME)) + load
    return Recording.from_columns(
        {"time": TIME, "reference": reference, "position": reference - whole, "torque": torque},
        Metadata(sample_period=1e-3),
    )


def refuse(one: Recording) -> None:
    refuse_what_cannot_be_tuned([one], 1.0, RESOLUTION, "rad")


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("noise", [0.0, 1e-4, 3e-4])
def test_a_sound_axis_passes(seed: int, noise: float) -> None:
    assert refusal(lambda: refuse(recording(0.0 * TIME, seed=seed, noise=noise))) == ""


def test_torque_ripple_passes_because_it_repeats_with_the_position() -> None:
    position = 0.2 * np.sin(2 * np.pi * TIME)
    assert refusal(lambda: refuse(recording(8e-4 * np.sin(72.0 * position + 1.0)))) == ""


@pytest.mark.parametrize("frequency", [25.0, 60.0, 140.0])
def test_a_limit_cycle_is_told_with_its_frequency(frequency: float) -> None:
    swinging = recording(2e-3 * np.sin(2 * np.pi * frequency * TIME))
    with pytest.raises(NotTunable, match=f"at {frequency:.0f} Hz") as told:
        refuse(swinging)
    assert told.value.exit_code == 3


def test_what_swings_less_than_the_sensor_can_tell_is_left_alone() -> None:
    small = oscillation(2.0 * RESOLUTION * np.sin(2 * np.pi * 60 * TIME), 1e-3, 1.0)
    assert small.share > 0.9
    assert small.amplitude == pytest.approx(2.0 * RESOLUTION, rel=0.1)
    error = 2.0 * RESOLUTION * np.sin(2 * np.pi * 60 * TIME)
    quiet = Recording.from_columns(
        {"time": TIME, "reference": 0 * TIME, "position": -error, "torque": np.sin(2 * np.pi * TIME)},
        Metadata(sample_period=1e-3),
    )
    assert refusal(lambda: refuse(quiet)) == ""


def test_stick_slip_that_comes_and_goes_is_refused() -> None:
    rng = np.random.default_rng(3)
    slow = np.repeat(2e-3 * rng.standard_normal(len(TIME) // 125), 125)
    assert unrepeatable([recording(slow)], 1.0) > 0.5
    with pytest.raises(NotTunable, match="does not repeat"):
        refuse(recording(slow))


def test_a_hand_on_the_table_is_seen_in_the_mean_torque_only() -> None:
    leaning = recording(0.0 * TIME, load=0.15 * (TIME > 3.0))
    assert load_change([leaning], 1.0) == pytest.approx(0.5, rel=0.1)
    with pytest.raises(NotTunable, match="load changes"):
        refuse_changing_load([leaning], 1.0)
    refuse_changing_load([recording(0.0 * TIME, load=0.15)], 1.0)


def test_two_windows_with_another_load_each_are_one_changing_load() -> None:
    with pytest.raises(NotTunable, match="load changes"):
        refuse_changing_load([recording(0.0 * TIME), recording(0.0 * TIME, load=0.1)], 1.0)
