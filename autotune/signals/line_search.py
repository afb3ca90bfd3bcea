"""Where a cost of one variable is lowest: between two bounds, or down parabolas from near there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy

from autotune.core.arrays import Floats

FIRST_STEP, LAST_STEP, MOST_PARABOLAS = 1e-2, 1e-4, 12
NO_FALL = 1e-3
"""Of the cost: it is known to no better than a hundredth."""


def settled(cost: Callable[[float], float], near: float, bounds: tuple[float, float]) -> float:
    """Where a smooth cost is lowest, from near there: down parabolas through three of its values.

    It ends where the next of them promises a fall of the cost that no data tell, or a step of no consequence.
    """
    step = FIRST_STEP
    here = cost(near)
    for _ in range(MOST_PARABOLAS):
        low, high = max(near - step, bounds[0]), min(near + step, bounds[1])
        sides = cost(low), cost(high)
        at = np.array([low, near, high]) - near
        slope, bend = _slope_and_bend(at, np.array([sides[0], here, sides[1]]) - here)
        best = min((sides[0], low), (sides[1], high), (here, near))
        if bend > 0.0:
            ahead = min(max(near - slope / bend, near - 4.0 * step, bounds[0]), near + 4.0 * step, bounds[1])
            best = min(best, (cost(ahead), ahead))
        won, moved = here - best[0], abs(best[1] - near)
        here, near = best
        if step <= LAST_STEP or (moved <= step and won <= NO_FALL * here):
            break
        step = max(LAST_STEP, 0.25 * step) if moved <= step else step
    return near


def _slope_and_bend(at: Floats, values: Floats) -> tuple[float, float]:
    """Slope and second derivative, at 0, of the parabola through 0 at 0 and two more points; 0 where there is none."""
    (one, _, two), (left, _, right) = at.tolist(), values.tolist()
    if one == 0.0 or two == 0.0:
        return 0.0, 0.0
    bend = 2.0 * (right / two - left / one) / (two - one)
    return right / two - 0.5 * bend * two, bend


def lowest(cost: Callable[[float], float], bounds: tuple[float, float], within: float) -> float:
    """Where a cost is lowest between two bounds, to so much."""
    options: Any = {"xatol": within}
    return float(scipy.optimize.minimize_scalar(cost, bounds=bounds, method="bounded", options=options).x)
