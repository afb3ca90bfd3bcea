"""A minimum without slopes, by parabolas along every coordinate: for costs that many places together give cheaply.

From each place a step is made both ways along every coordinate; the parabolas through them tell how far to go along
each, and parts of that are tried all at once [hooke-1961]. Steps are halved where nothing is lower.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from autotune.core.arrays import Floats

PARTS = (1.0, 0.5, 0.25)
"""Of what the parabolas say: coordinates hang together."""
FARTHEST = 1.5
"""Steps: further away a parabola tells nothing."""


def lowest_by_parabolas(
    costs_of: Callable[[Floats], Floats],
    start: Floats,
    steps: Floats,
    rounds: int,
    enough: float = 0.01,
    nearest: float = 0.2,
) -> tuple[Floats, float]:
    """Where the search ends, shape (n,), and the cost there.

    Args:
        costs_of: of places, shape (k, n); infinite where there is none.
        steps: of the first round, shape (n,).
        enough: relative fall of the cost below which steps are halved.
        nearest: part of the first steps at which it ends.
    """
    place, cost, size = start, float(costs_of(start[None])[0]), 1.0
    for _ in range(rounds):
        around = place + np.concatenate([np.diag(size * steps), -np.diag(size * steps)])
        known = costs_of(around)
        to = _to_their_floors(known, cost) * size * steps
        ahead = place + np.outer(PARTS, to)
        places, costs = np.concatenate([around, ahead]), np.concatenate([known, costs_of(ahead)])
        best = int(np.argmin(costs))
        if costs[best] < (1.0 - enough) * cost:
            place, cost = places[best], float(costs[best])
        else:
            size *= 0.5
        if size < nearest:
            break
    return place, cost


def _to_their_floors(known: Floats, cost: float) -> Floats:
    """How many steps it is to the floor of each coordinate's parabola, by the costs of a step up and down."""
    up, down = known.reshape(2, -1)
    with np.errstate(invalid="ignore", divide="ignore"):
        bend, slope = up + down - 2.0 * cost, 0.5 * (up - down)
        floor = np.where(bend > 0.0, -slope / bend, -FARTHEST * np.sign(slope))
    floor = np.where(np.isfinite(floor), floor, (up < cost).astype(float) - (down < cost))
    return np.clip(floor, -FARTHEST, FARTHEST)
