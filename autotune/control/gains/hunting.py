"""Hunting: a limit cycle about a constant set point (section 4.2.1, Figures 4.9 and 6.15e).

It is predicted on the twin, from steps of several sizes and either direction, because a loop may hold after one
and hunt after another; and recognised in what was measured, by the same rule: the position swings on by more than
a few counts of its sensor, and no less in the end than before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from autotune.control.gains.loop import Gains, LoopTiming
from autotune.control.gains.twin import follow, step_reference
from autotune.core.arrays import Floats
from autotune.models.drive_model import DriveModel

COUNTS = 6.0
"""Counts of the sensor from peak to peak: less is what rounding alone may do."""
LASTING = 0.7
"""Of the swing before: with less, it dies out."""
SECONDS = 6.0
LONG_SECONDS = 30.0
"""After the step: stick and slip about a set point may have periods of several seconds (0.04 to 0.3 Hz are
reported in section 6.3.5)."""
BEFORE = 0.2


@dataclass(frozen=True, slots=True)
class LimitCycle:
    """An oscillation that lasts: half its peak-to-peak [rad or m] and its frequency [Hz] (nan: not periodic).

    `unbounded`: the state left all bounds, there is no amplitude.
    """

    amplitude: float
    frequency: float
    unbounded: bool = False


def recognised(position: Floats, period: float, resolution: float) -> LimitCycle | None:
    """The limit cycle at the end of a record taken at one set point, shape (n,); None where it holds or settles."""
    third = len(position) // 3
    if third < 20:
        return None
    middle, last = position[third : 2 * third], position[-third:]
    swing, before = float(np.ptp(last)), float(np.ptp(middle))
    if swing <= COUNTS * resolution or swing < LASTING * before:
        return None
    rate = _frequency(last, period)
    if math.isnan(rate):
        rate = _frequency(position[third:], period)
    return LimitCycle(0.5 * swing, rate)


def _frequency(position: Floats, period: float) -> float:
    """Mean rate of upward passages through the middle, with a hysteresis of a tenth of the swing [Hz]."""
    high, low = float(position.max()), float(position.min())
    middle, margin = 0.5 * (high + low), 0.1 * (high - low)
    level = np.where(position > middle + margin, 1, np.where(position < middle - margin, -1, 0))
    known = np.flatnonzero(level)
    if len(known) < 2:
        return math.nan
    ups = known[1:][(level[known][1:] > 0) & (level[known][:-1] < 0)]
    return (len(ups) - 1) / ((ups[-1] - ups[0]) * period) if len(ups) > 2 else math.nan


def after_step(
    model: DriveModel, gains: Gains, timing: LoopTiming, size: float, seconds: float = SECONDS
) -> LimitCycle | None:
    """What is left `seconds` after a step of `size` [rad or m] on the twin."""
    motion = follow(model, gains, timing, step_reference(size, BEFORE, seconds, timing))
    if not motion.bounded:
        return LimitCycle(math.inf, math.nan, unbounded=True)
    after = motion.position[round(BEFORE / timing.period) :]
    return recognised(after, timing.period, timing.resolution)


def predicted(
    model: DriveModel, gains: Gains, timing: LoopTiming, sizes: Sequence[float], slow: bool = True
) -> LimitCycle | None:
    """The largest limit cycle after any of the steps, both ways; with `slow`, long ones are waited for as well."""
    found = [after_step(model, gains, timing, sign * size) for size in sizes for sign in (1.0, -1.0)]
    if slow and not any(found) and gains.ki > 0.0:
        found.append(after_step(model, gains, timing, sizes[0], LONG_SECONDS))
    cycles = [one for one in found if one is not None]
    return max(cycles, key=lambda one: one.amplitude) if cycles else None
