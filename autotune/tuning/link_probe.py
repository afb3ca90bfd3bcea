"""Cycles with the axis at rest, timed where they are played: in the cyclic process.

Imported there too, so it imports little.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.axis import Limits
from autotune.core.drive import HOLD, Command, Drive, Mode
from autotune.core.loop import Publish
from autotune.experiments.guard import Guard
from autotune.experiments.standstill import stands


@dataclass(frozen=True)
class Timing:
    """When the answers came [s], shape (n,), and how many cycles were lost before each."""

    answered: Floats
    missed: Floats


@dataclass(frozen=True)
class LinkProbe:
    """Holds the axis where it stands for so many cycles, under the guard."""

    limits: Limits
    cycles: int
    resolution: float

    @property
    def labels(self) -> tuple[str, ...]:
        return ("link",)

    def __call__(self, drive: Drive, publish: Publish) -> Timing:
        """Raises: GuardStop; DriveFault, LinkError from the drive. Power is off afterwards."""
        guard = Guard(self.limits, drive.period, self.resolution, self.cycles * drive.period + 60.0)
        table = np.zeros((self.cycles, 2))
        stands(drive, self.limits)
        drive.enable(Mode.POSITION)
        try:
            sample = drive.step(HOLD)
            guard.begin(Mode.POSITION, sample)
            still = Command(sample.reference)
            for cycle in range(self.cycles):
                guard.check(sample, still)
                sample = drive.step(still)
                table[cycle] = time.perf_counter(), sample.missed
                publish(sample, 0, 0)
        finally:
            drive.disable()
        return Timing(table[:, 0], table[:, 1])
