"""A course that one experiment alone shows: its way there tells the way back."""

from types import SimpleNamespace

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.diagnosis.candidates import course_predicts, predicts_better
from autotune.estimation.cross_validation import held_out, there_and_back, where_others_tell
from autotune.estimation.policy import POLICY

PERIOD, PASSES = 0.005, 4
ORDER = 9


def _axis(reaches: tuple[float, ...]) -> SimpleNamespace:
    """Experiments of triangles over so much of the travel each, one fold each."""
    places, ways, folds = [], [], []
    for number, reach in enumerate(reaches):
        leg = np.linspace(-reach, reach, int(2.0 / PERIOD))
        for turn in range(PASSES):
            places.append(leg if turn % 2 == 0 else leg[::-1])
            ways.append(np.full(len(leg), 1.0 if turn % 2 == 0 else -1.0))
            folds.append(np.full(len(leg), number))
    velocity, fold = np.concatenate(ways), np.concatenate(folds)
    data = SimpleNamespace(
        velocity=velocity,
        grid=slice(None),
        folds=fold,
        second=200,
        role=lambda *_: np.ones(len(fold), dtype=bool),
    )
    return SimpleNamespace(
        data=data, place=np.concatenate(places), training=np.ones(len(fold)), policy=POLICY, has_veto=False
    )


def _smooth(place: Floats) -> Floats:
    """A course of so many coefficients, each of which all of its places tell."""
    return np.polynomial.chebyshev.chebvander(place, ORDER)


def _fitted(problem: SimpleNamespace, torque: Floats, columns: Floats) -> SimpleNamespace:
    left = torque - columns @ np.linalg.lstsq(columns, torque, rcond=None)[0]
    fitted = SimpleNamespace(error=left, jacobian=columns, cost=float(np.mean(left**2)))
    return SimpleNamespace(fitted=fitted, unseen=held_out(problem, left, columns))


def _both(problem: SimpleNamespace, torque: Floats) -> tuple[SimpleNamespace, SimpleNamespace]:
    """A model with friction of one size, and one with a free course of it over the place."""
    way = problem.data.velocity[:, None]
    return _fitted(problem, torque, way), _fitted(problem, torque, way * _smooth(problem.place))


def _noise(problem: SimpleNamespace) -> Floats:
    return 0.2 * np.random.default_rng(20261128).standard_normal(len(problem.place))


def test_what_one_experiment_alone_reaches_is_told_by_its_way_back() -> None:
    problem = _axis((0.3, 0.4, 1.0))
    torque = problem.data.velocity * (1.0 + 0.3 * np.sin(4.0 * problem.place)) + _noise(problem)
    before, after = _both(problem, torque)
    assert not predicts_better(problem, before, after)  # the ends of the travel are told by no other
    assert course_predicts(problem, before, after)


def test_what_does_not_come_back_is_no_course() -> None:
    """A torque that goes with time: each way has a shape of its own."""
    problem = _axis((0.3, 0.4, 1.0))
    time = np.arange(len(problem.place)) * PERIOD
    torque = problem.data.velocity + 0.3 * np.sin(2.7 * time) + _noise(problem)
    assert not course_predicts(problem, *_both(problem, torque))


def test_where_others_tell_it_the_course_must_err_no_more() -> None:
    """Two experiments over the same travel contradict each other; the course is each one's own."""
    problem = _axis((1.0, 1.0))
    sign = np.where(problem.data.folds == 0, 1.0, -1.0)
    torque = problem.data.velocity * (1.0 + 0.3 * sign * np.sin(4.0 * problem.place)) + _noise(problem)
    before, after = _both(problem, torque)
    first, second = where_others_tell(problem, before.fitted, after.fitted)
    assert second >= first
    assert not course_predicts(problem, before, after)


def test_a_course_of_noise_predicts_nothing() -> None:
    problem = _axis((0.3, 0.4, 1.0))
    assert not course_predicts(problem, *_both(problem, problem.data.velocity + _noise(problem)))


def test_rows_that_their_own_experiment_alone_tells_do_not_count_for_others() -> None:
    problem = _axis((0.3, 1.0))
    torque = problem.data.velocity * (1.0 + 0.3 * np.sin(4.0 * problem.place)) + _noise(problem)
    before, after = _both(problem, torque)
    first, _ = where_others_tell(problem, before.fitted, after.fitted)
    near = np.abs(problem.place) < 0.5
    assert first <= float(np.sum(before.fitted.error[near] ** 2)) * 1.1
    assert there_and_back(problem, after.fitted).total == pytest.approx(
        float(np.sum(after.fitted.error**2)), rel=0.1
    )
