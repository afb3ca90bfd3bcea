"""What is between the samples of a signal, and signals that come late."""

from __future__ import annotations

import math
from functools import reduce
from operator import add

import numpy as np
import scipy

from autotune.core.arrays import Floats, Integers
from autotune.core.kernel_cache import kernel


def delayed(values: Floats, late: int, before: float) -> Floats:
    """Values `late` samples ago, shape (n,); `before` where that is before the first."""
    if late == 0:
        return values
    shown: Floats = np.concatenate([np.full(min(late, len(values)), before), values[:-late]])
    return shown


def later(values: Floats, count: float, every: int = 1) -> Floats:
    """Values of shape (…, n) so many places later, on straight lines between them; the first stays until then.

    Of `every` so many places the first one only.
    """
    if count == 0.0:
        return values[..., ::every]
    whole = int(count)
    first, last = values[..., :1], values.shape[-1]
    if every > 1:
        here = np.arange(0, last, every) - whole
        now, before = values[..., np.maximum(here, 0)], values[..., np.maximum(here - 1, 0)]
    else:
        held = np.concatenate([np.repeat(first, whole + 1, axis=-1), values], axis=-1)
        now, before = held[..., 1 : last + 1], held[..., :last]
    return np.asarray(now + (count - whole) * (before - now))


def row_means(table: Floats) -> Floats:
    """Mean of each row of a table of few columns, shape (n, k): to the last bit numpy's, which goes row by row.

    From eight columns on it has eight sums, of every eighth, and what is beyond the last eight is added to their sum.
    """
    count = table.shape[1]
    eights = count - count % 8
    columns = list(table.T)
    parts = [reduce(add, columns[first:eights:8]) for first in range(8 if eights else 0)]
    while len(parts) > 1:
        parts = [one + other for one, other in zip(parts[::2], parts[1::2], strict=True)]
    for i in range(eights, count):
        parts = [parts[0] + columns[i] if parts else columns[i]]
    return np.asarray(parts[0] / count)


def finer(values: Floats, ticks: int, cubic: bool) -> Floats:
    """Values of shape (n,) on the way from each to the next, shape (n·ticks,); beyond the last as before it.

    On straight lines, or on the cubics whose slopes at the samples are those of their neighbours (Catmull and Rom).
    """
    beyond = 2.0 * values[-1:] - values[-2:-1]
    known = np.concatenate([values[:1], values, beyond, beyond])
    fine = np.empty(len(values) * ticks)
    _finer(known, ticks, cubic, fine)
    return fine


