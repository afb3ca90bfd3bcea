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
