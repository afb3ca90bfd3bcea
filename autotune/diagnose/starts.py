"""How a fit of each effect begins: which parameters are free, from which values, found in the data.

A missing effect distorts the base fit, and some laws have several minima; a family may have several
starts, and what counts is the best of their refits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.arrays import Floats, Integers
from autotune.estimation.least_squares import Fitted, Free
from autotune.estimation.problem import Study
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.effect import Parameter
from autotune.models.table import EFFECTS
from autotune.models.torque_ripple import LINES, scale_slot

MEMORY_STEPS = (0.5, 1.0, 2.0, 4.0, 9.0, 25.0, 80.0)
MEMORY_IN_USE = 0.05  # of what all elements carry
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

    def position(self) -> Floats:
        return self.study.data.position[self.study.data.grid]

    def velocity(self) -> Floats:
        return self.study.data.velocity[self.study.data.grid]


Starts = Callable[[Context], Iterator[Start]]


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


def _start(
    context: Context,
    effect: str,
    values: Mapping[str, float],
    free: Mapping[str, tuple[float, float]],
    base: Mapping[int, float] | None = None,
) -> Start:
    """`values` of the effect's parameters; `free`: name → (scale, longest step)."""
    kind = EFFECTS[effect]
    p, on = context.p.copy(), context.fitted.packed.on.copy()
    for parameter in kind.parameters:
        p[parameter.slot] = parameter.neutral
    for name, value in values.items():
        p[kind.parameter(name).slot] = value
    for slot, value in (base or {}).items():
        p[slot] = value
    on[layout.flag(effect)] = True
    return Start(
        Packed(p, on), tuple(_free(kind.surface(n), kind.parameter(n), *how) for n, how in free.items())
    )


def _free(surface: str, parameter: Parameter, scale: float, step: float) -> Free:
    above = layout.COULOMB if surface == "break_away" else -1
    return Free(surface, parameter.slot, parameter.lower, parameter.upper, scale, step, above=above)


def _asymmetry(c: Context) -> Iterator[Start]:
    viscous = 0.3 * c.study.scales.torque / c.study.scales.velocity
    yield _start(
        c,
        "direction_asymmetry",
        {},
        {"coulomb": (0.1 * c.coulomb, 0.5 * c.coulomb), "viscous": (0.3 * viscous, viscous)},
    )


def _stribeck(c: Context) -> Iterator[Start]:
    top = c.study.scales.velocity
    for share, exponent in ((0.01, 2.0), (0.05, 2.0), (0.03, 1.0)):
        speed = share * top if not c.study.data.steady else 5.0 * share * top
        free = {
            "break_away": (0.1 * c.coulomb, 0.4 * c.coulomb),
            "stribeck_velocity": (0.3 * speed, 0.6 * speed),
        }
        values = {"break_away": 1.1 * c.coulomb, "stribeck_velocity": speed, "stribeck_exponent": exponent}
        yield _start(c, "stribeck", values, free)


def _nonlinear_viscous(c: Context) -> Iterator[Start]:
    top = c.study.scales.velocity
    for exponent, share in ((0.5, 0.1), (2.0, 0.05)):
        torque = share * c.coulomb / top**exponent
        values = {"torque": torque, "exponent": exponent, "knee": 2e-3 * top}
        free = {"torque": (torque, 5.0 * torque), "exponent": (0.3, 0.4)}
        yield _start(c, "nonlinear_viscous", values, free)


def _spot(c: Context) -> Iterator[Start]:
    low, high = np.percentile(c.position(), [1, 99])
    thin = thinned(c)
    place = c.position()[thin.rows]
    column = c.sensitivity("coulomb")[thin.rows] * c.coulomb
    best = (-1.0, 0.5 * (low + high), high - low)
    span = high - low
    for width in (0.04 * span, 0.1 * span, 0.22 * span, 0.5 * span):
        for centre in np.linspace(low, high, min(25, max(9, int(span / width)))):
            shape = np.exp(-(((place - centre) / width) ** 2))
            best = max(best, (thin.share((column * shape)[:, None]), float(centre), float(width)))
    _, centre, width = best
    yield _start(
        c,
        "position_dependent_friction",
        {"height": 0.02, "centre": centre, "width": width},
        {"height": (0.2, 0.5), "centre": (0.5 * width, 0.7 * width), "width": (0.4 * width, 0.5 * width)},
    )
    order = 1.0 if c.angle == 1.0 else 1.0 / span
    if span * order * c.angle >= 1.2 * math.pi:
        yield _start(
            c, "position_dependent_friction", {"order": order}, {"sin": (0.1, 0.4), "cos": (0.1, 0.4)}
        )


