"""Runs of rows that are alike, and the noise of rows that go smoothly on."""

from __future__ import annotations

import math

import numpy as np

from autotune.core.arrays import Flags, Floats

NORMAL_QUARTILE = 0.6745
"""Standard deviations to the upper quartile of the normal distribution."""


def runs_of(chosen: Flags) -> list[tuple[int, int]]:
    """Where runs of chosen rows begin and end, the end being the first row after it; `chosen` of shape (n,)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], chosen, [False]]).astype(np.int8)))
    return [(start, stop) for start, stop in edges.reshape(-1, 2).tolist()]


def white_noise(values: Floats) -> float:
    """Standard deviation of white noise on smooth values of shape (n,), n > 2: by the median of second differences.

    What goes smoothly on has next to none of them, and a few leaps do not move a median.
    """
    return float(np.median(np.abs(np.diff(values, 2)))) / (NORMAL_QUARTILE * math.sqrt(6.0))
