"""Steady-state characteristics (section 3.4.1): torque at constant speeds, over the same path.

Each triangle goes through a stretch round `centre` at one speed, up and down, so that
position-dependent torque is the same in both directions. The stretch is a whole number of
revolutions, or, at lower speeds, a whole part of one (2π/n), over which every ripple whose order is
a multiple of n averages out.
Before a slow stretch a faster run-in in the same direction saturates the friction state, so that
even a short stretch is in steady sliding. The order of speeds is random, which turns drifts
(warm-up) into noise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.errors import ConfigurationError
from autotune.experiments.experiment import PlannedExperiment
from autotune.experiments.path import Motion, Path
from autotune.recordings.recording import CONDITIONING

LABEL = "steady_state"
SLOWEST = 1 / 40  # of the user's peak speed
FASTEST = 8.0
RUN_IN = 0.4  # of the user's peak speed, over his amplitude: friction is saturated after it
SETTLING = 0.15  # s at constant speed before a stretch is measured
SHORTEST = 0.15  # s
PARTS = (1, 2, 3, 4, 6, 8, 12, 18, 24, 36, 48, 72, 144, 288, 720)


@dataclass(frozen=True)
class SteadyState(PlannedExperiment):
    """Triangles with rounded corners; repeats 2k and 2k + 1 of label `steady_state` are speed k up and down.

    Attributes:
        speeds: in the order played [rad/s or m/s], shape (n,).
        stretches: distance measured at each speed [rad or m], shape (n,).
    """

    speeds: tuple[float, ...]
    stretches: tuple[float, ...]

    @property
    def name(self) -> str:
        return LABEL

    def trace(self, path: Path) -> None:
        for index, (speed, stretch) in enumerate(zip(self.speeds, self.stretches, strict=True)):
            self._pass(path, 1.0, speed, stretch, 2 * index)
            self._pass(path, -1.0, speed, stretch, 2 * index + 1)
        path.move(self.motion.centre)

    def _pass(self, path: Path, direction: float, speed: float, stretch: float, repeat: int) -> None:
        motion = self.motion
        fast = max(speed, RUN_IN * motion.usual_speed)
        lead = lead_in(motion, speed)
        path.mark(CONDITIONING).move(motion.centre - direction * (0.5 * stretch + lead))
        path.ramp(direction * fast)
        if fast > speed:
            path.cruise(distance=motion.amplitude).ramp(direction * speed)
        path.cruise(seconds=SETTLING)
        path.mark(LABEL, repeat).cruise(distance=stretch)
        path.mark(CONDITIONING).ramp(0.0)


def lead_in(motion: Motion, speed: float) -> float:
    """Distance from rest to the beginning of the measured stretch."""
    fast = max(speed, RUN_IN * motion.usual_speed)
    path = Path(motion, 0.0)
    distance = path.ramp_distance(0.0, fast) + speed * SETTLING
    if fast > speed:
        distance += motion.amplitude + path.ramp_distance(fast, speed)
    return distance


def steady_state(
    motion: Motion, rng: np.random.Generator, seconds: float = 45.0, points: int = 14
) -> SteadyState:
    """Chooses speeds and stretches for about `seconds` of machine time.

    Raises:
        ConfigurationError: the travel is too small for any useful speed.
    """
    speeds = np.geomspace(SLOWEST * motion.usual_speed, _fastest(motion), points)
    order = tuple(float(speed) for speed in rng.permutation(speeds))
    low, high = SHORTEST, seconds
    for _ in range(12):
        middle = math.sqrt(low * high)
        if _experiment(motion, order, middle).duration > seconds:
            high = middle
        else:
            low = middle
    return _experiment(motion, order, low)


def _experiment(motion: Motion, speeds: tuple[float, ...], seconds: float) -> SteadyState:
    return SteadyState(motion, speeds, tuple(_stretch(motion, speed, seconds) for speed in speeds))


def _stretch(motion: Motion, speed: float, seconds: float) -> float:
    """Distance nearest to speed · seconds over which ripple averages out, and which fits the travel."""
    room = 2.0 * (motion.travel - lead_in(motion, speed))
    wanted = speed * seconds
    if motion.revolution is None:
        return min(wanted, room)
    whole = [motion.revolution * k for k in range(1, max(int(room / motion.revolution), 1) + 1)]
    fitting = [d for d in (*whole, *(motion.revolution / n for n in PARTS)) if d <= room]
    return min(fitting or [min(wanted, room)], key=lambda distance: abs(math.log(distance / wanted)))


def _fastest(motion: Motion) -> float:
    """Highest speed whose run-in and shortest stretch fit into the travel."""
    speed = min(FASTEST * motion.usual_speed, 2 / 3 * motion.top_speed)
    slowest = SLOWEST * motion.usual_speed
    while 0.5 * speed * SHORTEST + lead_in(motion, speed) > motion.travel:
        speed *= 0.9
        if speed < 4.0 * slowest:
            needed = replace(motion, travel=math.inf)
            raise ConfigurationError(
                f"experiment {LABEL!r} needs a travel of ±{lead_in(needed, 4.0 * slowest) / 0.85:.4g} round "
                f"{motion.centre:.4g}, but limits.position_min and limits.position_max leave "
                f"±{motion.travel / 0.85:.4g}; widen them, or make benchmark.amplitude smaller"
            )
    return speed
