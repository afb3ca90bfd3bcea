"""Excitation: pseudo-random binary signals, multisines, decaying sines and smooth steps.

All are plain arrays at the sample period of the loop. A PRBS of n bits repeats after 2ⁿ − 1 clock
ticks and has a flat spectrum up to about 0.4 of its clock (section 3.4.2, figure 3.9). A multisine
has its energy at chosen lines only; its phases are searched for a low peak. A decaying sine walks
round ever smaller hysteresis loops and leaves the friction state near zero (section 3.4.3).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError

PRBS_BITS = range(3, 17)
PHASE_TRIALS = 64


def prbs(bits: int, hold: int, amplitude: float, state: Sequence[int] | None = None) -> Floats:
    """One period of a pseudo-random binary signal.

    Args:
        bits: register length; the period has 2**bits − 1 ticks.
        hold: samples a tick, at least 1; fewer mean a wider band.
        amplitude: values are ±amplitude.
        state: start of the register, to get the same signal with another phase.

    Returns:
        Shape ((2**bits − 1) · hold,).

    Raises:
        ConfigurationError: bits outside 3…16, or hold below 1.
    """
    if bits not in PRBS_BITS or hold < 1:
        raise ConfigurationError(f"a PRBS of {bits} bits, held {hold} samples: use 3 to 16 bits, 1 or more")
    sequence, _ = scipy.signal.max_len_seq(bits, state=None if state is None else np.asarray(state))
    return amplitude * np.repeat(2.0 * sequence - 1.0, hold)


def multisine(
    frequencies: Sequence[float] | Floats,
    amplitudes: Sequence[float] | Floats,
    samples: int,
    period: float,
    rng: np.random.Generator,
) -> Floats:
    """Sum of sines with the phases, out of some random ones, that give the lowest peak.

    Args:
        frequencies: Hz, shape (m,), below half the sampling rate; multiples of 1/(samples · period)
            make the signal periodic.
        amplitudes: of each line, shape (m,).
        samples: length.
        period: sample period [s].
        rng: for the phases.

    Returns:
        Shape (samples,).

    Raises:
        ConfigurationError: no lines, lengths that differ, or a line at or above half the sampling rate.
    """
    lines = np.asarray(frequencies, dtype=np.float64)
    sizes = np.asarray(amplitudes, dtype=np.float64)
    if not len(lines) or lines.shape != sizes.shape:
        raise ConfigurationError(
            f"a multisine needs as many amplitudes ({sizes.size}) as lines ({lines.size})"
        )
    if lines.min() <= 0 or lines.max() >= 0.5 / period:
        raise ConfigurationError(
            f"multisine lines {lines.min():g} to {lines.max():g} Hz; they must lie between 0 and half the "
            f"sampling rate, {0.5 / period:g} Hz"
        )
    angle = 2.0 * math.pi * np.outer(np.arange(samples) * period, lines)
    trials = (np.sin(angle + rng.uniform(0, 2 * math.pi, len(lines))) @ sizes for _ in range(PHASE_TRIALS))
    return np.asarray(min(trials, key=lambda signal: float(np.abs(signal).max())), dtype=np.float64)


def decaying_sine(
    amplitude: float, smallest: float, cycles: int, frequency: float, fastest: float, period: float
) -> Floats:
    """Sine whose amplitude falls from `amplitude` to `smallest` by a constant factor a cycle.

    Its frequency rises while it falls, with 1/√amplitude (equal acceleration), from `frequency` up to
    `fastest`. It starts and ends smoothly at zero: the first half cycle fades in, the last one out.

    Args:
        amplitude, smallest: largest and smallest amplitude, 0 < smallest < amplitude.
        cycles: number of cycles, at least 2; many make what is left of the hysteresis small.
        frequency, fastest: at the beginning and at most [Hz].
        period: sample period [s].

    Returns:
        Shape (n,), as long as it takes.

    Raises:
        ConfigurationError: amplitudes, cycles or frequencies outside what is said above.
    """
    if not 0 < smallest < amplitude or cycles < 2 or not 0 < frequency <= fastest < 0.5 / period:
        raise ConfigurationError(
            f"a decaying sine from {amplitude:g} to {smallest:g} in {cycles} cycles, {frequency:g} to "
            f"{fastest:g} Hz; it must fall, stay above 0, have 2 cycles or more and keep below half the "
            "sampling rate"
        )
    turns = np.linspace(0.0, cycles, 100 * cycles + 1)
    decay = smallest / amplitude
    rate = np.minimum(frequency * decay ** (-0.5 * turns / cycles), fastest)
    seconds = np.concatenate([[0.0], np.cumsum(np.diff(turns) * 0.5 * (1.0 / rate[1:] + 1.0 / rate[:-1]))])
    count = math.ceil(seconds[-1] / period)
    phase = np.interp(np.arange(1, count + 1) * seconds[-1] / count, seconds, turns)
    envelope = amplitude * decay ** (phase / cycles)
    envelope = envelope * smooth_step(2.0 * phase) * smooth_step(2.0 * (cycles - phase))
    return np.asarray(envelope * np.sin(2.0 * math.pi * phase), dtype=np.float64)


def smooth_step(x: Floats) -> Floats:
    """0 below 0, 1 above 1, and the quintic 6x⁵ − 15x⁴ + 10x³ between: two continuous derivatives."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x**3 * (x * (6.0 * x - 15.0) + 10.0), dtype=np.float64)
