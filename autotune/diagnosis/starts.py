"""How a fit of each effect begins: what the effect's own starts (`Kind.starts`) find in the data.

Here stands what a start may look at (`Context`), and how the best of many starts are found (`scouted`). Two masses
need that: a step of a fit follows the slope of one place, and contact is rough there. On the measured motion, with the
twin's bias held and all that is in the model solved for linearly (variable projection, [golub-1973]), the cost is one
pass of the inverse, and its valleys are wide: all starts are looked at, and the best followed without slopes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import numpy as np
import scipy

from autotune.core.arrays import Floats, Integers
from autotune.diagnosis.ripple_orders import find_orders
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.least_squares import Fitted, Free, with_values
from autotune.estimation.parts import first_round, spread
from autotune.estimation.problem import Problem
from autotune.estimation.residual import residual
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.effect import Kind
from autotune.models.start_values import StartValues, Vary
from autotune.models.table import EFFECTS
from autotune.models.torque_ripple import TORQUE_RIPPLE, scale_slot

PASSES, PROBING = 45, 18
"""Passes of the inverse by which a start is followed, and those after which it must have shown something."""
FOLLOWED, AS_GOOD = 2, 1.3
"""Starts that are followed with the bias of the model without the effect, and times the cost of the best of them."""
LOOKED_AT = 5
"""Starts that are looked at inside the twin."""
PROMISED = 0.995
"""Of the cost without the effect: what probing must get below."""
ENOUGH = 1e-2
"""Relative difference of the cost below which a valley's floor is reached."""
FELT, FAR = (layout.INERTIA, layout.COULOMB), 1.5
"""What must have gone how far from the model that was given, for a fit to begin there too."""
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
        return max(float(self.p[layout.COULOMB]), 0.02 * self.problem.scales.torque)

    @property
    def left(self) -> float:
        return math.sqrt(self.fitted.cost)

    @property
    def reach(self) -> float:
        """Travel over which the bristle bends [motion unit]."""
        return self.coulomb / float(self.p[layout.STIFFNESS])

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
    def resolution(self) -> float:
        return self.problem.data.resolution

    @property
    def period(self) -> float:
        return self.problem.data.period

    @property
    def constant_speeds(self) -> bool:
        return self.problem.data.steady

    def position(self) -> Floats:
        return self.problem.data.position[self.problem.data.grid]

    def velocity(self) -> Floats:
        return self.problem.data.velocity[self.problem.data.grid]

    def thinned(self) -> Thin:
        return thinned(self)

    def orders_in_residual(self, most: int) -> list[float]:
        present = [
            float(self.p[TORQUE_RIPPLE.slot(f"order_{i}")]) for i in TORQUE_RIPPLE.terms_in_use(self.p)
        ]
        return find_orders(self.problem, thinned(self), self.angle, present, most)


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


def thinned(context: Context, most: int = 5000) -> Thin:
    """At most so many training rows, evenly spread."""
    rows = np.flatnonzero(context.problem.training > 0)
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
    above = layout.COULOMB if surface == "break_away" else -1
    return Free(surface, parameter.slot, lower, upper, vary.scale, vary.step, above=above)


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


def scouted(problem: Problem, model_fit: ModelFit, starts: Sequence[FitStart]) -> list[FitStart]:
    """The best of the starts, led down their valleys.

    The best two with the twin's bias of the model without the effect, and the best with its own: a load that rings
    changes the bias by as much as its valley is deep; that of a gap far from its size is chance.
    """
    cost = _projected_cost(problem, model_fit)
    held = model_fit.correction.bias
    costs = np.array([cost(start.packed, held) for start in starts])
    order = [int(i) for i in np.argsort(costs, kind="stable")[:LOOKED_AT] if math.isfinite(costs[i])]
    if not order:
        return []
    own = [(starts[i], problem.correction(starts[i].packed)) for i in order]
    ringing = [(cost(start.packed, twin.bias), start, twin.bias) for start, twin in own if twin.stable]
    ringing.sort(key=lambda item: item[0])
    promised = PROMISED * model_fit.fitted.cost
    led = [(starts[i], held) for i in order[:FOLLOWED] if costs[i] <= AS_GOOD * costs[order[0]]]
    led += [(start, bias) for _, start, bias in ringing[:1]]
    return [_led_down(partial(cost, bias=bias), start, promised) for start, bias in led]


class _Cost(Protocol):
    def __call__(self, packed: Packed, bias: Floats) -> float: ...


def _projected_cost(problem: Problem, model_fit: ModelFit) -> _Cost:
    """Mean square on the training rows of a model with an effect more, all of `model_fit` solved for [(N m)²].

    `bias` is the twin's, shape (m,).
    """
    data, before, rows = problem.data, model_fit.fitted, problem.training > 0
    weight = np.sqrt(problem.training[rows])
    basis = np.linalg.qr(before.jacobian[rows] * weight[:, None])[0]
    total = float(problem.training.sum())
    once = first_round(data, before.packed.on)
    raw = before.error + model_fit.correction.bias
    without = residual(once, before.packed, problem.moved)

    def cost(packed: Packed, bias: Floats) -> float:
        change = (residual(once, packed, problem.moved) - without)[:, None]
        spread(data, change, packed.on)
        error: Floats = (raw + change[:, 0] - bias)[rows] * weight
        left = float(error @ error) - float(np.sum((basis.T @ error) ** 2))
        return left / total if math.isfinite(left) else math.inf

    return cost


def _led_down(cost: Callable[[Packed], float], start: FitStart, promised: float) -> FitStart:
    """A start moved by the simplex method ([nelder-1965]), inside the bounds of what is free.

    It is given up where probing does not get below the cost that is `promised`.
    """
    free = start.free
    lower, upper = np.array([f.lower for f in free]), np.array([f.upper for f in free])
    here = start.packed.p[[f.slot for f in free]]
    steps = np.array([FIRST_STEP * (f.step if math.isfinite(f.step) else f.scale) for f in free])
    corners = here + np.vstack([np.zeros(len(free)), np.diag(np.where(here + steps > upper, -steps, steps))])
    passes = 0

    def at(values: Floats) -> Packed:
        return with_values(start.packed, free, np.clip(values * steps, lower, upper))

    def cost_of(values: Floats) -> float:
        nonlocal passes
        passes += 1
        return cost(at(values))

    def give_up(intermediate_result: scipy.optimize.OptimizeResult) -> None:
        if passes >= PROBING and intermediate_result.fun > promised:
            raise StopIteration

    found = scipy.optimize.minimize(
        cost_of, here / steps, method="Nelder-Mead", callback=give_up,
        options={
            "initial_simplex": np.clip(corners, lower, upper) / steps, "maxfev": PASSES, "xatol": 0.1,
            "fatol": ENOUGH * cost(start.packed),
        },
    )  # fmt: skip
    return FitStart(at(found.x), free)
