"""Is a turn a turn? Torque of a motor repeats with whole orders a turn; in another unit the orders are broken.

Slots, commutator bars, poles and the screw itself repeat a whole number of times in 2π rad. Where the
position is in degrees but declared as rad, order 72 appears at 72·π/180 = 1.2566. So: the spectrum of the
torque over position (less inertia and friction), its lines, and the unit in which they all are whole. One
line may be whole by chance, two hardly: within ±0.3 of the resolution each, 1 in 300 at ten turns.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.recordings.checks import torque_of
from autotune.recordings.recording import Recording
from autotune.signals.filters import motion

LEAST_TURNS = 10.0
"""Below, lines are too broad to be called whole."""
WITHIN = 0.3
"""Of the resolution, one order a span: where the top of a line lies."""
STANDS_OUT = 40.0
"""Power over the median of the neighbourhood; noise of a million lines reaches 20."""
_AROUND = 101
LEAST_LINES, MOST_LINES = 2, 8
_ROWS_A_BIN = 4
UNITS = (("degrees", math.pi / 180.0), ("turns", 2.0 * math.pi), ("rpm, integrated", math.pi / 30.0))


@dataclass(frozen=True, slots=True)
class Orders:
    """Orders of the torque's lines a declared turn, strongest first, and how many such turns were travelled."""

    orders: tuple[float, ...]
    turns: float

    def whole(self, factor: float = 1.0) -> int:
        """How many lines are whole where one declared unit is `factor` rad."""
        tolerance = WITHIN / (self.turns * factor)
        scaled = [order / factor for order in self.orders]
        return sum(round(one) > 0 and abs(one - round(one)) < tolerance for one in scaled)


def unit_question(recording: Recording) -> str:
    """A question where the torque repeats with the turn in another unit than the declared; else ""."""
    if recording.metadata.motion_unit != "rad":
        return ""
    found = find_orders(recording)
    count = len(found.orders)
    if count < LEAST_LINES or found.whole() > 0.5 * count:
        return ""
    for words, factor in UNITS:
        if found.turns * factor >= LEAST_TURNS and found.whole(factor) == count:
            told = ", ".join(f"{order / factor:.0f}" for order in found.orders)
            return (
                f"the torque repeats with {_listed(found.orders)} periods a turn, which no motor does; with position "
                f"in {words} they would be {told}. Are the units right? Units are given with 'autotune data import "
                "--column position=FIELD*deg'"
            )
    return ""


def find_orders(recording: Recording) -> Orders:
    """Lines of the torque over the longest travel of one segment."""
    part = max((part for _, part in recording.split()), key=lambda one: float(np.ptp(one["position"])))
    turns = float(np.ptp(part["position"])) / (2.0 * math.pi)
    if len(part) < 4096 // _ROWS_A_BIN or turns == 0.0:
        return Orders((), turns)
    place, rest = _rest(part)
    return Orders(tuple(line / turns for line in _lines(_over_place(place, rest))), turns)


def _rest(part: Recording) -> tuple[Floats, Floats]:
    """Filtered position, and the torque less inertia, friction and offset."""
    place, velocity, acceleration = motion(part["position"], part.period, 0.1 / part.period)
    slow = 0.02 * float(np.max(np.abs(velocity))) or 1.0
    columns = [np.ones(len(part)), velocity, np.tanh(velocity / slow), acceleration]
    table = np.column_stack([one / max(float(np.linalg.norm(one)), 1e-300) for one in columns])
    torque = torque_of(part)
    return place, torque - table @ np.linalg.lstsq(table, torque, rcond=None)[0]


def _over_place(place: Floats, rest: Floats) -> Floats:
    """Means in equal bins of position, less their mean; bins without a row are zero."""
    bins = 1 << int(math.log2(len(rest) / _ROWS_A_BIN))
    low, span = float(place.min()), float(np.ptp(place)) or 1.0
    number = np.minimum(((place - low) / span * bins).astype(np.int64), bins - 1)
    count = np.bincount(number, minlength=bins)
    mean = np.bincount(number, rest, minlength=bins) / np.maximum(count, 1)
    return np.where(count > 0, mean - float(np.mean(mean[count > 0])), 0.0)


def _lines(values: Floats) -> Sequence[float]:
    """Frequencies of the lines [periods a span], strongest first, between the bins by a parabola."""
    power = np.abs(np.fft.rfft(values * np.hanning(len(values)))) ** 2 + 1e-300
    level = scipy.ndimage.median_filter(power, _AROUND)
    inner = power[1:-1]
    top = (inner > power[:-2]) & (inner > power[2:]) & (inner > STANDS_OUT * level[1:-1])
    found = [int(i) + 1 for i in np.flatnonzero(top) if i >= 2]
    found = sorted(found, key=lambda i: -float(power[i]))[:MOST_LINES]
    return [_between(np.log(power[i - 1 : i + 2])) + i for i in found]


def _between(three: Floats) -> float:
    bend = float(three[0] - 2.0 * three[1] + three[2])
    return 0.5 * float(three[0] - three[2]) / bend if bend else 0.0


def _listed(orders: Sequence[float]) -> str:
    return ", ".join(f"{order:.4g}" for order in orders)
