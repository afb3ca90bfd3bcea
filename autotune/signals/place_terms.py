"""Torque that belongs to the place: waves over position, gravity, a spring; which are there, and how large.

Waves: a least-squares periodogram over position; lines are taken one after another, each refined in order,
as long as one stands out of the rest.

A model without what belongs to the place takes it for inertia and friction: an arm that swings about its lowest point
seems to have less inertia, one that is held up a bristle as long as its way. So such terms are fitted beside a model
that does not hold them (`PlaceTerms`) where they lower the error on stretches that were left out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from autotune.core.arrays import Floats

STANDS_OUT = 25.0
"""A line counts when its power is this many times the median of the scan."""
MOST_PASSING = 8
"""How many that stand out but are not the same everywhere are passed over."""
LEAST_GAIN = 0.1
"""Of the mean square on stretches left out: what terms of the place must take away."""
ALIKE = 1.03
"""Times the mean square: two terms that leave so nearly the same cannot be told apart over this travel."""
FOLDS = 8
BINS = 8
"""Places in the shortest wave that is looked for."""


@dataclass(frozen=True, slots=True)
class Line:
    """sine·sin(order·scale·q) + cosine·cos(order·scale·q)."""

    order: float
    sine: float
    cosine: float

    @property
    def amplitude(self) -> float:
        return math.hypot(self.sine, self.cosine)


def columns(position: Floats, orders: list[float], scale: float) -> Floats:
    """Sine and cosine columns of each order, shape (n, 2·m)."""
    if not orders:
        return np.zeros((len(position), 0))
    angle = np.outer(position, np.asarray(orders) * scale)
    return np.hstack([np.stack([np.sin(a), np.cos(a)], axis=1) for a in angle.T])


@dataclass(frozen=True, slots=True)
class PlaceTerms:
    """Torque of the place beside a model: a spring, and waves of these orders; `load` on an axis that turns is gravity.

    Attributes:
        scale: angle per motion unit and order: 1 for rad, 2π for m.
        load: turns of the load for one of the axis: below 1 behind a gear.
        spring_like: a spring and gravity leave the same over this travel.
    """

    scale: float
    spring: bool = False
    orders: tuple[float, ...] = ()
    spring_like: bool = False
    load: float = 1.0

    @property
    def gravity(self) -> bool:
        return self.scale == 1.0 and self.load in self.orders

    @property
    def waves(self) -> tuple[float, ...]:
        """Orders that are not gravity's."""
        return tuple(order for order in self.orders if not (self.gravity and order == self.load))

    @property
    def count(self) -> int:
        """Of columns."""
        return int(self.spring) + 2 * len(self.orders)

    def columns(self, position: Floats) -> Floats:
        """Position for a spring, then sine and cosine of each order, shape (n, count)."""
        waves = columns(position, list(self.orders), self.scale)
        return np.hstack([position[:, None], waves]) if self.spring else waves


