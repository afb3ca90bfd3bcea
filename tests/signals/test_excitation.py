"""Excitation signals: their spectra, peaks and ends."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.core.errors import ConfigurationError
from autotune.signals.excitation import decaying_sine, multisine, prbs, smooth_step


@given(st.integers(3, 12), st.integers(1, 4), st.floats(0.01, 10.0))
def test_prbs_is_binary_nearly_balanced_and_white(bits: int, hold: int, amplitude: float) -> None:
    signal = prbs(bits, hold, amplitude)
    ticks = signal[::hold]
    assert len(signal) == (2**bits - 1) * hold
    assert np.allclose(np.abs(signal), amplitude)
    assert abs(ticks.sum()) == pytest.approx(amplitude)
    spectrum = np.abs(np.fft.rfft(ticks))[1:] ** 2
    assert np.allclose(spectrum, spectrum[0], rtol=1e-6)


def test_prbs_refuses_impossible_registers() -> None:
    with pytest.raises(ConfigurationError, match="3 to 16 bits"):
        prbs(2, 1, 1.0)
    with pytest.raises(ConfigurationError, match="1 or more"):
        prbs(5, 0, 1.0)


def test_multisine_has_its_lines_and_nothing_else() -> None:
    lines, sizes = np.array([2.0, 5.0, 11.0, 23.0]), np.array([1.0, 0.5, 0.2, 0.1])
    signal = multisine(lines, sizes, 1000, 1e-3, np.random.default_rng(1))
    spectrum = np.abs(np.fft.rfft(signal)) / 500.0
    expected = np.zeros(501)
    expected[lines.astype(int)] = sizes
    assert np.allclose(spectrum, expected, atol=1e-9)


def test_multisine_has_a_low_peak_and_is_reproducible() -> None:
    lines = np.arange(1.0, 31.0)
    signals = [multisine(lines, np.ones(30), 1000, 1e-3, np.random.default_rng(seed)) for seed in (3, 3, 4)]
    assert np.array_equal(signals[0], signals[1])
    assert not np.allclose(signals[0], signals[2])
    crest = np.abs(signals[0]).max() / np.sqrt(np.mean(signals[0] ** 2))
    # below 1.41 is impossible for a sum of sines; random phases give about 3
    assert 1.41 < crest < 2.6


@pytest.mark.parametrize("lines", [[], [0.0, 1.0], [1.0, 500.0]])
def test_multisine_refuses_impossible_lines(lines: list[float]) -> None:
    with pytest.raises(ConfigurationError):
        multisine(lines, [1.0] * len(lines), 100, 1e-3, np.random.default_rng(0))


def test_decaying_sine_starts_and_ends_at_rest_and_falls_steadily() -> None:
    signal = decaying_sine(0.15, 2e-4, 14, 3.0, 3.0, 1e-3)
    assert len(signal) == pytest.approx(14 / 3.0 / 1e-3, abs=2)
    assert np.abs(signal).max() == pytest.approx(0.1, abs=0.05)
    assert abs(signal[-1]) < 1e-12
    assert abs(np.diff(signal)[[0, -1]]).max() < 1e-6
    peaks = np.array([part.max() for part in np.array_split(np.abs(signal), 14)])
    assert np.allclose(peaks[2:-1] / peaks[1:-2], (2e-4 / 0.15) ** (1 / 14), rtol=0.02)


def test_decaying_sine_keeps_its_acceleration_until_it_is_fastest() -> None:
    signal = decaying_sine(0.15, 2e-4, 32, 3.0, 10.0, 1e-3)
    early, late = (np.abs(np.diff(part, 2)).max() / 1e-6 for part in (signal[400:1000], signal[1200:1800]))
    assert late == pytest.approx(early, rel=0.2)
    crossings = np.flatnonzero(np.diff(np.sign(signal[-2000:])))
    assert np.median(np.diff(crossings)) == pytest.approx(50, abs=1)  # half a period of 10 Hz


@pytest.mark.parametrize(
    "changed",
    [{"smallest": 0.1}, {"smallest": 0.0}, {"cycles": 1}, {"frequency": 11.0}, {"fastest": 600.0}],
)
def test_decaying_sine_refuses_what_does_not_decay(changed: dict[str, float]) -> None:
    sizes = {"amplitude": 0.1, "smallest": 0.01, "cycles": 5, "frequency": 1.0, "fastest": 10.0}
    with pytest.raises(ConfigurationError, match="must fall"):
        decaying_sine(**(sizes | changed), period=1e-3)  # type: ignore[arg-type]


@given(st.floats(-5.0, 5.0))
def test_smooth_step_is_monotonic_and_bounded(x: float) -> None:
    low, high = smooth_step(np.array([x, x + 0.1]))
    assert 0.0 <= low <= high <= 1.0
