"""Iterative learning as the ceiling: the least error that any feedforward could leave on one motion.

    u_{k+1}(t) = Q·(u_k(t) + γ·C·e_k(t + δ))

with the controller's own torque C·e as the learning signal, advanced by the loop's delay, and Q a low-pass without
phase (Bristow, Tharayil and Alleyne, A survey of iterative learning control, 2006: PD type with a Q filter). It knows
nothing of friction and holds for the motion that was learnt only; that is why it is a ceiling and no compensation.
Here it learns on the twin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from autotune.control.gains.loop import Gains, LoopTiming
from autotune.control.gains.twin import follow
from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.models.drive_model import DriveModel

TRIALS = 40
GAIN = 0.5
CUT_OFF = 60.0
"""Hz, of Q: above it the controller's torque is encoder noise, and the loop's phase makes learning diverge."""
AHEAD = 2
"""Samples by which the torque is advanced: the hold, and the derivative's backward difference."""
STALLS = 6
"""Trials without a better one, after which it has converged."""


@dataclass(frozen=True, slots=True)
class Learnt:
    """What learning left.

    Attributes:
        torque: the feedforward of the best trial, shape (n,) [N m].
        peaks: largest error of each trial on the rows looked at [rad].
        trials: how many were made.
    """

    torque: Floats
    peaks: Floats
    trials: int

    @property
    def best(self) -> float:
        return float(np.min(self.peaks))


def learn(
    model: DriveModel,
    gains: Gains,
    timing: LoopTiming,
    reference: Floats,
    start: Floats | None = None,
    looked_at: slice = slice(None),
) -> Learnt:
    """Learns the feedforward torque for one motion on the twin.

    Args:
        reference: [rad], shape (n,), from rest; the motion is repeated as a whole.
        start: torque to begin with; none by default.
        looked_at: rows on which the error counts.

    Raises:
        ConfigurationError: a motion too short for the filter, or a loop that runs away.
    """
    if len(reference) * timing.period * CUT_OFF < 10.0:
        raise ConfigurationError(
            f"a motion of {len(reference) * timing.period:.3g} s is too short to learn on; "
            f"{10.0 / CUT_OFF:.2g} s are needed"
        )
    filters = scipy.signal.butter(2, min(CUT_OFF, 0.4 / timing.period), fs=1.0 / timing.period, output="sos")
    torque = np.zeros(len(reference)) if start is None else start.copy()
    best, peaks, since = torque, [], 0
    for _ in range(TRIALS):
        motion = follow(model, gains, timing, reference, torque)
        if not motion.bounded:
            raise ConfigurationError("the loop runs away on the twin; nothing can be learnt with these gains")
        peaks.append(float(np.max(np.abs(motion.error[looked_at]))))
        if peaks[-1] <= min(peaks):
            best, since = torque, 0
        else:
            since += 1
        if since >= STALLS:
            break
        feedback = motion.torque - torque
        ahead = np.concatenate([feedback[AHEAD:], np.full(AHEAD, feedback[-1])])
        torque = scipy.signal.sosfiltfilt(filters, torque + GAIN * ahead)
    return Learnt(best, np.array(peaks), len(peaks))
