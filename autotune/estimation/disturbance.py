"""What shakes an axis beside its command, as the twin is disturbed: process noise with its colour, sensor noise apart.

A process disturbance is a torque on the axis: white, and a part with a memory (a first-order autoregression).
It passes through the loop into position and torque. Noise of the position sensor passes through the
controller; noise of the torque sensor reaches nothing but the record.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from autotune.core.arrays import Floats


@dataclass(frozen=True, slots=True)
class Disturbance:
    """Levels are standard deviations.

    Attributes:
        white: of a torque on the axis that is new in every sample [N m]; `coloured`: of one with a memory.
        correlation: time constant of that memory [s].
        position: of the position before it is quantised.
        sensor: of the recorded torque [N m]; the axis does not feel it. nan where unknown.
        uneven: variance of stretches over what it is usually, where that is more than chance; else 1.
        lines: frequencies that stand out [Hz].
        jitter: of the moment at which a row is written [s]; the axis does not feel it.
    """

    white: float = 0.0
    coloured: float = 0.0
    correlation: float = 0.0
    position: float = 0.0
    sensor: float = math.nan
    uneven: float = 1.0
    lines: tuple[float, ...] = ()
    jitter: float = 0.0

    @property
    def process(self) -> float:
        """Of all torque that acts on the axis [N m]."""
        return math.hypot(self.white, self.coloured)

    def level_at(self, hertz: float, period: float) -> float:
        """Level of the white noise that is as dense at this frequency [N m]."""
        dense = float(coloured_power(np.array([hertz]), self.correlation, period)[0])
        return math.hypot(self.white, self.coloured * math.sqrt(dense))

    def louder(self, factor: float) -> Disturbance:
        """The same disturbance with `factor` times the torque and the position noise."""
        return replace(
            self, white=factor * self.white, coloured=factor * self.coloured, position=factor * self.position
        )

    def drawn(self, random: np.random.Generator, size: int, period: float) -> Floats:
        """A process disturbance [N m], shape (size,); always takes as many random numbers."""
        fresh = random.normal(0.0, 1.0, (2, size))
        memory = memory_of(self.correlation, period)
        gain = math.sqrt(1.0 - memory**2)
        fresh[1, :1] /= gain  # so that it begins with its usual variance
        coloured = scipy.signal.lfilter([gain], [1.0, -memory], fresh[1])
        return np.asarray(self.white * fresh[0] + self.coloured * coloured)


def memory_of(correlation: float, period: float) -> float:
    """Coefficient of the autoregression from sample to sample."""
    return math.exp(-period / correlation) if correlation > 0.0 else 0.0


def coloured_power(hertz: Floats, correlation: float, period: float) -> Floats:
    """Spectrum of a unit-variance autoregression over that of white noise of unit variance, shape (f,)."""
    memory = memory_of(correlation, period)
    angle = 2.0 * np.pi * hertz * period
    return np.asarray((1.0 - memory**2) / (1.0 - 2.0 * memory * np.cos(angle) + memory**2))


def jitter_of(measured: Floats, stretches: Sequence[slice], period: float) -> float:
    """Spread of the moment at which rows are written [s], by positions of shape (n,); 0 where there is none.

    Such rows are off by speed times delay, each by itself: fourth and sixth differences, which take out the motion, are
    then as large as each other and in proportion to speed.
    """
    moved = [np.abs(np.gradient(measured[rows], period))[3:-3] for rows in stretches]
    speed = np.concatenate(moved)
    fourth, sixth = (
        np.concatenate([_differences(measured[rows], order)[(6 - order) // 2 : len(v) + (6 - order) // 2]
                        for rows, v in zip(stretches, moved, strict=True)])
        for order in (4, 6)
    )  # fmt: skip
    edges = np.quantile(speed[speed > SLOW * np.quantile(speed, 0.99)], np.linspace(0.0, 1.0, SPEEDS + 1))
    delays, alike = [], []
    for low, high in itertools.pairwise(edges.tolist()):
        inside = (speed >= low) & (speed <= high)
        power = float(np.median(fourth[inside] ** 2)) / CHI
        alike.append(float(np.median(sixth[inside] ** 2)) / CHI / max(power, 1e-300))
        delays.append(math.sqrt(power / float(np.mean(speed[inside] ** 2))))
    quick = delays[len(delays) // 3 :]
    proportional = min(quick) > PROPORTIONAL * max(quick)
    return float(np.mean(quick)) if proportional and 0.5 < float(np.median(alike)) < 2.0 else 0.0


def _differences(values: Floats, order: int) -> Floats:
    """Of an order, so that white noise keeps its variance."""
    return np.asarray(np.diff(values, order) / math.sqrt(math.comb(2 * order, order)))


SLOW, SPEEDS, CHI, PROPORTIONAL = 0.05, 6, 0.4549, 0.8
"""Of the largest speed: slower tells nothing; classes of speed; median over mean of a squared normal number; and how
far classes of the faster two thirds may be apart."""
STILL = Disturbance()
"""Nothing shakes the axis."""
