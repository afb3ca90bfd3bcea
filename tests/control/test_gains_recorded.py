"""Hunting recognised in recordings, and why nothing is said where it cannot be."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.control.gains.recorded import held_set_points
from autotune.core.errors import RecordingError
from autotune.recordings.recording import Metadata, Recording
from tests.control.gains_axis import HOLDS, HUNTS, TIMING, on_the_plant


def recording(position: np.ndarray, reference: np.ndarray | None) -> Recording:
    time = np.arange(len(position)) * TIMING.period
    columns = {"time": time, "position": position, "torque": np.zeros(len(position))}
    if reference is not None:
        columns["reference"] = reference
    metadata = Metadata(sample_period=TIMING.period, position_resolution=TIMING.resolution)
    return Recording.from_columns(columns, metadata)


def test_an_axis_that_hunts_is_recognised() -> None:
    position = on_the_plant(HUNTS, 0.2, 3.0)
    seen = held_set_points(recording(position, np.full(len(position), 0.2)), TIMING.resolution)
    assert seen.cycle is not None
    assert seen.cycle.frequency == pytest.approx(26.5, rel=0.05)
    position = on_the_plant(HOLDS, 0.2, 3.0)
    seen = held_set_points(recording(position, np.full(len(position), 0.2)), TIMING.resolution)
    assert seen.cycle is None
    assert seen.seconds == pytest.approx(3.0, abs=0.01)


def test_without_set_points_nothing_is_said() -> None:
    position = on_the_plant(HOLDS, 0.2, 1.0)
    with pytest.raises(RecordingError, match="no set points"):
        held_set_points(recording(position, None), TIMING.resolution)
    moving = np.linspace(0.0, 1.0, len(position))
    with pytest.raises(RecordingError, match="record a standstill"):
        held_set_points(recording(position, moving), TIMING.resolution)


def test_a_slow_swing_that_was_asked_for_is_no_hunting() -> None:
    """A sine of five counts moves by hundredths of a count from row to row; the axis follows it to the count."""
    time, count = np.arange(4000) * TIMING.period, TIMING.resolution
    wanted = 5.0 * np.sin(2.0 * np.pi * time)
    with pytest.raises(RecordingError, match="record a standstill"):
        held_set_points(recording(count * np.round(wanted), count * wanted), count)
    rests = np.concatenate([wanted, np.zeros(2000)])
    seen = held_set_points(recording(count * np.round(rests), count * rests), count)
    assert seen.cycle is None
    assert seen.seconds == pytest.approx(2.0, abs=0.1)
