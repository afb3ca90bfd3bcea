"""Zero-phase filters, derivatives and integer decimation.

Arrays of shape (n,) or (k, n), along the last axis.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.core.kernel_cache import kernel


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
    if smooth.shape[-1] < 3:
        return smooth, derivative(smooth, period), np.zeros_like(smooth)
    rows = smooth.reshape(-1, smooth.shape[-1])
    velocity, acceleration = np.empty_like(rows), np.empty_like(rows)
    _differences(rows, period, velocity, acceleration)
    return smooth, velocity.reshape(smooth.shape), acceleration.reshape(smooth.shape)


def block_mean(values: Floats, factor: int) -> Floats:
    """Means of consecutive blocks of `factor` samples; a rest at the end is dropped."""
    blocks = values.shape[-1] // factor
    return np.asarray(
        values[..., : blocks * factor].reshape(*values.shape[:-1], blocks, factor).mean(axis=-1)
    )


@kernel
def _differences(rows: Floats, period: float, velocity: Floats, acceleration: Floats) -> None:
    """`derivative` and second differences of rows of shape (k, n) in one pass; the latter are 0 at the ends."""
    n = rows.shape[1]
    for i in range(len(rows)):
        row = rows[i]
        for k in range(1, n - 1):
            velocity[i, k] = (row[k + 1] - row[k - 1]) / (2.0 * period)
            acceleration[i, k] = ((row[k + 1] - row[k]) - (row[k] - row[k - 1])) / (period * period)
        velocity[i, 0], velocity[i, n - 1] = (row[1] - row[0]) / period, (row[n - 1] - row[n - 2]) / period
        acceleration[i, 0] = acceleration[i, n - 1] = 0.0


@lru_cache(maxsize=32)
def _sections(order: int, relative: float) -> tuple[Floats, Floats]:
    """Second-order sections, and their state at rest at a constant input of 1, shape (sections, 2)."""
    sections = np.ascontiguousarray(scipy.signal.butter(order, relative, output="sos"))
    return sections, np.ascontiguousarray(scipy.signal.sosfilt_zi(sections))


ABREAST = 4
"""Rows that are filtered side by side: a recursion waits for its last result, while others can go on."""


@kernel
def _forward_and_backward(sections: Floats, rest: Floats, padding: int, rows: Floats) -> None:
    """`scipy.signal.sosfiltfilt` in place on rows of shape (k, n), odd extension and all.

    The same sums in the same order; on the few hundred samples of a stretch scipy's routine takes ten to a hundred
    times as long, nearly all of it outside the filter.
    """
    n = rows.shape[1]
    long = np.empty((n + 2 * padding, ABREAST))
    for first in range(0, len(rows), ABREAST):
        last = min(first + ABREAST, len(rows)) - 1
        for lane in range(ABREAST):  # the last row once more where there are fewer
            _extended(rows[min(first + lane, last)], padding, long[:, lane])
        _through(sections, rest, long)
        _through(sections, rest, long[::-1])
        for i in range(first, last + 1):
            for k in range(n):
                rows[i, k] = long[padding + k, i - first]


@kernel
def _extended(row: Floats, padding: int, long: Floats) -> None:
    """A row of shape (n,) with an odd extension before and after it, to `long` of shape (n + 2·padding,)."""
    n = len(row)
    for k in range(n):
        long[padding + k] = row[k]
    for i in range(padding):
        long[i] = 2.0 * row[0] - row[padding - i]
        long[n + padding + i] = 2.0 * row[n - 1] - row[n - 2 - i]


@kernel
def _through(sections: Floats, rest: Floats, values: Floats) -> None:
    """Sections one after another, from rest at the first value, in place; direct form II transposed.

    `values` are of shape (n, 4). What a section remembers of each of them, z and w, is in numbers of its own: an
    array of them would be written and read once a sample, which takes longer than the sums.
    """
    start = values[0].copy()
    for s in range(len(sections)):
        b0, b1, b2, a1, a2 = sections[s, 0], sections[s, 1], sections[s, 2], sections[s, 4], sections[s, 5]
        z0, z1, z2, z3 = (
            rest[s, 0] * start[0],
            rest[s, 0] * start[1],
            rest[s, 0] * start[2],
            rest[s, 0] * start[3],
        )
        w0, w1, w2, w3 = (
            rest[s, 1] * start[0],
            rest[s, 1] * start[1],
            rest[s, 1] * start[2],
            rest[s, 1] * start[3],
        )
        for k in range(len(values)):
            x0, x1, x2, x3 = values[k, 0], values[k, 1], values[k, 2], values[k, 3]
            y0, y1, y2, y3 = b0 * x0 + z0, b0 * x1 + z1, b0 * x2 + z2, b0 * x3 + z3
            z0, z1 = b1 * x0 - a1 * y0 + w0, b1 * x1 - a1 * y1 + w1
            z2, z3 = b1 * x2 - a1 * y2 + w2, b1 * x3 - a1 * y3 + w3
            w0, w1, w2, w3 = b2 * x0 - a2 * y0, b2 * x1 - a2 * y1, b2 * x2 - a2 * y2, b2 * x3 - a2 * y3
            values[k, 0], values[k, 1], values[k, 2], values[k, 3] = y0, y1, y2, y3
