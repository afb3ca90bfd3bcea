"""Friction reduced to a table over velocity: what it plays, what it loses, what does not go in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from autotune.control.closed_loop import steady_error
from autotune.control.feedforward import FixedFeedforward, LugreParameters, stribeck_level
from autotune.control.reduction import DrivePart, Reduction, Remainder, reduce
from autotune.control.refinement import PeriodAverage, periodic_feedforward
from autotune.control.velocity_table import Points, TableBlock, is_point
from autotune.core.errors import ConfigurationError
from autotune.core.friction_table import in_words
from tests.control.test_reduction import PROVED, REFERENCE, STIFF, measured

BLOCK = TableBlock(6, 400.0, 1.5, 1e-5, 5e-4)
TOP = 20.0
STRIBECK = replace(PROVED, break_away=1.4 * PROVED.coulomb, stribeck_velocity=0.3)


def held(block: TableBlock) -> dict[str, float]:
    names = {
        f"feedforward.friction_table.{s}.{k}": 0.0
        for s in ("velocity", "torque")
        for k in range(block.points)
    }
    return names | {
        "friction_table.largest_velocity": block.largest_velocity,
        "friction_table.largest_torque": block.largest_torque,
        "friction_table.velocity_step": block.velocity_step,
        "friction_table.torque_step": block.torque_step,
    }


def as_measured(full: LugreParameters) -> PeriodAverage:
    """The benchmark with the full feedforward in force, on an axis that is as the model says."""
    applied = periodic_feedforward(full, REFERENCE, 1e-3)
    error = steady_error(full, STIFF, REFERENCE, applied, 1e-3, 1.34)
    return PeriodAverage(REFERENCE, error, np.zeros(len(REFERENCE)), applied, 1e-3, 6)


def test_a_block_is_what_the_drive_says() -> None:
    assert TableBlock.of(held(BLOCK)) == BLOCK
    assert TableBlock.of({"feedforward.inertia": 0.0}) is None
    assert is_point("feedforward.friction_table.torque.3")
    assert in_words(["inertia", "friction_table.torque.0", "friction_table.velocity.0"]) == [
        "friction_table",
        "inertia",
    ]


@pytest.mark.parametrize("full", [PROVED, STRIBECK])
def test_the_points_are_on_the_curve_in_whole_steps(full: LugreParameters) -> None:
    values = BLOCK.filled(full, 0.05, 1.0, TOP)
    points = Points.among(values)
    assert points is not None
    assert points.velocity[0] == points.torque[0] == 0.0
    assert np.all(np.diff(points.velocity) > 0.0)
    assert points.velocity[-1] == pytest.approx(TOP, abs=BLOCK.velocity_step)
    curve = [stribeck_level(full.array(), v) + full.viscous * v for v in points.velocity[1:]]
    assert np.max(np.abs(points.torque[1:] - curve)) <= 0.5001 * BLOCK.torque_step
    for values_of, step in ((points.velocity, BLOCK.velocity_step), (points.torque, BLOCK.torque_step)):
        assert np.allclose(values_of / step, np.round(values_of / step), atol=1e-6)
    assert points.at(-3.0) == -points.at(3.0)
    assert points.at(1e3) == points.torque[-1]


@pytest.mark.slow
def test_what_is_predicted_is_then_measured_on_the_simulated_axis() -> None:
    whole, controller = measured(FixedFeedforward(PROVED, 1e-3), 3)
    before, _ = measured(None, 3)
    names = {"inertia", "offset", *held(BLOCK)}
    found = reduce(PROVED, names, whole, controller, 1.34, BLOCK, TOP)
    assert (found.host, found.note) == ((), "")
    assert set(found.values) == {"inertia", "offset", *(name for name in found.values if is_point(name))}
    after, _ = measured(DrivePart(found.values, 1e-3), 3)
    assert after.peak_error < 0.8 * before.peak_error
    # as near as the kinetic reduction is asked to be
    assert found.predicted_peak == pytest.approx(after.peak_error, rel=0.25)
    assert found.predicted_rms == pytest.approx(float(np.sqrt(np.mean(after.error**2))), rel=0.15)
    assert found.predicted_loss > 0.0


@pytest.mark.slow
def test_a_table_is_better_than_coulomb_friction_where_friction_falls_with_speed() -> None:
    table = reduce(STRIBECK, {"inertia", *held(BLOCK)}, as_measured(STRIBECK), STIFF, 1.34, BLOCK, TOP)
    coulomb = reduce(STRIBECK, {"inertia", "viscous", "coulomb"}, as_measured(STRIBECK), STIFF, 1.34)
    assert table.predicted_rms < coulomb.predicted_rms


def test_the_law_of_the_drives_part_plays_the_table_and_the_host_the_rest() -> None:
    values = {"inertia": PROVED.inertia, **BLOCK.filled(PROVED, 0.05, 0.8, TOP)}
    points = Points.among(values)
    assert points is not None
    part, rest, whole = (
        DrivePart(values, 1e-3),
        Remainder(FixedFeedforward(PROVED, 1e-3), values, 1e-3),
        FixedFeedforward(PROVED, 1e-3),
    )
    for velocity, acceleration in ((0.3, 2.0), (-0.02, 1.0), (0.0, 0.0)):
        own = part.step(0.0, velocity, acceleration, None)
        assert own == pytest.approx(float(points.at(velocity)) + PROVED.inertia * acceleration)
        assert rest.step(0.0, velocity, acceleration, None) + own == pytest.approx(
            whole.step(0.0, velocity, acceleration, None)
        )


@pytest.mark.parametrize(
    ("block", "words"),
    [
        (replace(BLOCK, largest_torque=0.2), "overflows"),
        (replace(BLOCK, torque_step=0.1), "has steps of 0.1"),
    ],
)
def test_a_table_that_cannot_hold_it_is_refused_in_words(block: TableBlock, words: str) -> None:
    found = reduce(PROVED, {"inertia", *held(block)}, as_measured(PROVED), STIFF, 1.34, block, TOP)
    assert words in found.note
    assert Reduction.from_json(found.as_json()) == found
    assert "coulomb" in found.host
    assert set(found.values) == {"inertia"}
    with pytest.raises(ConfigurationError, match=words):
        reduce(PROVED, set(held(block)), as_measured(PROVED), STIFF, 1.34, block, TOP)


def test_steps_too_coarse_for_increasing_points_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="too coarse"):
        replace(BLOCK, velocity_step=1.0).filled(PROVED, 0.01, 1.0, TOP)
