"""Zero-phase filters, derivatives and integer decimation.

Arrays of shape (n,) or (k, n), along the last axis.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from scipy import signal

from autotune.core.arrays import Floats


def low_pass(values: Floats, cutoff: float, period: float, order: int = 4) -> Floats:
    """Butterworth low-pass run forward and backward: no phase, half power twice at `cutoff` [Hz].

    A cut-off at or above 0.45 of the sampling frequency leaves the values as they are.
    """
    if cutoff * period >= 0.45 or values.shape[-1] < 4:
        return np.array(values, dtype=np.float64)
    sections = _sections(order, round(2.0 * cutoff * period, 12))
    padding = min(values.shape[-1] - 1, round(2.0 / (cutoff * period)))
    return np.asarray(signal.sosfiltfilt(sections, values, padlen=padding))


def derivative(values: Floats, period: float) -> Floats:
    """Central differences, one-sided at the ends."""
    return np.asarray(np.gradient(values, period, axis=-1))


def motion(position: Floats, period: float, cutoff: float) -> tuple[Floats, Floats, Floats]:
    """Position, velocity and acceleration, zero-phase filtered at `cutoff` [Hz]."""
    smooth = low_pass(position, cutoff, period)
    velocity = derivative(smooth, period)
    acceleration = np.zeros_like(smooth)
    acceleration[..., 1:-1] = np.diff(smooth, 2, axis=-1) / period**2
    return smooth, velocity, acceleration


def block_mean(values: Floats, factor: int) -> Floats:
    """Means of consecutive blocks of `factor` samples; a rest at the end is dropped."""
    blocks = values.shape[-1] // factor
    return np.asarray(
        values[..., : blocks * factor].reshape(*values.shape[:-1], blocks, factor).mean(axis=-1)
    )


@lru_cache(maxsize=32)
def _sections(order: int, relative: float) -> Floats:
    return np.asarray(signal.butter(order, relative, output="sos"))
