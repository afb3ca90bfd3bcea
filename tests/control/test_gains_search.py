"""The search begins wherever margins bind, compares on the same axes, and gives up only on what is clearly slower."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from autotune.control.gains import search
from autotune.control.gains.judge import Task
from autotune.control.gains.loop import Gains, LoopTiming
from autotune.control.gains.members import drawn, family
from autotune.control.gains.requirements import Requirements, corners_of
from autotune.control.gains.search import (
    Point,
    apart,
    begun,
    edges_of,
    highest_kept,
    later,
    polished,
    searched,
    slower,
)
from autotune.control.gains.steps import HORIZON, step_sizes
from autotune.core.arrays import Floats
from autotune.models.drive_model import base_model
from tests.control.gains_axis import TIMING, expected_settling, vertical

ANY = Gains(1.0, 1.0, 1.0)


def test_the_highest_crossover_of_a_shape_is_where_the_margins_end() -> None:
    def missed(point: Floats) -> float:
        return max(0.0, float(point[0]) - 2.3 + 0.5 * float(point[1]))

    rungs = np.linspace(5.0, 0.0, 21)
    found = highest_kept(missed, np.array([1.0, 0.7]), rungs)
    assert found is not None
    assert 1.8 - 0.25 / 8 <= found[0] <= 1.8  # a rung is 0.25, halved three times
    assert found[1:] == pytest.approx([1.0, 0.7])
    assert highest_kept(missed, np.array([9.0, 0.7]), rungs) is None
    top = highest_kept(lambda point: 0.0, np.array([1.0, 0.7]), rungs)
    assert top is not None
    assert top[0] == pytest.approx(5.0)


def test_of_each_neighbourhood_the_best_is_kept() -> None:
    costs = {(0.0, 0.0, 0.0): 1.0, (0.1, 0.0, 0.0): 1.1, (1.0, 0.0, 0.0): 1.2, (0.0, 2.0, 0.0): 1.3}
    ranked = [Point(np.array(place), cost) for place, cost in costs.items()]
    assert [one.cost for one in apart(ranked, 0.3, 5)] == [1.0, 1.2, 1.3]
    assert [one.cost for one in apart(ranked, 0.3, 2)] == [1.0, 1.2]
    assert apart([], 0.3, 2) == []


def test_the_end_of_the_search_is_taken_on_and_never_worse() -> None:
    def cost(point: Floats) -> float:
        kept = point[0] + point[1] <= 1.0
        return float(3.0 - point[0] - 2.0 * point[1] + (point[2] - 1.0) ** 2) if kept else 100.0

    edges = np.array([(0.0, 1.0), (0.0, 0.8), (0.0, 2.0)])
    start = Point(np.array([0.2, 0.5, 0.8]), cost(np.array([0.2, 0.5, 0.8])))
    found = polished(cost, start, edges)
    assert found.cost < start.cost - 0.3
    assert found.cost == pytest.approx(cost(found.place))
    best = Point(np.array([0.2, 0.8, 1.0]), 1.2)
    assert polished(lambda point: 50.0, best, edges) is best


def test_only_what_is_clearly_slower_on_the_same_axes_is_given_up() -> None:
    best = np.array([1.0, 2.0, 1.5, 1.2])
    assert not slower(np.array([9.0]), np.empty(0))
    assert not slower(best[:1] * 1.9, best[:1])
    assert slower(best[:1] * 2.1, best[:1])
    assert slower(best + 0.05 + 0.01 * np.array([1.0, -1.0, 1.0, -1.0]), best)  # little, but each time
    assert not slower(best + np.array([0.9, -0.3, 0.6, -0.2]), best)  # more, by chance
    assert not slower(best, best)


def test_of_two_steps_the_later_counts_with_a_little_of_the_other() -> None:
    assert later(np.array([[0.2, 0.1], [0.1, 0.4]])) == pytest.approx([0.21, 0.41])
    assert later(np.array([[0.2]])) == pytest.approx([0.22])


@pytest.mark.slow(2)
def test_the_search_begins_on_the_edge_of_the_margins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "SHAPES", 16)
    monkeypatch.setattr(search, "POPULATION", 12)
    monkeypatch.setattr(search, "SOUGHT", (2, 31))
    model = vertical()
    kin = family(model, TIMING)
    task = Task(step_sizes(model, TIMING, 0.2), 1.26)
    trial = search._Trial(kin, corners_of(kin), task, ANY, Requirements())
    points = begun(trial, edges_of(TIMING.period, None))
    assert points.shape == (12, 3)
    rung = np.log(500.0 / 2.0) / (search.RUNGS - 1)
    for point in points[:9]:
        assert trial.missed(point) == 0.0
        assert trial.missed(point + np.array([rung, 0.0, 0.0])) > 0.0
    assert np.ptp(points[:9, 1]) > 1.0  # in more than one place
    assert np.ptp(points[:9, 2]) > 1.0


LATE = {
    "inertia": 1.8e-3, "viscous": 2.4e-3, "coulomb": 1.4, "stiffness": 166.0, "micro_damping": 0.52, "offset": -0.1,
    "break_away": 1.36, "stribeck_velocity": 0.084,
}  # fmt: skip


@pytest.mark.slow(3)
def test_a_step_that_only_the_integral_brings_home_gets_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Three cycles late, stiff at rest: beside a broad valley with hardly an integral lies a narrow one, with ten
    times as much, in which steps arrive in three quarters of the time."""
    for name, value in {
        "SHAPES": 64,
        "POPULATION": 16,
        "GENERATIONS": 2,
        "POLISHED": 10,
        "VALLEYS": 1,
    }.items():
        monkeypatch.setattr(search, name, value)
    monkeypatch.setattr(search, "SOUGHT", (4, 31))
    model = base_model(LATE, {name: 0.005 * abs(value) for name, value in LATE.items()})
    timing = LoopTiming(1e-3, 2.1e-4, 5.96, 3.2e-3, 3e-4, 0.8, 0.015)
    task = Task(step_sizes(model, timing, 0.17), 1.7)
    kin = family(model, timing)
    found = searched(kin, corners_of(kin), task, ANY, None, Requirements())
    assert found is not None
    assert found.ki > 300.0
    others = drawn(model, timing, 8, 5)
    weak = replace(found, kp=6.6, kd=0.172, ki=70.0)
    arrives, later_on = (expected_settling(others, one, task.steps.small) for one in (found, weak))
    assert arrives < 0.85 * later_on < HORIZON
