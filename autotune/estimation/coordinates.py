"""Coordinates in which a residual can live, and the share of its variance that each explains (η²)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TypeAlias

import numpy as np
import scipy

from autotune.core.arrays import Flags, Floats, Integers
from autotune.estimation.data import STANDSTILL_COUNTS, STANDSTILL_SECONDS, Prepared
from autotune.models.compiled import compiled

COUNT = 24
REST_SECONDS, REST_REACH = 0.1, 0.1
"""An axis rests where it moves no further in this time [s] than this part of its contact's reach, or a count's edge."""
FORGOTTEN = 0.05
"""Of a bristle's stretch at a rest: less tells nothing of it."""
Rests: TypeAlias = tuple[Integers, Floats]
"""As `since_rest` has them."""


def since_reversal(data: Prepared) -> tuple[Floats, Floats]:
    """Travel [motion unit] and time [s] since the last reversal, on the grid.

    A reversal counts once the axis has come back by three counts.
    """
    travel, samples = _by_sample(data)
    return travel[data.grid], samples[data.grid] * data.period


def travel_since_reversal(data: Prepared) -> Floats:
    """Travel since the last reversal [motion unit] of every sample, shape (n,)."""
    return _by_sample(data)[0]


def _by_sample(data: Prepared) -> tuple[Floats, Floats]:
    travel, samples = np.zeros(len(data.time)), np.zeros(len(data.time))
    least = 3.0 * data.resolution if data.resolution > 0 else 1e-4 * float(np.ptp(data.position))
    for stretch in data.stretches:
        _since(data.position[stretch.rows], least, travel[stretch.rows], samples[stretch.rows])
    return travel, samples


@compiled
def _since(position: Floats, least: float, travel: Floats, samples: Floats) -> None:
    """Travel and samples since the last reversal, written to the arrays, shape (n,)."""
    base, base_at = position[0], 0
    extreme, extreme_at, direction = position[0], 0, 0.0
    for k in range(len(position)):
        ahead = (position[k] - extreme) * direction
        if direction == 0.0 and abs(position[k] - extreme) > least:
            direction = 1.0 if position[k] > extreme else -1.0
            extreme, extreme_at = position[k], k
        elif ahead > 0.0:
            extreme, extreme_at = position[k], k
        elif ahead < -least:
            base, base_at = extreme, extreme_at
            direction = -direction
            extreme, extreme_at = position[k], k
        travel[k] = abs(position[k] - base)
        samples[k] = k - base_at


def coordinates(data: Prepared) -> dict[str, Floats]:
    """Values of every coordinate on the grid, shape (m,) each; temperature where it was recorded.

    Points of a speed curve have a speed and a direction; where and when they were measured is not kept.
    """
    velocity = data.velocity[data.grid]
    warmth = {} if data.temperature is None else {"temperature": data.temperature[data.grid]}
    if data.steady:
        return warmth | {"velocity": velocity, "direction": np.sign(velocity)}
    travel, time = since_reversal(data)
    return warmth | {
        "position": data.position[data.grid],
        "velocity": velocity,
        "acceleration": data.acceleration[data.grid],
        "direction": np.sign(velocity),
        "time": data.time[data.grid],
        "travel_since_reversal": np.log10(travel + 1e-9 * float(np.ptp(data.position)) + 1e-12),
        "time_since_reversal": np.log10(time + data.period),
    }


def variance_shares(data: Prepared, error: Floats, rows: Flags) -> dict[str, float]:
    """η² by coordinate, less what bins explain of noise by chance; each with the direction of motion."""
    table = coordinates(data)
    sign = table["velocity"] >= 0.0
    total = float(np.var(error[rows]))
    shares: dict[str, float] = {}
    for name, values in table.items():
        columns = bins(values, COUNT, rows)
        if name not in ("velocity", "direction", "time", "temperature"):
            columns = np.hstack([columns * sign[:, None], columns * ~sign[:, None]])
        shares[name] = _eta_squared(columns[rows], error[rows], total)
    return shares


