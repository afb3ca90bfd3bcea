"""What a guard's stop says about the axis; an impact at one place is nothing but an impact."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.core.axis import read_axis
from autotune.recordings.recording import Metadata, Recording
from autotune.tuning.stop_reasons import explained, gap_of
from tests.end_to_end.support import EXAMPLE

AXIS = read_axis(EXAMPLE)
TIME = np.arange(6000) * 1e-3


def recording(reference: Floats, error: Floats) -> Recording:
    columns = {"time": TIME, "reference": reference, "position": reference - error, "torque": 0.3 + 0 * TIME}
    return Recording.from_columns(
        {name: values[: len(error)] for name, values in columns.items()}, Metadata(sample_period=1e-3)
    )


def strokes(reach: float) -> Floats:
    """To and fro at constant speed, 1 s each way."""
    return reach * (np.abs((TIME % 2.0) - 1.0) - 0.5) * 2.0


def impacts(reference: Floats, distance: float, seed: int = 1) -> Floats:
    """An error with an impact at a distance after each reversal."""
    error = 1e-4 * np.random.default_rng(seed).standard_normal(len(reference))
    for second in range(6):
        begin = 1000 * second
        way = np.abs(reference[begin : begin + 1000] - reference[begin])
        hit = begin + int(np.argmax(way >= distance))
        error[hit : hit + 15] += 5e-3
    return error


def test_a_loop_that_swings_ever_wider() -> None:
    growing = 1e-5 * np.exp(1.2 * TIME) * np.sin(2 * np.pi * 60 * TIME)
    assert "oscillates by itself at 60 Hz" in explained(
        recording(strokes(0.5), growing), AXIS, baseline=False
    )


def test_a_loop_that_runs_away_within_forty_cycles_of_the_first_motion() -> None:
    time = TIME[:41]
    error = 2e-4 * np.exp(80.0 * time) * np.sin(2 * np.pi * 90 * time)
    assert "oscillates by itself" in explained(recording(0.01 * TIME[:41], error), AXIS, baseline=True)


def test_an_axis_that_never_broke_away() -> None:
    reference = 0.1 * TIME[:119] ** 2 / 0.0142
    stuck = recording(reference, 0.95 * reference)
    assert "not broken away" in explained(stuck, AXIS, baseline=True)
    assert explained(stuck, AXIS, baseline=False) == ""


@pytest.mark.parametrize("gap", [0.25, 0.5])
def test_a_gap_is_struck_at_the_same_distance_after_each_reversal(gap: float) -> None:
    reference = strokes(0.4)
    struck = recording(reference, impacts(reference, gap))
    assert gap_of(struck, 0.2) == pytest.approx(gap, rel=0.05)
    assert "backlash" in explained(struck, AXIS, baseline=False)


def test_a_gap_inside_the_benchmark_is_no_reason_to_refuse() -> None:
    reference = strokes(0.4)
    assert explained(recording(reference, impacts(reference, 0.1)), AXIS, baseline=False) == ""


def test_a_blow_at_one_place_is_something_in_the_way() -> None:
    reference = strokes(0.4)
    error = 1e-4 * np.random.default_rng(2).standard_normal(len(reference))
    error[-12:] += np.linspace(0.0, 2e-2, 12)
    assert explained(recording(reference, error), AXIS, baseline=False) == ""


def test_blows_in_one_direction_only_are_no_gap() -> None:
    reference = strokes(0.4)
    error = impacts(reference, 0.25)
    upwards = np.diff(reference, append=reference[-1]) > 0
    error[upwards] = 1e-4
    assert gap_of(recording(reference, error), 0.2) is None


def test_friction_that_turns_round_slowly_is_no_gap() -> None:
    """Presliding may reach far beyond a small benchmark: a long tail of the reversal's error, no impact."""
    reference = strokes(0.4)
    way = np.abs(reference - np.repeat(reference[::1000], 1000))
    error = 5e-3 * np.exp(-way / 0.02) + 1e-5 * np.random.default_rng(4).standard_normal(len(TIME))
    assert gap_of(recording(reference, error), 0.02) is None


def test_what_is_no_number_explains_nothing() -> None:
    error = np.full(len(TIME), np.nan)
    assert explained(recording(strokes(0.4), error), AXIS, baseline=True) == ""


def test_a_load_that_changed_while_the_axis_moved_is_told() -> None:
    """Somebody leans on the table; a load that is always the same, or turns with the axis, is none."""
    position = 0.5 * np.sin(2 * np.pi * TIME)
    slide = 0.3 * np.sign(np.cos(2 * np.pi * TIME))
    leaning = 0.2 * np.sin(2 * np.pi * TIME / 8.0)
    time = np.arange(12000) * 1e-3
    columns = {name: np.tile(values, 2) for name, values in (("position", position), ("torque", slide))}
    for load, told in (
        (np.tile(leaning, 2), True),
        (0.4 + 0.0 * time, False),
        (0.05 * columns["position"], False),
    ):
        seen = Recording.from_columns(
            {"time": time, "reference": columns["position"], **columns, "torque": columns["torque"] + load},
            Metadata(sample_period=1e-3),
        )
        assert ("load changes" in explained(seen, AXIS, baseline=False)) is told
