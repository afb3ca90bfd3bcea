"""Small and large steps on the twin, settled to ±10 % (section 4.2.1), and the stop at a reversal (4.1.1)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from autotune.control.gains.loop import Gains, LoopTiming
from autotune.control.gains.regimes import characteristic_space
from autotune.control.gains.twin import Motion, follow, shaken, step_reference
from autotune.models.drive_model import DriveModel

BAND = 0.1
"""Of the step: section 4.2.1."""
COUNTS = 20.0
"""Counts of the sensor that a small step has at least, so that its band is two of them."""
BEFORE, HORIZON = 0.1, 2.0
SHAKEN = (3, 4)
"""Seeds of the disturbances under which a step is settled."""


@dataclass(frozen=True, slots=True)
class StepSizes:
    """A step within presliding and one beyond it [rad or m]."""

    small: float
    large: float


def step_sizes(model: DriveModel, timing: LoopTiming, large: float) -> StepSizes:
    """Small: the characteristic space x_s, or 20 counts where that is more."""
    small = max(characteristic_space(model), COUNTS * timing.resolution)
    return StepSizes(min(small, large), large)


def settling_time(
    model: DriveModel,
    gains: Gains,
    timing: LoopTiming,
    size: float,
    horizon: float = HORIZON,
    band: float = BAND,
    seeds: tuple[int, ...] = SHAKEN,
) -> float:
    """From a step to the last time outside ±10 % of it (`band`) [s]; `horizon` where it does not settle.

    The mean over several disturbances, where the axis is known to be shaken.
    """
    reference = step_reference(size, BEFORE, horizon, timing)
    times = []
    for seed in seeds if timing.disturbance > 0.0 else seeds[:1]:
        noise = shaken(timing, len(reference), seed)
        motion = follow(model, gains, timing, reference, disturbance=noise)
        times.append(settled_after(motion, size, round(BEFORE / timing.period), horizon, band))
    return float(np.mean(times))


def settled_after(motion: Motion, size: float, start: int, horizon: float, band: float = BAND) -> float:
    """The same of a motion whose step came at sample `start`."""
    if not motion.bounded:
        return horizon
    outside = np.flatnonzero(np.abs(size - motion.position[start:]) > band * abs(size))
    return min(float(outside[-1] + 1) * motion.period, horizon) if len(outside) else 0.0


def stop_time(model: DriveModel, gains: Gains, timing: LoopTiming, speed: float) -> float:
    """How long the axis stands still where its reference turns at `speed` without a pause [s] (Figure 4.1b)."""
    h = timing.period
    side = max(round(0.5 / h), 10)
    ramp = np.arange(side) * speed * h
    reference = np.concatenate([ramp, ramp[-1] - np.arange(1, side + 1) * speed * h])
    motion = follow(model, gains, timing, reference)
    if not motion.bounded:
        return float("nan")
    lag = max(round(4.0 * timing.resolution / (speed * h)), 3)
    rate = (motion.position[side + lag :] - motion.position[side:-lag]) / (lag * h)
    before = (motion.position[side : side + lag] - motion.position[side - lag : side]) / (lag * h)
    still = np.abs(np.concatenate([before, rate])) < 0.1 * speed
    return float(np.count_nonzero(still)) * h
