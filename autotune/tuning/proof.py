"""Is it better beyond doubt? Windows with and without compensation, measured in turn.

Both are taken in pairs, so that slow drift (temperature) cancels in the difference. The figure is the
peak of the period-averaged error, the quadrant glitch; a paired t interval on the difference decides.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.core.errors import RecordingError
from autotune.recordings.recording import Recording

LEAST_PAIRS = 5
PEAK_TOLERANCE, RMS_TOLERANCE = 0.1, 0.05  # of the error before: what single windows cannot tell from nothing


@dataclass(frozen=True, slots=True)
class TrackingError:
    """Tracking error on the benchmark [motion unit].

    Attributes:
        peak_error: peak of the period-averaged error (the quadrant glitch).
        raw_peak_error: largest single error.
        rms_error: root mean square of all errors.
    """

    peak_error: float
    raw_peak_error: float
    rms_error: float


@dataclass(frozen=True, slots=True)
class Proof:
    """Before and after, and what may be said of the difference.

    Attributes:
        before, after: over all windows.
        improvement: mean over the pairs of (before − after) of the peak of each window [motion unit].
        interval: confidence interval of `improvement`.
        better: the whole interval lies above what was asked for, and the rms is not worse.
        pairs: peak of each window, shape (n, 2): before, after.
    """

    before: TrackingError
    after: TrackingError
    improvement: float
    interval: tuple[float, float]
    better: bool
    pairs: Floats


@dataclass(frozen=True, slots=True)
class HeldOutError:
    """Peak and rms of the error of each window of the held-out motion [motion unit], shape (n,)."""

    peak: Floats
    rms: Floats

    @classmethod
    def of(cls, windows: Sequence[Recording]) -> HeldOutError:
        errors = [window["reference"] - window["position"] for window in windows]
        return cls(
            np.array([np.max(np.abs(error)) for error in errors]),
            np.array([np.sqrt(np.mean(error**2)) for error in errors]),
        )

    def as_json(self) -> dict[str, list[float]]:
        return {"peak_error": self.peak.tolist(), "rms_error": self.rms.tolist()}


def harm(
    before: HeldOutError, after: HeldOutError, resolution: float, confidence: float
) -> tuple[str, float, float] | None:
    """What cannot be ruled out to be worse on the held-out motion: (figure, mean before, mean after), or None.

    Not worse beyond doubt: the upper bound of mean(after) − mean(before) (Welch, one-sided) is below the
    tolerance, a part of the error before and one count of the sensor.

    Args:
        before, after: at least two windows each.
        resolution: one count of the position sensor [motion unit].
        confidence: of the bound.
    """
    for name, one, other, part in (
        ("peak error", before.peak, after.peak, PEAK_TOLERANCE),
        ("rms error", before.rms, after.rms, RMS_TOLERANCE),
    ):
        tolerance = part * float(one.mean()) + resolution
        if not float(other.mean() - one.mean()) + _reach(one, other, confidence) <= tolerance:
            return name, float(one.mean()), float(other.mean())
    return None


def no_worse(before: TrackingError, after: TrackingError, resolution: float) -> bool:
    """Neither peak nor rms is worse by more than what single windows cannot tell from nothing."""
    return (
        after.peak_error <= (1.0 + PEAK_TOLERANCE) * before.peak_error + resolution
        and after.rms_error <= (1.0 + RMS_TOLERANCE) * before.rms_error + resolution
    )


def _reach(one: Floats, other: Floats, confidence: float) -> float:
    """One-sided reach of the difference of two means; degrees of freedom after Welch and Satterthwaite."""
    parts = [float(values.var(ddof=1)) / len(values) for values in (one, other)]
    if not sum(parts) > 0.0:
        return 0.0
    freedom = sum(parts) ** 2 / sum(
        part**2 / (len(values) - 1) for part, values in zip(parts, (one, other), strict=True)
    )
    return float(scipy.special.stdtrit(freedom, confidence)) * math.sqrt(sum(parts))


def fold(values: Floats, samples: int) -> Floats:
    """Whole periods as rows, shape (periods, samples).

    Raises:
        RecordingError: less than one period.
    """
    periods = len(values) // samples
    if periods < 1:
        raise RecordingError(
            f"the window has {len(values)} samples, less than one period of {samples}; it was cut short"
        )
    return values[: periods * samples].reshape(periods, samples)


def tracking_error(windows: Sequence[Recording], frequency: float) -> TrackingError:
    """Figures of merit over windows of whole periods of the benchmark.

    Raises:
        RecordingError: no window, or a window shorter than a period.
    """
    if not windows:
        raise RecordingError("no window of the benchmark was measured")
    errors = [window["reference"] - window["position"] for window in windows]
    samples = round(1.0 / (frequency * windows[0].period))
    average = np.concatenate([fold(error, samples) for error in errors]).mean(axis=0)
    every = np.concatenate(errors)
    return TrackingError(
        float(np.max(np.abs(average))), float(np.max(np.abs(every))), float(np.sqrt(np.mean(every**2)))
    )


def prove(
    before: Sequence[Recording],
    after: Sequence[Recording],
    frequency: float,
    least_improvement: float,
    confidence: float,
) -> Proof:
    """Compares windows measured in turn.

    Args:
        before, after: windows of the benchmark in the order measured, equally many, at least 5.
        frequency: of the benchmark [Hz].
        least_improvement: share of the peak error before that must be gained.
        confidence: of the interval, two-sided.

    Raises:
        RecordingError: too few or unequal numbers of windows.
    """
    if len(before) != len(after) or len(before) < LEAST_PAIRS:
        raise RecordingError(
            f"{len(before)} windows before and {len(after)} after were measured; the proof needs equally "
            f"many, at least {LEAST_PAIRS} each"
        )
    pairs = np.array(
        [
            [tracking_error([one], frequency).peak_error, tracking_error([other], frequency).peak_error]
            for one, other in zip(before, after, strict=True)
        ]
    )
    gains = pairs[:, 0] - pairs[:, 1]
    mean, spread = float(gains.mean()), float(gains.std(ddof=1)) / math.sqrt(len(gains))
    reach = float(scipy.special.stdtrit(len(gains) - 1, 0.5 + confidence / 2.0)) * spread
    total_before, total_after = tracking_error(before, frequency), tracking_error(after, frequency)
    better = (
        mean - reach > least_improvement * total_before.peak_error
        and total_after.rms_error <= total_before.rms_error
    )
    return Proof(total_before, total_after, mean, (mean - reach, mean + reach), better, pairs)
