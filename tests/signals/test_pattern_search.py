"""A search without slopes, on costs whose minimum is known."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.signals.pattern_search import lowest_by_parabolas

FLOOR = np.array([1.0, -2.0, 0.5])


def _bowl(places: Floats) -> Floats:
    """A quadratic form whose axes are not the coordinates'."""
    off = places - FLOOR
    form = np.array([[2.0, 0.8, 0.0], [0.8, 1.0, 0.3], [0.0, 0.3, 0.5]])
    return 1.0 + np.einsum("ki,ij,kj->k", off, form, off)


def test_it_comes_near_the_floor_of_a_bowl() -> None:
    place, cost = lowest_by_parabolas(_bowl, np.zeros(3), np.full(3, 0.5), rounds=20)
    assert 1.0 <= cost < 1.02
    assert place == pytest.approx(FLOOR, abs=0.2)


def test_ripples_narrower_than_a_step_do_not_stop_it() -> None:
    def rough(places: Floats) -> Floats:
        return _bowl(places) + 0.05 * np.sin(40.0 * places).sum(axis=1)

    _, cost = lowest_by_parabolas(rough, np.zeros(3), np.full(3, 0.5), rounds=20)
    assert cost < 1.1 < rough(np.zeros((1, 3)))[0]


def test_it_never_ends_higher_than_it_began_nor_where_there_is_nothing() -> None:
    def walled(places: Floats) -> Floats:
        return np.where(places[:, 0] > 0.2, np.inf, _bowl(places))

    place, cost = lowest_by_parabolas(walled, np.zeros(3), np.full(3, 0.5), rounds=10)
    assert place[0] <= 0.2
    assert cost <= _bowl(np.zeros((1, 3)))[0]


def test_no_round_is_a_look_at_the_start() -> None:
    asked: list[int] = []

    def counted(places: Floats) -> Floats:
        asked.append(len(places))
        return _bowl(places)

    place, _ = lowest_by_parabolas(counted, np.zeros(3), np.full(3, 0.5), rounds=0)
    assert asked == [1]
    assert not place.any()
