"""Iterative learning as the ceiling: the least error that any feedforward could leave on one motion.

    u_{k+1}(t) = Q·(u_k(t) + γ·C·e_k(t + δ))

with the controller's own torque C·e as the learning signal, advanced by the loop's delay, and Q a low-pass without
phase (Bristow, Tharayil and Alleyne, A survey of iterative learning control, 2006: PD type with a Q filter). It knows
nothing of friction and holds for the motion that was learnt only; that is why it is a ceiling and no compensation.
`learn` does so on the twin, for a motion from rest; on an axis the trials are measured, and `next_torque` makes one of
the last one's averaged period, which `LearntFeedforward` plays by time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from autotune.control.gains.loop import Gains, LoopTiming
from autotune.control.gains.twin import follow
from autotune.control.model_feedforward import torque_along
from autotune.control.structures.structure import reference_rates
from autotune.core.arrays import Floats
from autotune.core.drive import Sample
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


@dataclass(frozen=True, slots=True)
class TwinCeiling:
    """Largest errors on the twin [rad or m]: with the model's feedforward, after learning from it, with neither."""

    fixed: float
    learnt: float
    neither: float


def ceiling_on_twin(
    model: DriveModel, gains: Gains, timing: LoopTiming, reference: Floats, looked_at: slice
) -> TwinCeiling:
    """How near the model's own feedforward comes to what can be learnt on one motion from rest.

    Raises:
        ConfigurationError: as `learn`.
    """
    rates = reference_rates(reference, timing.period)
    start = torque_along(model, rates[:, 0], rates[:, 1], rates[:, 2], timing.period)
    found = learn(model, gains, timing, reference, start, looked_at)
    plain = follow(model, gains, timing, reference)
    if not plain.bounded:
        raise ConfigurationError("the loop runs away on the twin; nothing can be learnt with these gains")
    return TwinCeiling(float(found.peaks[0]), found.best, float(np.max(np.abs(plain.error[looked_at]))))


def next_torque(torque: Floats, feedback: Floats, period: float) -> Floats:
    """One period of the torque after a trial, in its steady cycle; shapes (n,) [N m or N].

    Args:
        torque: that was played; feedback: the controller's own torque beside it, averaged over periods.
    """
    wanted = torque + GAIN * np.roll(feedback, -AHEAD)
    rates = np.fft.rfftfreq(len(torque), period)
    keep = 1.0 / (1.0 + (rates / min(CUT_OFF, 0.4 / period)) ** 4)  # twice the Butterworth filter, no phase
    return np.asarray(np.fft.irfft(keep * np.fft.rfft(wanted), len(torque)))


class LearntFeedforward:
    """Plays one period of a torque by time, round and round; see `control.feedforward.FeedforwardLaw`."""

    settled = False

    def __init__(self, torque: Floats) -> None:
        self._torque = torque.tolist()
        self._at = 0

    def prepare(self) -> None:
        """Nothing to compile."""

    def step(self, reference: float, velocity: float, acceleration: float, previous: Sample | None) -> float:
        value = self._torque[self._at]
        self._at = (self._at + 1) % len(self._torque)
        return float(value)


def by_phase(torque: Floats, samples: int) -> Floats:
    """One period of a learnt torque on a sine of another length, turn by turn; shape (samples,)."""
    at = np.arange(samples) * (len(torque) / samples)
    return np.asarray(np.interp(at, np.arange(len(torque) + 1), np.append(torque, torque[0])))
