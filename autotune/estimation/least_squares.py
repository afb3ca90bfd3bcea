"""Levenberg–Marquardt on the twin-corrected residual: base and effects together.

Sensitivities are finite differences on the measured motion; the bias of the twin is held during the
inner steps. Steps of a base parameter are limited to 30 % of it, those of a shape to its own `step`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias, TypeVar

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.estimation.data import Prepared, Stretch, first_round, spread, until_last
from autotune.estimation.residual import Motion, alike, kind_of_pass, residuals
from autotune.models.drive_model import Packed
from autotune.models.transmission import BETWEEN

Judged: TypeAlias = Callable[[Sequence[Packed]], Sequence[tuple[Floats, Floats] | None]]
"""Residuals of the first of some models, as many as cost little more than one, and the biases that belong to them,
shape (m,) each; None where the twin is unstable."""
Sensed: TypeAlias = Callable[[Packed, Floats], tuple[Floats, Floats]]
"""Sensitivities and scales, as `jacobian` gives them, at a model whose bias is given, shape (m,)."""
Result = TypeVar("Result")
Asked: TypeAlias = tuple[Prepared, Sequence[Packed]]
"""Models whose residuals of the measured motion a fit asks for next, shape (models, m), and the data that they need."""
Steps: TypeAlias = Generator[Asked, Floats, Result]
CORRELATED = 4.0
"""Rows of a residual that count as one, as it went through a low-pass."""
BASE_STEP = 0.3
DIFFERENCE = 2e-3
STALE = 0.02
"""Relative fall of the cost above which sensitivities are computed anew."""
KEPT = 0.25
"""Of the fall that its quadratic model promises: a step that keeps less is compared with more damped ones (the gain
ratio of Nocedal and Wright, Numerical Optimization, chapter 4)."""
HOPE = 3.0
"""Steps as good as the last that a fit is trusted to have left."""
TRIALS, DAMPED, HARDER = 6, 1e-3, 8.0
"""Steps tried from one linearisation, least damping of the second of them, and what it grows by after that."""
TRIALS_JUDGED, DAMPED_JUDGED, HARDER_JUDGED = 4, 0.03, 10.0
"""The same where every step is judged by its own bias, at the cost of simulations."""
MOST_SETS = 3
"""Times the number of parameters: sets of them that are held, of which the lowest place in a box is looked for."""
JUDGED_TOGETHER = 2
"""Of these: with three simulations and the measured motion each they fill a pass."""


@dataclass(frozen=True, slots=True)
class Free:
    """A parameter that a fit may change.

    Attributes:
        name: on every surface; `slot`: its place in the vector.
        lower, upper: bounds.
        scale: what a large change is: finite differences and damping go by it.
        step: largest change in one iteration, in the parameter's unit; infinite if free.
        relative: whether scale and step follow the value (positive base parameters).
        above: slot of a parameter that this one is never below (break-away and Coulomb friction), or never below so
            many `times` it (stiffness and Coulomb friction: how far a contact bends); -1: none.
    """

    name: str
    slot: int
    lower: float
    upper: float
    scale: float
    step: float = np.inf
    relative: bool = False
    above: int = -1
    times: float = 1.0

    def least(self, p: Floats) -> float:
        """The lower bound beside the other parameters."""
        return self.lower if self.above < 0 else max(self.lower, self.times * float(p[self.above]))

    def scale_at(self, value: float) -> float:
        return max(abs(value), 2e-2 * self.scale) if self.relative else self.scale

    def step_at(self, value: float) -> float:
        return max(BASE_STEP * abs(value), 0.1 * self.scale) if self.relative else self.step


@dataclass(frozen=True, slots=True)
class Fitted:
    """Result of a fit.

    Attributes:
        packed: parameters; `free`: which of them were fitted.
        error: corrected residual on all grid rows, shape (m,).
        jacobian: d(residual)/d(parameter/scale), shape (m, parameters), at the last linearisation; 0 on rows
            that are not of the training; `scales`: what a column stands for.
        cost: mean square on the fitted rows [(N m)²].
        converged: no step from here leads downhill.
    """

    packed: Packed
    free: tuple[Free, ...]
    error: Floats
    jacobian: Floats
    scales: Floats
    cost: float
    converged: bool = False

    @property
    def values(self) -> Floats:
        return self.packed.p[[f.slot for f in self.free]]


def with_values(packed: Packed, free: Sequence[Free], values: Floats) -> Packed:
    p = packed.p.copy()
    p[[f.slot for f in free]] = values
    for parameter in free:
        if parameter.above >= 0:
            p[parameter.slot] = max(p[parameter.slot], parameter.times * p[parameter.above])
    return Packed(p, packed.on)


def jacobian(
    data: Prepared,
    moved: Motion,
    packed: Packed,
    free: Sequence[Free],
    at: Floats,
    known: tuple[Floats, Floats] | None = None,
) -> tuple[Floats, Floats]:
    """Sensitivities of the residual on training rows, shape (m, parameters), and the scales of its columns.

    `at` is the residual at `packed`; `known` are columns and scales of the first parameters, from a fit
    nearby, taken over to save time.
    """
    return done_alone(_sensitivities(data, packed, free, at, known), moved)


def _sensitivities(
    data: Prepared,
    packed: Packed,
    free: Sequence[Free],
    at: Floats,
    known: tuple[Floats, Floats] | None,
) -> Steps[tuple[Floats, Floats]]:
    """`jacobian`, asking for residuals."""
    columns = np.empty((len(at), len(free)), order="F")
    scales = np.empty(len(free))
    first = 0
    if known is not None:
        first = known[0].shape[1]
        columns[:, :first], scales[:first] = known
    changes: list[float] = []
    models: list[Packed] = []
    for i, parameter in enumerate(free[first:], first):
        value = packed.p[parameter.slot]
        scales[i] = parameter.scale_at(value)
        change = DIFFERENCE * scales[i]
        if value + change > parameter.upper:
            change = -change
        p = packed.p.copy()
        p[parameter.slot] = value + change
        changes.append(change)
        models.append(Packed(p, packed.on))
    if models:
        found = yield first_round(data, packed.on), models
        for i, moved_by in enumerate(found, first):
            columns[:, i] = (moved_by - at) * (scales[i] / changes[i - first])
    spread(data, columns[:, first:], packed.on)
    return columns, scales


def fitting(
    data: Prepared,
    packed: Packed,
    free: Sequence[Free],
    correction: Floats,
    weight: Floats,
    iterations: int = 5,
    stop: float = 2e-4,
    known: tuple[Floats, Floats] | None = None,
    hopeful: float = np.inf,
    judged: Judged | None = None,
    sensed: Sensed | None = None,
    whole: bool = True,
    target: float = np.inf,
) -> Steps[Fitted]:
    """Fits the free parameters on rows where `weight` (shape (m,), usually 0 and 1) is above 0.

    It asks for the residuals that it needs, so that several go side by side (`done_together`).

    `correction` is the twin's bias, subtracted from the residual. The result is never worse than the start.
    `known`: see `jacobian`. `hopeful`: a fit that cannot be expected to get below this cost, as its linear
    model at the start has it without any bounds, is not begun. `judged` renews the bias at every step
    (a step is rejected where the twin is unstable), `sensed` gives sensitivities in place of the measured motion's;
    without it, what moves in the twin only is held. Unless the `whole` error is asked for, it is right up to the
    last fitted row only. A fit is given up where a few steps as good as the last would not reach the cost `target`.
    """
    rows = weight > 0
    part = until_last(data, rows)
    problem = _Problem(part, rows, weight[rows], tuple(free), judged, sensed)
    here = yield from problem.at(packed, correction)
    columns, scales = yield from problem.sensitivities(data, here, known)
    known = known if known is not None and known[0].shape[1] < len(free) else None
    damping, converged = 1e-4, False
    for _ in range(iterations):
        normal, slope = problem.linearised(here, columns)
        if not (np.all(np.isfinite(normal)) and np.all(np.isfinite(slope))):
            here = replace(here, cost=np.inf)  # it diverges: nothing can be expected from here
            break
        promised = _most_gained(normal, slope)
        converged = promised < stop * here.cost
        if converged or here.cost - promised > hopeful:
            break
        found, damping = yield from problem.downhill(here, normal, slope, damping, scales)
        if found is None:
            converged = True
            break
        gained = here.cost - found.cost
        fall = gained / here.cost if here.cost > 0 else 0.0
        here, damping = found, max(damping / 6.0, 1e-6)
        if fall < stop or here.cost - HOPE * gained > target:
            break
        if fall > STALE:
            columns, scales = yield from problem.sensitivities(data, here, known)
    raw = here.raw
    if whole and part.stretches != data.stretches:
        (raw,) = yield data, [here.packed]
    error = raw - here.correction
    return Fitted(here.packed, tuple(free), error, columns, scales, here.cost, converged)


def done_alone(steps: Steps[Result], moved: Motion) -> Result:
    """What one fit comes to."""
    return done_together([steps], moved)[0]


def done_together(fits: Sequence[Steps[Result]], moved: Motion) -> list[Result]:
    """What several fits on parts of the same data come to: what they ask for goes through the inverse together.

    Every one makes the steps that it would make alone. Of those that ask for different parts of the data the most are
    answered first: the others wait for company.
    """
    results: dict[int, Result] = {}
    waiting: dict[int, Asked] = {}

    def go_on(number: int, step: Callable[[], Asked]) -> None:
        try:
            waiting[number] = step()
        except StopIteration as end:
            results[number] = end.value

    for number, one in enumerate(fits):
        go_on(number, partial(next, one))
    while waiting:
        groups: dict[tuple[Stretch, ...], list[int]] = {}
        for number, (data, _) in waiting.items():
            groups.setdefault(data.stretches, []).append(number)
        together = max(groups.values(), key=lambda group: sum(len(waiting[i][1]) for i in group))
        asked = [waiting.pop(i) for i in together]
        found = residuals(asked[0][0], [one for _, models in asked for one in models], moved)
        ends = np.cumsum([len(models) for _, models in asked])
        for number, (_, models), end in zip(together, asked, ends, strict=True):
            go_on(number, partial(fits[number].send, found[end - len(models) : end]))
    return [results[number] for number in range(len(fits))]


@dataclass(frozen=True, slots=True)
class _Place:
    """Where a fit is: residual, the bias taken from it, and what is left."""

    packed: Packed
    raw: Floats
    correction: Floats
    cost: float


@dataclass(frozen=True, slots=True)
class _Problem:
    """What a fit minimises; `rows` of the grid with their `share` of the cost."""

    data: Prepared
    rows: Flags
    share: Floats
    free: tuple[Free, ...]
    judged: Judged | None
    sensed: Sensed | None

    @property
    def total(self) -> float:
        return max(float(self.share.sum()), 1.0)

    def at(self, packed: Packed, correction: Floats) -> Steps[_Place]:
        (raw,) = yield self.data, [packed]
        return self._place(packed, raw, correction)

    def _place(self, packed: Packed, raw: Floats, correction: Floats) -> _Place:
        cost = float(np.dot(self.share, (raw - correction)[self.rows] ** 2) / self.total)
        return _Place(packed, raw, correction, cost)

    def _places(self, models: Sequence[Packed], correction: Floats) -> Steps[list[_Place | None]]:
        """Where the first of these steps lead to, as many as cost little more than one; None where a twin is unstable.

        `correction` is held unless it is renewed.
        """
        if self.judged is not None:
            found = zip(models, self.judged(models), strict=False)
            return [None if one is None else self._place(packed, *one) for packed, one in found]
        models = models[: alike([kind_of_pass(self.data, packed) for packed in models])]
        found_raw = yield self.data, models
        return [self._place(packed, raw, correction) for packed, raw in zip(models, found_raw, strict=True)]

    def sensitivities(
        self, data: Prepared, here: _Place, known: tuple[Floats, Floats] | None
    ) -> Steps[tuple[Floats, Floats]]:
        """Columns and their scales, `known` ones where they are not sensed; nothing of what moves in the twin only."""
        if self.sensed is not None:
            return self.sensed(here.packed, here.correction)
        columns, scales = yield from _sensitivities(data, here.packed, self.free, here.raw, known)
        if data.load_in_twin:
            columns[:, [i for i, one in enumerate(self.free) if one.slot in BETWEEN]] = 0.0
        return columns, scales

    def linearised(self, here: _Place, columns: Floats) -> tuple[Floats, Floats]:
        """Matrix and right side of the normal equations."""
        table = columns[self.rows]
        inner = table * self.share[:, None]
        error = (here.raw - here.correction)[self.rows]
        return inner.T @ table / self.total, inner.T @ error / self.total

    def downhill(
        self, here: _Place, normal: Floats, slope: Floats, damping: float, scales: Floats
    ) -> Steps[tuple[_Place | None, float]]:
        """The best of a few ever more damped steps, and its damping; None where none lowers the cost.

        The first is taken alone where it keeps what it promises. Where it does not, the others are looked at together,
        as what is not needed of them costs next to nothing: a step that goes far may just be lower than where it began.
        """
        trials, damped, harder = TRIALS, DAMPED, HARDER
        together, most = 1, TRIALS - 1
        if self.judged is not None:
            trials, damped, harder = TRIALS_JUDGED, DAMPED_JUDGED, HARDER_JUDGED
            together = most = JUDGED_TOGETHER
        values = here.packed.p[[f.slot for f in self.free]]
        best, at = here, damping
        waiting: list[tuple[Packed, float, float]] = []
        looked_at = 0
        while looked_at < trials:
            while len(waiting) < min(together, trials - looked_at):
                change = _step(normal, slope, damping, here.packed, self.free, scales)
                promised = _gained(normal, slope, change / scales)
                waiting.append((with_values(here.packed, self.free, values + change), damping, promised))
                damping = max(damping * harder, damped)
            places = yield from self._places([packed for packed, _, _ in waiting], here.correction)
            kept = looked_at > 0 or self.judged is not None
            for found, (_, used, promised) in zip(places, waiting, strict=False):
                if found is not None and np.isfinite(found.cost) and found.cost < best.cost:
                    best, at = found, used
                    kept = kept or here.cost - found.cost >= KEPT * promised
            if kept and best is not here:
                break
            looked_at, together = looked_at + len(places), most
            waiting = waiting[len(places) :]
        return (best, at) if best is not here else (None, damping)


def _gained(normal: Floats, slope: Floats, step: Floats) -> float:
    """By how much the cost falls at a step [scales] by its quadratic model."""
    return -float(2.0 * slope @ step + step @ normal @ step)


def _most_gained(normal: Floats, slope: Floats) -> float:
    """By how much the cost falls at the minimum of its quadratic model."""
    ridge = 1e-9 * float(np.trace(normal)) / len(normal) * np.eye(len(normal))
    return float(slope @ np.linalg.lstsq(normal + ridge, slope, rcond=1e-12)[0])


def _step(
    normal: Floats, slope: Floats, damping: float, packed: Packed, free: Sequence[Free], scales: Floats
) -> Floats:
    """A damped step that ends inside the bounds, and no further than each parameter may go at once.

    Scaled down as a whole, a step would be as short as the one that has furthest to go makes it.
    """
    values = packed.p[[f.slot for f in free]]
    limit = np.array([f.step_at(v) for f, v in zip(free, values, strict=True)])
    lower = np.array([f.least(packed.p) for f in free])
    lower = np.maximum(lower, values - limit)
    upper = np.minimum(np.array([f.upper for f in free]), values + limit)
    ridge = damping * np.diag(normal) + 1e-9 * float(np.trace(normal)) / len(free)
    low, high = (lower - values) / scales, (upper - values) / scales
    step = _lowest_in_box(normal + np.diag(ridge), slope, low, np.maximum(low, high))
    return np.asarray(np.clip(values + step * scales, lower, np.maximum(lower, upper)) - values)


def _lowest_in_box(matrix: Floats, slope: Floats, low: Floats, high: Floats) -> Floats:
    """Where ½·xᵀ·M·x + slopeᵀ·x is lowest in a box, by active sets (Nocedal and Wright, chapter 16).

    It never rises on the way there. All that is beyond its bounds at once, held where it would go, is not the lowest
    place: some of it would not go there beside the others.
    """
    step = np.clip(np.zeros(len(slope)), low, high)
    active = low < high
    for _ in range(MOST_SETS * len(slope)):
        target = step.copy()
        if active.any():
            held = matrix[np.ix_(active, ~active)] @ step[~active]
            target[active] = np.linalg.lstsq(
                matrix[np.ix_(active, active)], -slope[active] - held, rcond=1e-12
            )[0]
        change = target - step
        end = np.where(change > 0.0, high, low)
        room = np.where(change != 0.0, (end - step) / np.where(change != 0.0, change, 1.0), np.inf)
        first = int(np.argmin(room))
        if room[first] < 1.0:
            step = step + room[first] * change
            step[first], active[first] = end[first], False
            continue
        step = target
        uphill = matrix @ step + slope
        back = ~active & (low < high) & np.where(step <= low, uphill < 0.0, uphill > 0.0)
        if not back.any():
            break
        active[np.argmax(np.where(back, np.abs(uphill), 0.0))] = True
    return step


def followed(jacobian: Floats, error: Floats, weight: Floats) -> Floats:
    """An error once all parameters have followed, linearised, as rows of these weights ask for, shape (m,)."""
    columns, slope, _ = _slope(jacobian, error, weight)
    return np.asarray(error - columns @ slope)


def followed_within(fitted: Fitted, error: Floats, weight: Floats) -> Floats:
    """The same of the parameters of a fit, no further than their bounds.

    Beyond them, friction below zero takes up much of what a wrong loop leaves, or a torque of another moment.
    """
    columns, slope, size = _slope(fitted.jacobian, error, weight)
    lower, upper = (np.array([getattr(one, end) for one in fitted.free]) for end in ("lower", "upper"))
    reach = fitted.scales / size  # by which a parameter falls as its slope rises by one
    low, high = ((fitted.values - end) / reach for end in (upper, lower))
    if np.any((slope < low) | (slope > high)):
        weighted = columns * weight[:, None]
        box = np.minimum(low, 0.0), np.maximum(high, 0.0)
        slope = _lowest_in_box(weighted.T @ columns, -weighted.T @ error, *box)
    return np.asarray(error - columns @ slope)


def _slope(jacobian: Floats, error: Floats, weight: Floats) -> tuple[Floats, Floats, Floats]:
    """Columns of size one, shape (m, k), how much of each an error holds, and their sizes, shape (k,) each."""
    root = np.sqrt(weight)
    size = np.maximum(np.linalg.norm(jacobian * root[:, None], axis=0), 1e-300)
    columns = jacobian / size
    slope = np.linalg.lstsq(columns * root[:, None], error * root, rcond=1e-8)[0]
    return columns, np.asarray(slope), size


def covariance(fitted: Fitted, weight: Floats, correlated: float = CORRELATED) -> Floats:
    """Of the free parameters, in their units, shape (k, k); `correlated` rows count as one."""
    rows = weight > 0
    columns = fitted.jacobian[rows]
    freedom = max(rows.sum() / correlated - len(fitted.free), 1.0)
    variance = float(np.sum(fitted.error[rows] ** 2)) / correlated / freedom
    inverse = np.linalg.pinv(columns.T @ columns / correlated, rcond=1e-12, hermitian=True)
    return np.asarray(inverse * variance * np.outer(fitted.scales, fitted.scales))


def standard_errors(fitted: Fitted, weight: Floats, correlated: float = CORRELATED) -> Floats:
    """Of the free parameters, in their units; `correlated` rows count as one."""
    return np.asarray(np.sqrt(np.maximum(np.diag(covariance(fitted, weight, correlated)), 0.0)))
