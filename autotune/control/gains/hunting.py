"""Hunting: a limit cycle about a constant set point (section 4.2.1, Figures 4.9 and 6.15e).

It is predicted on the twin, from steps of several sizes and either direction, because a loop may hold after one
and hunt after another; and recognised in what was measured, by the same rule: the position swings on by more than
a few counts of its sensor, and no less in the end than before. What creeps one way without turning is no limit cycle.

The twin is shaken as the axis is: an axis that sticks while its integral grows breaks away earlier, and again and
again, where it is shaken; on a twin at rest such bursts come too late to be seen, or not at all.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from autotune.control.gains.loop import Gains, LoopTiming
from autotune.control.gains.twin import follow, shaken, step_reference
from autotune.core.arrays import Floats
from autotune.models.drive_model import DriveModel

COUNTS = 6.0
"""Counts of the sensor from peak to peak: less is what rounding alone may do."""
LASTING = 0.7
"""Of the swing before: with less, it dies out."""
SECONDS = 8.0
LONG_SECONDS = 30.0
"""After the step: stick and slip about a set point may have periods of several seconds (0.04 to 0.3 Hz are
reported in section 6.3.5), and bursts grow for some 10 s before they are as far as they come."""
BEFORE = 0.6
"""s from power-on, with an empty integral, to the step."""
PIECES = 9
RISE = 3.0
"""Times the swing of an earlier piece: it comes in bursts."""


@dataclass(frozen=True, slots=True)
class LimitCycle:
    """An oscillation that lasts: half its peak-to-peak [rad or m] and its frequency [Hz], nan where it is not periodic.

    `unbounded`: the state left all bounds, there is neither amplitude nor frequency. `bursts`: rests between swings.
    """

    amplitude: float
    frequency: float
    unbounded: bool = False
    bursts: bool = False


def recognised(position: Floats, period: float, resolution: float) -> LimitCycle | None:
    """The limit cycle at the end of a record taken at one set point, shape (n,); None where it holds or settles."""
    third = len(position) // 3
    if third < 20:
        return None
    middle, last, later = position[third : 2 * third], position[-third:], position[len(position) // 4 :]
    swing, before = float(np.ptp(last)), float(np.ptp(middle))
    if _in_bursts(later, resolution):
        return LimitCycle(0.5 * float(np.ptp(later)), _frequency(later, period), bursts=True)
    if swing <= COUNTS * resolution or swing < LASTING * before:
        return None
    rate = _frequency(last, period)
    if math.isnan(rate):
        rate = _frequency(later, period)
    return None if math.isnan(rate) else LimitCycle(0.5 * swing, rate)


def _in_bursts(position: Floats, resolution: float) -> bool:
    """A swing that dies out and comes again: a piece of the second half swings more than an earlier one."""
    swings = [float(np.ptp(piece)) for piece in np.array_split(position, PIECES)]
    return any(
        later > RISE * earlier and later > 2.0 * COUNTS * resolution
        for k, earlier in enumerate(swings)
        for later in swings[max(k + 1, PIECES // 2) :]
    )


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
    reference = step_reference(size, BEFORE, seconds, timing)
    noise = shaken(timing, len(reference), int(size > 0.0))
    motion = follow(model, gains, timing, reference, disturbance=noise, held_offset=False)
    if not motion.bounded:
        return LimitCycle(math.inf, math.nan, unbounded=True)
    after = motion.position[round(BEFORE / timing.period) :]
    return recognised(after, timing.period, timing.resolution)


def _grown(model: DriveModel, gains: Gains, timing: LoopTiming, size: float) -> LimitCycle | None:
    """`after_step`, and for bursts what they have grown to."""
    found = after_step(model, gains, timing, size)
    if found is None or not found.bursts:
        return found
    return after_step(model, gains, timing, size, LONG_SECONDS) or found


def predicted(
    model: DriveModel, gains: Gains, timing: LoopTiming, sizes: Sequence[float], slow: bool = True
) -> LimitCycle | None:
    """The largest limit cycle after any of the steps, both ways; with `slow`, long ones are waited for as well."""
    found = [_grown(model, gains, timing, sign * size) for size in sizes for sign in (1.0, -1.0)]
    if slow and not any(found) and gains.ki > 0.0:
        found.append(after_step(model, gains, timing, sizes[0], LONG_SECONDS))
    cycles = [one for one in found if one is not None]
    return max(cycles, key=lambda one: one.amplitude) if cycles else None
