"""Gains of a recursion, where some of its rows do not hold and its values are rounded to steps.

A value's change by the one before, which is the first column, and by others that are exact.
"""

from __future__ import annotations

import numpy as np

from autotune.core.arrays import Floats, Integers

WEIGHED = 30
"""Rounds of a fit that rows which do not hold shall not lead."""
SAME = 1e-6
"""Of what a value changes by: less is no chance."""
ROUNDED = 2.0
"""Standard deviations within which 0.96 lie of what rounding leaves."""
BESIDE, WITHIN_ROUNDING = 3.0, 0.85
"""Times that, and of the rows that leave so little those within it, at least: where noise is as large a half are."""
PROMPT = 0.05
"""Of all rows those that hold, at least."""
LEAST_ROWS = 100
"""That hold to rounding: fewer do not tell the gains better."""
ROUGHER, SETTLING = (4.0, 2.0), 4
"""Times what rounding leaves, at first, and rounds after."""


def gains_of_recursion(
    table: Floats, wanted: Floats, slowest: Integers, step: float
) -> tuple[Floats, Floats, float, float]:
    """Gains of a recursion, told by its slowest rows first; what it leaves, shape (r,); and below which it leaves
    nothing, and what rounding leaves of it [N m]."""
    gains = _least_absolute(table[slowest], wanted[slowest], step)
    if step > 0.0:
        gains = _of_rounded(table, wanted, gains, step)
    rounded = ROUNDED * by_rounding(gains, step)
    same = max(SAME * float(np.std(wanted)), rounded)
    return gains, np.abs(wanted - table @ gains), same, rounded


def rows_told(left: Floats, least: float, rounded: float) -> int:
    """How many rows a recursion explains to `least` [N m], by what it leaves of those that move; 0 where they tell no
    law.

    Of what lies near what rounding leaves (`rounded`) most must lie within.
    """
    same, near = int(np.sum(left < least)), int(np.sum(left < BESIDE * rounded))
    return same if same > max(PROMPT * max(len(left), LEAST_ROWS), WITHIN_ROUNDING * near) else 0


def by_rounding(gains: Floats, step: float) -> float:
    """Standard deviation of what three values that are rounded to steps leave of the recursion."""
    memory = float(gains[0])
    return step * float(np.sqrt((1.0 + (1.0 + memory) ** 2 + memory**2) / 12.0))


def _of_rounded(table: Floats, wanted: Floats, gains: Floats, step: float) -> Floats:
    """The gains told by all rows that they explain to rounding: slow rows, whose demand changes by a few steps, tell
    them roughly.

    The change before, the first column, is rounded as the wanted one is: two demands each, one of them in both. Without
    their moments least squares would take it for smaller.
    """
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    variance = step**2 / 12.0
    for times in (*ROUGHER, *(1.0 for _ in range(SETTLING))):
        rows = np.abs(wanted - table @ gains) < times * ROUNDED * by_rounding(gains, step)
        if np.count_nonzero(rows) < LEAST_ROWS:
            break
        part, told = table[rows] / size, int(np.count_nonzero(rows))
        inner, along = part.T @ part, part.T @ wanted[rows]
        inner[0, 0] -= 2.0 * told * variance / size[0] ** 2
        along[0] += told * variance / size[0]
        gains = np.linalg.lstsq(inner, along, rcond=1e-14)[0] / size
    return np.asarray(gains)


def _least_absolute(table: Floats, wanted: Floats, step: float = 0.0) -> Floats:
    """Gains of the columns that leave least in absolute value, shape (k,): rows that are wrong do not count.

    Least squares that weigh every row by what it left before, or by the `step` that demands are rounded to.
    """
    size = np.maximum(np.linalg.norm(table, axis=0), 1e-300)
    weight = np.ones(len(wanted))
    gains = np.zeros(table.shape[1])
    least = max(SAME**2 * float(np.std(wanted)), step)
    if least == 0.0:  # a demand that never changes in these rows tells nothing
        return gains
    for _ in range(WEIGHED):
        gains = np.linalg.lstsq(table / size * weight[:, None], weight * wanted, rcond=1e-12)[0] / size
        weight = 1.0 / np.sqrt(np.maximum(np.abs(wanted - table @ gains), least))
    return np.asarray(gains)
