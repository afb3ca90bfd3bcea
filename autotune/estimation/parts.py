"""Parts of a recording: as much of it as a fit looks at, and as much as its sensitivities need.

What comes after the last fitted row (veto and test) need not be computed during a fit. Sensitivities are the
same in every repeat of an experiment, as long as nothing but the motion decides them: they are taken on the
first round and copied.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.estimation.data import TRAINING, Block, Prepared, Stretch
from autotune.models import layout
from autotune.models.table import EFFECTS

SAME_PLACE = 0.01
"""Of the travel: repeats that are further apart are not the same motion."""
_DRIFTING = [layout.flag(kind.name) for kind in EFFECTS.values() if kind.drifts]


def until_last(data: Prepared, rows: Flags) -> Prepared:
    """The data up to the last sample that these grid rows need; residuals are 0 after it."""
    needed = data.grid[rows]
    if len(needed) == 0:
        return data
    end = int(needed.max()) + len(data.taps) // 2 + 1
    stretches = (Stretch(s.start, min(s.stop, end), s.closed) for s in data.stretches if s.start < end)
    return replace(data, stretches=tuple(stretches))


def first_round(data: Prepared, on: Flags) -> Prepared:
    """The data up to the end of the first repeats; all that is fitted where repeats are not alike.

    What drifts makes them differ, and so does another place.
    """
    rows = data.role(TRAINING)
    if not on[_DRIFTING].any():
        for block in _alike(data):
            rows[block.rows] = np.arange(block.repeats * block.count) < block.count
    return until_last(data, rows)


def spread(data: Prepared, columns: Floats, on: Flags) -> None:
    """Copies what `first_round` gives of columns, shape (m, k), to the other repeats; other roles get 0."""
    columns[~data.role(TRAINING)] = 0.0
    if on[_DRIFTING].any():
        return
    for block in _alike(data):
        part = columns[block.rows]
        part[:] = np.tile(part[: block.count], (block.repeats, 1))


def _alike(data: Prepared) -> list[Block]:
    """Fitted blocks whose repeats are the same motion at the same place."""
    position = data.position[data.grid]
    apart = SAME_PLACE * float(np.ptp(position)) if len(position) else 0.0
    found: list[Block] = []
    for block in data.blocks:
        if block.role == TRAINING and block.repeats > 1:
            table = position[block.rows].reshape(block.repeats, block.count)
            if float(np.max(np.abs(table[1:] - table[0]))) <= apart:
                found.append(block)
    return found