def _eta_squared(columns: Floats, error: Floats, total: float) -> float:
    count = columns.sum(axis=0)
    used = count > 0
    mean = (columns.T @ error)[used] / count[used]
    between = float(np.sum(count[used] * (mean - error.mean()) ** 2)) / len(error)
    chance = (int(used.sum()) - 1) / max(len(error) / 4.0, 1.0)
    return float(np.clip(between / max(total, 1e-300) - chance, 0.0, 1.0))


def generic_columns(data: Prepared, rows: Flags) -> Mapping[str, Floats]:
    """Free functions that no physics stands behind: what they explain and physics does not is unknown."""
    table = coordinates(data)
    if data.steady:
        return {"velocity": bins(table["velocity"], 2 * COUNT, rows)}
    sign = (table["velocity"] >= 0.0)[:, None]
    position = bins(table["position"], COUNT, rows)
    travel = bins(table["travel_since_reversal"], COUNT, rows)
    return {
        "velocity": bins(table["velocity"], 2 * COUNT, rows),
        "acceleration": bins(table["acceleration"], COUNT, rows),
        "position": np.hstack([position * sign, position * ~sign]),
        "time": bins(table["time"], COUNT, rows),
        "travel_since_reversal": np.hstack([travel * sign, travel * ~sign]),
    }


def since_rest(data: Prepared, reach: float) -> Rests:
    """Number of the last rest of every grid row, and what is left there of the bristle's stretch at it, shape (m,).

    `reach`: way of the contact before it slides [motion unit]. Within a rest nothing is known of the stretch, nor where
    the low-pass reaches into a standstill, where friction holds any torque: nan.
    """
    number, left = np.zeros(len(data.time), dtype=np.int64), np.zeros(len(data.time))
    counts = STANDSTILL_COUNTS * data.resolution
    first = 0
    for stretch in data.stretches:
        position = data.position[stretch.rows]
        still = _moves_within(data, position, REST_SECONDS) < max(counts, REST_REACH * reach)
        still[0] = True  # how the bristle is stretched where a recording begins is not known either
        way = np.cumsum(np.abs(np.diff(position, prepend=position[:1])))
        last = np.maximum.accumulate(np.where(still, np.arange(len(position)), 0))
        stands = _moves_within(data, position, 2.0 * STANDSTILL_SECONDS) < counts
        near = scipy.ndimage.maximum_filter1d(still | stands, len(data.taps))
        number[stretch.rows] = first + np.cumsum(still & ~np.append(False, still[:-1]))
        left[stretch.rows] = np.where(near, np.nan, np.exp(-(way - way[last]) / reach))
        first = int(number[stretch.stop - 1]) + 1
    return number[data.grid], left[data.grid]


def _moves_within(data: Prepared, position: Floats, seconds: float) -> Floats:
    """How far the axis moves within so many seconds around every sample, shape (n,)."""
    window = 2 * max(1, round(0.5 * seconds * data.pace / data.period)) + 1
    highest = scipy.ndimage.maximum_filter1d(position, window)
    return np.asarray(highest - scipy.ndimage.minimum_filter1d(position, window))


def without_rests(error: Floats, rests: Rests) -> Floats:
    """An error without what a bristle's unknown stretch at each of the rests makes of it, shape (m,); 0 within rests.

    Vibrations below a count let the stretch creep while the axis rests, alike in every repeat and unlike in any twin;
    it is forgotten as the axis moves on.
    """
    number, left = rests
    rest = np.isnan(left)
    share = np.where(rest | (left < FORGOTTEN), 0.0, left)
    rest_error = np.where(rest, 0.0, error)
    stretch = np.bincount(number, share * rest_error) / np.maximum(np.bincount(number, share**2), 1e-300)
    return np.asarray(rest_error - share * stretch[number])


def bins(values: Floats, count: int, chosen: Flags) -> Floats:
    """One column per bin of equal population, shape (m, bins)."""
    edges = np.unique(np.quantile(values[chosen], np.linspace(0, 1, count + 1)[1:-1]))
    index = np.searchsorted(edges, values)
    return np.asarray(index[:, None] == np.arange(len(edges) + 1)[None, :], dtype=np.float64)
