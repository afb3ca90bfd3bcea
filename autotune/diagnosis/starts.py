"""How a fit of each effect begins: what the effect's own starts (`Kind.starts`) find in the data.

Here stands what a start may look at (`Context`), and how the best of many starts are found (`scouted`). Two masses
need that: a step of a fit follows the slope of one place, and contact is rough there. All that is in the model is
solved for linearly (variable projection, [golub-1973]), so that valleys are wide. With a twin every start costs some
runs of it, and all are looked at. Without one, on the measured motion, the cost is one pass of the inverse: the best
are followed without slopes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from autotune.core.arrays import Floats, Integers
from autotune.diagnosis.ripple_orders import find_orders
from autotune.estimation.bias_corrected_fit import PROMISED, ModelFit, Projected
from autotune.estimation.cross_validation import beyond_presliding
from autotune.estimation.data import first_round, repeats_alike
from autotune.estimation.least_squares import Fitted, Free, with_values
from autotune.estimation.problem import Problem
from autotune.estimation.residual import kind_of_pass
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.effect import Kind
from autotune.models.lanes import WIDTH
from autotune.models.load_side import SPLITS
from autotune.models.reversal_memory import contact
from autotune.models.start_values import StartValues, Vary
from autotune.models.table import EFFECTS
from autotune.models.torque_ripple import TORQUE_RIPPLE, scale_slot
from autotune.models.transmission import BETWEEN, contact_damping, load_shares
from autotune.signals.covariance_search import lowest_along_valley
from autotune.signals.pattern_search import Asked, Reached, lowest_by_parabolas
from autotune.signals.simplex import Descent, lowest_places

PASSES, PROBING = 45, 18
"""Passes of the inverse by which a start is followed, and those after which it must have shown something."""
FOLLOWED, AS_GOOD = 2, 1.3
"""Starts that are followed, and times the cost of the best of them."""
LOOKED_AT, APART = 8, 2.0
"""Starts of each damping that are looked at more closely: their twins fill a pass; and how many times the size of the
one that of the other is, at least: next to each other they lie in one valley."""
ENOUGH, NEAR = 1e-2, 0.1
"""Relative difference of the cost, and of places in steps, below which a valley's floor is reached."""
SHOWN, TRACE = 0.2, 0.5
"""Of the fall that is needed: what the best of all starts must show before it is led on; and of that, what the best of
those with friction on both sides must. Starts are so near each other that a true second mass shows a third of what it
explains, and more."""
FELT, FAR = (layout.INERTIA, layout.COULOMB), 1.5
"""What must have gone how far from the model that was given, for a fit to begin there too."""
ROUNDS, FIRST_ROOT = 6, 1.0 / 3.0
"""Rounds in which the best start is led by its twins to its floor; and first steps, of the root of what is large."""
LED_ON, AFTER_A_FIT = 3, 0.5
"""Rounds in which a fit that has stopped is led on, and the part of the first steps with which."""
GENERATIONS = 40
"""In which what was led along the coordinates follows its valley across them."""
SCATTERED, CLOSER, FITTED = 192, 16, 3
"""Places that are scattered near a fit between two masses and as many far from it; those of either that are looked at
more closely, and those from which it is fitted anew."""
TRADED = {
    "gap": (1.7, 3.0),
    "contact_compliance": (2.8, 8.0),
    "compliance": (2.8, 8.0),
    "load_inertia": (1.25, 3.0),
    "damping": (1.6, 3.0),
    "impact_damping": (1.6, 3.0),
}
"""What trades places between two masses, and times how much it is looked for near a fit and far off, up and down."""
SHARED = ("load_friction", "load_offset")
"""What motor and load share in any way, far from a fit."""
FIRST_STEP = 0.5
"""Of the longest step of a parameter."""


@dataclass(frozen=True, slots=True)
class FitStart:
    """Where a refit begins: parameters and flags, and what is free beside the base."""

    packed: Packed
    free: tuple[Free, ...]


