"""Stretches of constant velocity in any position signal.

The signal is cut at its reversals, then each piece, as long as it is not straight, where it is bent
most. What is straight is a leg; its ends are trimmed, so that inertia and the bristle have settled.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from autotune.core.arrays import Floats

_DEEPEST = 6
_BEND = 0.04
"""A piece is straight where it leaves its chord by less than this share of its length."""


@dataclass(frozen=True, slots=True)
class Leg:
    """Rows `start` to `stop` (exclusive) at `velocity` [rad/s or m/s]."""

    start: int
    stop: int
    velocity: float

    @property
    def rows(self) -> slice:
        return slice(self.start, self.stop)

    def __len__(self) -> int:
        return self.stop - self.start


def find_legs(
    path: Floats, period: float, resolution: float, settle_distance: float = 0.0, settle_time: float = 0.03
) -> list[Leg]:
    """Legs of a position signal of shape (n,), trimmed.

    Args:
        path: reference where there is one, else measured position.
        resolution: what the signal can be trusted to; movements below 5 of it are no legs.
        settle_distance, settle_time: what is cut off after the start of each leg; a sixth of the leg
            at its start and a twentieth at its end are cut at least.
    """
    tolerance = max(resolution, 1e-12)
    span = float(np.ptp(path)) if len(path) else 0.0
    if span < 5.0 * tolerance:
        return []
    legs: list[Leg] = []
    for start, stop in _monotone(path, max(3.0 * tolerance, 0.01 * span)):
        legs += [
            _trimmed(path, piece, period, settle_distance, settle_time)
            for piece in _straight(path, start, stop, tolerance, 0)
        ]
    return [leg for leg in legs if len(leg) >= 8 and abs(leg.velocity) * len(leg) * period > 5 * tolerance]


def _monotone(path: Floats, threshold: float) -> list[tuple[int, int]]:
    """Pieces between turning points; a turn counts once the signal has come back by `threshold`."""
    turns = [0]
    low = high = 0
    direction = 0
    for index, value in enumerate(path.tolist()):
        if value > path[high]:
            high = index
        if value < path[low]:
            low = index
        if direction >= 0 and value < path[high] - threshold:
            if direction:
                turns.append(high)
            direction, low = -1, index
            high = index
        elif direction <= 0 and value > path[low] + threshold:
            if direction:
                turns.append(low)
            direction, high = 1, index
            low = index
    turns.append(len(path))
    return [(a, b) for a, b in itertools.pairwise(turns) if b - a > 8]


def _straight(path: Floats, start: int, stop: int, tolerance: float, depth: int) -> list[tuple[int, int]]:
    if stop - start < 16:
        return []
    inner = path[start:stop]
    chord = np.linspace(inner[0], inner[-1], len(inner))
    away = np.abs(inner - chord)
    length = abs(inner[-1] - inner[0])
    worst = int(np.argmax(away))
    if length < 5.0 * tolerance:
        return []
    if away[worst] <= max(_BEND * length, 1.5 * tolerance):
        return [(start, stop)]
    if depth == _DEEPEST:
        return []
    middle = start + min(max(worst, 8), len(inner) - 8)
    return _straight(path, start, middle, tolerance, depth + 1) + _straight(
        path, middle, stop, tolerance, depth + 1
    )


def _trimmed(path: Floats, piece: tuple[int, int], period: float, distance: float, time: float) -> Leg:
    start, stop = piece
    length = stop - start
    speed = abs(path[stop - 1] - path[start]) / max(length - 1, 1)
    head = max(length // 6, round(time / period), round(distance / speed) if speed > 0 else length)
    first, last = start + head, stop - max(length // 20, 2)
    if last - first < 8:
        return Leg(start, start, 0.0)
    rows = np.arange(first, last)
    slope = np.polyfit(rows - first, path[first:last], 1)[0]
    return Leg(first, last, float(slope / period))
