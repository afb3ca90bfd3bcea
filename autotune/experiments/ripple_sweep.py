"""One turn forward and one backward at constant speed: torque over position shows as lines of the tracking error."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from autotune.experiments.experiment import PlannedExperiment
from autotune.experiments.path import Motion, Path
from autotune.recordings.recording import CONDITIONING

FORWARD, BACKWARD = "ripple_forward", "ripple_backward"
TURN = 2.0 * math.pi
LINE_FREQUENCY = 60.0
"""Hz at which the highest order passes: near the bandwidth of a servo loop, where its error is largest."""
SLOWEST = 0.2  # rad/s: friction slides at it
SETTLE = 0.15  # s at constant speed before a turn counts


@dataclass(frozen=True)
class RippleSweep(PlannedExperiment):
    """`speed` [rad/s]; `suffix` tells sweeps of one programme apart."""

    speed: float = 1.0
    repeat: int = 0

    @property
    def name(self) -> str:
        return FORWARD

    def trace(self, path: Path) -> None:
        motion, speed = self.motion, self.speed
        run_up = path.ramp_distance(0.0, speed) + SETTLE * speed
        centre = motion.centre
        path.move(centre - 0.5 * TURN - run_up)
        for sign, label in ((1.0, FORWARD), (-1.0, BACKWARD)):
            path.mark(CONDITIONING).ramp(sign * speed).cruise(seconds=SETTLE)
            path.mark(label, self.repeat).cruise(distance=TURN)
            path.mark(CONDITIONING).cruise(seconds=SETTLE).ramp(0.0).dwell(SETTLE)
        path.move(centre)


def sweep_of(motion: Motion, highest_order: int, repeat: int = 0) -> RippleSweep:
    """A sweep that shows waves up to an order."""
    speed = min(max(TURN * LINE_FREQUENCY / highest_order, SLOWEST), motion.speed, 0.5 * motion.top_speed)
    return RippleSweep(replace(motion), speed=speed, repeat=repeat)
