"""Parts of a recording that fits and their sensitivities are computed on: nothing may be lost by it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from autotune.estimation.data import (
    LEAST_ROWS,
    TRAINING,
    VETO,
    Prepared,
    Stretch,
    first_round,
    prepare,
    until_last,
    until_sample,
)
from autotune.estimation.least_squares import done_alone, done_together, fitting, jacobian, with_values
from autotune.estimation.problem import base_free, new_problem
from autotune.estimation.residual import measured_motion, residual
from autotune.models import layout
from autotune.models.drive_model import base_model
from tests.support.axes import MEDIUM, NOMINAL

SEED = 44
PACKED = base_model(NOMINAL).pack()


@pytest.fixture(scope="module")
def data(recorded) -> Prepared:
    return prepare([recorded(SEED, elastic_transmission=MEDIUM["elastic_transmission"])])


def sensitivities(data: Prepared, on: np.ndarray) -> np.ndarray:
    problem = new_problem(data, None)
    packed = replace(PACKED, on=on)
    free = base_free(packed, problem.scales, "rad")
    return jacobian(data, problem.moved, packed, free, residual(data, packed, problem.moved))[0]


def test_residuals_before_the_end_are_those_of_the_whole(data: Prepared) -> None:
    rows = data.role(TRAINING)
    part = until_last(data, rows)
    assert part.stretches[-1].stop < data.stretches[-1].stop
    whole = residual(data, PACKED, measured_motion(data))
    cut = residual(part, PACKED, measured_motion(data))
    np.testing.assert_array_equal(cut[rows], whole[rows])
    np.testing.assert_array_equal(cut[data.role("test")], 0.0)


@pytest.mark.parametrize("rows", [1, 2, LEAST_ROWS - 1, LEAST_ROWS, LEAST_ROWS + 1])
def test_a_stretch_that_has_just_begun_is_no_shorter_than_any(data: Prepared, rows: int) -> None:
    """A recording with a gap behind every experiment; a twin of a single row has no speed to begin with."""
    start = data.stretches[0].start + 1000
    two = Stretch(data.stretches[0].start, start, True), Stretch(start, data.stretches[0].stop, True)
    apart = replace(data, stretches=two)
    first, begun = until_sample(apart, start + rows, settled=0.0).stretches
    assert first == two[0]
    assert (begun.start, begun.stop) == (start, start + max(rows, LEAST_ROWS))
    assert until_sample(apart, start, settled=0.0).stretches == two[:1]


def test_sensitivities_of_the_first_round_hold_for_the_others(data: Prepared) -> None:
    """What repeats differ by is noise: far less than what the column is."""
    rows = data.role(TRAINING)
    assert first_round(data, PACKED.on).stretches[-1].stop < 0.6 * until_last(data, rows).stretches[-1].stop
    warming = PACKED.on.copy()
    warming[layout.flag("thermal_drift")] = True  # by itself it changes nothing, but every repeat is computed
    copied, own = sensitivities(data, PACKED.on), sensitivities(data, warming)
    first = np.zeros(len(rows), dtype=bool)
    for block in data.blocks:
        first[block.rows] = (np.arange(block.repeats * block.count) < block.count) & (block.role == TRAINING)
    np.testing.assert_allclose(copied[first], own[first], atol=1e-12)
    for column, true in zip(copied[rows].T, own[rows].T, strict=True):
        assert np.sum((column - true) ** 2) < 0.03 * np.sum(true**2)
    np.testing.assert_array_equal(copied[data.role(VETO)], 0.0)


def test_repeats_at_another_place_are_computed_each(data: Prepared) -> None:
    position = data.position.copy()
    for block in data.blocks:
        position[data.grid[block.rows][block.count :]] += 0.5
    elsewhere = replace(data, position=position)
    everything = until_last(elsewhere, elsewhere.role(TRAINING))
    assert first_round(elsewhere, PACKED.on).stretches == everything.stretches


def test_fits_side_by_side_are_those_that_each_would_be_alone(data: Prepared) -> None:
    problem = new_problem(data, None)
    free = base_free(PACKED, problem.scales, "rad")
    none, weight = np.zeros(len(data.grid)), problem.training
    values = PACKED.p[[one.slot for one in free]]
    starts = [
        with_values(PACKED, free[:count], times * values[:count])
        for count, times in ((6, 1.3), (2, 0.7), (4, 1.0))
    ]
    asked = [(start, free[: 6 - 2 * i]) for i, start in enumerate(starts)]

    together = done_together(
        [fitting(data, start, some, none, weight, 3, whole=i > 0) for i, (start, some) in enumerate(asked)],
        problem.moved,
    )

    for i, ((start, some), found) in enumerate(zip(asked, together, strict=True)):
        alone = done_alone(fitting(data, start, some, none, weight, 3, whole=i > 0), problem.moved)
        np.testing.assert_array_equal(found.packed.p, alone.packed.p)
        np.testing.assert_array_equal(found.error, alone.error)
        np.testing.assert_array_equal(found.jacobian, alone.jacobian)
