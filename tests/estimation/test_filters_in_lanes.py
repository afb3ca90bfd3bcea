"""Filters of several motions at once: the same numbers as one after the other."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.estimation.residual import motions_in_lanes
from autotune.signals.filters import motion

SPANS = ([(0, 3000)], [(10, 60), (100, 1500), (1600, 2900)])


@pytest.mark.parametrize("count", [2, 8])
@pytest.mark.parametrize("spans", SPANS)
def test_eight_motions_have_the_numbers_of_one(count: int, spans: list[tuple[int, int]]) -> None:
    positions = np.cumsum(np.random.default_rng(7).normal(size=(count, 3000)), axis=1)
    together = motions_in_lanes(list(positions), 1e-3, 40.0, spans)
    assert together is not None
    for alone, found in zip(motion(positions, 1e-3, 40.0, spans), together, strict=True):
        assert np.array_equal(found[:count], alone)
        assert np.array_equal(found[count:], np.repeat(alone[-1:], 8 - count, axis=0))


def test_what_is_not_filtered_is_left_to_the_other_routine() -> None:
    positions = [np.zeros(100), np.ones(100)]
    assert motions_in_lanes(positions, 1e-3, 450.0, [(0, 100)]) is None
    assert motions_in_lanes(positions, 1e-3, 40.0, [(0, 50), (60, 63)]) is None
