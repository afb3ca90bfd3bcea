"""A torque whose level wanders through a recording: told from what an effect makes of each experiment."""

from types import SimpleNamespace

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.diagnosis.evidence import time_driven
from autotune.diagnosis.evidence.time_driven import without_wander
from autotune.diagnosis.wording import wander_note
from autotune.estimation.data import TRAINING, Block, Wander
from autotune.estimation.policy import POLICY
from autotune.estimation.residual import clockless
from autotune.recordings.recording import Metadata

PERIOD, COUNT, EXPERIMENTS = 0.02, 400, 8
ROWS = 2 * COUNT * EXPERIMENTS


def _problem() -> SimpleNamespace:
    """Eight experiments of eight seconds, each played twice, one play after the other."""
    blocks = tuple(Block(f"part {i}", TRAINING, 2 * i * COUNT, 2, COUNT) for i in range(EXPERIMENTS))
    data = SimpleNamespace(
        blocks=blocks, grid=np.arange(ROWS), period=PERIOD, repeated=True, starts=(0,), wander=None
    )
    return SimpleNamespace(data=data, weight=np.ones(ROWS), policy=POLICY, noise_variance=lambda *_: 0.01)


def _noise() -> Floats:
    return 0.1 * np.random.default_rng(20261128).standard_normal(ROWS)


@pytest.fixture
def _kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        time_driven, "replace", lambda data, **changed: SimpleNamespace(**(vars(data) | changed))
    )
    monkeypatch.setattr(time_driven, "_by_time", lambda problem, packed, data: SimpleNamespace(data=data))


def _walk() -> Floats:
    """A level that goes on: a sensor that warms, and cools a little."""
    time = np.arange(ROWS) * PERIOD
    return 0.4 * np.sin(2.0 * np.pi * 0.6 * time / time[-1])


@pytest.mark.usefixtures("_kept")
def test_a_level_that_goes_on_from_repeat_to_repeat_is_taken_out() -> None:
    found = without_wander(_problem(), None, _walk() + _noise())
    assert found is not None
    told = np.interp(np.arange(ROWS) * PERIOD, found.data.wander.times, found.data.wander.levels)
    inside = slice(COUNT, -COUNT)
    level = _walk() - _walk().mean()
    assert told[inside] == pytest.approx(
        level[inside], abs=0.03
    )  # a mean of 400 rows: 0.005; a bend within: 0.02


@pytest.mark.usefixtures("_kept")
@pytest.mark.parametrize(
    "levels",
    [
        np.array([0.4, -0.4, 0.3, -0.2, 0.4, -0.3, 0.1, -0.3]),
        0.4 * np.sin(0.6 * np.arange(EXPERIMENTS)),
        np.zeros(EXPERIMENTS),
    ],
    ids=["as it comes", "in the order in which they were played", "noise"],
)
def test_what_both_plays_of_an_experiment_have_alike_is_no_wandering(levels: Floats) -> None:
    """A spring that is stretched elsewhere in each experiment, even further in each than in the one before."""
    assert without_wander(_problem(), None, np.repeat(levels, 2 * COUNT) + _noise()) is None


@pytest.mark.usefixtures("_kept")
def test_of_few_experiments_and_of_two_recordings_nothing_is_told() -> None:
    few, two = _problem(), _problem()
    few.data.blocks = few.data.blocks[:4]
    two.data.starts = (0, ROWS // 2)
    assert without_wander(few, None, _walk() + _noise()) is None
    assert without_wander(two, None, _walk() + _noise()) is None


def test_a_level_is_no_part_of_what_is_compared_and_is_told() -> None:
    wander = Wander(np.array([0.0, 1.0]), np.array([-0.1, 0.1]))
    metadata = Metadata(motion_unit="m")
    data = SimpleNamespace(clocked=(), wander=wander, torque=np.zeros(101), period=0.01, metadata=metadata)
    assert clockless(data, np.ones(101)) == pytest.approx(1.0 - np.linspace(-0.1, 0.1, 101))
    assert "(by 0.1 N rms)" in wander_note(data)
    assert wander_note(SimpleNamespace(wander=None)) == ""
