"""The search for gains: those that settle soonest, as far as it is expected of the axis, and keep what is asked.

Gains are sought as (ωc, a, b): kd makes ωc the crossover of the sliding regime, kp = kd·ωc/a, ki = kp·ωc/b. Those that
do not keep `Requirements` are left by their margins alone; the rest is run on the twin, on axes drawn from the
intervals: what counts is the time that is expected of the true one.

The quickest gains lie where margins bind, and in more than one place: a large step wants a high crossover, a small one
that friction holds wants the integral. So the search begins on that edge, with the highest crossover that each of many
shapes (a, b) can have (margins alone, no motion); differential evolution (Storn and Price, 1997) with a fixed seed goes
on from there, and a simplex (Nelder and Mead, 1965) from the best of each neighbourhood ends it.

Times scatter by chance, most where the integral works a step free of friction. All gains are therefore tried on the
same axes under the same disturbances; what is clearly slower than the best so far is given up on after few of them (a
race: Birattari et al., 2002), and what the search ends with is compared on other axes, half of it going on each time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from autotune.control.gains.hunting import after_step
from autotune.control.gains.judge import Task
from autotune.control.gains.loop import Gains
from autotune.control.gains.members import Family, Member, drawn
from autotune.control.gains.requirements import Corner, Requirements, binding, shaped, shortfall
from autotune.control.gains.sampled import torque_noise
from autotune.control.gains.steps import HORIZON, SHAKEN, settling_time
from autotune.control.gains.stick_slip import sticks_at
from autotune.core.arrays import Floats

SEED = 20
SHAPES = 128
"""Pairs (a, b) with which the search begins."""
RUNGS = 24
"""Crossovers tried for each, evenly on a logarithmic scale: 30 % apart."""
POPULATION, GENERATIONS = 64, 18
POLISHED, VALLEYS, APART = 60, 3, 0.35
"""Gains tried by each simplex, how many there are, and how far apart (in ln) the points from which they begin."""
LEAST_BANDWIDTH = 0.5  # Hz
SOUGHT, COMPARED = (16, 31), (32, 32)
"""How many axes are drawn from the intervals, and by which seed: for the search, and to compare what it found. An
overshoot that just stays within the band on the nominal axis need not on the true one, and settles far later then."""
STAGES = (1, 4, 8, 16)
"""Axes after which gains in the search are held against the best so far."""
CLEARLY = 2.0
"""Standard errors of the difference; twice the time where there is but one axis."""
SHORT, ROOM = (0.25, 0.5, 1.0), 4.0
"""s after the step that are looked at first, at least that many times the best so far: what is slower shows there.
Whether the rest stays in its band is seen in `HORIZON`."""
FINALISTS, SAME = 12, 0.02
"""What the search ends with: so many, this far apart (in ln)."""
ROUNDS = (8, 16, 32)
"""Axes on which they are compared, half of them each time."""
MISSED = 100.0
"""Cost from which on the requirements are missed."""
ON_TARGET = 0.02
"""Relative: what counts as the bandwidth that was asked for."""


def searched(
    kin: Family,
    corners: tuple[Corner, ...],
    task: Task,
    current: Gains,
    bandwidth: float | None,
    wanted: Requirements,
) -> Gains | None:
    """The best of the search in the structure of `current`; None where nothing keeps the requirements at `corners`."""
    trial = _Trial(kin, corners, task, current, wanted)
    edges = edges_of(kin.nominal.timing.period, bandwidth)
    result = scipy.optimize.differential_evolution(
        trial.cost,
        scipy.optimize.Bounds(edges[:, 0], edges[:, 1]),
        maxiter=GENERATIONS,
        seed=SEED,
        tol=1e-3,
        polish=False,
        init=begun(trial, edges),
    )
    order = np.argsort(result.population_energies)
    ranked = [Point(result.population[k], float(result.population_energies[k])) for k in order]
    ends = [polished(trial.cost, start, edges) for start in apart(ranked, APART, VALLEYS)]
    points = sorted([*ends, *ranked], key=lambda one: one.cost)
    parts = (1.0,) if bandwidth is not None else (1.0, 0.95, 0.9, 0.8, 0.7, 0.6)
    kept = (
        _backed_off(corners, current, one.place, wanted, parts)
        for one in apart([one for one in points if one.cost < MISSED], SAME, FINALISTS)
    )
    return trial.quickest([gains for gains in kept if gains is not None])


@dataclass(frozen=True, slots=True)
class Point:
    """A place in the search, (ln ωc, ln a, ln b), shape (3,), and what it costs."""

    place: Floats
    cost: float


def apart(ranked: list[Point], distance: float, most: int) -> list[Point]:
    """The best of each neighbourhood, best first, so many at most."""
    kept: list[Point] = []
    for one in ranked:
        if len(kept) == most:
            break
        if all(np.linalg.norm(one.place - other.place) > distance for other in kept):
            kept.append(one)
    return kept


def polished(cost: Callable[[Floats], float], start: Point, edges: Floats) -> Point:
    """A simplex from a point, within the edges, shape (3, 2); the point itself where it finds nothing better.

    The best gains lie in a corner between margins, which evolution alone comes near but slowly.
    """
    inward = np.where(start.place > edges.mean(axis=1), -1.0, 1.0)
    simplex = np.vstack([start.place, start.place + np.diag(0.1 * inward)])
    found = scipy.optimize.minimize(
        cost,
        start.place,
        method="Nelder-Mead",
        bounds=scipy.optimize.Bounds(edges[:, 0], edges[:, 1]),
        options={"initial_simplex": simplex, "maxfev": POLISHED, "xatol": 1e-3, "fatol": 1e-4},
    )
    return Point(np.asarray(found.x, dtype=np.float64), float(found.fun)) if found.fun < start.cost else start


def begun(trial: _Trial, edges: Floats) -> Floats:
    """Where the search begins, shape (POPULATION, 3): the quickest on the edge of the margins, the rest anywhere."""
    shapes = scipy.stats.qmc.scale(
        scipy.stats.qmc.Sobol(2, seed=SEED).random(SHAPES), edges[1:, 0], edges[1:, 1]
    )
    rungs = np.linspace(edges[0, 1], edges[0, 0], RUNGS)
    highest = [highest_kept(trial.missed, shape, rungs) for shape in shapes]
    known = [one for one in highest if one is not None]
    found = sorted((Point(one, trial.cost(one)) for one in known), key=lambda one: one.cost)
    anywhere = scipy.stats.qmc.scale(
        scipy.stats.qmc.Sobol(3, seed=SEED).random(SHAPES), edges[:, 0], edges[:, 1]
    )
    edge = np.reshape([one.place for one in found[: 3 * POPULATION // 4]], (-1, 3))
    return np.vstack([edge, anywhere])[:POPULATION]


def highest_kept(missed: Callable[[Floats], float], shape: Floats, rungs: Floats) -> Floats | None:
    """(ln ωc, ln a, ln b) with the highest crossover of falling `rungs` that keeps all; None where none does."""
    for k, rung in enumerate(rungs):
        if missed(np.array([rung, *shape])) > 0.0:
            continue
        low, high = rung, rungs[max(k - 1, 0)]
        for _ in range(3):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if missed(np.array([middle, *shape])) <= 0.0 else (low, middle)
        return np.array([low, *shape])
    return None


def edges_of(period: float, bandwidth: float | None) -> Floats:
    """Ends of ln ωc, ln a, ln b; shape (3, 2)."""
    low, high = LEAST_BANDWIDTH, 0.25 / period
    if bandwidth is not None:
        low, high = bandwidth * (1.0 - ON_TARGET), bandwidth * (1.0 + ON_TARGET)
    edges: Floats = np.log(np.array([(low, high), (1.05, 8.0), (1.5, 60.0)]))
    return edges


class _Trial:
    """Gains tried on the twin: what they cost, and which of several are the quickest."""

    def __init__(
        self, kin: Family, corners: tuple[Corner, ...], task: Task, current: Gains, wanted: Requirements
    ) -> None:
        self._nominal, self._task, self._current, self._wanted = kin.nominal, task, current, wanted
        self._corners, self._few = corners, binding(corners)
        model, timing = kin.nominal.model, kin.nominal.timing
        self._sought, self._compared = drawn(model, timing, *SOUGHT), drawn(model, timing, *COMPARED)
        # a velocity loop does not bring a small step home against friction; that is the position loop's business
        small = () if current.structure == "pi_velocity" else (task.steps.small,)
        self._sizes = (*small, task.steps.large)
        self._best, self._least = np.empty((0, len(self._sizes))), math.inf

    def missed(self, point: Floats) -> float:
        """By how much the requirements are missed at the corners that usually bind, 0 where they are kept."""
        gains, timing = shaped(self._corners, self._current, point), self._nominal.timing
        noise = torque_noise(gains, timing) / (self._wanted.noise * timing.torque_limit)
        return max(0.0, noise - 1.0) + shortfall(self._few, gains, self._wanted)

    def cost(self, point: Floats) -> float:
        """Expected time of (ln ωc, ln a, ln b); from `MISSED` on where the requirements are missed."""
        if (missed := self.missed(point)) > 0.0:
            return MISSED + missed
        gains = shaped(self._corners, self._current, point)
        short = next((one for one in SHORT if one >= ROOM * self._least), HORIZON)
        for horizon in sorted({short, HORIZON}):
            rows = np.empty((0, len(self._sizes)))
            for stage in STAGES:
                rows = self._tried(gains, self._sought[:stage], rows, horizon)
                times, best = later(rows), later(np.minimum(self._best[:stage], horizon))
                if slower(times, best):
                    return self._least * float(times.mean() / best.mean())
                if len(times) > 1 and times.min() >= HORIZON:  # it arrives on none
                    return float(times.mean())
        found = float(times.mean()) + self._faults(gains, times)
        if found < self._least:
            self._best, self._least = rows, found
        return found

    def quickest(self, finalists: list[Gains]) -> Gains | None:
        """The quickest on other axes: the better half goes on to twice as many each time. None of none."""
        ranked = [(gains, np.empty((0, len(self._sizes)))) for gains in finalists]
        for count in ROUNDS:
            members = self._compared[:count]
            ranked = [(one, self._tried(one, members, rows)) for one, rows in ranked]
            ranked.sort(key=lambda one: float(later(one[1]).mean()) + self._faults(one[0], later(one[1])))
            ranked = ranked[: (len(ranked) + 1) // 2]
        return ranked[0][0] if ranked else None

    def _tried(
        self, gains: Gains, members: tuple[Member, ...], known: Floats, horizon: float = HORIZON
    ) -> Floats:
        """Seconds to settle on the members, shape (n, steps), of which the first rows are known."""
        more = [
            [settle_on(members[k], gains, size, k, horizon) for size in self._sizes]
            for k in range(len(known), len(members))
        ]
        return np.vstack([known, np.reshape(more, (-1, len(self._sizes)))])

    def _faults(self, gains: Gains, times: Floats) -> float:
        """What is added to the time of gains with which the nominal axis hunts, or sticks in slow motion."""
        task, nominal = self._task, self._nominal
        if (
            times.mean() < HORIZON
            and after_step(nominal.model, gains, nominal.timing, task.steps.large, 2.0) is not None
        ):
            return 50.0
        return 10.0 if sticks_at(nominal.model, gains, nominal.timing, task.speed) else 0.0


def later(rows: Floats) -> Floats:
    """Seconds to settle, shape (n, steps), as one figure: the later step with a little of the other; shape (n,)."""
    return np.asarray(rows.max(axis=1) + 0.1 * rows.min(axis=1))


def slower(times: Floats, best: Floats) -> bool:
    """Whether gains are clearly slower than the best so far, on the same axes, shapes (n,); not where there is none."""
    if not len(best):
        return False
    if len(times) == 1:
        return bool(times[0] > CLEARLY * best[0])
    more = times - best
    return bool(more.mean() > CLEARLY * more.std(ddof=1) / math.sqrt(len(more)))


def settle_on(member: Member, gains: Gains, size: float, number: int, horizon: float = HORIZON) -> float:
    """Seconds to settle after a step on a drawn axis, under a disturbance of its own; `horizon` at most."""
    return settling_time(member.model, gains, member.timing, size, horizon, seeds=(SHAKEN[0] + number,))


def _backed_off(
    corners: tuple[Corner, ...],
    current: Gains,
    point: Floats,
    wanted: Requirements,
    parts: tuple[float, ...],
) -> Gains | None:
    """Less crossover at the same shape, that many times, until every corner keeps the requirements."""
    for part in parts:
        gains = shaped(corners, current, point + np.array([math.log(part), 0.0, 0.0]))
        if shortfall(corners, gains, wanted) < 0.02:
            return gains
    return None
