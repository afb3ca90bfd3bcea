"""How a fit of each effect begins: what the effect's own starts (`Kind.starts`) find in the data.

Here stands what a start may look at (`Context`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from autotune.core.arrays import Floats, Integers
from autotune.diagnosis.ripple_orders import find_orders
from autotune.estimation.least_squares import Fitted, Free
from autotune.estimation.problem import Problem
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.effect import Kind
from autotune.models.start_values import StartValues, Vary
from autotune.models.table import EFFECTS
from autotune.models.torque_ripple import TORQUE_RIPPLE, scale_slot


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
    def reach(self) -> float:
        """Travel over which the bristle bends [motion unit]."""
        return self.coulomb / float(self.p[layout.STIFFNESS])

    @property
    def angle(self) -> float:
        """Radians per motion unit and cycle: 1 on rotary axes, 2π on linear ones."""
        return float(self.p[scale_slot()])

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
    """Where fits of an effect begin in these data."""
    for start in kind.starts(context):
        yield begun(context, kind, start)


def shapes(effect: str, packed: Packed) -> tuple[Free, ...]:
    """What becomes free once an effect's first fit is there."""
    kind = EFFECTS[effect]
    later = kind.freed_later(packed.p) if kind.freed_later is not None else {}
    return tuple(varying(kind, name, vary) for name, vary in later.items())
