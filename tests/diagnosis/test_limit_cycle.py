"""An axis that hunts, told by what its repeats do not share, and a twin that hunts as it does."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from autotune.diagnosis.evidence import repeated
from autotune.estimation.data import TRAINING, Block

COUNT, BLOCKS = 400, 4
"""Rows of a repeat, and experiments: four, one after the other, twice."""


def _problem() -> SimpleNamespace:
    """Grid rows go through each experiment's repeats; the samples run through a round of all."""
    rounds = np.arange(2)[None, :, None] * BLOCKS * COUNT
    samples = np.arange(BLOCKS)[:, None, None] * COUNT + rounds + np.arange(COUNT)[None, None, :]
    blocks = tuple(Block(f"part {i}", TRAINING, i * 2 * COUNT, 2, COUNT) for i in range(BLOCKS))
    return SimpleNamespace(data=SimpleNamespace(blocks=blocks, grid=samples.ravel(), period=0.001))


def _hunting(hertz: float, level: float) -> np.ndarray:
    """A torque that hunts with this rms, in another phase in the second repeat, and a little noise; rows of 1 ms."""
    clock = np.arange(2 * BLOCKS * COUNT) * 0.001
    phase = np.where(clock < BLOCKS * COUNT * 0.001, 0.0, 2.0)
    noise = 0.01 * np.random.default_rng(3).standard_normal(len(clock))
    return math.sqrt(2.0) * level * np.sin(2.0 * np.pi * hertz * clock + phase) + noise


@pytest.mark.parametrize(
    ("level", "coulomb", "loud", "told"),
    [(2.0, 1.0, 0.0, True), (0.5, 1.0, 0.0, False), (0.5, 0.0, 20.0, False), (0.0, 0.0, 0.0, False)],
    ids=["more than friction", "less than friction", "hum beside much torque, no friction", "noise"],
)
def test_a_limit_cycle_is_told_where_it_outweighs_friction(
    level: float, coulomb: float, loud: float, told: bool
) -> None:
    """Its level is that of a sine, amplitude over the root of two; its phase is another in the second repeat."""
    problem = _problem()
    hum = _hunting(105.0, level)
    motion = loud * np.sign(np.sin(2.0 * np.pi * np.arange(len(hum)) / COUNT))
    problem.data.torque = hum + motion
    assert repeated.limit_cycle(problem, coulomb) == (pytest.approx(105.0, abs=2.5) if told else 0.0)


@pytest.mark.parametrize(
    ("hertz", "times", "stable", "alike"),
    [
        (105.0, 1.0, True, True),
        (108.0, 1.3, True, True),
        (118.0, 1.0, True, False),
        (105.0, 0.5, True, False),
        (105.0, 2.0, True, False),
        (105.0, 0.0, True, False),
        (105.0, 1.0, False, False),
    ],
    ids=["the same", "near", "elsewhere", "fainter", "louder", "quiet", "unstable"],
)
def test_a_twin_hunts_alike_at_the_frequency_and_with_the_torque_of_the_axis(
    monkeypatch: pytest.MonkeyPatch, hertz: float, times: float, stable: bool, alike: bool
) -> None:
    problem = _problem()
    problem.data.torque = _hunting(105.0, 2.0)
    problem.twin, problem.controller, problem.disturbance = True, object(), None
    run = SimpleNamespace(torque=_hunting(hertz, times * 2.0), stable=stable)
    monkeypatch.setattr(repeated, "run_twin", lambda *_: run)
    assert repeated.hunts_alike(problem, object()) is alike


def test_a_model_without_a_twin_hunts_like_nothing() -> None:
    problem = _problem()
    problem.twin = False
    assert not repeated.hunts_alike(problem, object())
