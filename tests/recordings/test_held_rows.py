"""Files with several rows to each cycle of their controller."""

from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from autotune.estimation.bandwidth import prepared_for
from autotune.estimation.controller import find_controller
from autotune.recordings.held_rows import one_row_a_cycle, rows_a_cycle
from autotune.recordings.recording import Metadata, Recording
from tests.estimation.simulated import RESOLUTION, TRUE, recorded

CYCLE = 2e-3


def _oversampled(rows: int) -> Recording:
    """What a scope sees of a loop with that cycle so many times in each: it begins a row before one.

    The torque is still the last cycle's as the next begins.
    """
    loop = recorded(TRUE, period=CYCLE, seconds=12.0)
    places = np.arange(rows * (len(loop) - 1)) / rows
    columns = {
        "time": places * CYCLE,
        "reference": np.repeat(loop["reference"], rows)[: len(places)],
        "position": np.interp(places, np.arange(len(loop)), loop["position"]),
        "torque": np.concatenate([loop["torque"][:1], np.repeat(loop["torque"], rows)])[: len(places)],
    }
    metadata = Metadata(sample_period=CYCLE / rows, position_resolution=RESOLUTION)
    return Recording.from_columns({name: values[1:] for name, values in columns.items()}, metadata, "motion")


@pytest.mark.parametrize("rows", [2, 3, 5])
def test_a_scope_that_is_faster_than_the_loop_is_compared_once_a_cycle(rows: int) -> None:
    scope = _oversampled(rows)
    assert rows_a_cycle(scope["reference"]) == (rows, rows - 1)
    data = prepared_for([scope])
    assert data.period == pytest.approx(CYCLE)
    assert any("one row for each of its cycles" in said for said in data.metadata.remarks)
    law = find_controller(data)
    assert (law.kp, law.kd, law.ki) == pytest.approx((TRUE.kp, TRUE.kd, TRUE.ki), rel=0.01)
    assert law.ticks == 1


def test_rows_of_a_loop_are_left_as_they_are() -> None:
    loop = recorded(TRUE)
    assert one_row_a_cycle(loop) is loop
    assert one_row_a_cycle(loop.rows(slice(0, 60))).period == loop.period  # too few to tell


def test_a_drive_that_works_between_its_set_points_keeps_its_rows() -> None:
    """Its torque changes in each of them."""
    scope = _oversampled(2)
    smooth = np.interp(np.arange(len(scope)), np.arange(0, len(scope), 2), scope["torque"][::2])
    between = replace(scope, floats=MappingProxyType({**scope.floats, "torque": smooth}))
    assert one_row_a_cycle(between) is between


def _of_a_quick_drive(demanded: bool) -> Recording:
    """A drive that works in each row on set points that stand in four of them: they kick its torque when they step."""
    rows, random = 4, np.random.default_rng(20261128)
    time = np.arange(24_000) * 5e-4
    reference = np.repeat(np.sin(3.0 * time[::rows]), rows)
    position = np.round(np.sin(3.0 * (time - 0.004)) / RESOLUTION) * RESOLUTION
    asked = TRUE.kp * (reference - position) - TRUE.kd * np.diff(position, prepend=position[:1])
    noise = np.std(np.diff(asked)) * random.standard_normal(len(time))
    columns = {"time": time, "reference": reference, "position": position, "torque": asked}
    if demanded:
        columns |= {"torque": asked + noise, "torque_command": asked}
    return Recording.from_columns(columns, Metadata(sample_period=5e-4), "motion")


@pytest.mark.parametrize("demanded", [False, True])
def test_a_drive_that_works_oftener_than_its_set_points_come_keeps_its_rows(demanded: bool) -> None:
    """What it asks for answers to each count in between, though it steps most with the set points."""
    drive = _of_a_quick_drive(demanded)
    assert rows_a_cycle(drive["reference"])[0] == 4
    assert one_row_a_cycle(drive) is drive


def test_a_current_loop_that_follows_a_host_does_not_answer_in_between() -> None:
    """What it still does of the last demand is little of the motion's; noise is none of it."""
    scope, random = _oversampled(4), np.random.default_rng(20261128)
    followed = np.array(scope["torque"])
    for row in range(1, len(followed)):
        followed[row] = followed[row - 1] + 0.6 * (scope["torque"][row] - followed[row - 1])
    followed += 0.2 * np.std(np.diff(followed)) * random.standard_normal(len(followed))
    slow = replace(scope, floats=MappingProxyType({**scope.floats, "torque": followed}))
    assert one_row_a_cycle(slow).period == pytest.approx(CYCLE)
