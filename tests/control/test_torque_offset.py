"""An offset that is faded and never makes a step, and when a model fits an axis."""

from __future__ import annotations

import math

import numpy as np
import pytest

from autotune.control.torque_offset import FADE_IN, FADE_OUT, STEP, ModelCheck, Phase, TorqueOffset

LIMIT, PERIOD = 1.34, 1e-3


def test_it_fades_in_follows_and_fades_out() -> None:
    offset = TorqueOffset(LIMIT, PERIOD)
    assert [offset.step(0.3) for _ in range(10)] == [0.0] * 10  # watching
    offset.phase = Phase.PLAYING
    played = [offset.step(0.3) for _ in range(round(FADE_IN / PERIOD) + 2)]
    assert played[-1] == pytest.approx(0.3)
    assert played[len(played) // 2] == pytest.approx(0.15, rel=0.02)
    offset.phase = Phase.LEAVING
    gone = [offset.step(0.3) for _ in range(round(FADE_OUT / PERIOD) + 2)]
    assert gone[0] > 0.25
    assert gone[-1] == 0.0
    assert offset.out


@pytest.mark.parametrize("torque", [10.0, -10.0, 0.5])
def test_no_step_is_larger_than_its_share_of_the_limit(torque: float) -> None:
    offset = TorqueOffset(LIMIT, PERIOD)
    offset.phase = Phase.PLAYING
    for _ in range(600):
        offset.step(0.0)
    rng = np.random.default_rng(1)
    played = [offset.step(torque * rng.choice((-1.0, 1.0))) for _ in range(500)]
    assert np.abs(np.diff(played)).max() <= STEP * LIMIT * (1.0 + 1e-12)
    assert max(map(abs, played)) <= LIMIT
    assert offset.limited > 100


def judged(scale: float, noise: float) -> str:
    check = ModelCheck(0.01)
    rng = np.random.default_rng(2)
    for k in range(2000):
        velocity = math.cos(2.0 * math.pi * k * PERIOD)
        model = 0.3 * math.copysign(1.0, velocity) + 0.05
        check.see(velocity, model, scale * model + 0.02 + noise * rng.standard_normal())
    assert check.done
    return check.doubt()


@pytest.mark.parametrize("noise", [0.02, 0.15])  # of a single sample; means of 20 are compared
def test_a_model_that_fits(noise: float) -> None:
    assert judged(1.0, noise) == ""


@pytest.mark.parametrize(("scale", "noise"), [(0.5, 0.0), (1.6, 0.0), (-1.0, 0.0), (1.0, 1.0), (0.0, 0.0)])
def test_a_model_that_does_not_fit(scale: float, noise: float) -> None:
    assert "does not fit" in judged(scale, noise)


def test_motion_in_one_direction_is_not_enough() -> None:
    check = ModelCheck(0.01)
    for _ in range(5000):
        check.see(1.0, 0.3, 0.3)
    assert not check.done
