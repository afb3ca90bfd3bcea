"""Pieces of a recording that are gone through side by side, where what a recursion began with is soon forgotten.

A state that is forgotten as an axis moves, as a bristle's is, is the same wherever a recursion along the motion began,
once it has moved far enough. So a piece begins so much earlier that it has forgotten that, and what it gives until then
is not used. Pieces take as many rows each, lead-in and all.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from autotune.core.arrays import Floats, Integers

WORTH = 0.75
"""Of all rows: pieces that take more of them each are not worth the trouble."""


class Pieces(NamedTuple):
    """Where pieces are: rows that each takes, the first that it takes, and those that it gives, shape (pieces,)."""

    rows: int
    first: Integers
    begin: Integers
    end: Integers


def in_pieces(moved: Floats, far: float, most: int, shared: int) -> Pieces | None:
    """The shortest pieces of a motion, at most so many; None where they are hardly shorter than all.

    Args:
        moved: the way until each row, shape (n,), growing.
        far: the way in which all is forgotten.
        shared: rows before a piece's own ones that it has forgotten all by, too, to compare it with the one before.
    """
    n = len(moved)
    low, high, best = max(-(-n // most) - 1, shared), int(WORTH * n), None
    while high - low > max(n // 200, 1):
        middle = (low + high) // 2
        found = _of_length(moved, far, most, shared, middle)
        low, high, best = (middle, high, best) if found is None else (low, middle, found)
    return best


def _of_length(moved: Floats, far: float, most: int, shared: int, rows: int) -> Pieces | None:
    """Pieces of so many rows each; None where so many of them do not reach the end."""
    n = len(moved)
    first, end = [0], [rows]
    while end[-1] < n and len(end) < most:
        least = moved[max(end[-1] - shared, 0)] - far
        first.append(int(min(max(np.searchsorted(moved, least, "right") - 1, 0), n - rows)))
        end.append(first[-1] + rows)
        if end[-1] <= end[-2]:
            return None
    return Pieces(rows, np.array(first), np.array([0, *end[:-1]]), np.array(end)) if end[-1] >= n else None
