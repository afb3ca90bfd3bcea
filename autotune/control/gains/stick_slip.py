"""Stick-slip in slow motion (sections 3.1.2 and 4.1.6): below which speed the axis stands still now and then.

Predicted on the twin by constant speeds, each long enough to go many times the characteristic space. Linearised
about a speed (4.12) it is a matter of eigenvalues; that is reported by `routh` as information.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from autotune.control.gains.loop import Gains, LoopTiming
from autotune.control.gains.regimes import characteristic_space
from autotune.control.gains.twin import follow, shaken
from autotune.core.arrays import Floats
from autotune.models.drive_model import DriveModel

SPEEDS = 6
STANDS = 0.2
"""Of the speed asked for: slower is standing. On an axis a tenth would be; the rest is for what the model lacks."""
TIMES = 2
"""So often it must come to stand in the second half of the way."""
HELD = 0.5
"""Of the second half: who stands for longer does not follow, however seldom it comes to stand."""
WAY = 60.0
"""Times the characteristic space that each speed goes."""
LONGEST = 20.0
"""s, of one speed."""


@dataclass(frozen=True, slots=True)
class SlowMotion:
    """Speeds looked at [rad/s or m/s], rising, and whether the axis stick-slips at each."""

    speeds: Floats
    sticks: tuple[bool, ...]

    @property
    def below(self) -> float:
        """The speed below which it stick-slips; 0 where it does at none of them."""
        if not any(self.sticks):
            return 0.0
        highest = max(k for k, one in enumerate(self.sticks) if one)
        return float(self.speeds[min(highest + 1, len(self.speeds) - 1)])


def slow_speeds(model: DriveModel, timing: LoopTiming, fastest: float) -> Floats:
    """From what crosses x_s (or 20 counts) in half a second to `fastest`, evenly on a logarithmic scale."""
    slowest = 2.0 * max(characteristic_space(model), 20.0 * timing.resolution)
    return np.geomspace(min(slowest, 0.5 * fastest), fastest, SPEEDS)


def sticks_at(model: DriveModel, gains: Gains, timing: LoopTiming, speed: float) -> bool:
    """Whether the axis comes to stand again and again while its reference moves at `speed`."""
    way = WAY * max(characteristic_space(model), 20.0 * timing.resolution)
    seconds = min(max(way / speed, 1.0), LONGEST)
    count = round(seconds / timing.period)
    reference = np.arange(count, dtype=np.float64) * (speed * timing.period)
    motion = follow(model, gains, timing, reference, disturbance=shaken(timing, count, 2))
    return not motion.bounded or stands_often(motion.position, speed, timing)


def stands_often(position: Floats, speed: float, timing: LoopTiming) -> bool:
    """The same of a measured position at constant demanded speed, shape (n,); or it stands all the time.

    A loop too weak to leave friction in the time looked at is no even motion: nothing is known of what follows.
    """
    span = max(round(8.0 * timing.resolution / (speed * timing.period)), 4)
    if len(position) < 4 * span:
        return False
    late = position[len(position) // 2 :]
    rate = (late[span:] - late[:-span]) / (span * timing.period)
    stands = rate < STANDS * speed
    if np.mean(stands) > HELD:
        return True
    return int(np.count_nonzero(np.diff(stands.astype(np.int8)) == 1)) >= TIMES


def slow_motion(model: DriveModel, gains: Gains, timing: LoopTiming, fastest: float) -> SlowMotion:
    """Looks at `SPEEDS` speeds up to `fastest`."""
    return slow_at(model, gains, timing, slow_speeds(model, timing, fastest))


def slow_at(model: DriveModel, gains: Gains, timing: LoopTiming, speeds: Floats) -> SlowMotion:
    """Looks at given speeds, rising, shape (n,)."""
    return SlowMotion(speeds, tuple(sticks_at(model, gains, timing, float(speed)) for speed in speeds))
