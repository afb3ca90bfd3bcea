"""Torque and motion of other people's files: their columns are shifted against each other.

Anything from a filtered position, read late, to a torque that was logged after the bus. Where neither a
controller nor repeats tell how they belong together, the torque is moved by fractions of a sample to
where a model explains it best, the nearest such place.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy import ndimage

from autotune.core.arrays import Flags
from autotune.estimation.data import Prepared
from autotune.estimation.residual import smoothed

EARLIEST, LATEST = -4.0, 6.0
"""Half samples of the file by which the torque may be moved."""
LEAST_FAST = 0.2


def best_shift(cost: Callable[[float], float], start: float, finer: int = 1) -> tuple[float, float]:
    """The nearest minimum of a cost over the shift, in tenths of half samples, and its cost there.

    `finer`: rows for each sample of the file.
    """
    earliest, latest = finer * EARLIEST, finer * LATEST
    known: dict[float, float] = {}

    def at(shift: float) -> float:
        if shift not in known:
            known[shift] = cost(shift)
        return known[shift]

    best = start
    for _ in range(round(latest - earliest)):
        near = [s for s in (best - 1.0, best + 1.0) if earliest <= s <= latest]
        better = min(near, key=at)
        if at(better) >= at(best):
            break
        best = better
    if not earliest <= best - 1.0 <= best + 1.0 <= latest:
        return best, at(best)
    before, here, after = at(best - 1.0), at(best), at(best + 1.0)
    curve = before - 2.0 * here + after
    vertex = round(best + 0.5 * (before - after) / curve, 1) if curve > 0.0 else best
    return min((best, vertex), key=at), min(at(best), at(vertex))


def shifted(data: Prepared, half_samples: float) -> Prepared:
    """The data with the recorded torque moved to later motion by so many half samples."""
    torque = data.recorded_torque.copy()
    for stretch in data.stretches:
        rows = np.arange(stretch.start, stretch.stop, dtype=np.float64)
        recorded = data.recorded_torque[stretch.rows]
        torque[stretch.rows] = np.interp(rows + 0.5 * half_samples, rows, recorded)
    return replace(data, torque=torque, shift=half_samples)


def aligned(data: Prepared) -> Prepared:
    """The data with the torque shifted to where it fits inertia and friction best.

    Rows near a reversal do not count: friction that reverses over some travel looks like a delay.
    """
    rows = away_from_reversals(data)
    return shifted(
        data, best_shift(lambda shift: linear_misfit(shifted(data, shift), rows), 0.0, data.finer)[0]
    )


def away_from_reversals(data: Prepared) -> Flags:
    """Grid rows whose low-pass sees one direction only, shape (m,); all where those are too few."""
    speed = np.abs(data.velocity)
    slow = speed < 0.1 * float(np.percentile(speed, 99.5))
    near = ndimage.maximum_filter1d(slow, 2 * (len(data.taps) // 2) + 1)
    rows = np.asarray(~near[data.grid])
    return rows if rows.mean() > LEAST_FAST else np.ones(len(rows), dtype=np.bool_)


def linear_misfit(data: Prepared, rows: Flags) -> float:
    """Share of the torque's variance that inertia, friction and offset leave on some grid rows."""
    torque = data.torque
    acted = np.concatenate([torque[:1], 0.5 * (torque[1:] + torque[:-1])])
    table = np.column_stack(
        [
            smoothed(data, data.acceleration),
            smoothed(data, data.velocity),
            smoothed(data, np.sign(data.velocity)),
            np.ones(len(data.grid)),
        ]
    )
    target, table = smoothed(data, np.ascontiguousarray(acted))[rows], table[rows]
    table = table / np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    left = target - table @ np.linalg.lstsq(table, target, rcond=1e-10)[0]
    return float(np.sum(left**2)) / max(float(np.sum((target - target.mean()) ** 2)), 1e-300)
