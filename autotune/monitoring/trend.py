"""What a history of friction says: temperature taken out, steps, bends and single odd days found.

    ln F_i = a + b·t_i + c·(T_i − T̄) + Σ s_k·[t_i ≥ t_k] + Σ h_k·max(t_i − t_k, 0) + e_i

Days that lie apart from both neighbours are set aside first. Where the history breaks is found by cutting
it into straight pieces (`segments`); each break may be a step, a bend or both, and what chance could have
made is dropped, weakest first (5.5 standard deviations, which allows for the many places tried). The
scatter of e is taken from second differences, and a first c from first ones, so that slow changes count
neither as noise nor as temperature.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.monitoring.segments import breaks
from autotune.signals.runs import white_noise

if TYPE_CHECKING:
    from autotune.monitoring.drift import Before

LEAST_POINTS = 6
SURE = 5.5
LEAST_SIZE = 0.03
LEAST_SCATTER = 0.003
MOST_KNOTS = 20
TURNS = 3
FEW = 5.0
LEAST_SPREAD = 3.0  # K
SETTLED = 2  # points from a step on before it is called one
BENT = 6  # points from a bend on before it is called one


@dataclass(frozen=True, slots=True)
class Change:
    """One change: `step` at once, `trend` beginning then, `odd` one day only. `size` is relative.

    `until`: end of a trend that had come to its end before the last point; None where it goes on.
    """

    kind: str
    at: datetime
    size: float
    standard_error: float
    until: datetime | None = None


@dataclass(frozen=True, slots=True)
class Trend:
    """Result of `analyse`.

    Attributes:
        changes: in time order.
        temperature_coefficient: relative change a kelvin, None where the data do not tell.
        scatter: of a single point, relative.
        level: fitted value at the last point, at mean temperature.
    """

    changes: tuple[Change, ...]
    temperature_coefficient: float | None
    scatter: float
    level: float


def trend_over(checks: Sequence[Before]) -> Trend | None:
    """Trend of the friction level over checks, oldest first."""
    return analyse(
        [datetime.fromisoformat(one.at) for one in checks],
        [one.level for one in checks],
        [one.temperature for one in checks],
    )


def analyse(times: list[datetime], values: list[float], temperatures: list[float]) -> Trend | None:
    """Finds what changed; None with fewer than six points.

    Args:
        times: in order; values: above 0; temperatures: °C, nan where not known. All of length n.
    """
    if len(values) < LEAST_POINTS:
        return None
    t = np.array([(time - times[0]).total_seconds() / 86400.0 for time in times])
    y = np.log(np.array(values))
    temperature = _centred(np.array(temperatures, dtype=np.float64))
    odd = _odd_days(y)
    keep = np.flatnonzero(~(odd | _pending(y)))
    fit = _Fit(t[keep], y[keep], temperature[keep] if temperature is not None else None)
    fit.grow()
    changes = [
        *(_odd_change(times, y, fit, keep, int(index)) for index in np.flatnonzero(odd)),
        *fit.changes([times[index] for index in keep]),
    ]
    coefficient = fit.temperature_coefficient
    return Trend(
        tuple(sorted(changes, key=lambda change: change.at)),
        coefficient,
        fit.scatter,
        math.exp(fit.level),
    )


def sentence(change: Change, what: str) -> str:
    """One change in plain words."""
    day = f"{change.at.day} {change.at:%B}"
    size = f"{abs(change.size):.0%}"
    same = "at the same temperature"
    if change.kind == "odd":
        word = "above" if change.size > 0 else "below"
        return f"{what} was {size} {word} the usual on {day} only: the axis stuck, or the check was disturbed"
    direction = "up" if change.size > 0 else "down"
    if change.kind == "step" and change.size < 0:
        return f"{what} {direction} {size} at once on {day}, {same}: as after re-greasing"
    if change.kind == "step":
        return f"{what} {direction} {size} at once on {day}, {same}: look for damage or lost lubricant"
    span = f"since {day}"
    if change.until is not None:
        span = f"from {day} to {change.until.day} {change.until:%B}"
    if change.size < 0:
        return f"{what} {direction} {size} {span}, {same}: running in"
    return f"{what} {direction} {size} {span}, {same}: check lubrication"


def _centred(temperature: Floats) -> Floats | None:
    """Deviation from the mean; None where it is unknown or hardly changes."""
    if not np.isfinite(temperature).all() or float(np.ptp(temperature)) < LEAST_SPREAD:
        return None
    return np.asarray(temperature - temperature.mean())


def _scatter(y: Floats) -> float:
    """Standard deviation of a single point from second differences, robust; few points tell it badly."""
    if len(y) < 4:
        return LEAST_SCATTER
    caution = 1.0 + FEW / len(y)
    return max(caution * white_noise(y), LEAST_SCATTER)


def _first_coefficient(y: Floats, temperature: Floats | None) -> float:
    """Influence of temperature from day to day, which no slow change can imitate; outliers weigh little."""
    if temperature is None:
        return 0.0
    warmer, more = np.diff(temperature), np.diff(y)
    usual = np.abs(more - np.median(more)) < 4.0 * max(float(np.median(np.abs(more))), LEAST_SCATTER)
    warmth = float(np.sum(warmer[usual] ** 2))
    return float(np.sum(warmer[usual] * more[usual])) / warmth if warmth > 0.0 else 0.0


def _odd_days(y: Floats) -> NDArray[np.bool_]:
    """Points far from both neighbours, which agree with one another; never the last point."""
    odd = np.zeros(len(y), dtype=np.bool_)
    far = max(8.0 * _scatter(y), 2.0 * LEAST_SIZE)
    left, right = y[1:-1] - y[:-2], y[1:-1] - y[2:]
    odd[1:-1] = (np.abs(left) > far) & (np.abs(right) > far) & (left * right > 0)
    odd[1:-1] &= np.abs(left - right) < 0.5 * np.minimum(np.abs(left), np.abs(right))
    return odd


def _pending(y: Floats) -> NDArray[np.bool_]:
    """The last point where it stands alone: tomorrow tells whether it was an odd day or a step."""
    alone = np.zeros(len(y), dtype=np.bool_)
    far = max(8.0 * _scatter(y[:-1]), 2.0 * LEAST_SIZE)
    alone[-1] = abs(y[-1] - y[-2]) > far and abs(y[-1] - np.median(y[-4:-1])) > far
    return alone


def _odd_change(times: list[datetime], y: Floats, fit: _Fit, keep: NDArray[np.int64], index: int) -> Change:
    near = keep[np.argsort(np.abs(keep - index))[:4]]
    size = math.expm1(float(y[index] - np.mean(y[near])))
    return Change("odd", times[index], size, fit.scatter)


class _Fit:
    """The regression. Columns are kept with what they mean."""

    def __init__(self, t: Floats, y: Floats, temperature: Floats | None) -> None:
        self._t, self._y, self._temperature = t, y, temperature
        self.scatter = _scatter(y - self._warmth(_first_coefficient(y, temperature)))
        self._columns: list[Floats] = []
        self._meaning: list[tuple[str, int]] = []
        self._begin()

    def _begin(self) -> None:
        self._columns, self._meaning = [np.ones_like(self._t)], [("level", 0)]
        if self._temperature is not None:
            self._columns.append(self._temperature)
            self._meaning.append(("temperature", 0))

    def _warmth(self, coefficient: float) -> Floats:
        return np.zeros_like(self._y) if self._temperature is None else coefficient * self._temperature

    def grow(self) -> None:
        """Steps and bends where the history breaks; breaks and temperature are found in turns."""
        coefficient = _first_coefficient(self._y, self._temperature)
        for _ in range(TURNS):
            found = breaks(self._t, self._y - self._warmth(coefficient), self.scatter, SURE**2)
            self._begin()
            for at in found[-MOST_KNOTS:]:
                self._add("step", at, SETTLED)
                self._add("trend", at, BENT)
            self._add("trend", 0, BENT)
            self._prune()
            coefficient = self._coefficient()[0]

    def _add(self, kind: str, at: int, least: int) -> None:
        """A bend at the first point is a plain trend."""
        if at > len(self._t) - least:
            return
        since = self._t - self._t[at]
        self._columns.append((since >= 0).astype(float) if kind == "step" else np.maximum(since, 0.0))
        self._meaning.append((kind, at))

    def _coefficient(self) -> tuple[float, float]:
        """Influence of temperature and its standard error; (0, inf) where there is none."""
        solution, errors = self._solve()
        for k, (kind, _) in enumerate(self._meaning):
            if kind == "temperature":
                return float(solution[k]), float(errors[k])
        return 0.0, math.inf

    def _prune(self) -> None:
        """Drops, weakest first, what later additions have made superfluous or too small to matter."""
        while True:
            solution, errors = self._solve()
            weak = [
                (abs(solution[k]) / errors[k], k)
                for k, (kind, at) in enumerate(self._meaning)
                if kind in ("step", "trend")
                and (
                    abs(solution[k]) < SURE * errors[k] or abs(self._size(kind, at, solution[k])) < LEAST_SIZE
                )
            ]
            if not weak:
                return
            del self._columns[(k := min(weak)[1])], self._meaning[k]

    def _solve(self) -> tuple[Floats, Floats]:
        design = np.column_stack(self._columns)
        inverse = np.linalg.pinv(design.T @ design)
        errors = self.scatter * np.sqrt(np.maximum(np.diag(inverse), 1e-18))
        return np.asarray(inverse @ (design.T @ self._y)), np.asarray(errors)

    def _size(self, kind: str, at: int, coefficient: float) -> float:
        """Change that it makes up to now (a bend: to the next bend or step)."""
        if kind == "step":
            return float(coefficient)
        return float(coefficient * (self._t[-1] - self._t[at]))

    @property
    def temperature_coefficient(self) -> float | None:
        """Where it is known to a fifth."""
        value, error = self._coefficient()
        return value if abs(value) > 5.0 * error else None

    @property
    def level(self) -> float:
        solution, _ = self._solve()
        row = [0.0 if kind == "temperature" else column[-1]
               for column, (kind, _) in zip(self._columns, self._meaning, strict=True)]  # fmt: skip
        return float(np.dot(row, solution))

    def changes(self, times: list[datetime]) -> list[Change]:
        """Steps, and stretches between bends in which friction moved by a size that matters."""
        solution, errors = self._solve()
        found = [
            Change("step", times[at], math.expm1(solution[k]), float(errors[k]))
            for k, (kind, at) in enumerate(self._meaning)
            if kind == "step"
        ]
        return found + self._stretches(times, solution)

    def _stretches(self, times: list[datetime], solution: Floats) -> list[Change]:
        """Straight pieces, from each bend or step to the next; those that go on the same way are one."""
        bends = {at: float(solution[k]) for k, (kind, at) in enumerate(self._meaning) if kind == "trend"}
        steps = {at for kind, at in self._meaning if kind == "step"}
        slope = 0.0
        pieces: list[tuple[int, int, float]] = []
        for at, until in pairwise([*sorted({*bends, *steps}), len(self._t) - 1]):
            slope += bends.get(at, 0.0)
            moved = slope * float(self._t[until] - self._t[at])
            if abs(moved) < LEAST_SIZE:
                continue
            if pieces and pieces[-1][1] == at and at not in steps and (pieces[-1][2] > 0) == (moved > 0):
                at, moved = pieces[-1][0], pieces.pop()[2] + moved
            pieces.append((at, until, moved))
        return [
            Change(
                "trend", times[at], math.expm1(moved), self.scatter * 2.0 / math.sqrt(max(until - at, 1)),
                times[until] if until < len(self._t) - 1 else None,
            )
            for at, until, moved in pieces
        ]  # fmt: skip
