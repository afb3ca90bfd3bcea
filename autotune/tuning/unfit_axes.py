"""Axes that must not be tuned: told from the benchmark itself, before anything is fitted or written.

A feedforward depends on the reference only, so it can take away what repeats with the reference, and
nothing else. Three things say that there is something else, each in the unit of what it would spoil:

* an oscillation of the loop (limit cycle, hunting, resonance at the bandwidth, gains near instability): most of the
  error's power lies in a narrow band far above the benchmark's own frequency;
* an error that does not repeat from period to period (stick-slip, a disturbed axis);
* a load that changes: friction and inertia cancel in the mean torque of a whole period of the benchmark,
  so the mean is the load, and only a changing load makes it change.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.core.errors import NotEnoughExcitation
from autotune.recordings.recording import Recording
from autotune.tuning.proof import fold


class NotTunable(NotEnoughExcitation):
    """The axis does something that no feedforward can compensate; nothing is applied (exit code 3).

    `stop` is the guard's own sentence, where it was the guard that ended the look at it.
    """

    def __init__(self, message: str, stop: str = "") -> None:
        super().__init__(f"{message}. The guard ended the look at it: {stop}" if stop else message)
        self.stop = stop


@dataclass(frozen=True, slots=True)
class Policy:
    """Where an axis is refused.

    Attributes:
        oscillating: share of the error's power in one narrow band. Sound axes have up to 0.06 (simulated axis, also
            with backlash or a soft transmission), limit cycles 0.7 and more.
        unrepeatable: rms of what does not repeat over the rms of what does, smoothed over a twentieth of a
            period. A feedforward leaves at least that much. Sound axes have 0.02 to 0.04.
        load_change: range of the mean torques of single periods, over the mean size of the torque that the
            benchmark takes. Sound axes have below 0.02; a hand that leans on the table 0.4 and more.
        counts: errors smaller than this many counts of the sensor are not judged.
        smooth: part of a period over which errors are averaged; band: relative half width of the narrow band.
    """

    oscillating: float = 0.4
    unrepeatable: float = 0.25
    load_change: float = 0.2
    counts: float = 4.0
    smooth: float = 0.05
    band: float = 0.15


POLICY = Policy()


@dataclass(frozen=True, slots=True)
class Oscillation:
    """The strongest narrow band of an error: Hz, amplitude [motion unit], and its share of the error's power."""

    frequency: float
    amplitude: float
    share: float


def oscillation(error: Floats, period: float, frequency: float, policy: Policy = POLICY) -> Oscillation:
    """What of an error, shape (n,), swings much faster than the benchmark of `frequency` [Hz].

    Args:
        period: sample period [s].
    """
    width = min(max(round(policy.smooth / (frequency * period)), 3), max(len(error) // 2, 1))
    error = error - error.mean()
    rapid = error - scipy.ndimage.uniform_filter1d(error, width)
    power, whole = float(np.mean(rapid**2)), float(np.mean(error**2))
    if not power > 0.0:
        return Oscillation(0.0, 0.0, 0.0)
    lines, density = scipy.signal.periodogram(rapid * np.hanning(len(rapid)), 1.0 / period)
    top = float(lines[int(np.argmax(density))])
    inside = np.abs(lines - top) <= max(policy.band * top, 2.0 * float(lines[1]))
    part = float(density[inside].sum() / density.sum())
    return Oscillation(top, math.sqrt(2.0 * part * power), min(part * power / whole, 1.0))


def unrepeatable(windows: Sequence[Recording], frequency: float, policy: Policy = POLICY) -> float:
    """Rms of what does not repeat from period to period over the rms of what does, both smoothed."""
    samples = round(1.0 / (frequency * windows[0].period))
    errors = np.concatenate([fold(w["reference"] - w["position"], samples) for w in windows])
    if len(errors) < 2:
        return 0.0
    smooth = scipy.ndimage.uniform_filter1d(
        errors, max(round(policy.smooth * samples), 1), axis=1, mode="wrap"
    )
    spread = float(np.sqrt(smooth.var(axis=0, ddof=1).mean()))
    size = float(np.sqrt(np.mean(errors.mean(axis=0) ** 2)))
    return spread / size if size > 0.0 else 0.0


def load_change(windows: Sequence[Recording], frequency: float) -> float:
    """Range of the mean torques of single periods over the mean size of the torque about its mean."""
    samples = round(1.0 / (frequency * windows[0].period))
    torques = np.concatenate([fold(window["torque"], samples) for window in windows])
    size = float(np.mean(np.abs(torques - torques.mean())))
    return float(np.ptp(torques.mean(axis=1))) / size if size > 0.0 else 0.0


def refuse_what_cannot_be_tuned(
    windows: Sequence[Recording], frequency: float, resolution: float, unit: str, policy: Policy = POLICY
) -> None:
    """Looks at windows of the benchmark as the axis is, without the feedforward that is to be tuned.

    Raises:
        NotTunable: in words, what was seen and what to do.
    """
    _refuse_oscillation(windows, frequency, resolution, unit, policy)
    refuse_changing_load(windows, frequency, policy)  # first: it also spoils what repeats
    errors = np.concatenate([window["reference"] - window["position"] for window in windows])
    if float(np.max(np.abs(errors))) > policy.counts * resolution:
        share = unrepeatable(windows, frequency, policy)
        if share > policy.unrepeatable:
            raise NotTunable(
                f"the tracking error does not repeat from period to period: {100 * share:.0f} % of it comes and goes "
                f"(allowed {100 * policy.unrepeatable:.0f} %), so the axis hunts or sticks and slips, or something "
                "disturbs it. A feedforward can take away only what repeats; look at the controller's gains "
                "and at what acts on the axis, then run again"
            )


def refuse_changing_load(windows: Sequence[Recording], frequency: float, policy: Policy = POLICY) -> None:
    """Windows of the benchmark, with or without feedforward, from one time of the run or from all of it.

    Raises:
        NotTunable: the load changed between them.
    """
    change = load_change(windows, frequency)
    if change > policy.load_change:
        raise NotTunable(
            f"the load changes in time: the mean torque of whole benchmark periods moved by {100 * change:.0f} % "
            f"of the torque that the motion itself takes (allowed {100 * policy.load_change:.0f} %). Somebody leans on "
            "the machine, a process force acts, or the load is not the same all the time; what is learned so is "
            "wrong a moment later. Keep the load as it is in operation, and the axis free, then run again"
        )


def _refuse_oscillation(
    windows: Sequence[Recording], frequency: float, resolution: float, unit: str, policy: Policy
) -> None:
    for window in windows:
        found = oscillation(window["reference"] - window["position"], window.period, frequency, policy)
        if found.share > policy.oscillating and found.amplitude > policy.counts * resolution:
            raise NotTunable(oscillates(found, unit))


def oscillates(found: Oscillation, unit: str) -> str:
    """The oscillation in words, with what to do."""
    return (
        f"the position loop oscillates by itself at {found.frequency:.0f} Hz with about {1e3 * found.amplitude:.2g} "
        f"m{unit}, {100 * found.share:.0f} % of the error's power: a limit cycle, a resonance at the "
        "bandwidth, or gains near instability. A feedforward cannot take that away; lower the controller's gains or "
        "put a notch filter there, then run again"
    )
