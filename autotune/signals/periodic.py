"""Whether a reference repeats itself, and after how long: such a recording is held out by phase, not by time.

A stretch of time left out of a periodic motion is seen again in every other period, so that any free function of
position and velocity is known there by heart. A range of phases left out is seen nowhere else.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from autotune.core.arrays import Floats

MOST, LEAST = 20, 5
"""Ranges of phases that a period is cut into."""
FOLD_SECONDS = 0.3
ALIKE = 2e-3
"""Mean squared difference a period later, of twice the variance."""
APART = 0.5
"""What it must have come to in between."""
MOST_POINTS = 1 << 15
LEAST_PERIODS = 2.0


@dataclass(frozen=True, slots=True)
class Periodic:
    """Rows `start` to `stop` whose motion repeats itself after `samples` rows; `folds` ranges of phases."""

    start: int
    stop: int
    samples: float
    folds: int

    def fold(self, rows: NDArray[np.int64]) -> NDArray[np.int64]:
        """Which range of phases rows are in, 0 … folds − 1."""
        phase = np.mod((rows - self.start) / self.samples, 1.0)
        number = np.minimum(np.floor(phase * self.folds), self.folds - 1)
        return np.asarray(number, dtype=np.int64)


def periodic(values: Floats, start: int, period: float) -> Periodic | None:
    """Values from row `start` on, where they repeat themselves; `period` of a row [s]."""
    samples = period_of(values)
    if samples is None:
        return None
    folds = min(MOST, max(LEAST, round(samples * period / FOLD_SECONDS)))
    return Periodic(start, start + len(values), samples, folds)


def period_of(values: Floats) -> float | None:
    """Rows after which values of shape (n,) come again, to a fraction of a row; None where they do not."""
    every = max(1, len(values) // MOST_POINTS)
    thin = values[::every]
    if len(thin) < 50 or np.ptp(thin) == 0.0:
        return None
    difference = _difference(thin)
    far = np.flatnonzero(difference > APART)
    if len(far) == 0:
        return None
    first = int(far[0])
    between = _between_lags(difference)
    near = np.flatnonzero(between[first:] < ALIKE)
    if len(near) == 0:
        return None
    begin = first + int(near[0])
    after = np.flatnonzero(between[begin:] >= ALIKE)
    end = begin + int(after[0]) if len(after) else len(difference)
    period = _lowest(difference, begin + int(np.argmin(difference[begin:end])))
    return _refined(difference, period) * every


def _difference(values: Floats) -> Floats:
    """Mean squared difference of values a lag apart over twice their variance, by lag up to half of them."""
    n = len(values)
    centred = values - values.mean()
    lags = np.arange(int(n / LEAST_PERIODS) + 1)
    product = scipy.signal.correlate(centred, centred, method="fft")[n - 1 :][: len(lags)]
    energy = np.concatenate([[0.0], np.cumsum(centred**2)])
    ends = energy[n - lags] + energy[n] - energy[lags]
    variance = max(float(np.var(values)), 1e-300)
    return np.asarray((ends - 2.0 * product) / (n - lags) / (2.0 * variance), dtype=np.float64)


def _between_lags(difference: Floats) -> Floats:
    """The least within one lag of each, by a parabola: a short period half a row off no lag is one all the same."""
    before, here, after = difference[:-2], difference[1:-1], difference[2:]
    curve = before - 2.0 * here + after
    valley = (curve > 0.0) & (np.abs(before - after) <= 2.0 * curve)
    depth = (before - after) ** 2 / (8.0 * np.where(valley, curve, 1.0))
    lowest = difference.copy()
    lowest[1:-1] -= np.where(valley, depth, 0.0)
    return lowest


def _lowest(difference: Floats, at: int) -> float:
    """The vertex of the parabola through a minimum and its neighbours."""
    if not 0 < at < len(difference) - 1:
        return float(at)
    before, here, after = difference[at - 1 : at + 2]
    curve = before - 2.0 * here + after
    return at + float(0.5 * (before - after) / curve) if curve > 0.0 else float(at)


def _refined(difference: Floats, period: float) -> float:
    """The period from the minimum after twice, four times, … as many of them."""
    count = 2
    while count * period < len(difference) - 2:
        around = round(count * period)
        reach = max(1, round(0.2 * period))
        low = max(1, around - reach)
        at = low + int(np.argmin(difference[low : around + reach + 1]))
        if difference[at] > 4.0 * ALIKE:
            break
        period = _lowest(difference, at) / count
        count *= 2
    return period