def held_out_error(parts: Sequence[tuple[Floats, Floats]]) -> float:
    """Mean square that least squares leaves on stretches left out in turn.

    Args:
        parts: regressors (n, k) and target (n,) of each piece of the recording, in time.
    """
    design, target = np.vstack([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
    size = np.maximum(np.sqrt(np.mean(design**2, axis=0)), 1e-300)
    folds = [rows for rows in np.array_split(np.arange(len(target)), FOLDS) if len(rows)]
    squares = [design[rows].T @ design[rows] / np.outer(size, size) for rows in folds]
    along = [design[rows].T @ target[rows] / size for rows in folds]
    total, towards, left = sum(squares), sum(along), 0.0
    for rows, square, part in zip(folds, squares, along, strict=True):
        found = np.linalg.lstsq(total - square, towards - part, rcond=1e-12)[0] / size
        left += float(np.sum((target[rows] - design[rows] @ found) ** 2))
    return left / max(len(target), 1)


def find_lines(
    position: Floats,
    torque: Floats,
    fixed: Floats,
    scale: float,
    most: int = 4,
    highest: float | None = None,
) -> list[Line]:
    """Lines in `torque` over `position`, both of shape (n,), beside the columns `fixed` (n, k).

    Args:
        scale: angle per motion unit and order: 1 for rad, 2π for m.
        most: how many lines at most.
        highest: largest order; by default 200 times the lowest.

    Needs one and a half periods of travel; shorter waves than the spacing resolves are not looked for.
    """
    span = float(np.ptp(position))
    if span <= 0 or len(position) < 40:
        return []
    lowest = 1.5 * 2.0 * math.pi / (span * scale)
    top = highest if highest is not None else lowest * 200.0
    orders: list[float] = []
    passing: list[float] = []
    for _ in range(most + MOST_PASSING):
        design = np.hstack([fixed, columns(position, orders, scale)])
        rest = torque - design @ np.linalg.lstsq(design, torque, rcond=None)[0]
        order = _strongest(position, rest, lowest, top, scale, passing)
        if order is None or len(orders) == most:
            break
        (orders if _in_both_halves(position, rest, fixed, order, scale) else passing).append(order)
    if not orders:
        return []
    design = np.hstack([fixed, columns(position, orders, scale)])
    found = np.linalg.lstsq(design, torque, rcond=None)[0][fixed.shape[1] :].reshape(-1, 2)
    return [Line(o, float(s), float(c)) for o, (s, c) in zip(orders, found, strict=True)]


def _in_both_halves(position: Floats, rest: Floats, fixed: Floats, order: float, scale: float) -> bool:
    """A wave fixed to position is the same in two halves of the data, beside the fixed columns."""
    first = np.arange(len(rest)) < len(rest) // 2
    parts = []
    for rows in (first, ~first):
        design = np.hstack([columns(position[rows], [order], scale), fixed[rows]])
        parts.append(np.linalg.lstsq(design, rest[rows], rcond=None)[0][:2])
    return bool(np.linalg.norm(parts[0] - parts[1]) < 0.5 * np.linalg.norm(parts[0] + parts[1]))


def _power(position: Floats, rest: Floats, orders: Floats, scale: float) -> Floats:
    """Projection on exp(i·order·scale·q)."""
    return np.asarray(np.abs(np.exp(-1j * scale * np.outer(orders, position)) @ rest) ** 2)


def _scan(position: Floats, rest: Floats, lowest: float, top: float, scale: float) -> tuple[Floats, Floats]:
    """Orders from `lowest` to `top`, four to what the travel tells apart, and the power of each.

    What falls on one place is added up first, so that one transform gives all orders.
    """
    way = (position - position.min()) * scale
    width = 2.0 * math.pi / (top * BINS)
    sums = np.bincount(np.rint(way / width).astype(np.int64), rest)
    length = scipy.fft.next_fast_len(math.ceil(4.0 * float(way.max()) / width), True)
    orders = np.arange(length // 2 + 1, dtype=np.float64) * (2.0 * math.pi / (length * width))
    wanted = (orders >= lowest) & (orders < top)
    power = np.abs(scipy.fft.rfft(sums, length)[wanted]) ** 2
    return np.asarray(orders[wanted]), np.asarray(power, dtype=np.float64)


def _strongest(
    position: Floats, rest: Floats, lowest: float, top: float, scale: float, passing: list[float]
) -> float | None:
    """The order that stands out most, beside those that were found to be passing."""
    step = 2.0 * math.pi / (np.ptp(position) * scale) / 4.0
    grid, power = _scan(position, rest, lowest, top, scale)
    if len(grid) < 16:
        return None
    for order in passing:
        power[np.abs(grid - order) < 4.0 * step] = 0.0
    best = int(np.argmax(power))
    if power[best] < STANDS_OUT * np.median(power):
        return None
    fine = np.linspace(max(grid[best] - step, lowest), grid[best] + step, 41)
    order = float(fine[int(np.argmax(_power(position, rest, fine, scale)))])
    whole = round(order)
    # waves a metre are as likely no whole number
    near = scale == 1.0 and whole > 0 and abs(order - whole) < step
    return float(whole) if near else order
