"""How a fit of each effect begins: what the effect's own starts (`Kind.starts`) find in the data.

Here stand what a start may look at (`Context`), and the search for orders that repeat with position.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from autotune.core.arrays import Floats, Integers
from autotune.estimation.least_squares import Fitted, Free
from autotune.estimation.problem import Study
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.effect import Kind
from autotune.models.start_values import StartValues, Vary
from autotune.models.table import EFFECTS
from autotune.models.torque_ripple import TORQUE_RIPPLE, scale_slot

LEAST_LINE_GAIN = 0.008
MOST_LINES = 7
LINE_CONTRAST = 6.0


@dataclass(frozen=True, slots=True)
class Start:
    """Where a refit begins: parameters and flags, and what is free beside the base."""

    packed: Packed
    free: tuple[Free, ...]


@dataclass(frozen=True, slots=True)
class Context:
    """What a start may look at: the study, the fit without the effect, and the values before it."""

    study: Study
    fitted: Fitted
    nominal: Packed

    @property
    def p(self) -> Floats:
        return self.fitted.packed.p

    @property
    def coulomb(self) -> float:
        return max(float(self.p[layout.COULOMB]), 0.02 * self.study.scales.torque)

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
        return self.study.scales.torque

    @property
    def speed(self) -> float:
        return self.study.scales.velocity

    @property
    def travel(self) -> float:
        return self.study.scales.travel

    @property
    def mean_speed(self) -> float:
        return float(np.mean(np.abs(self.study.data.velocity)))

    @property
    def largest_torque(self) -> float:
        """The largest recorded, or the drive's limit where that is lower."""
        largest = float(np.max(np.abs(self.study.data.torque)))
        return min(self.study.data.metadata.torque_limit or largest, largest)

    @property
    def resolution(self) -> float:
        return self.study.data.resolution

    @property
    def period(self) -> float:
        return self.study.data.period

    @property
    def constant_speeds(self) -> bool:
        return self.study.data.steady

    def position(self) -> Floats:
        return self.study.data.position[self.study.data.grid]

    def velocity(self) -> Floats:
        return self.study.data.velocity[self.study.data.grid]

    def thinned(self) -> Thin:
        return thinned(self)

    def orders_in_residual(self, most: int) -> list[float]:
        return find_orders(self)[:most]


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
    rows = np.flatnonzero(context.study.training > 0)
    rows = rows[:: max(1, math.ceil(len(rows) / most))]
    basis = np.linalg.qr(context.fitted.jacobian[rows])[0]
    error = context.fitted.error[rows]
    return Thin(rows, basis, error - basis @ (basis.T @ error))


def begun(context: Context, kind: Kind, start: StartValues) -> Start:
    """A start of an effect beside what is in the model already."""
    p, on = context.p.copy(), context.fitted.packed.on.copy()
    for parameter in kind.parameters:
        p[parameter.slot] = parameter.neutral
    for name, value in start.values.items():
        p[kind.slot(name)] = value
    for slot, value in start.base.items():
        p[slot] = value
    on[layout.flag(kind.name)] = True
    return Start(Packed(p, on), tuple(varying(kind, name, vary) for name, vary in start.free.items()))


def varying(kind: Kind, name: str, vary: Vary) -> Free:
    """A parameter that is free, inside its physical bounds and those of the start."""
    parameter, surface = kind.parameter(name), kind.surface(name)
    lower, upper = max(parameter.lower, vary.lower), min(parameter.upper, vary.upper)
    above = layout.COULOMB if surface == "break_away" else -1
    return Free(surface, parameter.slot, lower, upper, vary.scale, vary.step, above=above)


def starts_of(kind: Kind, context: Context) -> Iterator[Start]:
    """Where fits of an effect begin in these data."""
    for start in kind.starts(context):
        yield begun(context, kind, start)


def shapes(effect: str, packed: Packed) -> tuple[Free, ...]:
    """What becomes free once an effect's first fit is there."""
    kind = EFFECTS[effect]
    later = kind.freed_later(packed.p) if kind.freed_later is not None else {}
    return tuple(varying(kind, name, vary) for name, vary in later.items())


def candidate_orders(c: Context) -> Floats:
    """Orders that the travel can tell apart and the sampling can show."""
    travel = c.study.scales.travel * c.angle / (2 * math.pi)
    slow = float(np.percentile(np.abs(c.velocity()), 25)) * c.angle / (2 * math.pi)
    cutoff = 0.9 / (c.study.data.period * max(len(c.study.data.taps) // 2, 1))
    most = 400.0 if c.angle == 1.0 else 2000.0 / max(travel, 1e-9)
    highest = min(most, 0.8 * cutoff / max(slow, 1e-9))
    lowest = 1.5 / max(travel, 1e-9)
    if c.angle == 1.0:
        first = max(2.0, math.ceil(lowest))
        return np.arange(first, max(highest, first + 1.0))
    return np.asarray(np.arange(lowest, max(highest, 2 * lowest), 0.35 / max(travel, 1e-12)))


def line_columns(c: Context, order: float, rows: Integers) -> Floats:
    """Sine and cosine of an order, faded out where the low-pass removes them, shape (rows, 2)."""
    angle = order * c.angle
    phase = angle * c.position()[rows]
    hertz = np.abs(c.velocity()[rows]) * angle / (2 * math.pi)
    cutoff = 0.9 / (c.study.data.period * max(len(c.study.data.taps) // 2, 1))
    fade = np.exp(-((hertz / cutoff) ** 4))
    return np.asarray(np.column_stack([np.sin(phase) * fade, np.cos(phase) * fade]))


def find_orders(c: Context, most: int = MOST_LINES) -> list[float]:
    """Ripple orders in the residual, strongest first.

    A line must stand out of what its neighbours explain beside it: over a short travel a strong line
    leaks into them, and what they seem to explain without it is its own.
    """
    thin = thinned(c)
    present = [c.p[TORQUE_RIPPLE.slot(f"order_{i}")] for i in TORQUE_RIPPLE.terms_in_use(c.p)]
    found: list[float] = []
    orders = candidate_orders(c)
    tables = [line_columns(c, float(order), thin.rows) for order in orders]
    gains = np.array([thin.share(table) for table in tables])
    while len(found) < most:
        best = int(np.argmax(gains))
        order = float(orders[best])
        if gains[best] < LEAST_LINE_GAIN or any(abs(order - other) < 0.5 for other in present):
            break
        extra = np.linalg.qr(thin.without_base(tables[best]))[0]
        thin = Thin(thin.rows, np.hstack([thin.basis, extra]), thin.error - extra @ (extra.T @ thin.error))
        beside = np.array([thin.share(table) for table in tables])
        near = (orders > 0.6 * order - 1.0) & (orders < 1.7 * order + 1.0)
        left = (1.0 - gains[best]) * float(np.median(beside[near]))
        if gains[best] < LINE_CONTRAST * left:
            break
        found.append(order)
        gains = beside
    return found
