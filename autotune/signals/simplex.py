"""Several descents by the simplex method ([nelder-1965]) side by side, for costs that are cheap in company.

Every descent takes the steps that it would take alone, in the order in which it would; what it asks for is looked at
together with what the others ask for, and with what any of them may ask for next.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Hashable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from autotune.core.arrays import Floats

_Ask: TypeAlias = tuple[Sequence[Floats], Sequence[Floats]]
"""Places whose costs are needed, and others that may be needed next."""


@dataclass(frozen=True, slots=True)
class Descent:
    """Where one begins, and when it ends.

    Attributes:
        corners: of the first simplex, shape (k + 1, k).
        near, flat: differences of places and of costs that count as none.
        most: costs that may be asked for; `probing`: those after which the lowest must be below `promised`.
    """

    corners: Floats
    near: float
    flat: float
    most: int
    probing: int
    promised: float

    def steps(self) -> Generator[_Ask, list[float], Floats]:
        """Asks for costs; returns the lowest place."""
        places, asked, first = self.corners.copy(), len(self.corners), True
        costs = np.array((yield list(places), []))
        while True:
            order = np.argsort(costs)
            places, costs = places[order], costs[order]
            in_vain = not first and asked >= self.probing and costs[0] > self.promised
            if asked >= self.most or in_vain or self._arrived(places, costs):
                return np.asarray(places[0])
            first = False
            over, far, outside, inside = _mirrored(places)
            (reflected,) = yield [over], [far, outside, inside]
            asked += 1
            if costs[0] <= reflected < costs[-2]:
                places[-1], costs[-1] = over, reflected
                continue
            if asked >= self.most:
                continue
            other = far if reflected < costs[0] else outside if reflected < costs[-1] else inside
            (found,) = yield [other], []
            asked += 1
            if reflected < costs[0] and found >= reflected:
                places[-1], costs[-1] = over, reflected
            elif found < costs[-1] and (other is inside or found <= reflected):
                places[-1], costs[-1] = other, found
            else:
                left = self.most - asked
                places[1 : 2 + left] = places[0] + 0.5 * (places[1 : 2 + left] - places[0])
                shrunk = list(places[1 : 1 + left])
                costs[1 : 1 + len(shrunk)] = yield shrunk, []
                asked += len(shrunk)

    def _arrived(self, places: Floats, costs: Floats) -> bool:
        apart = float(np.max(np.abs(places[1:] - places[0])))
        return apart <= self.near and bool(np.max(np.abs(costs[0] - costs[1:])) <= self.flat)


def _mirrored(places: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """The worst corner mirrored at the middle of the others: as far, twice and half as far, and half way to it."""
    middle, worst = np.add.reduce(places[:-1], 0) / (len(places) - 1), places[-1]
    return (
        2.0 * middle - worst,
        3.0 * middle - 2.0 * worst,
        1.5 * middle - 0.5 * worst,
        0.5 * middle + 0.5 * worst,
    )


def lowest_places(
    descents: Sequence[Descent],
    costs_of: Callable[[list[tuple[int, Floats]]], Sequence[float]],
    company: Callable[[int, Floats], Hashable],
    width: int,
) -> list[Floats]:
    """Where each descent ends.

    Args:
        costs_of: costs of places, each with the number of its descent.
        company: places for which this is equal cost little more together than one alone, up to `width` of them.
    """
    running = {i: descent.steps() for i, descent in enumerate(descents)}
    asks = {i: next(steps) for i, steps in running.items()}
    known: dict[tuple[int, bytes], float] = {}
    ends: dict[int, Floats] = {}
    while running:
        wanted = [(i, place) for i, (needed, _) in asks.items() for place in needed]
        wanted = [item for item in wanted if _key(*item) not in known]
        if wanted:
            together = wanted + _guests(wanted, asks, company, width)
            known |= {_key(*item): cost for item, cost in zip(together, costs_of(together), strict=True)}
        for i in list(running):
            try:
                asks[i] = running[i].send([known[_key(i, place)] for place in asks[i][0]])
            except StopIteration as ended:
                ends[i] = ended.value
                del running[i], asks[i]
    return [ends[i] for i in range(len(descents))]


def _guests(
    wanted: Sequence[tuple[int, Floats]],
    asks: dict[int, _Ask],
    company: Callable[[int, Floats], Hashable],
    width: int,
) -> list[tuple[int, Floats]]:
    """Places that may be needed next and fit into the passes that are made anyhow."""
    seats: dict[Hashable, int] = {}
    for i, place in wanted:
        kind = company(i, place)
        seats[kind] = seats.get(kind, 0) + 1
    free = {kind: -taken % width for kind, taken in seats.items()}
    found: list[tuple[int, Floats]] = []
    for i, (_, likely) in asks.items():
        for place in likely:
            kind = company(i, place)
            if free.get(kind, 0) > 0:
                free[kind] -= 1
                found.append((i, place))
    return found


def _key(number: int, place: Floats) -> tuple[int, bytes]:
    return number, place.tobytes()