@dataclass(frozen=True, slots=True)
class Context:
    """What a start may look at: the problem, the fit without the effect, and the values before it."""

    problem: Problem
    fitted: Fitted
    nominal: Packed

    @property
    def p(self) -> Floats:
        return self.fitted.packed.p

    @property
    def coulomb(self) -> float:
        return max(contact(self.p, self.fitted.packed.on)[0], 0.02 * self.problem.scales.torque)

    @property
    def left(self) -> float:
        return math.sqrt(self.fitted.cost)

    @property
    def reach(self) -> float:
        """Travel over which the contact bends [motion unit]."""
        level, reach = contact(self.p, self.fitted.packed.on)
        return self.coulomb / level * reach

    @property
    def angle(self) -> float:
        """Radians per motion unit and cycle: 1 on rotary axes, 2π on linear ones."""
        return float(self.p[scale_slot()])

    def given_base(self) -> dict[int, float]:
        """The base before the fit without the effect, by place; empty where the fit is near it."""
        given = {place: float(self.nominal.p[place]) for place in range(len(layout.BASE))}
        ratios = [self.p[place] / max(value, 1e-300) for place, value in given.items() if place in FELT]
        return given if any(max(ratio, 1.0 / max(ratio, 1e-300)) > FAR for ratio in ratios) else {}

    def sensitivity(self, name: str) -> Floats:
        """d(residual)/d(parameter) on the grid."""
        index = [f.name for f in self.fitted.free].index(name)
        return np.asarray(self.fitted.jacobian[:, index] / self.fitted.scales[index])

    @property
    def torque(self) -> float:
        return self.problem.scales.torque

    @property
    def speed(self) -> float:
        return self.problem.scales.velocity

    @property
    def travel(self) -> float:
        return self.problem.scales.travel

    @property
    def mean_speed(self) -> float:
        return float(np.mean(np.abs(self.problem.data.velocity)))

    @property
    def largest_torque(self) -> float:
        """The largest recorded, or the drive's limit where that is lower."""
        largest = float(np.max(np.abs(self.problem.data.torque)))
        return min(self.problem.data.metadata.torque_limit or largest, largest)

    @property
    def high_torque(self) -> float:
        return min(float(np.quantile(np.abs(self.problem.data.torque), 0.95)), self.largest_torque)

    @property
    def resolution(self) -> float:
        return self.problem.data.resolution

    @property
    def period(self) -> float:
        return self.problem.data.period

    @property
    def cutoff(self) -> float:
        return self.problem.data.cutoff

    @property
    def constant_speeds(self) -> bool:
        return self.problem.data.steady

    def position(self) -> Floats:
        return self.problem.data.position[self.problem.data.grid]

    def velocity(self) -> Floats:
        return self.problem.data.velocity[self.problem.data.grid]

    def thinned(self) -> Thin:
        return thinned(self)

    def ripple_orders(self) -> list[float]:
        """Orders of the ripple that the model has."""
        return [float(self.p[TORQUE_RIPPLE.slot(f"order_{i}")]) for i in TORQUE_RIPPLE.terms_in_use(self.p)]

    def orders_in_residual(self, most: int) -> list[float]:
        present = self.ripple_orders()
        for kind in EFFECTS.values():
            if kind.waves is not None and self.fitted.packed.on[layout.flag(kind.name)]:
                present += kind.waves(self.p)
        return find_orders(self.problem, thinned(self, sliding=True), self.angle, present, most)


@dataclass(frozen=True, slots=True)
class Thin:
    """A part of the training rows, to look for places and orders in, with the fitted columns taken out.

    Attributes:
        rows: of the grid, shape (t,); `basis`: of the fitted columns there, shape (t, parameters).
        error: residual without them, shape (t,).
    """

    rows: Integers
    basis: Floats
    error: Floats

    def without_base(self, columns: Floats) -> Floats:
        return np.asarray(columns - self.basis @ (self.basis.T @ columns))

    def share(self, columns: Floats) -> float:
        """Share of the residual that columns of shape (t, k) explain."""
        extra = self.without_base(columns)
        inner = extra.T @ extra
        size = np.trace(inner)
        if size < 1e-12 * max(float(np.sum(columns**2)), 1e-300):
            return 0.0
        target = extra.T @ self.error
        explained = float(target @ np.linalg.solve(inner + 1e-9 * size * np.eye(len(inner)), target))
        return explained / max(float(self.error @ self.error), 1e-300)


