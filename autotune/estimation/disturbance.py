"""What shakes an axis beside its command, as the twin is disturbed: process noise with its colour, sensor noise apart.

A process disturbance is a torque on the axis: white, and a part with a memory (a first-order autoregression).
It passes through the loop into position and torque. Noise of the position sensor passes through the
controller; noise of the torque sensor reaches nothing but the record.
"""

from __future__ import annotations

import math
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
    """

    white: float = 0.0
    coloured: float = 0.0
    correlation: float = 0.0
    position: float = 0.0
    sensor: float = math.nan
    uneven: float = 1.0
    lines: tuple[float, ...] = ()

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


STILL = Disturbance()
"""Nothing shakes the axis."""