@kernel
def _finer(known: Floats, ticks: int, cubic: bool, fine: Floats) -> None:
    """`finer` of values with one before them and two beyond, written to `fine`."""
    for k in range(len(fine) // ticks):
        zero, one, two, three = known[k], known[k + 1], known[k + 2], known[k + 3]
        for i in range(ticks):
            part = i / ticks
            if cubic:
                bend = 2.0 * zero - 5.0 * one + 4.0 * two - three + part * (3.0 * (one - two) + three - zero)
                fine[k * ticks + i] = one + 0.5 * part * (two - zero + part * bend)
            else:
                fine[k * ticks + i] = one + part * (two - one)


def bend_between(reference: Floats, period: float, ticks: int, smooth: bool) -> Floats:
    """Second difference around each set point, which a drive knows on its way to it; on lines if smooth, else held."""
    rate = np.diff(reference) / period
    bend = np.asarray(np.diff(rate, prepend=rate[:1], append=rate[-1:]) / period)
    return finer(bend, ticks, cubic=False) if smooth else np.repeat(bend, ticks)


def around(values: Floats, period: float) -> tuple[Floats, Floats]:
    """Rate and second difference around each of the values, shape (n,) each; at both ends those of the parabola there.

    What a planner knows at the moment of a row, where motion is smooth: of its acceleration a second difference has
    a twelfth of the fourth one more.
    """
    if len(values) < 3:
        return np.zeros(len(values)), np.zeros(len(values))
    bend = np.diff(values, 2) / period**2
    rate = np.asarray(np.gradient(values, period, edge_order=2))
    return rate, np.concatenate([bend[:1], bend, bend[-1:]])


def missed_around(bend: Floats) -> Floats:
    """How much second differences around values, shape (n,), may be off from what is at the value's moment, shape (n,).

    The leading term of smooth motion, a twelfth of the fourth difference: the largest of a row and its neighbours, as
    what begins between two rows is in both.
    """
    bends = np.diff(bend, 2, prepend=bend[:1], append=bend[-1:])
    return np.asarray(scipy.ndimage.maximum_filter1d(np.abs(bends), 3) / 12.0)


def rate_between(reference: Floats, fine: Floats, period: float, ticks: int, smooth: bool) -> Floats:
    """Rate of the reference between set points: on lines from one to the next if smooth, else by its steps."""
    if smooth:
        return finer(np.asarray(np.gradient(reference)) / period, ticks, cubic=False)
    return np.asarray(np.diff(fine, prepend=fine[:1]) * (ticks / period))


@kernel
def filtered_terms(moved: Floats, wanted: Floats, edges: Integers, smoothing: float, terms: Floats) -> None:
    """Filtered rates of −y and r to columns 1 and 3; as `scipy.signal.lfilter` sums them, in each stretch."""
    left = smoothing - 1.0
    for i in range(len(edges)):
        before, ahead = 0.0, 0.0
        for k in range(edges[i, 0], edges[i, 1]):
            rate, speed = before + smoothing * moved[k], ahead + smoothing * wanted[k]
            terms[k, 1], terms[k, 3] = -rate, speed
            before, ahead = -(left * rate), -(left * speed)


@kernel
def filtered_rates(fine: Floats, edges: Integers, step: float, share: float, moved: Floats) -> None:
    """Filtered rates of values, 0 at first, as `scipy.signal.lfilter` sums them, in each stretch."""
    left = share - 1.0
    for i in range(len(edges)):
        ahead, last = 0.0, fine[edges[i, 0]]
        for k in range(edges[i, 0], edges[i, 1]):
            rate = ahead + share * ((fine[k] - last) / step)
            moved[k], ahead, last = rate, -(left * rate), fine[k]


def between_moments(values: Floats) -> Floats:
    """Mean of each of the values, recorded as at the samples, and the next; shape (…, n)."""
    return np.asarray(0.5 * (values + np.concatenate([values[..., 1:], values[..., -1:]], axis=-1)))


def mean_answer(values: Floats, period: float, gains: tuple[float, float, float], rate: float) -> Floats:
    """What kp·x + kd·λ/(s + λ)·ẋ + ki·∫x comes to from each sample to the next, in the mean; shape (…, n).

    The values lie on straight lines between the samples, and on the last one after it; all begins at rest.

    Args:
        period: between the samples [s].
        gains: kp, kd and ki.
        rate: λ, of the filter of the rate [1/s].
    """
    rows = np.array(values, dtype=np.float64, order="C").reshape(-1, values.shape[-1])
    _mean_answers(rows, period, *gains, rate)
    return rows.reshape(values.shape)


@kernel
def _mean_answers(rows: Floats, period: float, kp: float, kd: float, ki: float, rate: float) -> None:
    """`mean_answer` of rows of shape (k, n), in place."""
    left = math.exp(-rate * period)
    mean = (1.0 - left) / (rate * period)
    for row in rows:
        filtered, summed = 0.0, 0.0
        for k in range(len(row)):
            here, ahead = row[k], row[min(k + 1, len(row) - 1)]
            slope = (ahead - here) / period
            within = summed + period * (here / 3.0 + ahead / 6.0)
            row[k] = 0.5 * kp * (here + ahead) + kd * (slope + (filtered - slope) * mean) + ki * within
            filtered = slope + (filtered - slope) * left
            summed += 0.5 * period * (here + ahead)
