"""The noise floor: what repeats of an experiment do not share, as an estimate with its interval.

With errors e_k of k repeats of one trajectory the variance over repeats estimates the noise, whatever a
model lacks (that is the same in all of them). A chunk of n rows with an autocorrelation r_l of the noise
has about ν = n·(k − 1)/(1 + 2·Σ r_l²) degrees of freedom, and its variance a relative standard error of
√(2/ν) (Bartlett 1946); the interval is that of the logarithm of the pooled variance.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.estimation.problem import CHUNK, Study

LAGS = 40
"""Grid rows over which noise may be correlated: 0.2 s."""
QUANTILE = 1.96
"""Of the normal distribution, for an interval of 95 %."""


@dataclass(frozen=True, slots=True)
class NoiseFloor:
    """Estimate of the noise's rms [N m or N], and its interval of 95 %."""

    rms: float
    low: float
    high: float

    @property
    def interval(self) -> tuple[float, float]:
        return self.low, self.high


def noise_floor(study: Study, error: Floats, rows: Flags) -> NoiseFloor | None:
    """The floor under the error of repeated experiments, every row alike; None where nothing was repeated.

    Args:
        error: residual on the grid, shape (m,); rows: those that count, shape (m,).
    """
    chunks = [
        chunk
        for block in study.data.blocks
        if block.repeats > 1
        for chunk in _chunks(
            error[block.rows].reshape(block.repeats, -1), rows[block.rows].reshape(block.repeats, -1)
        )
    ]
    if not chunks:
        return None
    variance, freedom, count = np.array(chunks).T
    share = count / count.sum()
    mean = float(share @ variance)
    if mean <= 0.0:
        return NoiseFloor(0.0, 0.0, 0.0)
    spread = math.sqrt(float(np.sum(share**2 * 2.0 * variance**2 / freedom))) / mean
    reach = math.exp(0.5 * QUANTILE * spread)
    rms = math.sqrt(mean)
    return NoiseFloor(rms, rms / reach, rms * reach)


def _chunks(table: Floats, counted: Flags) -> list[tuple[float, float, float]]:
    """Variance over repeats, its degrees of freedom and the rows of every chunk of about a second."""
    kept = counted.all(axis=0)
    found = []
    for part in np.array_split(np.flatnonzero(kept), max(1, int(kept.sum()) // CHUNK)):
        if len(part) < 2:
            continue
        values = table[:, part]
        freedom = len(part) * (len(values) - 1) / _correlated(values - values.mean(axis=0))
        found.append((float(values.var(axis=0, ddof=1).mean()), max(freedom, 1.0), float(values.size)))
    return found


def _correlated(noise: Floats) -> float:
    """1 + 2·Σ r_l², rows that count as one for a variance; `noise` of shape (repeats, rows)."""
    power = float(np.sum(noise**2))
    if power <= 0.0:
        return 1.0
    repeats, size = noise.shape
    lags = range(1, min(LAGS, size - 1) + 1)
    products = np.array([float(np.sum(noise[:, lag:] * noise[:, :-lag])) for lag in lags]) / power
    by_chance = len(lags) / float(size * max(repeats - 1, 1))  # what Σ r_l² of white noise is on average
    beyond: float = max(float(np.sum(products**2)) - by_chance, 0.0)
    return 1.0 + 2.0 * beyond
