"""A search without slopes, on costs whose minimum is known."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.signals.covariance_search import STALLED, lowest_along_valley
from autotune.signals.pattern_search import Reached

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


def _from(place: Floats, costs_of: Callable[[Floats], Floats], generations: int) -> Reached:
    """A search in steps of a half."""

    def asked(places: Sequence[Floats]) -> Floats:
        return costs_of(np.array(places))

    begun = Reached(place, float(costs_of(place[None])[0]))
    return lowest_along_valley(asked, begun, np.full(len(place), 0.5), 8, generations)


def test_it_comes_to_the_floor_of_a_bowl_and_ends_there() -> None:
    asked = []

    def costs_of(places: Floats) -> Floats:
        asked.append(len(places))
        return _bowl(places)

    search = _from(np.zeros(3), costs_of, 60)
    assert 1.0 <= search.cost < 1.0 + 1e-2
    assert len(asked) < 1 + 60
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


def test_what_comes_no_lower_asks_for_nothing_any_more() -> None:
    asked = []

    def costs_of(places: Floats) -> Floats:
        asked.append(len(places))
        return np.where(places.any(axis=1), 9.0, 1.0)

    assert _from(np.zeros(3), costs_of, 60).cost == 1.0
    assert asked == [1] + [8] * (STALLED + 1)


def test_the_same_question_has_the_same_answer() -> None:
    one, other = (_from(np.zeros(3), _bowl, 6) for _ in range(2))
    assert one.cost == other.cost
    np.testing.assert_array_equal(one.place, other.place)
