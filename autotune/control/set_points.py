"""Set points of a foreign master: are they plausible, and what motion do they ask for.

A sidecar hears positions only, in whole counts q, once a cycle T. Velocity and acceleration at the newest of them
are those of the parabola that fits the last `POINTS` best (least squares; an endpoint filter of Savitzky and
Golay, Anal. Chem. 36 (1964) 1627): no delay for a parabola, and of the quantisation 0.0133 q/(√12 T²) is left in
the acceleration. Fewer points leave more of it, more smear the ends of an acceleration (jerk).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from autotune.core.axis import Limits

POINTS = 21
_COUNTS = 3.0  # that three rounded positions can be off together
_MARGIN = 1.1  # of speed and acceleration: a master may plan right at the limit
WINDOW = 50  # SYNCs over which set points are counted
_ASTRAY = 2  # set points more or less than SYNCs in such a window


@dataclass(frozen=True, slots=True)
class Motion:
    """Position, velocity and acceleration of a reference at one cycle; SI."""

    position: float
    velocity: float
    acceleration: float


class MotionEstimate:
    """Motion that positions once a cycle ask for."""

    def __init__(self, period: float) -> None:
        time = period * np.arange(1 - POINTS, 1)
        fit = np.linalg.pinv(np.vander(time, 3, increasing=True))
        self._velocity, self._acceleration = fit[1], 2.0 * fit[2]
        self._positions: deque[float] = deque(maxlen=POINTS)

    def step(self, position: float) -> Motion | None:
        """Takes the next set point; None until there are enough."""
        self._positions.append(position)
        if len(self._positions) < POINTS:
            return None
        near = np.array(self._positions) - position
        return Motion(position, float(self._velocity @ near), float(self._acceleration @ near))


class SetPointWatch:
    """Compares set points with the axis's limits.

    Args:
        resolution: one count of the position sensor [rad or m].
        inertia: of the model [kg m² or kg]; what the torque limit cannot accelerate is a jump.
    """

    def __init__(self, limits: Limits, period: float, resolution: float, inertia: float) -> None:
        self._limits = limits
        self._step = _MARGIN * limits.speed * period + resolution
        fastest = 2.0 * limits.torque / inertia
        self._bend = _MARGIN * fastest * period**2 + _COUNTS * resolution
        self._before: tuple[float, ...] = ()

    def see(self, position: float) -> str:
        """Takes the next set point; what is wrong with it, in words; empty where nothing is."""
        before, self._before = self._before, (*self._before[-1:], position)
        limits = self._limits
        if not math.isfinite(position):
            return f"a set point is {position}"
        if not limits.position_min <= position <= limits.position_max:
            return (
                f"the set point {position:.6g} is outside of the limits {limits.position_min:g} to "
                f"{limits.position_max:g}"
            )
        if before and abs(position - before[-1]) > self._step:
            return (
                f"the set points jump: from {before[-1]:.6g} to {position:.6g} in one cycle, "
                f"{self._step:.3g} is what limits.speed allows"
            )
        if len(before) == 2 and abs(position - 2.0 * before[1] + before[0]) > self._bend:
            return (
                f"the set points jump in speed at {position:.6g}: limits.torque cannot accelerate the axis so"
            )
        return ""


class Cadence:
    """One set point for each SYNC: more come from two masters, fewer from none that moves the axis."""

    def __init__(self) -> None:
        self._syncs = self._targets = 0

    def target(self) -> None:
        self._targets += 1

    def sync(self) -> str:
        """Counts a SYNC; what is wrong with the window that it ends, in words; empty where nothing is."""
        self._syncs += 1
        if self._syncs < WINDOW:
            return ""
        surplus = self._targets - self._syncs
        self._syncs = self._targets = 0
        if surplus > _ASTRAY:
            return f"{surplus + WINDOW} set points came with {WINDOW} SYNCs: two masters command this drive"
        if surplus < -_ASTRAY:
            return f"{surplus + WINDOW} set points came with {WINDOW} SYNCs: the master fell silent, or two send SYNC"
        return ""