def _imbalance(c: Context) -> Iterator[Start]:
    free = {"sin": (0.1 * c.coulomb, np.inf), "cos": (0.1 * c.coulomb, np.inf)}
    if c.angle == 1.0:
        yield _start(c, "gravity_imbalance", {}, free)


def _spring(c: Context) -> Iterator[Start]:
    yield _start(c, "spring", {}, {"stiffness": (c.coulomb / c.study.scales.travel, np.inf)})


def _memory(c: Context) -> Iterator[Start]:
    """Elements on a raster of displacements: what they carry enters linearly."""
    reach = min(c.reach, 0.01 * c.study.scales.travel)
    for stiffer in (1.0, 3.0, 9.0):
        values = {}
        free = {}
        for i, factor in enumerate(MEMORY_STEPS, 1):
            values[f"displacement_{i}"] = factor * reach / stiffer
            values[f"torque_{i}"] = 0.01 * c.coulomb
            free[f"torque_{i}"] = (0.1 * c.coulomb, 0.5 * c.coulomb)
        base = {layout.STIFFNESS: c.p[layout.STIFFNESS] * stiffer}
        yield _start(c, "reversal_memory", values, free, base)


def shapes(effect: str, packed: Packed) -> tuple[Free, ...]:
    """What becomes free once a family's first fit is there: displacements of the elements that carry."""
    if effect != "reversal_memory":
        return ()
    kind = EFFECTS[effect]
    numbers = range(1, len(MEMORY_STEPS) + 1)
    torque = [float(packed.p[kind.parameter(f"torque_{i}").slot]) for i in numbers]
    moving = []
    for i in numbers:
        if torque[i - 1] > MEMORY_IN_USE * sum(torque):
            name = f"displacement_{i}"
            slot = kind.parameter(name).slot
            value = float(packed.p[slot])
            moving.append(Free(kind.surface(name), slot, 0.2 * value, 5.0 * value, 0.5 * value, 0.4 * value))
    return tuple(moving)


def _thermal(c: Context) -> Iterator[Start]:
    power = c.coulomb * float(np.mean(np.abs(c.study.data.velocity)))
    for seconds in (20.0, 90.0):
        yield _start(
            c,
            "thermal_drift",
            {"softening": 0.0, "time_constant": seconds, "idle": 0.5 * power},
            {
                "softening": (0.1 / power, 0.5 / power),
                "time_constant": (0.3 * seconds, 0.6 * seconds),
                "idle": (power, 2.0 * power),
            },
        )


LEAST_LOAD = 0.1
"""Share of the inertia beyond a transmission: less, behind a soft spring, is a hysteresis element."""


def _beyond(start: Start) -> Start:
    """The start with a load that deserves the name."""
    free = [replace(f, lower=LEAST_LOAD) if f.name.endswith(".load_inertia") else f for f in start.free]
    return Start(start.packed, tuple(free))


def _load_side(friction: float) -> dict[str, float]:
    return {"load_inertia": 0.4, "load_friction": friction, "damping": 0.05}


def _elastic(c: Context) -> Iterator[Start]:
    for hertz in (25.0, 60.0, 120.0):
        reduced = 0.24 * c.p[layout.INERTIA]
        compliance = 1.0 / (reduced * (2 * math.pi * hertz) ** 2)
        free = {
            "compliance": (compliance, 0.6 * compliance),
            "load_inertia": (0.2, 0.2),
            "load_friction": (0.2, 0.3),
        }
        values = {"compliance": compliance, **_load_side(0.4)}
        yield _not_too_stiff(c, _beyond(_start(c, "elastic_transmission", values, free)))


STIFFEST = 2.0 * math.pi * 500.0
"""Angular frequency [rad/s] above which a resonance of two equal masses is not looked for, or half the
sampling rate where that is higher."""


def _backlash(c: Context) -> Iterator[Start]:
    reduced = 0.24 * c.p[layout.INERTIA]
    compliance = 1.0 / (reduced * (2 * math.pi * 200.0) ** 2)
    for reaches in (0.3, 1.0, 3.0):
        gap = max(reaches * c.reach, 4.0 * c.study.data.resolution)
        values = {"gap": gap, "contact_compliance": compliance, **_load_side(0.4)}
        free = {
            "gap": (0.5 * gap, 0.6 * gap),
            "contact_compliance": (compliance, compliance),
            "load_inertia": (0.2, 0.2),
            "load_friction": (0.2, 0.3),
        }
        yield _not_too_stiff(c, _beyond(_start(c, "backlash", values, free)))


