"""High speed without reversal (section 3.4.2): a PRBS on the torque offset round a constant speed.

The position loop stays closed, so the axis keeps to its path; the frequency response follows from
cross-spectra with the excitation (3.45), which is the recorded torque feedforward.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from autotune.core.errors import ConfigurationError
from autotune.experiments.experiment import PlannedExperiment
from autotune.experiments.path import Motion, Path, times
from autotune.recordings.recording import CONDITIONING
from autotune.signals.excitation import prbs

LABEL = "high_speed"
SPEED = 4.0  # of the user's peak speed
EXCITATION = 0.05  # of the torque limit
TICK = 2e-3  # s, in whole samples: flat up to 200 Hz, or a fifth of a slower sampling rate
SETTLING = 0.2  # s
BITS = (9, 8, 7)
LEAST_SPEED = 0.5  # of the user's peak speed


@dataclass(frozen=True)
class HighSpeed(PlannedExperiment):
    """Passes at constant speed, up and down in turn; repeat k of label `high_speed` is pass k.

    Attributes:
        speed: [rad/s or m/s].
        excitation: amplitude of the PRBS on the torque offset [N m or N].
        bits: of the PRBS; one period takes (2**bits − 1) · `hold` samples.
        periods: whole PRBS periods a pass.
        passes: even, so that the axis comes back.
    """

    speed: float
    excitation: float
    bits: int
    periods: int
    passes: int

    @property
    def name(self) -> str:
        return LABEL

    def trace(self, path: Path) -> None:
        motion = self.motion
        signal = np.tile(prbs(self.bits, hold(motion), self.excitation), self.periods)
        for index in range(self.passes):
            speed = self.speed if index % 2 == 0 else -self.speed
            reach = 0.5 * speed * len(signal) * motion.period
            lead = path.ramp_distance(0.0, speed) + self.speed * SETTLING
            path.mark(CONDITIONING).move(motion.centre - reach - (lead if speed > 0 else -lead))
            path.ramp(speed).cruise(seconds=SETTLING)
            steps = times(len(signal), speed * motion.period)
            path.mark(LABEL, index).add(path.position + steps, end_speed=speed, torque=signal)
            path.mark(CONDITIONING).ramp(0.0)
        path.move(motion.centre)


def hold(motion: Motion) -> int:
    """Samples of one tick of the PRBS."""
    return max(round(TICK / motion.period), 1)


def high_speed(motion: Motion, seconds: float = 10.0, excitation: float | None = None) -> HighSpeed:
    """Chooses speed, passes and PRBS for the travel at hand, in about `seconds`.

    Raises:
        ConfigurationError: the travel is too small to go at speed for even one short PRBS period.
    """
    wanted = min(SPEED * motion.usual_speed, motion.top_speed / 3.0)
    size = EXCITATION * motion.torque if excitation is None else excitation
    for bits, periods in [(b, p) for b in BITS for p in (3, 2, 1)]:
        stretch = periods * (2**bits - 1) * hold(motion) * motion.period
        speed = min(wanted, 1.6 * motion.travel / (stretch + 2.0 * SETTLING))
        if stretch <= 0.4 * seconds and speed >= min(LEAST_SPEED * motion.usual_speed, wanted):
            passes = max(2, 2 * round(0.4 * seconds / (stretch + SETTLING)))
            return HighSpeed(motion, speed, size, bits, periods, passes)
    needed = LEAST_SPEED * motion.usual_speed * (stretch + 2.0 * SETTLING) / 1.6 / 0.85
    raise ConfigurationError(
        f"experiment {LABEL!r} needs a travel of ±{needed:.4g} round {motion.centre:.4g}, but "
        f"limits.position_min and limits.position_max leave ±{motion.travel / 0.85:.4g}; widen them, or play "
        "'identification' without it: steady state and presliding give inertia and viscous friction too"
    )