def thinned(context: Context, most: int = 5000, sliding: bool = False) -> Thin:
    """At most so many training rows, evenly spread; where the contact slides only, if the axis does so long enough.

    While a contact climbs it is at few places, and what its law is not exactly looks like waves that are short.
    """
    problem = context.problem
    if sliding:
        problem = beyond_presliding(problem, context.fitted.packed) or problem
    rows = np.flatnonzero(problem.training > 0)
    rows = rows[:: max(1, math.ceil(len(rows) / most))]
    basis = np.linalg.qr(context.fitted.jacobian[rows])[0]
    error = context.fitted.error[rows]
    return Thin(rows, basis, error - basis @ (basis.T @ error))


def begun(context: Context, kind: Kind, start: StartValues) -> FitStart:
    """A start of an effect beside what is in the model already."""
    p, on = context.p.copy(), context.fitted.packed.on.copy()
    for parameter in kind.parameters:
        p[parameter.slot] = parameter.neutral
    for name, value in start.values.items():
        p[kind.slot(name)] = value
    for slot, value in start.base.items():
        p[slot] = value
    on[layout.flag(kind.name)] = True
    return FitStart(Packed(p, on), tuple(varying(kind, name, vary) for name, vary in start.free.items()))


def varying(kind: Kind, name: str, vary: Vary) -> Free:
    """A parameter that is free, inside its physical bounds and those of the start."""
    parameter, surface = kind.parameter(name), kind.surface(name)
    lower, upper = max(parameter.lower, vary.lower), min(parameter.upper, vary.upper)
    return Free(surface, parameter.slot, lower, upper, vary.scale, vary.step, above=parameter.above)


def starts_of(kind: Kind, context: Context) -> Iterator[FitStart]:
    """Where fits of an effect begin in these data.

    What belongs to the place drives the fit without it far away: gravity looks like inertia and like a bristle as long
    as the way. So it begins from the base that was given too, where that is another.
    """
    given = context.given_base() if kind.of_place else {}
    for start in kind.starts(context):
        yield begun(context, kind, start)
        if given:
            yield begun(context, kind, replace(start, base={**given, **start.base}))


def shapes(effect: str, packed: Packed) -> tuple[Free, ...]:
    """What becomes free once an effect's first fit is there."""
    kind = EFFECTS[effect]
    later = kind.freed_later(packed.p) if kind.freed_later is not None else {}
    return tuple(varying(kind, name, vary) for name, vary in later.items())


def scouted(
    problem: Problem,
    model_fit: ModelFit,
    starts: Sequence[FitStart],
    needed: float = 0.0,
    instead: bool = False,
) -> list[FitStart]:
    """The best of the starts: by their own twins, or led down their valleys where there is no twin.

    `needed` is the relative fall of the cost below which an effect comes to nothing beside others. The best start where
    its twin shows too little of that is given with nothing free: it is not worth another run. `instead`: they stand in
    the place of what the model has between its masses, are to be seen at their best whatever that leaves, and are not
    helped by its slopes.
    """
    if problem.twin:
        once = _one_of_each(problem, starts)
        projected = Projected.of(once, model_fit, tuple(BETWEEN) if instead else ())
        return _by_own_twins(projected, starts, needed, math.inf if instead else PROMISED)
    projected = Projected.of(problem, model_fit)
    none = model_fit.correction.bias
    changes = projected.changes([start.packed for start in starts])
    costs = np.array([projected.cost(change, none) for change in changes])
    order = [int(i) for i in np.argsort(costs, kind="stable")[:FOLLOWED] if math.isfinite(costs[i])]
    led = [i for i in order if costs[i] <= AS_GOOD * costs[order[0]]]
    valleys = [_Valley(starts[i], none, ENOUGH * float(costs[i])) for i in led]
    return _led_down(projected, valleys, PROMISED * model_fit.fitted.cost)