def _not_too_stiff(c: Context, start: Start) -> Start:
    """The start with a lower bound on compliance: beyond it motor and load are one mass to these samples.

    Without it a fit that needs no compliance ends where an integration takes ten times as long.
    """
    rate = max(math.pi / c.study.data.period, STIFFEST)
    least = 4.0 / (float(c.p[layout.INERTIA]) * rate**2)
    free = [replace(f, lower=least) if f.name.endswith("compliance") else f for f in start.free]
    return Start(start.packed, tuple(free))


def _lag(c: Context) -> Iterator[Start]:
    h = c.study.data.period
    yield _start(c, "torque_lag", {"time_constant": 0.3 * h}, {"time_constant": (0.5 * h, h)})


def _saturation(c: Context) -> Iterator[Start]:
    limit = c.study.data.metadata.torque_limit or float(np.max(np.abs(c.study.data.torque)))
    limit = min(limit, float(np.max(np.abs(c.study.data.torque))))
    yield _start(c, "torque_saturation", {"loss": 0.05, "torque": limit}, {"loss": (0.2, 0.3)})


LEAST_AGE = 0.1
"""Seconds in which a contact ages: one that is faster falls with speed, as Stribeck's does, at every speed."""


def _dwell(c: Context) -> Iterator[Start]:
    for slip in (0.3 * c.reach, 2.0 * c.reach):
        values = {"rise": 0.1 * c.coulomb, "time_constant": 1.0, "slip": slip}
        free = {
            "rise": (0.2 * c.coulomb, 0.4 * c.coulomb),
            "time_constant": (0.5, 0.8),
            "slip": (0.5 * slip, 0.7 * slip),
        }
        start = _start(c, "dwell_time_break_away", values, free)
        bounded = [
            replace(f, lower=LEAST_AGE) if f.name.endswith(".time_constant") else f for f in start.free
        ]
        yield Start(start.packed, tuple(bounded))


def _load(c: Context) -> Iterator[Start]:
    for share in (0.0, 1.0):
        free = {"factor": (0.1, 0.2), "friction_share": (0.3, 0.4)}
        yield _start(c, "load_dependent_friction", {"factor": 0.03, "friction_share": share}, free)


def _eccentricity(c: Context) -> Iterator[Start]:
    if c.angle != 1.0:
        return
    size = max(c.study.data.resolution, 1e-4)
    yield _start(c, "encoder_eccentricity", {}, {"sin": (size, 0.02), "cos": (size, 0.02)})


def _ripple(c: Context) -> Iterator[Start]:
    """New lines beside those that the model has already."""
    kind = EFFECTS["torque_ripple"]
    present = [i for i in range(1, LINES + 1) if c.p[kind.parameter(f"order_{i}").slot] > 0.0]
    orders = find_orders(c)[: LINES - len(present)]
    if not orders:
        return
    names = {f"{part}_{i}" for i in present for part in ("order", "sin", "cos")}
    values = {name: float(c.p[kind.parameter(name).slot]) for name in names}
    free: dict[str, tuple[float, float]] = {}
    for i, order in enumerate(orders, len(present) + 1):
        values |= {f"order_{i}": order, f"sin_{i}": 0.0, f"cos_{i}": 0.0}
        free |= {f"sin_{i}": (0.1 * c.coulomb, np.inf), f"cos_{i}": (0.1 * c.coulomb, np.inf)}
        if c.angle != 1.0:
            reach = 1.0 / (c.angle * c.study.scales.travel)
            free[f"order_{i}"] = (0.2 * reach, 0.5 * reach)
    yield _start(c, "torque_ripple", values, free)


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
    present = [c.p[EFFECTS["torque_ripple"].parameter(f"order_{i}").slot] for i in range(1, LINES + 1)]
    found: list[float] = []
    orders = candidate_orders(c)
    tables = [line_columns(c, float(order), thin.rows) for order in orders]
    gains = np.array([thin.share(table) for table in tables])
    while len(found) < most:
        best = int(np.argmax(gains))
        order = float(orders[best])
        if gains[best] < LEAST_LINE_GAIN or any(abs(order - other) < 0.5 for other in present if other > 0):
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


FAMILIES: Mapping[str, Starts] = {
    "torque_ripple": _ripple,
    "direction_asymmetry": _asymmetry,
    "stribeck": _stribeck,
    "nonlinear_viscous": _nonlinear_viscous,
    "position_dependent_friction": _spot,
    "gravity_imbalance": _imbalance,
    "spring": _spring,
    "reversal_memory": _memory,
    "thermal_drift": _thermal,
    "elastic_transmission": _elastic,
    "backlash": _backlash,
    "torque_lag": _lag,
    "torque_saturation": _saturation,
    "dwell_time_break_away": _dwell,
    "load_dependent_friction": _load,
    "encoder_eccentricity": _eccentricity,
}
