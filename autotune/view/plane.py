"""A plane for a viewer that has none: torque over velocity, mapped to a box of 1.6 × 1.

The viewer's two-dimensional view shows pixels with y downwards; data are mapped to the box with y
flipped, and grid and tick labels are drawn as entities of their own. Pure arithmetic.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autotune.core.arrays import Floats

WIDTH = 1.6
HEIGHT = 1.0


@dataclass(frozen=True, slots=True)
class Plane:
    """Ranges and names of both coordinates.

    Attributes:
        x_range, y_range: shown values, low below high.
        scale_from: where the scale of x begins, right of what stands in the box's left part; None: at its edge.
    """

    title: str
    x_name: str
    y_name: str
    x_range: tuple[float, float]
    y_range: tuple[float, float]
    scale_from: float | None = None

    def place(self, x: Floats, y: Floats) -> Floats:
        """Positions in the box, shape (n, 2)."""
        (x0, x1), (y0, y1) = self.x_range, self.y_range
        return np.column_stack([(x - x0) / (x1 - x0) * WIDTH, (y1 - y) / (y1 - y0) * HEIGHT])

    def inside(self, x: Floats, y: Floats) -> NDArray[np.bool_]:
        """Which points are finite and lie in the box."""
        (x0, x1), (y0, y1) = self.x_range, self.y_range
        return np.asarray((x >= x0) & (x <= x1) & (y >= y0) & (y <= y1))

    def strips(self, x: Floats, y: Floats) -> list[Floats]:
        """A curve as strips, cut where it leaves the box and where x changes its sign."""
        inside = self.inside(x, y)
        cut = (np.diff(np.sign(x)) != 0) | (np.diff(inside.astype(int)) != 0)
        pieces = np.split(np.arange(len(x)), np.flatnonzero(cut) + 1)
        return [self.place(x[rows], y[rows]) for rows in pieces if len(rows) > 1 and inside[rows[0]]]

    def grid(self) -> tuple[list[Floats], list[Floats]]:
        """Grid lines and the two zero axes (or lower edges), as strips of two points."""
        lines = [self._vertical(x) for x in self._x_ticks()]
        lines += [self._horizontal(y) for y in ticks(*self.y_range)]
        zero_x = min(max(0.0, self.x_range[0]), self.x_range[1])
        zero_y = min(max(0.0, self.y_range[0]), self.y_range[1])
        return lines, [self._vertical(zero_x), self._horizontal(zero_y)]

    def labels(self) -> tuple[Floats, list[str]]:
        """Where the tick labels and axis names stand, shape (n, 2), and their texts."""
        xs, ys = self._x_ticks(), ticks(*self.y_range)
        low, left = self.y_range[0], self.x_range[0]
        under = self.place(np.array(xs), np.full(len(xs), low)) + np.array([0.0, 0.05])
        beside = self.place(np.full(len(ys), left), np.array(ys)) + np.array([-0.07, 0.0])
        names = np.array([[WIDTH / 2, HEIGHT + 0.14], [0.08, -0.07]])
        texts = [*map(_text, xs), *map(_text, ys), self.x_name, self.y_name]
        return np.vstack([under, beside, names]), texts

    def bounds(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """What the view should show, labels included: x and y range in the box's coordinates."""
        return (-0.16, WIDTH + 0.06), (-0.15, HEIGHT + 0.27)

    def _x_ticks(self) -> list[float]:
        low, high = self.x_range
        return ticks(low if self.scale_from is None else self.scale_from, high)

    def _vertical(self, x: float) -> Floats:
        return self.place(np.array([x, x]), np.array(self.y_range))

    def _horizontal(self, y: float) -> Floats:
        return self.place(np.array(self.x_range), np.array([y, y]))


def ticks(low: float, high: float, count: int = 5) -> list[float]:
    """Round numbers from low to high, about `count` of them, steps of 1, 2 or 5 times a power of ten."""
    span = high - low
    if not math.isfinite(span) or span <= 0:
        return [low]
    rough = span / count
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= rough * 0.999)
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [0.0 if k == 0 else k * step for k in range(first, last + 1)]


def symmetric(largest: float) -> tuple[float, float]:
    """A range about zero that holds `largest`, rounded up to 1, 2 or 5 times a power of ten."""
    if not math.isfinite(largest) or largest <= 0:
        return -1.0, 1.0
    power = 10.0 ** math.floor(math.log10(largest))
    reach = next(m * power for m in (1, 1.5, 2, 3, 5, 7.5, 10) if m * power >= largest * 0.999)
    return -reach, reach


def round_range(low: float, high: float) -> tuple[float, float]:
    """A range that holds both, its ends on round numbers; one of its own where they are the same."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return -1.0, 1.0
    if high - low <= 1e-9 * max(abs(low), abs(high)):
        room = 0.1 * abs(low) or 1.0
        low, high = low - room, high + room
    first, second = ticks(low, high, 8)[:2]
    step = second - first
    return step * math.floor(low / step + 1e-9), step * math.ceil(high / step - 1e-9)


def _text(value: float) -> str:
    return f"{value:.6g}".replace("-", "−")
