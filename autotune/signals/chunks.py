"""What comes again and what is chance: means of rows with their errors, second by second, as noise has a colour."""

from __future__ import annotations

import math

import numpy as np

from autotune.core.arrays import Floats

CHUNK = 200  # grid rows, about a second


def shared(table: Floats) -> Floats:
    """Mean product of two repeats, row by row, of a table of shape (repeats, count)."""
    k = len(table)
    return np.asarray((table.sum(axis=0) ** 2 - (table**2).sum(axis=0)) / (k * (k - 1)))


def chunk_means(values: Floats) -> Floats:
    """Means of the values of rows over every second or so, and how many rows each has, shape (pieces, 2)."""
    pieces = max(1, len(values) // CHUNK)
    return np.array([[part.mean(), len(part)] for part in np.array_split(values, pieces)])


def by_second(values: Floats) -> Floats:
    """Sums of the values of rows over every second or so, three of them at least."""
    return np.array([part.sum() for part in np.array_split(values, max(3, len(values) // CHUNK))])


def beyond_chance(values: Floats, times: float) -> bool:
    """Whether the mean of rows is more than so many times its standard error, second by second."""
    seconds = by_second(values)
    error = float(seconds.std(ddof=1)) / math.sqrt(len(seconds))
    return float(seconds.mean()) > times * error


def mean_and_error(chunks: list[Floats]) -> tuple[float, float]:
    """Mean of pieces by their rows (`chunk_means`) and its standard error; nan without any."""
    if not chunks:
        return float("nan"), float("nan")
    means, counts = np.concatenate(chunks).T
    mean = float(np.average(means, weights=counts))
    if len(means) < 3:
        return mean, abs(mean)
    share = counts / counts.sum()
    return mean, float(np.sqrt(np.sum(share**2 * (means - mean) ** 2)))
