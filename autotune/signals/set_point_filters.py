"""Filters that a drive has its set points go through: a running mean, or equal first-order lags one after the other.

Drives take corners off their set points before the position loop sees them. The running mean ("moving average",
"jerk filter") makes of a step of the speed a ramp, lags ("command smoothing", "PT1", "PT2") an exponential; between
set points that come once a row they go on lines.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy

from autotune.core.arrays import Floats


@dataclass(frozen=True, slots=True)
class SetPointFilter:
    """A filter of set points. `named`: as it is told, of a time in ms; `apply`: of values of shape (n,) that come once
    a row, with its time in rows: the mean's length, or the sum of the lags' time constants."""

    named: str
    apply: Callable[[Floats, float], Floats]


def running_mean(values: Floats, rows: float) -> Floats:
    """Mean over the last `rows` (above 0) of values on lines, which stood before the first; shape (n,)."""
    summed = np.concatenate([[0.0], np.cumsum(0.5 * (values[1:] + values[:-1]))])
    begins = np.arange(len(values)) - rows
    first = np.clip(np.floor(begins).astype(np.int64), 0, max(len(values) - 2, 0))
    part = np.maximum(begins - first, 0.0)
    slope = np.append(np.diff(values), 0.0)[first]
    until = summed[first] + part * values[first] + 0.5 * part**2 * slope + np.minimum(begins, 0.0) * values[0]
    return np.asarray((summed - until) / rows)


def equal_lags(count: int, values: Floats, rows: float) -> Floats:
    """`values` of shape (n,) through `count` first-order lags whose time constants sum up to `rows` (above 0)."""
    constant = rows / count
    kept = math.exp(-1.0 / constant)
    held = constant * -math.expm1(-1.0 / constant)
    shown = values - values[0]
    for _ in range(count):
        shown = scipy.signal.lfilter([1.0 - held, held - kept], [1.0, -kept], shown)
    return np.asarray(shown + values[0])


SET_POINT_FILTERS = (
    SetPointFilter("a running mean of {:.3g} ms", running_mean),
    SetPointFilter("a first-order lag of {:.3g} ms", partial(equal_lags, 1)),
    SetPointFilter("two equal lags of {:.3g} ms together", partial(equal_lags, 2)),
    SetPointFilter("three equal lags of {:.3g} ms together", partial(equal_lags, 3)),
)
