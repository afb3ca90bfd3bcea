"""A minimum without slopes, by parabolas along every coordinate: for costs that many places together give cheaply.

From each place a step is made both ways along every coordinate; the parabolas through them tell how far to go along
each, and parts of that are tried all at once [hooke-1961]. Steps are halved where nothing is lower.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from autotune.core.arrays import Floats

PARTS = (1.0, 0.5, 0.25)
"""Of what the parabolas say: coordinates hang together."""
FARTHEST = 1.5
"""Steps: further away a parabola tells nothing."""
ENOUGH, NEAREST = 0.01, 0.2
"""Relative fall of the cost below which steps are halved, and the part of the first steps at which a search ends."""

Asked: TypeAlias = list[tuple[int, Floats]]
"""Places of shape (n,) whose costs are asked for, each with the number of the search that asks."""


@dataclass(frozen=True, slots=True)
class Reached:
    """How far a search has come: a place, shape (n,), the cost there, and the part of the first steps that is left."""

    place: Floats
    cost: float
    size: float = 1.0

    @property
    def ended(self) -> bool:
        return self.size < NEAREST


def lowest_by_parabolas(
    costs_of: Callable[[Asked], Floats], begun: Sequence[Reached], steps: Sequence[Floats], rounds: int
) -> list[Reached]:
    """How far several searches have come after so many rounds, side by side; each goes on from where it is.

    Args:
        costs_of: infinite where there is none.
        steps: of the first round of each, shape (n,).
    """
    here = list(begun)
    for _ in range(rounds):
        moving = [i for i, one in enumerate(here) if not one.ended]
        if not moving:
            break
        length = {i: here[i].size * steps[i] for i in moving}
        around = {
            i: here[i].place + np.concatenate([np.diag(length[i]), -np.diag(length[i])]) for i in moving
        }
        known = _costs(costs_of, around)
        ahead = {
            i: here[i].place + np.outer(PARTS, _to_their_floors(known[i], here[i].cost) * length[i])
            for i in moving
        }
        beyond = _costs(costs_of, ahead)
        for i in moving:
            places, costs = np.concatenate([around[i], ahead[i]]), np.concatenate([known[i], beyond[i]])
            here[i] = _moved(here[i], places, costs)
    return here


def _costs(costs_of: Callable[[Asked], Floats], places: dict[int, Floats]) -> dict[int, Floats]:
    """Costs of the places of each search, all asked for at once."""
    costs = costs_of([(i, place) for i, many in places.items() for place in many])
    ends = np.cumsum([len(many) for many in places.values()])[:-1]
    return dict(zip(places, np.split(costs, ends), strict=True))


def _moved(here: Reached, places: Floats, costs: Floats) -> Reached:
    best = int(np.argmin(costs))
    if costs[best] < (1.0 - ENOUGH) * here.cost:
        return Reached(places[best], float(costs[best]), here.size)
    return Reached(here.place, here.cost, 0.5 * here.size)


def _to_their_floors(known: Floats, cost: float) -> Floats:
    """How many steps it is to the floor of each coordinate's parabola, by the costs of a step up and down."""
    up, down = known.reshape(2, -1)
    with np.errstate(invalid="ignore", divide="ignore"):
        bend, slope = up + down - 2.0 * cost, 0.5 * (up - down)
        floor = np.where(bend > 0.0, -slope / bend, -FARTHEST * np.sign(slope))
    floor = np.where(np.isfinite(floor), floor, (up < cost).astype(float) - (down < cost))
    return np.clip(floor, -FARTHEST, FARTHEST)
