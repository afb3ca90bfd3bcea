"""Codes that an encoder never tells: its reading jumps over the same few of them whenever the axis creeps by.

A scratch on a scale, a bit that sticks or an interpolation that is off leaves a place out. An axis may jump as well (it
sticks and slips), but not over the same codes each time, both ways: how often it jumps elsewhere says how likely it is
that all passes of one place did so by chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from autotune.core.arrays import Flags, Floats, Integers
from autotune.core.remembered import Remembered, digest_of

LEAST = 3
"""Codes from one that is told to the next: what rounding and one step of noise do not make."""
AROUND = 5
"""Rows on either side that say how fast the axis creeps: by at most one over `LEAST` of the jump in each."""
PASSES = 4
CHANCE = 1e-3
"""Passes of a place, at least, and how likely it may be that they all jumped by chance, at any of the places."""


@dataclass(frozen=True, slots=True)
class Gap:
    """Codes that are never told: from `place` to `place + width` [of the position]; `passes`: slow ones, all jumped."""

    place: float
    width: float
    passes: int


def missing_codes(measured: Floats, pieces: Sequence[slice], resolution: float) -> tuple[Gap, ...]:
    """Where an encoder leaves codes out; nothing where it has no known resolution.

    Args:
        measured: positions as they were read, shape (n,).
        pieces: rows, evenly sampled and contiguous.
        resolution: one count, in the position's unit; 0 where none is known.

    Of the positions that were asked for last it is remembered.
    """
    question = digest_of(measured), tuple((rows.start, rows.stop) for rows in pieces), float(resolution)
    return _FOUND.answer(question, lambda: _missing_codes(measured, pieces, resolution))


_FOUND: Remembered[tuple[Gap, ...]] = Remembered(4)


def _missing_codes(measured: Floats, pieces: Sequence[slice], resolution: float) -> tuple[Gap, ...]:
    parts = [part for part in (measured[rows] for rows in pieces) if len(part) > 2 * AROUND + 1]
    if resolution <= 0.0 or not parts:
        return ()
    codes = [np.rint(part / resolution).astype(np.int64) for part in parts]
    told = np.unique(np.concatenate(codes))
    wide = np.flatnonzero(np.diff(told) >= LEAST)
    low, high = told[wide], told[wide + 1]
    jumps, ordinary = zip(*(_slow_jumps(one) for one in codes), strict=True)
    below, above, upward = (np.concatenate(column) for column in zip(*jumps, strict=True))
    # which gap a jump goes over: the first that begins at its lower code or above
    gap = np.searchsorted(low, below)
    over = gap < len(low)
    over[over] &= high[gap[over]] <= above[over]
    elsewhere, steps = int(np.sum(~over)), int(sum(ordinary))
    by_chance = (elsewhere + 1.0) / (elsewhere + steps + 1.0)
    found = []
    for i in np.unique(gap[over]).tolist():
        mine = over & (gap == i)
        passes, ways = int(mine.sum()), len(np.unique(upward[mine]))
        if passes >= PASSES and ways == 2 and by_chance**passes * max(len(told), 1) <= CHANCE:
            found.append(Gap(float(low[i] * resolution), float((high[i] - low[i]) * resolution), passes))
    return tuple(found)


def _slow_jumps(codes: Integers) -> tuple[tuple[Integers, Integers, Flags], int]:
    """Steps over `LEAST` codes and more amid slow ones: the lower and upper code, whether upwards; how many are less.

    Only what creeps is looked at: at speed the rows leave out codes of any encoder.
    """
    steps = np.diff(codes)
    size = np.abs(steps)
    rows = np.lib.stride_tricks.sliding_window_view(size, AROUND)
    pace = np.full(len(size), np.inf)
    pace[AROUND:-AROUND] = np.maximum(
        np.median(rows[: -AROUND - 1], axis=1), np.median(rows[AROUND + 1 :], axis=1)
    )
    jumps = (size >= LEAST) & (LEAST * pace <= size)
    at = np.flatnonzero(jumps)
    below, above = np.minimum(codes[at], codes[at + 1]), np.maximum(codes[at], codes[at + 1])
    ordinary = int(np.sum((size > 0) & (size < LEAST) & (pace <= 1.0)))
    return (below, above, steps[at] > 0), ordinary
