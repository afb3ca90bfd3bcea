"""Dahl's curve (section 3.4.4): torque against position in very slow loops, with turning points.

Large loops saturate every elastic element of the friction; the nested ones, ever smaller, tell the
elements apart (reversal-point memory).
"""

from __future__ import annotations

from dataclasses import dataclass

from autotune.experiments.experiment import PlannedExperiment
from autotune.experiments.path import Motion, Path
from autotune.recordings.recording import CONDITIONING

LABEL, NESTED = "dahl", "dahl_nested"
LARGE = 0.6  # of the user's amplitude
SMALL = (0.3, 0.1, 0.035, 0.012)
REPEATS, NESTED_REPEATS = 3, 2
TURNING = 0.2  # part of the usual acceleration: sharp turns, as seen in position


@dataclass(frozen=True)
class Dahl(PlannedExperiment):
    """Loops at constant speed: the large one three times, the nested set twice.

    Attributes:
        large: amplitude of the large loops [rad or m].
        small: amplitudes of the nested loops, falling [rad or m].
        speed: of all loops [rad/s or m/s].
    """

    large: float
    small: tuple[float, ...]
    speed: float

    @property
    def name(self) -> str:
        return LABEL

    def trace(self, path: Path) -> None:
        centre, sharp = self.motion.centre, TURNING * self.motion.acceleration
        self._go(path, centre - self.large, sharp)
        for repeat in range(REPEATS):
            path.mark(LABEL, repeat)
            self._go(path, centre + self.large, sharp)
            self._go(path, centre - self.large, sharp)
        path.mark(CONDITIONING)
        self._go(path, centre, sharp)
        for repeat in range(NESTED_REPEATS):
            path.mark(NESTED, repeat)
            for amplitude in self.small:
                self._go(path, centre + amplitude, sharp)
                self._go(path, centre - amplitude, sharp)
            path.mark(CONDITIONING)
            self._go(path, centre - self.large if repeat + 1 < NESTED_REPEATS else centre, sharp)
            self._go(path, centre, sharp)

    def _go(self, path: Path, target: float, acceleration: float) -> None:
        path.move(target, speed=self.speed, acceleration=acceleration)


def dahl(motion: Motion, seconds: float = 25.0) -> Dahl:
    """Loops over part of the user's amplitude in about `seconds`."""
    large = LARGE * motion.amplitude
    small = tuple(part * motion.amplitude for part in SMALL)
    speed = 0.1 * motion.usual_speed
    for _ in range(6):
        speed *= Dahl(motion, large, small, speed).duration / seconds
    return Dahl(motion, large, small, speed)
