"""Zero-phase filters, derivatives and integer decimation.

Arrays of shape (n,) or (k, n), along the last axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.core.kernel_cache import kernel

ORDER = 4
"""Of the low-pass: two sections."""


def low_pass(values: Floats, cutoff: float, period: float) -> Floats:
    """Butterworth low-pass of fourth order run forward and backward: no phase, half power twice at `cutoff` [Hz].

    A cut-off at or above 0.45 of the sampling frequency leaves the values as they are.
    """
    smooth = np.array(values, dtype=np.float64, order="C")
    _smooth_within(smooth.reshape(-1, smooth.shape[-1]), 0, smooth.shape[-1], cutoff, period)
    return smooth


def _smooth_within(rows: Floats, first: int, last: int, cutoff: float, period: float) -> None:
    """`low_pass` in place, of a span of rows of shape (k, n) by itself."""
    found = low_pass_of(cutoff, period)
    if found is None or last - first < 4:
        return
    padding = min(last - first - 1, found.padding)
    _forward_and_backward(found.sections, found.rest, padding, rows, first, last)


class LowPass(NamedTuple):
    """Second-order sections, shape (2, 6), their state at rest at a constant input of 1, shape (2, 2), and the samples
    by which values are continued at both ends.
    """

    sections: Floats
    rest: Floats
    padding: int


def low_pass_of(cutoff: float, period: float) -> LowPass | None:
    """What `low_pass` filters with; None where the cut-off leaves values as they are."""
    if cutoff * period >= 0.45:
        return None
    return LowPass(*_sections(round(2.0 * cutoff * period, 12)), round(2.0 / (cutoff * period)))


def derivative(values: Floats, period: float) -> Floats:
    """Central differences, one-sided at the ends."""
    return np.asarray(np.gradient(values, period, axis=-1))


def motion(
    position: Floats | Sequence[Floats],
    period: float,
    cutoff: float,
    spans: Sequence[tuple[int, int]] | None = None,
) -> tuple[Floats, Floats, Floats]:
    """Position, velocity and acceleration, zero-phase filtered at `cutoff` [Hz]; arrays of shape (n,) or (k, n).

    Each of the `spans`, in order, from a sample up to one, is filtered by itself; all is 0 beside them.
    """
    smooth = np.array(position, dtype=np.float64, order="C")
    rows = smooth.reshape(-1, smooth.shape[-1])
    velocity, acceleration = np.empty_like(rows), np.empty_like(rows)
    done = 0
    for first, last in spans if spans is not None else [(0, rows.shape[1])]:
        for part in (rows, velocity, acceleration):
            part[:, done:first] = 0.0
        done = last
        _smooth_within(rows, first, last, cutoff, period)
        if last - first < 3:
            velocity[:, first:last] = derivative(rows[:, first:last], period)
            acceleration[:, first:last] = 0.0
        else:
            _differences(rows, first, last, period, velocity, acceleration)
    for part in (rows, velocity, acceleration):
        part[:, done:] = 0.0
    return smooth, velocity.reshape(smooth.shape), acceleration.reshape(smooth.shape)


def block_mean(values: Floats, factor: int) -> Floats:
    """Means of consecutive blocks of `factor` samples; a rest at the end is dropped."""
    blocks = values.shape[-1] // factor
    return np.asarray(
        values[..., : blocks * factor].reshape(*values.shape[:-1], blocks, factor).mean(axis=-1)
    )


@kernel
def _differences(
    rows: Floats, first: int, last: int, period: float, velocity: Floats, acceleration: Floats
) -> None:
    """`derivative` and second differences of a span of rows of shape (k, n); the latter are 0 at its ends."""
    n = last - first
    for i in range(len(rows)):
        row, rate, bend = rows[i, first:last], velocity[i, first:last], acceleration[i, first:last]
        for k in range(1, n - 1):
            rate[k] = (row[k + 1] - row[k - 1]) / (2.0 * period)
            bend[k] = ((row[k + 1] - row[k]) - (row[k] - row[k - 1])) / (period * period)
        rate[0], rate[n - 1] = (row[1] - row[0]) / period, (row[n - 1] - row[n - 2]) / period
        bend[0] = bend[n - 1] = 0.0


@lru_cache(maxsize=32)
def _sections(relative: float) -> tuple[Floats, Floats]:
    """Second-order sections, and their state at rest at a constant input of 1, shape (sections, 2)."""
    sections = np.ascontiguousarray(scipy.signal.butter(ORDER, relative, output="sos"))
    return sections, np.ascontiguousarray(scipy.signal.sosfilt_zi(sections))


ABREAST = 4
"""Rows that are filtered side by side: a recursion waits for its last result, while others can go on."""


@kernel
def _forward_and_backward(
    sections: Floats, rest: Floats, padding: int, rows: Floats, start: int, stop: int
) -> None:
    """`scipy.signal.sosfiltfilt` in place on a span of rows of shape (k, n), odd extension and all.

    The same sums in the same order; on the few hundred samples of a stretch scipy's routine takes ten to a hundred
    times as long, nearly all of it outside the filter.
    """
    n = stop - start
    long = np.empty((n + 2 * padding, ABREAST))
    for first in range(0, len(rows), ABREAST):
        last = min(first + ABREAST, len(rows)) - 1
        for lane in range(ABREAST):  # the last row once more where there are fewer
            _extended(rows[min(first + lane, last), start:stop], padding, long[:, lane])
        _through(sections, rest, long)
        _through(sections, rest, long[::-1])
        for i in range(first, last + 1):
            for k in range(n):
                rows[i, start + k] = long[padding + k, i - first]


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
    """Both sections, from rest at the first value, in place; direct form II transposed.

    `values` are of shape (n, 4). What a section remembers of each of them, z and w, is in numbers of its own: an
    array of them would be written and read once a sample, which takes longer than the sums. The second section goes
    along with the first, as while one waits for its last result the other can go on.
    """
    b0, b1, b2, a1, a2 = sections[0, 0], sections[0, 1], sections[0, 2], sections[0, 4], sections[0, 5]
    d0, d1, d2, c1, c2 = sections[1, 0], sections[1, 1], sections[1, 2], sections[1, 4], sections[1, 5]
    x0, x1, x2, x3 = values[0, 0], values[0, 1], values[0, 2], values[0, 3]
    z0, z1, z2, z3 = rest[0, 0] * x0, rest[0, 0] * x1, rest[0, 0] * x2, rest[0, 0] * x3
    w0, w1, w2, w3 = rest[0, 1] * x0, rest[0, 1] * x1, rest[0, 1] * x2, rest[0, 1] * x3
    s0, s1, s2, s3 = rest[1, 0] * x0, rest[1, 0] * x1, rest[1, 0] * x2, rest[1, 0] * x3
    t0, t1, t2, t3 = rest[1, 1] * x0, rest[1, 1] * x1, rest[1, 1] * x2, rest[1, 1] * x3
    for k in range(len(values)):
        x0, x1, x2, x3 = values[k, 0], values[k, 1], values[k, 2], values[k, 3]
        y0, y1, y2, y3 = b0 * x0 + z0, b0 * x1 + z1, b0 * x2 + z2, b0 * x3 + z3
        z0, z1 = b1 * x0 - a1 * y0 + w0, b1 * x1 - a1 * y1 + w1
        z2, z3 = b1 * x2 - a1 * y2 + w2, b1 * x3 - a1 * y3 + w3
        w0, w1, w2, w3 = b2 * x0 - a2 * y0, b2 * x1 - a2 * y1, b2 * x2 - a2 * y2, b2 * x3 - a2 * y3
        x0, x1, x2, x3 = d0 * y0 + s0, d0 * y1 + s1, d0 * y2 + s2, d0 * y3 + s3
        s0, s1 = d1 * y0 - c1 * x0 + t0, d1 * y1 - c1 * x1 + t1
        s2, s3 = d1 * y2 - c1 * x2 + t2, d1 * y3 - c1 * x3 + t3
        t0, t1, t2, t3 = d2 * y0 - c2 * x0, d2 * y1 - c2 * x1, d2 * y2 - c2 * x2, d2 * y3 - c2 * x3
        values[k, 0], values[k, 1], values[k, 2], values[k, 3] = x0, x1, x2, x3
