"""What of the standard programme a diagnosis is fitted on."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.estimation.bandwidth import prepared_both
from autotune.recordings.programme import fitted_part
from autotune.recordings.recording import Metadata, Recording
from tests.estimation.simulated import TRUE, recorded


def recording_of(*segments: tuple[str, int, int]) -> Recording:
    """Segments by name, repeat and length."""
    names = np.concatenate([np.full(length, name) for name, _, length in segments])
    repeats = np.concatenate([np.full(length, repeat) for _, repeat, length in segments])
    ramp = np.arange(len(names), dtype=np.float64)
    columns = {"time": ramp * 1e-3, "position": ramp, "torque": ramp, "reference": ramp}
    return Recording.from_columns(columns, Metadata(sample_period=1e-3), names, repeats)


def test_presliding_with_its_way_there_and_back_is_not_fitted() -> None:
    whole = recording_of(
        ("conditioning", 0, 50), ("steady_state", 0, 40), ("conditioning", 0, 30), ("steady_state", 1, 40),
        ("dahl", 0, 60), ("dahl", 1, 60), ("conditioning", 0, 20), ("presliding", 0, 70), ("presliding", 1, 70),
        ("conditioning", 0, 20), ("high_speed", 0, 80), ("high_speed", 1, 80),
    )  # fmt: skip
    fitted = fitted_part(whole)
    found = [(s.experiment, s.repeat, s.stop - s.start) for s in fitted.segments()]
    assert found == [
        ("conditioning", 0, 50), ("steady_state/0", 0, 40), ("conditioning", 0, 30), ("steady_state/1", 1, 40),
        ("dahl", 0, 60), ("dahl", 1, 60), ("high_speed/0", 0, 80),
        ("high_speed/1", 1, 80),
    ]  # fmt: skip
    assert fitted["time"][-160] == pytest.approx(0.460)
    assert [s.experiment for s in whole.segments()].count("presliding") == 2


def test_every_second_speed_and_two_repeats_are_fitted() -> None:
    strokes: list[tuple[str, int, int]] = []
    for repeat, length in enumerate((40, 40, 50, 50, 60, 60, 70, 70)):
        strokes += [("conditioning", 0, 10), ("steady_state", repeat, length)]
    whole = recording_of(*strokes, ("dahl", 0, 60), ("dahl", 1, 60), ("dahl", 2, 60))
    position = np.concatenate([np.linspace(0.0, speed, len(r)) for speed, r in zip(
        (0, 8, 0, 8, 0, 1, 0, 1, 0, 5, 0, 5, 0, 3, 0, 3, 0, 0, 0), (rows for _, rows in whole.split()), strict=True
    )])  # fmt: skip
    moved = Recording(
        whole.metadata, {**whole.floats, "position": position}, whole.experiment, whole.repeat, whole.missed
    )
    kept = [(s.experiment, s.repeat) for s in fitted_part(moved).segments() if s.experiment != "conditioning"]
    fast, slow = (
        [("steady_state/0", 0), ("steady_state/1", 1)],
        [("steady_state/6", 6), ("steady_state/7", 7)],
    )
    assert kept == [*fast, *slow, ("dahl", 0), ("dahl", 1)]


def test_a_recording_of_anything_else_is_prepared_once() -> None:
    other = recorded(TRUE, seconds=20.0)
    assert fitted_part(other) is other
    data, whole = prepared_both([other])
    assert whole is data


def test_a_recording_without_presliding_is_fitted_whole() -> None:
    whole = recording_of(("dahl", 0, 60), ("high_speed", 0, 80))
    assert len(fitted_part(whole)) == len(whole)


def test_presliding_under_a_position_controller_is_fitted() -> None:
    whole = recording_of(("dahl", 0, 60), ("presliding", 0, 70))
    led = Recording.from_columns(
        {**whole.floats, "reference": whole["position"] + 1e-3},
        whole.metadata,
        whole.experiment,
        whole.repeat,
    )
    assert len(fitted_part(led)) == len(led)
    assert len(fitted_part(whole)) < len(whole)
