"""The gentle daily look: which motion it is. At most a minute, never faster than the axis's own motion.

Constant-speed legs up and down at speeds up to the benchmark's own peak speed, over a stretch in which
torque ripple averages out; then the benchmark as the drive runs it, and once more without compensation.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError
from autotune.experiments.path import Motion
from autotune.experiments.sines import BenchmarkSine
from autotune.experiments.steady_state import SteadyState, lead_in

LONGEST_SECONDS = 60.0
MARGIN_SECONDS = 3.0
SLOWEST = 0.2  # of the benchmark's peak speed
COMPENSATED, UNCOMPENSATED = "tracking", "uncompensated"


@dataclass(frozen=True, slots=True)
class CheckPlan:
    """Legs for friction, then `windows` of the benchmark with and without the drive's own feedforward."""

    legs: SteadyState
    motion: Motion
    periods: int

    def window(self, label: str) -> BenchmarkSine:
        """One window of the benchmark."""
        return BenchmarkSine(self.motion, 1, self.periods, label=label)

    @property
    def duration(self) -> float:
        """Machine time of legs and both windows [s]."""
        return self.legs.duration + 2.0 * (self.periods + 2) / self.motion.frequency


def plan_check(axis: Axis, seed: int = 0) -> CheckPlan:
    """The richest check that takes at most a minute.

    Raises:
        ConfigurationError: not even the shortest fits, or the travel is too small.
    """
    motion = gentle(Motion.of(axis))
    for speeds, periods in ((5, 3), (5, 2), (4, 2), (4, 1)):
        plan = CheckPlan(_legs(motion, speeds, seed), motion, periods)
        if plan.duration <= LONGEST_SECONDS - MARGIN_SECONDS:
            return plan
    raise ConfigurationError(
        f"the shortest check of axis {axis.name} would take {plan.duration:.0f} s; at most {LONGEST_SECONDS:.0f} s "
        "are allowed. Raise benchmark.frequency in the axis file"
    )


def gentle(motion: Motion) -> Motion:
    """Moves no faster and hardly harder than the benchmark itself."""
    hardness = motion.usual_speed**2 / motion.amplitude
    return replace(
        motion,
        speed=min(motion.speed, motion.usual_speed),
        acceleration=min(motion.acceleration, 2.0 * hardness),
    )


def _legs(motion: Motion, count: int, seed: int) -> SteadyState:
    speeds = np.geomspace(SLOWEST, 1.0, count) * motion.usual_speed
    order = tuple(float(speed) for speed in np.random.default_rng(seed).permutation(speeds))
    stretch = _stretch(motion)
    return SteadyState(motion, order, (stretch,) * count)


def _stretch(motion: Motion) -> float:
    """About twice the amplitude, a whole part of a revolution where there is one."""
    wanted = 2.0 * motion.amplitude
    room = 2.0 * (motion.travel - lead_in(motion, motion.usual_speed))
    if room <= 0.2 * wanted:
        raise ConfigurationError(
            f"the check needs a travel of about ±{wanted:.4g} round {motion.centre:.4g}; widen "
            "limits.position_min and limits.position_max, or make benchmark.amplitude smaller"
        )
    if motion.revolution is None:
        return min(wanted, room)
    parts = [motion.revolution / n for n in (1, 2, 3, 4, 6, 12, 24, 36, 72, 144)]
    fitting = [part for part in parts if part <= room] or [min(wanted, room)]
    return min(fitting, key=lambda part: abs(part - wanted))
