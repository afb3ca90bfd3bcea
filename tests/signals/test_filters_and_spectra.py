"""Filters and spectra."""

import numpy as np
from scipy import signal

from autotune.signals.filters import block_mean, derivative, low_pass, motion
from autotune.signals.spectra import cross_spectra, frequency_response, together

PERIOD = 1e-3


def test_the_low_pass_has_no_phase() -> None:
    """Half power twice, that is half the amplitude, at the cut-off; a tenth of it passes unchanged."""
    time = np.arange(4000) * PERIOD
    middle = slice(500, 3500)
    for frequency, gain in ((3.0, 1.0), (30.0, 0.5)):
        wave = np.sin(2 * np.pi * frequency * time)
        np.testing.assert_allclose(low_pass(wave, 30.0, PERIOD)[middle], gain * wave[middle], atol=0.01)


def test_motion_of_a_slow_sine_is_its_derivatives() -> None:
    time = np.arange(3000) * PERIOD
    position, velocity, acceleration = motion(np.sin(2 * np.pi * time), PERIOD, 100.0)
    middle = slice(300, 2700)
    w = 2 * np.pi
    np.testing.assert_allclose(position[middle], np.sin(w * time)[middle], atol=1e-4)
    np.testing.assert_allclose(velocity[middle], w * np.cos(w * time)[middle], atol=1e-3 * w)
    np.testing.assert_allclose(acceleration[middle], -(w**2) * np.sin(w * time)[middle], atol=2e-3 * w**2)


def test_rows_beside_each_other_are_filtered_as_each_alone() -> None:
    """To the last digit, and as scipy's routine does it; one to nine rows fill their passes or not."""
    walks = np.cumsum(np.random.default_rng(2).standard_normal((9, 700)), axis=1)
    sections = signal.butter(4, 2.0 * 40.0 * PERIOD, output="sos")
    padding = round(2.0 / (40.0 * PERIOD))
    for count in (1, 3, 4, 9):
        together = motion(walks[:count], PERIOD, 40.0)
        for row in range(count):
            for part, alone in zip(together, motion(walks[row], PERIOD, 40.0), strict=True):
                np.testing.assert_array_equal(part[row], alone)
        np.testing.assert_allclose(
            together[0], signal.sosfiltfilt(sections, walks[:count], padlen=padding), rtol=1e-12, atol=1e-12
        )


def test_differences_are_those_of_numpy() -> None:
    walk = np.cumsum(np.random.default_rng(3).standard_normal(50))
    smooth, velocity, acceleration = motion(walk, PERIOD, 1e6)  # beyond the samples: not filtered
    np.testing.assert_array_equal(smooth, walk)
    np.testing.assert_array_equal(velocity, np.gradient(walk, PERIOD))
    np.testing.assert_array_equal(acceleration[1:-1], np.diff(walk, 2) / PERIOD**2)
    assert acceleration[0] == acceleration[-1] == 0.0


def test_block_means_and_derivative() -> None:
    np.testing.assert_allclose(block_mean(np.arange(7.0), 3), [1.0, 4.0])
    np.testing.assert_allclose(derivative(np.arange(5.0) * 0.2, 0.1), 2.0)


def test_cross_spectra_see_through_feedback() -> None:
    """In closed loop U and Y share the noise; (3.45) with the excitation does not mind, Y/U would."""
    generator = np.random.default_rng(1)
    n = 60000
    excitation = np.repeat(generator.choice([-1.0, 1.0], n // 2), 2)
    noise = 0.03 * generator.standard_normal(n)
    y, u = np.zeros(n), np.zeros(n)
    for k in range(1, n):
        y[k] = 0.9 * y[k - 1] + 0.1 * u[k - 1] + noise[k]
        u[k] = excitation[k] - 3.0 * y[k]
    found = frequency_response(excitation, u, y, PERIOD, 1024)
    _, truth = signal.freqz([0, 0.1], [1, -0.9], found.frequency, fs=1 / PERIOD)
    good = (found.coherence > 0.5) & (found.frequency < 60)
    assert good.sum() > 20
    error = np.abs(found.response / truth - 1.0)[good]
    assert np.median(error) < 0.1
    assert np.all(error < 6 * np.sqrt(2) * found.relative_error[good] + 0.05)


def test_records_are_averaged_before_they_are_divided() -> None:
    """(3.45) is a ratio of averages: noise of four times the source leaves it within 2 %.

    The mean of the records' ratios is a tenth off, as noise in a divisor does not average out.
    """
    generator = np.random.default_rng(4)
    parts, truth = [], 0.5
    for _ in range(300):
        source = generator.standard_normal(1024)
        measured = source + 4.0 * generator.standard_normal(1024)
        parts.append(cross_spectra(source, measured, truth * source, PERIOD, 256))
    whole = together(parts)
    assert abs(whole.averages - 300 * parts[0].averages) < 1e-6
    ratios = np.mean([part.response().response for part in parts], axis=0)
    assert abs(np.mean(whole.response().response) - truth) < 0.02 * truth
    assert abs(np.mean(ratios) - truth) > 0.1 * truth
