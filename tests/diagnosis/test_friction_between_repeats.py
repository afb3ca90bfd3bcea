"""A friction level that differs between repeats: of all experiments alike, or of the one that an axis warms in."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.estimation.bandwidth import prepared_to_fit
from autotune.estimation.cross_validation import (
    _level_between,
    _of_drift,
    drift,
    rests_of,
    shared,
    still_explainable,
)
from autotune.estimation.data import TRAINING, Block
from autotune.estimation.least_squares import Fitted, Free
from autotune.estimation.policy import POLICY
from autotune.estimation.problem import Problem, new_problem
from autotune.models import layout
from autotune.models.drive_model import base_model
from autotune.recordings.recording import Recording
from tests.support.axes import NOMINAL

COUNT, EXPERIMENTS = 500, 4
BLOCKS = tuple(Block(f"part {i}", TRAINING, 2 * i * COUNT, 2, COUNT) for i in range(EXPERIMENTS))
COLUMN = np.tile(np.sign(np.sin(np.arange(COUNT) / 30.0)), 2 * EXPERIMENTS)
"""Sensitivity to the level of friction: its sign changes with each stroke."""


def _noise() -> Floats:
    return 0.02 * np.random.default_rng(20261129).standard_normal(len(COLUMN))


def _variance(error: Floats, _: str) -> float:
    return float(np.mean([block.by_repeat(error).var(axis=0, ddof=1).mean() for block in BLOCKS]))


PROBLEM = SimpleNamespace(
    policy=POLICY, data=SimpleNamespace(blocks=BLOCKS), noise_variance=_variance, weight=np.ones(len(COLUMN))
)


def _drifting(levels: tuple[float, ...]) -> Floats:
    """An error in which the last repeat of each experiment has so much more friction than the first."""
    error = _noise()
    for block, level in zip(BLOCKS, levels, strict=True):
        table = block.by_repeat(COLUMN).copy()
        table[0] *= -0.5 * level
        table[1] *= 0.5 * level
        error[block.rows] += table.ravel()
    return error


@pytest.mark.parametrize(
    "levels",
    [(0.1, 0.1, 0.1, 0.1), (0.2, 0.0, 0.0, 0.0), (0.2, 0.0, 0.0, -0.18)],
    ids=["alike", "first", "apart"],
)
def test_what_differs_between_repeats_is_told_of_each_experiment(levels: tuple[float, ...]) -> None:
    """A slope of 500 rows of noise is known to 0.0013; of the first alone it was hidden by the three others."""
    error = _drifting(levels)
    found = _level_between(PROBLEM, error, COLUMN, TRAINING)
    assert found.slopes == pytest.approx(levels, abs=0.006)
    assert found.variance == pytest.approx(0.25 * np.mean(np.square(levels)), rel=0.1)
    assert _of_drift(PROBLEM, error, COLUMN, TRAINING) == pytest.approx(2.0 * found.variance, rel=0.1)


def test_rows_that_do_not_count_tell_of_no_level() -> None:
    """Beside another law of presliding those after reversals do not, and have a level of their own."""
    error = _noise()
    apart = np.zeros(len(COLUMN), dtype=np.bool_)
    for block in BLOCKS:
        block.by_repeat(apart)[:, : COUNT // 2] = True
        table = block.by_repeat(COLUMN)
        block.by_repeat(error)[1, : COUNT // 2] += 0.2 * table[1, : COUNT // 2]
    assert _level_between(PROBLEM, error, COLUMN, TRAINING).variance > 0.0
    sliding = SimpleNamespace(**vars(PROBLEM) | {"weight": 1.0 - apart})
    assert _level_between(sliding, error, COLUMN, TRAINING).variance == 0.0
    none = SimpleNamespace(**vars(PROBLEM) | {"weight": np.zeros(len(COLUMN))})
    assert _level_between(none, error, COLUMN, TRAINING).slopes == (0.0,) * EXPERIMENTS


def test_a_level_of_noise_is_none() -> None:
    found = _level_between(PROBLEM, _noise(), COLUMN, TRAINING)
    assert found.variance == 0.0
    assert not any(found.slopes)


def test_a_part_of_what_differs_in_one_experiment_is_none() -> None:
    """Less than half of what its repeats do not share: what wanders slowly has as much of a level by chance."""
    error = _drifting((0.02, 0.0, 0.0, 0.0))
    assert _level_between(PROBLEM, error, COLUMN, TRAINING).variance == 0.0


def test_without_friction_there_is_no_level() -> None:
    assert _level_between(PROBLEM, _noise(), None, TRAINING).slopes == ()
    assert _of_drift(PROBLEM, _noise(), None, TRAINING) == 0.0


@pytest.mark.parametrize("repeats", [2, 3, 5])
def test_a_level_that_drifts_is_told_as_large_as_it_is_however_often_a_motion_was_played(
    short: Recording, repeats: int
) -> None:
    """Of three repeats half as much again was told as there was, more than the whole error; of five twice as much."""
    problem, column = _played(short, repeats)
    drifted = np.zeros_like(column)
    for block in problem.data.blocks:
        drifted[block.rows] = _rising(block, column)
    fitted = _fitted(_few_noise(column) + drifted, column)
    correction, made = problem.correction(fitted.packed), problem.mean_square(drifted, TRAINING)
    assert drift(problem, fitted, correction, TRAINING)[0] == pytest.approx(made, rel=0.05)
    assert still_explainable(problem, fitted, correction, TRAINING) == pytest.approx(made, rel=0.05)
    assert shared(problem, fitted, correction) == pytest.approx(made, rel=0.05)


def test_a_stretch_that_differs_where_repeats_begin_is_no_level_that_drifts(short: Recording) -> None:
    """How far a bristle is stretched at a rest is forgotten on its reach; a transmission's share fell to a third."""
    problem, column = _played(short, 2)
    error, soft = _few_noise(column), base_model({**NOMINAL, "stiffness": 0.01 * NOMINAL["stiffness"]}).pack()
    _, left = rests_of(problem, soft)
    for block in problem.data.blocks:
        error[block.rows] += _rising(block, np.nan_to_num(left) * column)
    assert _level_between(problem, error, column, TRAINING).variance > 0.0
    fitted = replace(_fitted(error, column), packed=soft)
    assert drift(problem, fitted, problem.correction(soft), TRAINING)[0] == 0.0


def _played(short: Recording, repeats: int) -> tuple[Problem, Floats]:
    """The training of a recording as if each of its motions had been played so often, and the sign of its velocity."""
    data = prepared_to_fit([short])
    blocks = tuple(
        replace(one, repeats=repeats, count=2 * one.count // repeats)
        for one in data.blocks
        if one.role == TRAINING
    )
    column = np.sign(data.velocity[data.grid])
    for block in blocks:
        column[block.rows] = np.tile(block.by_repeat(column)[0], block.repeats)
    return new_problem(replace(data, blocks=blocks), None), column


def _rising(block: Block, column: Floats) -> Floats:
    """What a level makes that rises by a twentieth from an experiment's first repeat to its last, by a sensitivity."""
    late = np.linspace(-0.5, 0.5, block.repeats)[:, None]
    return np.asarray(0.05 * late * block.by_repeat(column)).ravel()


def _few_noise(column: Floats) -> Floats:
    return 1e-3 * np.random.default_rng(3).standard_normal(len(column))


def _fitted(error: Floats, column: Floats) -> Fitted:
    free = Free("coulomb", layout.COULOMB, 0.0, 1.0, 1.0)
    return Fitted(base_model(NOMINAL).pack(), (free,), error, column[:, None], np.ones(1), 1.0)
