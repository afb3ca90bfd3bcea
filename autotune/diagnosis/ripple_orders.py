"""Orders of torque ripple, whole or not: found at the resolution of the travel, and made whole where they may be.

A wave of N periods a revolution is told from another over a travel of T revolutions where they differ by about
1/T. Orders are looked for at a third of that; the best is refined, taken out, and the rest looked at again. Gears,
balls of a screw, belts and bearings have no whole numbers; a motor's poles have.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import scipy
from numpy.typing import NDArray

from autotune.core.arrays import Flags, Floats, Integers
from autotune.estimation.bias_corrected_fit import ModelFit, fit_inside_twin
from autotune.estimation.least_squares import covariance
from autotune.estimation.problem import Problem
from autotune.models.drive_model import Packed
from autotune.models.torque_ripple import TORQUE_RIPPLE

LEAST_LINE_GAIN = 0.008
MOST_LINES = 7
LINE_CONTRAST = 6.0
"""Times what its neighbours explain beside it: so much, and more than the chance of all orders that are tried."""
CHANCE = 0.01
AHEAD, MANY = 2, 6.0
"""Lines beside which one is judged that does not stand out alone, and periods over the travel that it must have then:
with fewer, some together are any smooth function of the place."""
SPACING = 0.35
"""Of what the travel can tell apart: distance of the orders that are tried."""
SAME = 0.7
"""Of what the travel can tell apart: a line so near to one in the model is that one."""
LEAST_PERIODS = 1.5
"""Over the travel, of a wave."""
NO_IMBALANCE = 1.5
"""Periods a turn from which on a wave is no imbalance, whatever the travel; below, where that tells it from one."""
MOST_PERIODS, MOST_IN_A_TURN = 2000.0, 400.0
"""Over the travel, and in a turn where that is more: so many are looked for at most. Behind a gear, over little travel,
a turn holds thousands."""
MOST_ORDERS = 3000
MOST_VALUES = 8e6
"""Of all columns that are kept at a time."""
PIECE = 128
SWEEPS, FINE_EXCHANGE = 3, 1e-3
"""Times that all lines are looked for anew, and by what part one must leave less then, so that it comes to an end."""
TONES = 257
"""Frequencies at which the response of the low-pass is told."""
REFINED, STEPS = 9, 3
WITHIN = 2.0
"""Standard errors, rows counted as correlated, and a share of the resolution: a whole number so near is meant."""
LEAST_DOUBT, BY_CHANCE = 0.01, 0.25
"""Cycles: an interval that goes so far either way holds a whole number by chance as often as not."""


class Searched(Protocol):
    """What orders are looked for in: the rows, and the residual without what the fitted parameters explain."""

    @property
    def rows(self) -> Integers: ...
    @property
    def basis(self) -> Floats: ...
    @property
    def error(self) -> Floats: ...


def find_orders(
    problem: Problem, thin: Searched, angle: float, present: list[float], most: int
) -> list[float]:
    """Orders that stand out of the residual, strongest first; `angle`: radians per motion unit and cycle.

    A line must stand out of what its neighbours explain beside it: over a short travel a strong line leaks into
    them, and what they seem to explain without it is its own. Waves near each other hide one another: of many periods
    each is judged beside up to two more.
    """
    orders = candidate_orders(problem, angle)
    if len(orders) == 0:
        return []
    tells = 2.0 * math.pi / (problem.scales.travel * angle)
    every = max(1, math.ceil(2.0 * len(orders) * len(thin.rows) / MOST_VALUES))
    rows, basis, error = thin.rows[::every], thin.basis[::every], thin.error[::every]
    basis = np.linalg.qr(basis)[0]
    error = error - basis @ (basis.T @ error)
    waves = _Waves(problem, angle, rows)
    raster = _Raster(waves, orders, waves.table(orders), basis, error, tells)
    far = raster.apart_from(present)
    surprising = scipy.stats.chi2.ppf(1.0 - CHANCE / len(orders), 2) / scipy.stats.chi2.median(2)
    contrast = max(LINE_CONTRAST, float(surprising))
    found: list[float] = []
    trial: list[float] = []
    left, beside_found = error, basis
    gains = np.where(far, _gains(raster.table, basis, error), 0.0)
    while len(trial) < min(most, MOST_LINES) and np.max(gains) >= LEAST_LINE_GAIN:
        order = waves.refined(float(orders[int(np.argmax(gains))]), SPACING * tells, beside_found, left)
        before = float(left @ left)
        trial, beside_found, left = raster.together([*trial, order])
        order, rest = trial[-1], float(left @ left)
        beside = np.where(far, _gains(raster.table, beside_found, left), 0.0)
        slid = any(abs(order - other) <= SAME * tells for other in present)
        if slid or order < orders[0]:  # to one in the model; a wave that slides below is the imbalance's
            break
        fallen = [
            before,
            *(waves.left_without(i, trial, basis, error) for i in range(len(found), len(trial) - 1)),
        ]
        new = [order, *trial[len(found) : -1]]
        if all(
            one - rest >= contrast * rest * _usual(orders, beside, line)
            for one, line in zip(fallen, new, strict=True)
        ):
            found = trial
        elif len(trial) - len(found) > AHEAD or min(new) < MANY * tells:
            break
        far &= raster.apart_from([order])
        gains = np.where(far, beside, 0.0)
    return _in_turn(raster, found, present, contrast)


@dataclass(frozen=True, slots=True)
class _Raster:
    """All orders that are tried, their waves, and what is left without them beside a basis.

    Attributes:
        tells: difference of orders that the travel can tell apart.
    """

    waves: _Waves
    orders: Floats
    table: NDArray[np.float32]
    basis: Floats
    error: Floats
    tells: float

    def together(self, lines: list[float]) -> tuple[list[float], Floats, Floats]:
        return self.waves.together(lines, SPACING * self.tells, self.basis, self.error)

    def apart_from(self, lines: list[float]) -> Flags:
        """Orders that the travel can tell from all of the lines."""
        far = np.ones(len(self.orders), dtype=np.bool_)
        for other in lines:
            far &= np.abs(self.orders - other) > SAME * self.tells
        return far

    def gains(self, lines: list[float], beside: Floats, left: Floats) -> Floats:
        """Of all orders that are none of the lines, beside them."""
        return np.where(self.apart_from(lines), _gains(self.table, beside, left), 0.0)


def _in_turn(raster: _Raster, lines: list[float], present: list[float], contrast: float) -> list[float]:
    """Lines that were found one by one, each looked for anew beside the others, and those that are needed then.

    Two waves that beat over a short stroke show as one between them; the rest of both is told by the strokes that are
    long, and takes further lines where the first one stays.
    """
    if len(lines) < 2:
        return lines
    lines, left = _exchanged(raster, lines, present)
    while len(lines) > 2:
        fewer = [_exchanged(raster, [*lines[:i], *lines[i + 1 :]], present) for i in range(len(lines))]
        least = min(range(len(lines)), key=lambda i: fewer[i][1])
        _, beside, rest = raster.together(lines)
        usual = _usual(raster.orders, raster.gains([*present, *lines], beside, rest), lines[least])
        if fewer[least][1] - left > contrast * left * usual:
            break
        lines, left = fewer[least]
    return lines


def _exchanged(raster: _Raster, lines: list[float], present: list[float]) -> tuple[list[float], float]:
    """Lines, each in the best place beside the others, and the sum of squares that they leave."""
    lines, _, left = raster.together(lines)
    best = float(left @ left)
    for _ in range(SWEEPS):
        before = best
        for i in range(len(lines)):
            others, beside, rest = raster.together([*lines[:i], *lines[i + 1 :]])
            gains = raster.gains([*present, *others], beside, rest)
            order = float(raster.orders[int(np.argmax(gains))])
            order = raster.waves.refined(order, SPACING * raster.tells, beside, rest)
            trial, _, rest = raster.together([*others[:i], order, *others[i:]])
            if float(rest @ rest) < (1.0 - FINE_EXCHANGE) * best:
                lines, best = trial, float(rest @ rest)
        if best == before:
            break
    return lines, best


def _usual(orders: Floats, gains: Floats, order: float) -> float:
    """What the neighbours of an order gain; infinite where it has none."""
    near = (orders > 0.6 * order - 1.0) & (orders < 1.7 * order + 1.0)
    return float(np.median(gains[near])) if near.any() else math.inf


def candidate_orders(problem: Problem, angle: float) -> Floats:
    """Orders that the travel can tell apart and the sampling can show.

    One period a turn is an imbalance, and what the travel does not tell from it.
    """
    travel = problem.scales.travel * angle / (2 * math.pi)
    speed = np.abs(problem.data.velocity[problem.data.grid])
    slow = float(np.percentile(speed, 25)) * angle / (2 * math.pi)
    most = MOST_PERIODS / max(travel, 1e-9)
    if angle == 1.0:
        most = max(most, MOST_IN_A_TURN)
    highest = min(most, 0.8 * problem.data.cutoff / max(slow, 1e-9))
    lowest = LEAST_PERIODS / max(travel, 1e-9)
    if angle == 1.0:
        lowest = max(lowest, min(1.0 + SAME / max(travel, 1e-9), NO_IMBALANCE))
        highest = max(highest, lowest + 1.0)
    step = SPACING / max(travel, 1e-12)
    highest = min(max(highest, 2.0 * lowest if angle != 1.0 else highest), lowest + MOST_ORDERS * step)
    found = np.arange(lowest, highest, step)
    if angle != 1.0:
        return np.asarray(found)
    whole = np.arange(
        math.ceil(lowest), min(MOST_IN_A_TURN, 0.8 * problem.data.cutoff / max(slow, 1e-9)) + 1.0
    )
    return np.unique(np.concatenate([found, whole]))


class _Waves:
    """Sines and cosines over the rows, each as large as the low-pass leaves it at the speed there."""

    def __init__(self, problem: Problem, angle: float, rows: Integers) -> None:
        data, at = problem.data, problem.data.grid[rows]
        self._phase = angle * data.position[at]
        self._rate = np.abs(data.velocity[at]) * angle / (2 * math.pi) * data.period
        reach = np.arange(len(data.taps)) - len(data.taps) // 2
        self._tones = np.linspace(0.0, 0.5, TONES)
        self._response = np.cos(2.0 * math.pi * np.outer(self._tones, reach)) @ data.taps

    def table(self, orders: Floats) -> NDArray[np.float32]:
        """Columns of shape (rows, 2·orders): sine and cosine by turns."""
        result = np.empty((len(self._phase), 2 * len(orders)), dtype=np.float32)
        for start in range(0, len(orders), PIECE):
            part = orders[start : start + PIECE]
            phase = np.outer(self._phase, part)
            fade = self._passed(part)
            result[:, 2 * start : 2 * (start + len(part)) : 2] = np.sin(phase) * fade
            result[:, 2 * start + 1 : 2 * (start + len(part)) : 2] = np.cos(phase) * fade
        return result

    def refined(self, order: float, step: float, basis: Floats, error: Floats) -> float:
        """The order around that explains most."""
        for reach in (step, step / 4.0):
            trials = order + reach * np.linspace(-1.0, 1.0, REFINED)
            gains = _gains(self.table(trials), basis, error)
            order = float(trials[int(np.argmax(gains))])
        return order

    def together(
        self, orders: list[float], step: float, basis: Floats, error: Floats
    ) -> tuple[list[float], Floats, Floats]:
        """All orders at their best beside each other (Gauss–Newton), the basis with them, and what they leave."""
        found: Floats = np.array(orders, dtype=np.float64)
        for _ in range(STEPS):
            columns = self._beside(self.table(found), basis)
            sizes = np.asarray(np.linalg.lstsq(columns, error, rcond=None)[0], dtype=np.float64)
            slopes = self._beside(self._slopes(found, sizes), basis)
            both = np.hstack([columns, slopes])
            change = np.linalg.lstsq(both, error - columns @ sizes, rcond=1e-9)[0][len(sizes) :]
            found = np.asarray(found + np.clip(change, -step, step), dtype=np.float64)
        extra = np.linalg.qr(self._beside(self.table(found), basis))[0]
        return found.tolist(), np.hstack([basis, extra]), np.asarray(error - extra @ (extra.T @ error))

    def left_without(self, number: int, orders: list[float], basis: Floats, error: Floats) -> float:
        """Sum of squares that all orders but one leave, the others where they are."""
        columns = self._beside(self.table(np.delete(np.array(orders), number)), basis)
        rest = error - columns @ np.linalg.lstsq(columns, error, rcond=None)[0]
        return float(rest @ rest)

    def _slopes(self, orders: Floats, sizes: Floats) -> Floats:
        """What waves of these sizes change by with their orders, shape (rows, orders)."""
        phase = np.outer(self._phase, orders)
        fade = self._passed(orders)
        turned = sizes[::2] * np.cos(phase) - sizes[1::2] * np.sin(phase)
        return np.asarray(self._phase[:, None] * turned * fade)

    def _passed(self, orders: Floats) -> Floats:
        """Share of each wave that the low-pass leaves, shape (rows, orders); none of what comes faster than half the
        sampling."""
        return np.interp(np.outer(self._rate, orders), self._tones, self._response, right=0.0)

    @staticmethod
    def _beside(columns: NDArray[np.floating], basis: Floats) -> Floats:
        return np.asarray(columns - basis @ (basis.T @ columns), dtype=np.float64)


def _gains(table: NDArray[np.float32], basis: Floats, error: Floats) -> Floats:
    """Share of the error that each pair of columns explains beside the basis, shape (pairs,)."""
    inside = basis.T.astype(table.dtype) @ table
    along = (error.astype(table.dtype) @ table).astype(np.float64)
    sine, cosine = table[:, ::2], table[:, 1::2]
    first = np.einsum("ij,ij->j", sine, sine, dtype=np.float64) - np.sum(inside[:, ::2] ** 2, axis=0)
    second = np.einsum("ij,ij->j", cosine, cosine, dtype=np.float64) - np.sum(inside[:, 1::2] ** 2, axis=0)
    mixed = np.einsum("ij,ij->j", sine, cosine, dtype=np.float64) - np.sum(
        inside[:, ::2] * inside[:, 1::2], axis=0
    )
    one, other = along[::2], along[1::2]
    size = first + second
    determinant = first * second - mixed**2
    told = (size > 1e-3 * len(error)) & (determinant > 1e-6 * size**2)
    explained = (second * one**2 - 2.0 * mixed * one * other + first * other**2) / np.where(
        told, determinant, 1.0
    )
    return np.where(told, np.maximum(explained, 0.0), 0.0) / max(float(error @ error), 1e-300)


def with_whole_orders(problem: Problem, model_fit: ModelFit) -> ModelFit:
    """The model with each order a whole number where its interval contains one and is narrow, fitted again.

    On rotary axes: of waves a metre none is likelier than another.
    """
    packed = model_fit.fitted.packed
    rotary = problem.data.metadata.motion_unit == "rad"
    if not rotary or packed.p[TORQUE_RIPPLE.slot("order_1")] <= 0.0:
        return model_fit
    places = {one.slot: i for i, one in enumerate(model_fit.free)}
    spread = np.sqrt(np.maximum(np.diag(covariance(model_fit.fitted, problem.training)), 0.0))
    p, whole = packed.p.copy(), set()
    for number in TORQUE_RIPPLE.terms_in_use(packed.p):
        slot = TORQUE_RIPPLE.slot(f"order_{number}")
        if slot not in places:
            continue
        nearest = float(round(p[slot]))
        doubt = WITHIN * float(spread[places[slot]]) + LEAST_DOUBT
        if nearest >= 1.0 and abs(p[slot] - nearest) <= doubt <= BY_CHANCE:
            p[slot] = nearest
            whole.add(slot)
    if not whole:
        return model_fit
    free = [one for one in model_fit.free if one.slot not in whole]
    settled = fit_inside_twin(problem, Packed(p, packed.on), free, 2, model_fit.effects)
    if settled is None or settled.fitted.cost > MUCH_WORSE * model_fit.fitted.cost:
        return model_fit
    return replace(settled, converged=model_fit.converged)


MUCH_WORSE = 1.02
"""Times the cost: a whole number that leaves more was not meant."""
