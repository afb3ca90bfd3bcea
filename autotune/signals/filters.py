"""Zero-phase filters, derivatives and integer decimation.

Arrays of shape (n,) or (k, n), along the last axis.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy
from numba import njit

from autotune.core.arrays import Floats


def low_pass(values: Floats, cutoff: float, period: float, order: int = 4) -> Floats:
    """Butterworth low-pass run forward and backward: no phase, half power twice at `cutoff` [Hz].

    A cut-off at or above 0.45 of the sampling frequency leaves the values as they are.
    """
    if cutoff * period >= 0.45 or values.shape[-1] < 4:
        return np.array(values, dtype=np.float64)
    padding = min(values.shape[-1] - 1, round(2.0 / (cutoff * period)))
    rows = np.array(values, dtype=np.float64, order="C").reshape(-1, values.shape[-1])
    sections, rest = _sections(order, round(2.0 * cutoff * period, 12))
    _forward_and_backward(sections, rest, padding, rows)
    return rows.reshape(values.shape)


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
def _sections(order: int, relative: float) -> tuple[Floats, Floats]:
    """Second-order sections, and their state at rest at a constant input of 1, shape (sections, 2)."""
    sections = np.ascontiguousarray(scipy.signal.butter(order, relative, output="sos"))
    return sections, np.ascontiguousarray(scipy.signal.sosfilt_zi(sections))


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _forward_and_backward(sections: Floats, rest: Floats, padding: int, rows: Floats) -> None:
    """`scipy.signal.sosfiltfilt` in place on rows of shape (k, n), odd extension and all.

    The same sums in the same order; on the few hundred samples of a stretch scipy's routine takes ten to a hundred
    times as long, nearly all of it outside the filter.
    """
    n = rows.shape[1]
    long = np.empty(n + 2 * padding)
    for row in rows:
        long[padding : padding + n] = row
        for i in range(padding):
            long[i] = 2.0 * row[0] - row[padding - i]
            long[n + padding + i] = 2.0 * row[n - 1] - row[n - 2 - i]
        _through(sections, rest, long)
        _through(sections, rest, long[::-1])
        row[:] = long[padding : padding + n]


@njit(cache=True, error_model="numpy")  # type: ignore[untyped-decorator]
def _through(sections: Floats, rest: Floats, values: Floats) -> None:
    """Sections one after another, from rest at the first value, in place; direct form II transposed."""
    state = rest * values[0]
    for k in range(len(values)):
        x = values[k]
        for s in range(len(sections)):
            y = sections[s, 0] * x + state[s, 0]
            state[s, 0] = sections[s, 1] * x - sections[s, 4] * y + state[s, 1]
            state[s, 1] = sections[s, 2] * x - sections[s, 5] * y
            x = y
        values[k] = x
