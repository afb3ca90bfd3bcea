"""Torque that repeats with position: which orders are there, and how large.

A least-squares periodogram over position; lines are taken one after another, each refined in order,
as long as one stands out of the rest.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from autotune.core.arrays import Floats

STANDS_OUT = 25.0
"""A line counts when its power is this many times the median of the scan."""
MOST_PASSING = 8
"""How many that stand out but are not the same everywhere are passed over."""


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
        highest: largest order; by default what the spacing of positions resolves, at most 400 scans.

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
    """Projection on exp(i·order·scale·q), in pieces that keep memory small."""
    power = np.empty(len(orders))
    for start in range(0, len(orders), 64):
        part = orders[start : start + 64]
        power[start : start + 64] = np.abs(np.exp(-1j * scale * np.outer(part, position)) @ rest) ** 2
    return power


def _strongest(
    position: Floats, rest: Floats, lowest: float, top: float, scale: float, passing: list[float]
) -> float | None:
    """The order that stands out most, beside those that were found to be passing."""
    step = 2.0 * math.pi / (np.ptp(position) * scale) / 4.0
    grid = np.arange(lowest, top, step)
    if len(grid) < 16:
        return None
    power = _power(position, rest, grid, scale)
    for order in passing:
        power[np.abs(grid - order) < 4.0 * step] = 0.0
    best = int(np.argmax(power))
    if power[best] < STANDS_OUT * np.median(power):
        return None
    fine = np.linspace(max(grid[best] - step, lowest), grid[best] + step, 41)
    order = float(fine[int(np.argmax(_power(position, rest, fine, scale)))])
    whole = round(order)
    return float(whole) if whole > 0 and abs(order - whole) < step else order