def _one_of_each(problem: Problem, starts: Sequence[FitStart]) -> Problem:
    """The problem with the first repeat of each experiment only: a run of the twin takes half as long."""
    once = first_round(problem.data, starts[0].packed.on) if starts else problem.data
    if len(once.stretches) == len(problem.data.stretches) and once.stretches == problem.data.stretches:
        return problem
    if not repeats_alike(problem.data):
        return problem.until_trained()
    return replace(problem, data=replace(once, blocks=tuple(replace(one, repeats=1) for one in once.blocks)))


def _by_own_twins(
    projected: Projected, starts: Sequence[FitStart], needed: float, promised: float = PROMISED
) -> list[FitStart]:
    """The best start by its own twin; led down where any is better than the model without it (`promised` of its cost).

    All are looked at with one run, and the best of every size with as many as a fit takes. Where much is needed, those
    with friction on both sides are looked at first: what none of them shows a trace of is no second mass.
    """
    problem = projected.problem
    if not starts:
        return []

    def costs_of(models: Sequence[Packed], runs: int = 1) -> Floats:
        return projected.costs_in_twins(models, runs)

    shown = SHOWN * needed if SHOWN * needed > 1.0 - PROMISED else 0.0
    first = np.full(len(starts), math.inf)
    few = np.flatnonzero([_friction_at_load(start) == SPLITS[len(SPLITS) // 2] for start in starts])
    for part in (few, np.setdiff1d(np.arange(len(starts)), few)):
        first[part] = costs_of([starts[i].packed for i in part])
        if part is few and shown and first.min() > (1.0 - TRACE * shown) * projected.before:
            return [replace(starts[int(np.argmin(first))], free=())]
    order = _of_each_size(starts, first)
    closer = costs_of([starts[i].packed for i in order], problem.simulations + 1)
    near = [int(order[i]) for i in np.argsort(closer, kind="stable") if math.isfinite(closer[i])]
    if near and shown and closer.min() > (1.0 - shown) * projected.before:
        return [replace(starts[near[0]], free=())]
    if not near or closer.min() > promised * projected.before:
        return [starts[i] for i in near[:1]]
    (led,) = _led_by_twins([starts[i] for i in near], [float(first[i]) for i in near], costs_of)
    return [_round_the_bend(led, costs_of)]


def _friction_at_load(start: FitStart) -> float:
    """Share of the friction beyond the transmission."""
    return load_shares(start.packed.p, start.packed.on)[1]


def _of_each_size(starts: Sequence[FitStart], costs: Floats) -> list[int]:
    """The best starts of sizes that are apart, of each damping, the best first; their size is what is free first.

    The floor of a valley is narrower than a raster that can be looked at, and what comes to nothing costs as much as
    nothing does: gaps too small to be seen stood before one whose valley leaves half, and none of its size was led on.
    And where the contact is damped too little for the loop, the start that costs less is the one that leads nowhere.
    """
    dampings = np.array([contact_damping(start.packed.p, start.packed.on) for start in starts])
    sizes = np.array([float(start.packed.p[start.free[0].slot]) for start in starts])
    order = np.argsort(costs, kind="stable")
    chosen: list[int] = []
    for damping in np.unique(dampings):
        chosen += _apart(sizes, [int(i) for i in order if dampings[i] == damping])
    return sorted(chosen, key=lambda i: float(costs[i]))


def _apart(sizes: Floats, order: Sequence[int]) -> list[int]:
    """The first of those in order whose sizes are apart."""
    chosen: list[int] = []
    for i in order:
        ratios = sizes[i] / np.maximum(sizes[chosen], 1e-300)
        if np.all(np.maximum(ratios, 1.0 / np.maximum(ratios, 1e-300)) >= APART):
            chosen.append(i)
        if len(chosen) >= LOOKED_AT:
            break
    return chosen


def scattered(problem: Problem, model_fit: ModelFit) -> list[Packed]:
    """Places around a fit with two masses whose twins leave least: the best of those near it, and of those far from it.

    The floor of its valley is rough where a contact rattles: between a minimum of half a gap in a harder contact and
    the true one each step costs more, and neither slopes nor steps lead there. A heavy load behind a hard spring and a
    light one behind a soft one have each a valley of their own. What trades places is scattered evenly (Halton's
    sequence, [halton-1960]).
    """
    between = [one for one in model_fit.free if one.slot in BETWEEN]
    costs_of = _costs_beside(problem, model_fit, [one.slot for one in between])
    chosen = []
    for far in (False, True):
        places = _places_around(model_fit.fitted.packed, between, far)
        near = np.argsort(costs_of(places, 1), kind="stable")[:CLOSER]
        closer = costs_of([places[i] for i in near], problem.simulations + 1)
        chosen += [places[near[i]] for i in np.argsort(closer, kind="stable")[:FITTED]]
    return chosen


def _places_around(packed: Packed, between: Sequence[Free], far: bool) -> list[Packed]:
    """Models that differ in what trades places between the masses, near a model or `far` from it."""
    names = [one.name.rpartition(".")[2] for one in between]
    times = np.array([TRADED.get(name, (1.0, 1.0))[far] for name in names])
    spread = scipy.stats.qmc.Halton(len(between), seed=0).random(SCATTERED)
    values = packed.p[[one.slot for one in between]] * times ** (2.0 * spread - 1.0)
    shared = [i for i, name in enumerate(names) if far and name in SHARED]
    values[:, shared] = spread[:, shared]
    return [with_values(packed, between, _bounded(between, one)) for one in values]


def led_on(problem: Problem, model_fit: ModelFit, across: bool = False) -> Packed:
    """A fit with two masses, what is between them led on from where it stopped: by its twins, and without slopes.

    There stiffness and the shares of the load have changed places, and what the base's parameters make of the twin's
    bias is held in the sensitivities: no step is lower, though the valley goes on. It runs across the coordinates as
    often as not: `across` asks that it be followed round its bend too, which takes several times as many runs.
    """
    moved = tuple(one for one in model_fit.free if one.slot in BETWEEN)
    beside = _costs_beside(problem, model_fit, [one.slot for one in moved])

    def costs_of(models: Sequence[Packed]) -> Floats:
        return beside(models, problem.simulations + 1)

    start = FitStart(model_fit.fitted.packed, moved)
    (end,) = _led_by_twins([start], [float(costs_of([start.packed])[0])], costs_of, LED_ON, AFTER_A_FIT)
    return (_round_the_bend(end, costs_of) if across else end).packed


def _costs_beside(
    problem: Problem, model_fit: ModelFit, moved: Sequence[int]
) -> Callable[[Sequence[Packed], int], Floats]:
    """Costs of models that differ from a fit at the slots `moved`, by so many runs of their twins; all else that is
    free follows.
    """
    projected = Projected.of(problem, model_fit, moved)
    return replace(projected, problem=problem.until_judged()).costs_in_twins


def _led_by_twins(
    starts: Sequence[FitStart],
    costs: Sequence[float],
    costs_of: Callable[[Sequence[Packed]], Floats],
    rounds: int = ROUNDS,
    size: float = 1.0,
) -> list[FitStart]:
    """The best of starts that cost so much, moved to where its twin leaves least, in so many `rounds` at last.

    All go down side by side, the better half of them after each round; `size` is the part of the usual first steps.

    What is between two masses is positive, and goes by its root: a gap by the time in which it is crossed, compliance
    by the period of what rings.
    """

    def asked(places: Asked) -> Floats:
        return costs_of([_at_root(starts[number], place) for number, place in places])

    steps = [_first_steps(start) for start in starts]
    begun = [Reached(_root(start), cost, size) for start, cost in zip(starts, costs, strict=True)]
    left = list(range(len(starts)))

    def led(rounds: int) -> None:
        ends = lowest_by_parabolas(
            lambda places: asked([(left[i], place) for i, place in places]),
            [begun[i] for i in left], [steps[i] for i in left], rounds,
        )  # fmt: skip
        for i, end in zip(left, ends, strict=True):
            begun[i] = end

    while len(left) > 1:
        led(1)
        left = sorted(left, key=lambda i: begun[i].cost)[: len(left) // 2]
    led(rounds)
    best = starts[left[0]]
    return [replace(best, packed=_at_root(best, begun[left[0]].place))]


def _round_the_bend(start: FitStart, costs_of: Callable[[Sequence[Packed]], Floats]) -> FitStart:
    """A start that was led along the coordinates, moved on along its valley, which may run across them and be bent."""
    begun = Reached(_root(start), float(costs_of([start.packed])[0]))
    end = lowest_along_valley(
        lambda places: costs_of([_at_root(start, place) for place in places]),
        begun, AFTER_A_FIT * _first_steps(start), WIDTH, GENERATIONS,
    )  # fmt: skip
    return replace(start, packed=_at_root(start, end.place))


def _root(start: FitStart) -> Floats:
    """Where a start is, by the roots of what is free."""
    return np.asarray(np.sqrt(start.packed.p[[f.slot for f in start.free]]))


def _first_steps(start: FitStart) -> Floats:
    """Of those roots."""
    return np.asarray(FIRST_ROOT * np.sqrt([f.scale for f in start.free]))


def _at_root(start: FitStart, place: Floats) -> Packed:
    """The model of a start at another place, which is told by those roots."""
    return with_values(start.packed, start.free, _bounded(start.free, np.maximum(place, 0.0) ** 2))


def _bounded(free: Sequence[Free], values: Floats) -> Floats:
    """Values inside the bounds of what is free."""
    lower, upper = (np.array([getattr(f, end) for f in free]) for end in ("lower", "upper"))
    return np.asarray(np.clip(values, lower, upper))


@dataclass(frozen=True, slots=True)
class _Valley:
    """A start to lead down, with the twin's bias that is held, and the difference of costs that counts as none."""

    start: FitStart
    bias: Floats
    flat: float

    @property
    def _bounds(self) -> tuple[Floats, Floats]:
        free = self.start.free
        return np.array([f.lower for f in free]), np.array([f.upper for f in free])

    @property
    def _steps(self) -> Floats:
        return np.array(
            [FIRST_STEP * (f.step if math.isfinite(f.step) else f.scale) for f in self.start.free]
        )

    def at(self, place: Floats) -> Packed:
        """The model at a place, which is told in steps."""
        return with_values(self.start.packed, self.start.free, np.clip(place * self._steps, *self._bounds))

    def descent(self, promised: float) -> Descent:
        here, steps = self.start.packed.p[[f.slot for f in self.start.free]], self._steps
        first = np.diag(np.where(here + steps > self._bounds[1], -steps, steps))
        corners = np.clip(here + np.vstack([np.zeros(len(here)), first]), *self._bounds) / steps
        return Descent(corners, NEAR, self.flat, PASSES, PROBING, promised)


def _led_down(projected: Projected, valleys: Sequence[_Valley], promised: float) -> list[FitStart]:
    """Starts moved by the simplex method, inside the bounds of what is free.

    One is given up where probing does not get below the cost that is `promised`.
    """

    def costs_of(places: list[tuple[int, Floats]]) -> list[float]:
        changes = projected.changes([valleys[i].at(place) for i, place in places])
        return [
            projected.cost(change, valleys[i].bias) for change, (i, _) in zip(changes, places, strict=True)
        ]

    def company(number: int, place: Floats) -> Hashable:
        return kind_of_pass(projected.once, valleys[number].at(place))

    ends = lowest_places([valley.descent(promised) for valley in valleys], costs_of, company, WIDTH)
    return [
        FitStart(valley.at(place), valley.start.free) for valley, place in zip(valleys, ends, strict=True)
    ]


def own_course(problem: Problem, model_fit: ModelFit, effect: str) -> bool:
    """Whether the course of an effect, as it was fitted, is one that this effect has."""
    own = EFFECTS[effect].own_course
    return own is None or own(Context(problem, model_fit.fitted, model_fit.fitted.packed))
