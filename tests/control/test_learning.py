"""Learning is a ceiling on its own motion, and worse than a model on others."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.control.gains.twin import follow, smoothed
from autotune.control.learning import LearntFeedforward, by_phase, learn, next_torque
from autotune.control.model_feedforward import torque_along
from autotune.control.structures.structure import reference_rates
from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from tests.control.gains_axis import THESIS, TIMING, vertical

LATE = slice(1000, None)


def sine(amplitude: float, frequency: float, seconds: float = 3.0) -> Floats:
    time = np.arange(round(seconds / TIMING.period)) * TIMING.period
    fade = np.minimum(2.0 * time, 1.0)
    return smoothed(amplitude * fade * np.sin(2.0 * np.pi * frequency * time), TIMING.reference_filter)


def modelled(reference: Floats) -> Floats:
    rates = reference_rates(reference, TIMING.period)
    return torque_along(vertical(), rates[:, 0], rates[:, 1], rates[:, 2], TIMING.period)


def peak(reference: Floats, torque: Floats | None) -> float:
    return float(np.max(np.abs(follow(vertical(), THESIS, TIMING, reference, torque).error[LATE])))


def test_learning_takes_the_error_to_a_few_counts() -> None:
    reference = sine(0.2, 1.0)
    found = learn(vertical(), THESIS, TIMING, reference, looked_at=LATE)
    assert found.best < 0.3 * found.peaks[0]
    assert peak(reference, found.torque) == pytest.approx(found.best)


def test_the_model_is_near_the_ceiling_and_better_on_motions_never_seen() -> None:
    """What was learnt on the sine, played by place on other sines, against the model's own feedforward."""
    reference = sine(0.2, 1.0)
    learnt = learn(vertical(), THESIS, TIMING, reference, modelled(reference), looked_at=LATE)
    assert peak(reference, modelled(reference)) < 1.5 * learnt.best + 3.0 * TIMING.resolution
    better = []
    for amplitude, frequency in ((0.1, 0.7), (0.3, 0.5), (0.05, 2.0), (0.25, 1.3)):
        other = sine(amplitude, frequency)
        better.append(peak(other, learnt.torque) / peak(other, modelled(other)))
    assert min(better) > 3.0


def test_a_motion_too_short_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="too short to learn on"):
        learn(vertical(), THESIS, TIMING, np.zeros(50))


def test_the_next_trial_takes_over_what_repeats_and_leaves_what_is_fast() -> None:
    turn = 2.0 * np.pi * np.arange(1000) / 1000.0
    slow, fast = np.sin(3.0 * turn), np.sin(300.0 * turn)
    taken = next_torque(slow, np.zeros(1000), 1e-3)
    assert taken == pytest.approx(slow, abs=1e-3)
    assert next_torque(fast, np.zeros(1000), 1e-3) == pytest.approx(np.zeros(1000), abs=0.01)
    more = next_torque(np.zeros(1000), slow, 1e-3)
    assert more == pytest.approx(0.5 * np.roll(slow, -2), abs=1e-3)


def test_what_was_learnt_is_played_round_and_round_and_stretched_by_its_phase() -> None:
    torque = np.sin(2.0 * np.pi * np.arange(8) / 8.0)
    law = LearntFeedforward(torque)
    assert [law.step(0.0, 0.0, 0.0, None) for _ in range(16)] == pytest.approx([*torque, *torque])
    assert by_phase(torque, 16)[::2] == pytest.approx(torque)
