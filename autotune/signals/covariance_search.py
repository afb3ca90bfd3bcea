"""A minimum without slopes, where a valley is narrow and bent: for costs that many places together give cheaply.

Each generation of places is drawn from a normal distribution whose covariance learns the valley's direction from the
places that cost least (CMA-ES [hansen-2001]). Searches of several starts go side by side, so that what they ask for
is looked at together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TypeAlias

import numpy as np
from cmaes import CMA

from autotune.core.arrays import Floats

SEED = 20_240
STALLED, ENOUGH = 12, 0.01
"""Generations, and the relative fall of the lowest cost, without which a search has come to its floor."""

Asked: TypeAlias = list[tuple[int, Floats]]
"""Places of shape (n,) whose costs are asked for, each with the number of the search that asks."""


@dataclass(slots=True)
class Search:
    """One search, which goes on from where it is.

    Attributes:
        place, cost: the lowest so far, shape (n,).
        steps: standard deviations of the first generation, shape (n,); `places`: of a generation.
    """

    place: Floats
    cost: float
    steps: Floats
    places: int
    _before: list[float] = field(default_factory=list)
    _drawn: CMA = field(init=False)

    def __post_init__(self) -> None:
        begun = np.asarray(self.place / self.steps, dtype=np.float64)
        self._drawn = CMA(begun, 1.0, seed=SEED, population_size=self.places)

    @property
    def ended(self) -> bool:
        """Whether the last generations have not come lower."""
        before = self._before
        return len(before) > STALLED and before[-1] > (1.0 - ENOUGH) * before[-1 - STALLED]

    def asks(self) -> list[Floats]:
        """A generation's places."""
        return [np.asarray(self._drawn.ask() * self.steps) for _ in range(self.places)]

    def told(self, places: Sequence[Floats], costs: Floats) -> None:
        """The costs of a generation's places; infinite where there is none."""
        worst = max((cost for cost in costs if math.isfinite(cost)), default=1.0)
        known = np.where(np.isfinite(costs), costs, 2.0 * worst)
        self._drawn.tell([(p / self.steps, float(c)) for p, c in zip(places, known, strict=True)])
        best = int(np.argmin(costs))
        if costs[best] < self.cost:
            self.place, self.cost = places[best], float(costs[best])
        self._before.append(self.cost)


def led_down(costs_of: Callable[[Asked], Floats], searches: Sequence[Search], generations: int) -> None:
    """Moves several searches on, by so many generations each at most."""
    for _ in range(generations):
        moving = [(i, one.asks()) for i, one in enumerate(searches) if not one.ended]
        if not moving:
            return
        costs = costs_of([(i, place) for i, places in moving for place in places])
        ends = np.cumsum([len(places) for _, places in moving])[:-1]
        for (i, places), own in zip(moving, np.split(costs, ends), strict=True):
            searches[i].told(places, own)
