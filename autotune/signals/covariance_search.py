"""A minimum without slopes, where a valley is narrow and bent: for costs that many places together give cheaply.

Each generation of places is drawn from a normal distribution whose covariance learns the valley's direction from the
places that cost least (CMA-ES [hansen-2001]).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from cmaes import CMA

from autotune.core.arrays import Floats
from autotune.signals.pattern_search import Reached

SEED = 20_240
STALLED, ENOUGH = 12, 0.01
"""Generations, and the relative fall of the lowest cost, without which a search has come to its floor."""


def lowest_along_valley(
    costs_of: Callable[[Sequence[Floats]], Floats],
    begun: Reached,
    steps: Floats,
    places: int,
    generations: int,
) -> Reached:
    """The lowest place of so many generations at most, or where it began.

    Args:
        costs_of: of a generation's places, each of shape (n,); infinite where there is none.
        steps: standard deviations of the first generation, shape (n,); `places`: of a generation.
    """
    drawn = CMA(np.asarray(begun.place / steps, dtype=np.float64), 1.0, seed=SEED, population_size=places)
    here, lowest = begun, list[float]()
    for _ in range(generations):
        if len(lowest) > STALLED and lowest[-1] > (1.0 - ENOUGH) * lowest[-1 - STALLED]:
            break
        asked = [np.asarray(drawn.ask() * steps) for _ in range(places)]
        costs = costs_of(asked)
        worst = max((cost for cost in costs if math.isfinite(cost)), default=1.0)
        known = np.where(np.isfinite(costs), costs, 2.0 * worst)
        drawn.tell([(place / steps, float(cost)) for place, cost in zip(asked, known, strict=True)])
        best = int(np.argmin(costs))
        if costs[best] < here.cost:
            here = replace(here, place=asked[best], cost=float(costs[best]))
        lowest.append(here.cost)
    return here
