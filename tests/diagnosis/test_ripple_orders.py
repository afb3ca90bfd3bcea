"""Ripple orders found at the resolution of the travel, whole or not."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from autotune.core.arrays import Floats, Integers
from autotune.diagnosis.ripple_orders import candidate_orders, find_orders
from autotune.estimation.data import prepare
from autotune.estimation.problem import Problem, new_problem
from tests.support.axes import plain_axis
from tests.support.diagnosis_programme import play, programme


@dataclass(frozen=True)
class _Rest:
    """A residual with an offset taken out."""

    rows: Integers
    basis: Floats
    error: Floats


@pytest.fixture(scope="module")
def problem() -> Problem:
    """Scans over one and a half turns."""
    return new_problem(prepare([play(plain_axis(3), 3, programme(("scans",)))]), None)


def _rest(problem: Problem, waves: tuple[tuple[float, float], ...], noise: float = 1e-3) -> _Rest:
    slow = np.abs(problem.data.velocity[problem.data.grid]) < 3.0  # nothing that the low-pass would take
    rows = np.flatnonzero((problem.training > 0) & slow)
    place = problem.data.position[problem.data.grid[rows]]
    error = np.random.default_rng(2).normal(0.0, noise, len(rows))
    for order, size in waves:
        error += size * np.sin(order * place + order)
    basis = np.full((len(rows), 1), len(rows) ** -0.5)
    return _Rest(rows, basis, error - error.mean())


@pytest.mark.parametrize("waves", [((20.64, 10e-3), (22.72, 5e-3)), ((17.01, 30e-3), (35.64, 15e-3))])
def test_orders_that_are_no_whole_numbers_are_found(problem, waves) -> None:
    """Over 1.5 turns: a twentieth of an order is a fifteenth of what such a travel tells apart."""
    found = find_orders(problem, _rest(problem, waves), 1.0, [], 7)
    assert found[:2] == pytest.approx([order for order, _ in waves], abs=0.05)
    assert len(found) == 2


def test_waves_of_thousands_a_turn_are_found_over_little_travel(problem) -> None:
    """Behind a gear: narrow humps, of which all but the first wave are above 400 a turn."""
    rest = _rest(problem, ())
    little = problem.data.position * (0.15 / problem.scales.travel)
    data = replace(
        problem.data, position=little, velocity=problem.data.velocity * (0.15 / problem.scales.travel)
    )
    small = replace(problem, data=data, scales=replace(problem.scales, travel=0.15))
    place = little[problem.data.grid[rest.rows]]
    error = rest.error + 10e-3 * np.exp(2.0 * np.cos(330.0 * place) - 2.0)
    found = find_orders(small, replace(rest, error=error - error.mean()), 1.0, [], 7)
    assert sorted(found)[:3] == pytest.approx([330.0, 660.0, 990.0], rel=0.01)


def test_waves_that_hide_one_another_are_found_beside_each_other(problem) -> None:
    """Two as strong as each other, 1.4 of what the travel tells apart from each other, and a third further off."""
    waves = ((20.3, 10e-3), (21.2, 9e-3), (47.6, 7e-3))
    found = find_orders(problem, _rest(problem, waves), 1.0, [], 7)
    assert sorted(found) == pytest.approx([order for order, _ in waves], abs=0.05)


@pytest.mark.parametrize("draw", range(10))
def test_waves_that_beat_over_short_strokes_are_told_by_the_few_long_ones(problem, draw) -> None:
    """Nine tenths of the rows lie within half a turn, over which two waves beat nearly once; the rest over seven."""
    waves = ((28.71, 10e-3), (30.37, 6.5e-3), (67.33, 6e-3))
    rest, rng = _rest(problem, ()), np.random.default_rng(draw)
    place = np.linspace(0.0, 2.0 * np.pi * 7.05, len(problem.data.position))
    at = problem.data.grid[rest.rows]
    short = rng.uniform(size=len(at)) < 0.9
    place[at[short]] = 20.0 + rng.uniform(0.0, np.pi, np.count_nonzero(short))
    data = replace(problem.data, position=place, velocity=np.zeros(len(place)))
    long = replace(problem, data=data, scales=replace(problem.scales, travel=float(np.ptp(place))))
    phases = rng.uniform(0.0, 2.0 * np.pi, len(waves))
    error = rest.error + sum(
        size * np.sin(order * place[at] + phase) for (order, size), phase in zip(waves, phases, strict=True)
    )
    found = find_orders(long, replace(rest, error=error - error.mean()), 1.0, [], 7)
    assert sorted(found) == pytest.approx([order for order, _ in waves], abs=0.05)


def _over(problem: Problem, turns: float, waves: tuple[tuple[float, float], ...]) -> list[float]:
    """Orders found where the same motion goes over so many turns."""
    times = turns * 2.0 * np.pi / problem.scales.travel
    data = replace(
        problem.data, position=times * problem.data.position, velocity=times * problem.data.velocity
    )
    wide = replace(problem, data=data, scales=replace(problem.scales, travel=times * problem.scales.travel))
    rest = _rest(problem, ())
    place = data.position[data.grid[rest.rows]]
    error = rest.error + sum(size * np.sin(order * place + order) for order, size in waves)
    return find_orders(wide, replace(rest, error=error - error.mean()), 1.0, [], 7)


@pytest.mark.parametrize(("turns", "waves"), [(40.0, ((1.38, 10e-3), (1.48, 8e-3))), (4.0, ((1.34, 10e-3),))])
def test_waves_of_little_more_than_a_turn_are_no_imbalance_where_the_travel_tells_them_apart(
    problem, turns, waves
) -> None:
    """Over forty turns orders of 1.38 and 1.48 are far from 1, over four 1.34 is 1.4 periods from it."""
    assert sorted(_over(problem, turns, waves)) == pytest.approx([one for one, _ in waves], abs=0.4 / turns)


@pytest.mark.parametrize("turns", [1.6, 2.5, 4.0, 40.0])
def test_one_wave_a_turn_is_the_imbalances(problem, turns) -> None:
    assert _over(problem, turns, ((1.0, 10e-3),)) == []


def test_a_hump_is_no_sum_of_waves(problem) -> None:
    rest = _rest(problem, ())
    place = problem.data.position[problem.data.grid[rest.rows]]
    error = rest.error + 20e-3 * np.exp(-((place - 1.0) ** 2) / 0.5)
    assert find_orders(problem, replace(rest, error=error - error.mean()), 1.0, [], 7) == []


def test_noise_holds_no_orders(problem) -> None:
    assert find_orders(problem, _rest(problem, ()), 1.0, [], 7) == []


def test_a_turn_without_a_period_and_a_half_holds_none(problem) -> None:
    turns = problem.scales.travel / (2 * np.pi)
    assert candidate_orders(problem, 1.0).min() == pytest.approx(1.0 + 0.7 / turns)
    little = replace(problem, scales=replace(problem.scales, travel=0.2))
    assert candidate_orders(little, 1.0).min() >= 1.5 * 2 * np.pi / 0.2 - 1e-9
