"""A leap of the position is measured against what the axis does elsewhere, and can be overruled."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from autotune.core.errors import RecordingError

from .conftest import Floats, axis_signals, bring_in, write_table


def without_velocity(signals: dict[str, Floats]) -> dict[str, Floats]:
    return {name: values for name, values in signals.items() if name != "velocity"}


@pytest.mark.parametrize("jitter", [0.0, 3e-4])
@pytest.mark.parametrize(
    ("rows", "leap"), [(slice(1200, None), 3.0), (slice(1200, None), -0.15), (slice(1200, 1201), 0.5)]
)
def test_a_leap_is_refused_with_its_row(tmp_path: Path, rows: slice, leap: float, jitter: float) -> None:
    """A sensor set anew, by a small part of the travel too, and a single wrong value."""
    signals = without_velocity(axis_signals())
    signals["position"][rows] += leap
    signals["time"] += jitter * np.random.default_rng(1).uniform(-1.0, 1.0, 2000)
    with pytest.raises(RecordingError, match=r"jumps .* at row 1201, .*--keep-leaps"):
        bring_in(write_table(tmp_path / "t.csv", signals))


def test_a_leap_that_was_looked_at_is_kept_and_said(tmp_path: Path) -> None:
    signals = without_velocity(axis_signals())
    signals["position"][1200:] += 3.0
    imported = bring_in(write_table(tmp_path / "t.csv", signals), keep_leaps=True)
    np.testing.assert_allclose(imported.recording["position"], signals["position"], rtol=1e-8, atol=1e-12)
    assert any("position leaps 1 times" in line and "row 1201" in line for line in imported.lines)


def test_a_joint_at_rest_may_jerk(tmp_path: Path) -> None:
    """A segment that rests but for 3.3 mrad, of a joint that travels 1.35 rad elsewhere in the file."""
    random = np.random.default_rng(4)
    moving = axis_signals(3000)
    position = np.concatenate([moving["position"] * 1.35 / 1.6, 1e-6 * random.standard_normal(1000)])
    position[3500:] += 3.3e-3
    torque = np.concatenate([moving["torque"], 0.1 + 1e-3 * random.standard_normal(1000)])
    time = 1e-3 * np.arange(4000) + np.where(np.arange(4000) < 3000, 0.0, 5.0)
    imported = bring_in(
        write_table(tmp_path / "t.csv", {"time": time, "position": position, "torque": torque})
    )
    assert len(imported.recording.segments()) == 2
    np.testing.assert_allclose(imported.recording["position"], position, rtol=1e-8, atol=1e-11)


def test_coarse_counts_and_steps_between_slow_samples_are_no_leaps(tmp_path: Path) -> None:
    time = 1e-3 * np.arange(4000)
    crawling = np.round(0.004 * np.sin(2 * time) / 1e-3) * 1e-3
    table = 0.5 * np.floor(20 * time)
    for position in (crawling, table):
        torque = 0.3 * np.sign(np.cos(2 * time))
        columns = {"time": time, "position": position, "torque": torque}
        imported = bring_in(write_table(tmp_path / "t.csv", columns), keep_signs=True)
        np.testing.assert_allclose(imported.recording["position"], position, rtol=1e-8, atol=1e-11)


def test_a_wrapped_position_is_unwrapped_before_it_is_interpolated(tmp_path: Path) -> None:
    """Interpolated across the end of a turn, a row in between would lie anywhere."""
    time = 1e-3 * np.arange(4000) + np.random.default_rng(2).uniform(-3e-4, 3e-4, 4000)
    position = 3.0 + 9.0 * np.sin(2 * time)
    torque = 0.3 * np.sign(np.cos(2 * time)) - 0.36 * np.sin(2 * time)
    columns = {"time": time, "position": position % (2 * np.pi), "torque": torque}
    recording = bring_in(write_table(tmp_path / "t.csv", columns, digits=12)).recording
    # cubic pieces: about omega^3 h^3/30 of 9 rad with h up to 1.6 ms
    np.testing.assert_allclose(recording["position"], 3.0 + 9.0 * np.sin(2 * recording["time"]), atol=1e-7)
