"""A search without slopes, on costs whose minimum is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.signals.covariance_search import STALLED, Asked, Search, led_down

FLOOR = np.array([1.0, -2.0, 0.5])


def _bowl(places: Floats) -> Floats:
    """A quadratic form whose axes are not the coordinates'."""
    off = places - FLOOR
    form = np.array([[2.0, 0.8, 0.0], [0.8, 1.0, 0.3], [0.0, 0.3, 0.5]])
    return 1.0 + np.einsum("ki,ij,kj->k", off, form, off)


def _banana(places: Floats) -> Floats:
    """A valley that is narrow and bent, 1 at its floor in (1, 1)."""
    x, y = places.T
    return 1.0 + (1.0 - x) ** 2 + 100.0 * (y - x**2) ** 2


def _from(place: Floats, costs_of: Callable[[Floats], Floats], generations: int) -> Search:
    """A search in steps of a half."""

    def asked(places: Asked) -> Floats:
        return costs_of(np.array([at for _, at in places]))

    search = Search(place, float(costs_of(place[None])[0]), np.full(len(place), 0.5), 8)
    led_down(asked, [search], generations)
    return search


def test_it_comes_to_the_floor_of_a_bowl_and_ends_there() -> None:
    search = _from(np.zeros(3), _bowl, 60)
    assert 1.0 <= search.cost < 1.0 + 1e-2
    assert search.ended
    assert search.place == pytest.approx(FLOOR, abs=0.15)


def test_it_follows_a_narrow_valley_round_its_bend() -> None:
    """Steps along the coordinates alone stop on its slopes."""
    search = _from(np.array([-1.0, 1.0]), _banana, 60)
    assert search.cost < 1.05
    assert search.place == pytest.approx([1.0, 1.0], abs=0.5)


def test_ripples_narrower_than_a_step_do_not_stop_it() -> None:
    def rough(places: Floats) -> Floats:
        return _bowl(places) + 0.05 * np.sin(40.0 * places).sum(axis=1)

    assert _from(np.zeros(3), rough, 40).cost < 1.1 < rough(np.zeros((1, 3)))[0]


def test_it_never_ends_higher_than_it_began_nor_where_there_is_nothing() -> None:
    def walled(places: Floats) -> Floats:
        return np.where(places[:, 0] > 0.2, np.inf, _bowl(places))

    search = _from(np.zeros(3), walled, 20)
    assert search.place[0] <= 0.2
    assert search.cost <= _bowl(np.zeros((1, 3)))[0]
    nowhere = _from(np.zeros(3), lambda places: np.where(places.any(axis=1), np.inf, 1.0), 3)
    assert not nowhere.place.any()


def test_no_generation_is_the_start() -> None:
    assert not _from(np.zeros(3), _bowl, 0).place.any()


def test_searches_side_by_side_go_where_each_goes_alone_and_go_on_where_they_stopped() -> None:
    """Two generations and then four are six; what has ended asks for nothing any more."""
    asked: list[list[int]] = []

    def costs_of(places: Asked) -> Floats:
        asked.append([number for number, _ in places])
        return np.array([float(_bowl(place[None])[0]) for _, place in places])

    def begun() -> list[Search]:
        starts = np.zeros(3), np.array([1.0, -2.0, 0.6])
        steps = np.full(3, 0.5), np.full(3, 0.1)
        return [Search(s, float(_bowl(s[None])[0]), by, 4) for s, by in zip(starts, steps, strict=True)]

    together, alone = begun(), begun()
    led_down(costs_of, together, 2)
    led_down(costs_of, together, 4)
    for one, other in zip(together, alone, strict=True):
        led_down(costs_of, [other], 6)
        assert one.cost == other.cost
        np.testing.assert_array_equal(one.place, other.place)
    assert asked[0] == [0] * 4 + [1] * 4
    (there,) = begun()[1:]
    led_down(lambda places: np.ones(len(places)) * 9.0, [there], STALLED + 1)
    asked.clear()
    led_down(costs_of, [there], 5)
    assert there.ended
    assert not asked
