"""A search without slopes, on costs whose minimum is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.signals.pattern_search import Asked, Reached, lowest_by_parabolas

FLOOR = np.array([1.0, -2.0, 0.5])


def _bowl(places: Floats) -> Floats:
    """A quadratic form whose axes are not the coordinates'."""
    off = places - FLOOR
    form = np.array([[2.0, 0.8, 0.0], [0.8, 1.0, 0.3], [0.0, 0.3, 0.5]])
    return 1.0 + np.einsum("ki,ij,kj->k", off, form, off)


def _from_nothing(costs_of: Callable[[Floats], Floats], rounds: int) -> Reached:
    """A search from 0 in steps of a half."""

    def asked(places: Asked) -> Floats:
        return costs_of(np.array([place for _, place in places]))

    begun = Reached(np.zeros(3), float(costs_of(np.zeros((1, 3)))[0]))
    (end,) = lowest_by_parabolas(asked, [begun], [np.full(3, 0.5)], rounds)
    return end


def test_it_comes_near_the_floor_of_a_bowl() -> None:
    end = _from_nothing(_bowl, rounds=20)
    assert 1.0 <= end.cost < 1.02
    assert end.ended
    assert end.place == pytest.approx(FLOOR, abs=0.2)


def test_ripples_narrower_than_a_step_do_not_stop_it() -> None:
    def rough(places: Floats) -> Floats:
        return _bowl(places) + 0.05 * np.sin(40.0 * places).sum(axis=1)

    assert _from_nothing(rough, rounds=20).cost < 1.1 < rough(np.zeros((1, 3)))[0]


def test_it_never_ends_higher_than_it_began_nor_where_there_is_nothing() -> None:
    def walled(places: Floats) -> Floats:
        return np.where(places[:, 0] > 0.2, np.inf, _bowl(places))

    end = _from_nothing(walled, rounds=10)
    assert end.place[0] <= 0.2
    assert end.cost <= _bowl(np.zeros((1, 3)))[0]


def test_no_round_is_the_start() -> None:
    assert not _from_nothing(_bowl, rounds=0).place.any()


def test_searches_side_by_side_go_where_each_goes_alone_and_go_on_where_they_stopped() -> None:
    """Two rounds and then four are six; what has ended asks for nothing any more."""
    asked: list[list[int]] = []

    def costs_of(places: Asked) -> Floats:
        asked.append([number for number, _ in places])
        return np.array([float(_bowl(place[None])[0]) for _, place in places])

    starts = [np.zeros(3), np.array([1.0, -2.0, 0.6])]
    begun = [Reached(start, float(_bowl(start[None])[0])) for start in starts]
    steps = [np.full(3, 0.5), np.full(3, 0.1)]
    ends = lowest_by_parabolas(costs_of, lowest_by_parabolas(costs_of, begun, steps, 2), steps, 4)
    for start, step, end in zip(begun, steps, ends, strict=True):
        (alone,) = lowest_by_parabolas(costs_of, [start], [step], 6)
        assert (alone.cost, alone.size) == (end.cost, end.size)
        np.testing.assert_array_equal(alone.place, end.place)
    assert asked[0] == [0] * 6 + [1] * 6
    assert lowest_by_parabolas(costs_of, [Reached(starts[0], 1.0, 0.1)], steps[:1], 5)[0].cost == 1.0
