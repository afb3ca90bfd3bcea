"""Only a difference that is better beyond doubt counts."""

from __future__ import annotations

import numpy as np
import pytest

from autotune.core.errors import RecordingError
from autotune.recordings.recording import Metadata, Recording
from autotune.tuning.proof import prove, tracking_error


def window(glitch: float, rng: np.random.Generator, noise: float = 1e-4, periods: int = 3) -> Recording:
    """A sine tracked with an error of two glitches a period."""
    time = np.arange(periods * 1000) * 1e-3
    reference = 0.2 * np.sin(2 * np.pi * time)
    error = glitch * np.exp(-(((time % 0.5) - 0.25) ** 2) / 2e-4) + noise * rng.standard_normal(len(time))
    return Recording.from_columns(
        {"time": time, "reference": reference, "position": reference - error, "torque": 0 * time}, Metadata()
    )


def windows(glitch: float, spread: float, seed: int, count: int = 6) -> list[Recording]:
    rng = np.random.default_rng(seed)
    return [window(glitch + spread * rng.standard_normal(), rng) for _ in range(count)]


def test_the_peak_of_the_period_average_is_the_glitch_without_the_noise() -> None:
    found = tracking_error(windows(2e-3, 0.0, 1), 1.0)
    assert found.peak_error == pytest.approx(2e-3, abs=1e-4)
    assert 2.1e-3 < found.raw_peak_error < 2.6e-3
    assert found.rms_error < found.peak_error


def test_a_clear_gain_is_better_and_its_interval_holds_the_truth() -> None:
    proof = prove(windows(2e-3, 1e-4, 1), windows(5e-4, 1e-4, 2), 1.0, 0.1, 0.99)
    assert proof.better
    assert proof.interval[0] < 1.5e-3 < proof.interval[1]
    assert proof.interval[0] > 1e-3


def test_no_gain_is_never_better_whatever_the_noise() -> None:
    verdicts = [
        prove(windows(2e-3, 3e-4, seed), windows(2e-3, 3e-4, seed + 1000), 1.0, 0.1, 0.99).better
        for seed in range(60)
    ]
    assert not any(verdicts)


def test_a_gain_within_the_scatter_is_not_beyond_doubt() -> None:
    proof = prove(windows(2e-3, 8e-4, 3), windows(1.7e-3, 8e-4, 4), 1.0, 0.1, 0.99)
    assert not proof.better


def test_too_few_or_unequal_windows_are_refused() -> None:
    with pytest.raises(RecordingError, match="at least 5"):
        prove(windows(2e-3, 0.0, 1, 4), windows(1e-3, 0.0, 2, 4), 1.0, 0.1, 0.99)
    with pytest.raises(RecordingError, match="equally"):
        prove(windows(2e-3, 0.0, 1, 6), windows(1e-3, 0.0, 2, 5), 1.0, 0.1, 0.99)
