"""High speed without reversal (section 3.4.2): inertia, viscous friction and mechanical resonances.

A pseudo-random excitation in closed loop; the response from torque to velocity is the ratio of
cross-spectra with the excitation (3.45), each averaged over all windows of all passes before they are
divided, so that noise in the loop does not bias it. Below the first resonance its inverse is
jω·J + σ2 (3.44). A torque that comes late by τ turns it by e^{jωτ}, whose real part is σ2 − J·ω²·τ: the lag
of the torque path, which presliding cannot tell from damping. Where the response rises well above that
line there is a resonance that a notch will need.

Where a load hangs on a spring, the motor stands still at the load's own resonance (motor clamped): the real part of
jω·G, 1/J for one mass, falls through zero there and is that of the motor alone above. Noise does not bias that either.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import scipy
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.core.errors import NotEnoughExcitation
from autotune.estimation.controller import is_closed
from autotune.identify.estimate import Estimate, Quantity
from autotune.recordings.checks import clipped, guide_of, torque_of
from autotune.recordings.recording import Recording
from autotune.signals.spectra import Response, Spectra, cross_spectra, together

COHERENT = 0.6
"""From which a line may count as part of a resonance."""
LARGEST_ERROR = 0.25
"""Relative standard error of a line that is still fitted: coherence 0.6 in one pass, less in many. A bound of
0.6 whatever the passes picks the lines that noise made large: 2 % of inertia in heavy noise."""
SPOILED = 0.5
"""Coherence over the median line's below which it is not noise that spoils a line, but the ends of the passes."""
WEIGHINGS = 3
"""The second and third weigh lines by the fitted response: by its own, a line that noise made small counts more."""
WINDOW_SECONDS = 0.5
LEAST_WINDOW = 16  # samples; sampled so slowly, a spectrum has no lines
RESONANCE = 3.0
"""The response must rise to this multiple of the rigid axis's to count as a resonance."""
_LEAST_LINES = 8
HANN_WIDTH = 1.5
STANDS = 0.1
"""Of the largest real part of jω·G, below which the motor stands. Rigid axes have 0.58 and more everywhere."""
ANTIRESONANCES = (15.0, 200.0)
"""Hz: below, friction at rest stands in the way; above, the lag of a torque path turns it round."""


@dataclass(frozen=True, slots=True)
class Resonance:
    """A peak of the response: frequency [Hz] and how many times the rigid axis's response it reaches."""

    frequency: float
    height: float


@dataclass(frozen=True, slots=True)
class HighSpeed:
    """Result of the experiment.

    Attributes:
        estimate: inertia and viscous.
        response: from torque to velocity, with coherence.
        rigid: what the estimate predicts at the same frequencies.
        resonances: strongest first.
        lag: of the torque path behind the command that was recorded [s]; it comes out negative where noise is
            larger than it.
    """

    estimate: Estimate
    response: Response
    rigid: NDArray[np.complex128]
    resonances: tuple[Resonance, ...]
    lag: Quantity


@dataclass(frozen=True, slots=True)
class Antiresonance:
    """A load on a spring: its own resonance with the motor clamped [Hz], and the motor's inertia without it."""

    frequency: float
    inertia: float


def antiresonance(recording: Recording) -> Antiresonance | None:
    """Where the motor stands while its load swings; None for an axis that is one mass there.

    Raises:
        NotEnoughExcitation: as `identify_high_speed`.
    """
    response = _response(recording)
    omega = 2.0 * math.pi * response.frequency
    lightness = np.convolve((1j * omega * response.response).real, np.ones(3) / 3.0, "same")
    low, high = ANTIRESONANCES
    inside = (response.frequency > low) & (response.frequency < high)
    if np.count_nonzero(inside) < _LEAST_LINES:
        return None
    largest = float(np.percentile(lightness[inside], 90.0))
    error = np.abs(omega * response.response) * response.relative_error
    stands = inside & (lightness < STANDS * largest) & (error < largest)
    if not largest > 0.0 or not np.any(stands):
        return None
    frequency = float(response.frequency[stands][0])
    above = (response.frequency > 1.5 * frequency) & (response.frequency < 4.0 * frequency)
    level = float(np.median(lightness[above])) if np.any(above) else 0.0
    return Antiresonance(frequency, 1.0 / level) if level > 0.0 else None


def identify_high_speed(recording: Recording) -> HighSpeed:
    """Frequency response of all passes together.

    Raises:
        NotEnoughExcitation: no excitation, passes too short, torque clipped, or no coherence.
    """
    return _fitted(_response(recording), recording.period)


def _response(recording: Recording) -> Response:
    passes = [_pass(segment) for _, segment in recording.split()]
    usable = [spectra for spectra in passes if spectra is not None]
    if not usable:
        raise NotEnoughExcitation(
            f"no pass at high speed is longer than {2 * WINDOW_SECONDS} s, free of clipping and excited; add a "
            "pseudo-random signal to the torque offset or to the reference"
        )
    return together(usable).response()


def _pass(segment: Recording) -> Spectra | None:
    """Spectra of one pass; excitation is the torque offset, else what the reference has beside a ramp."""
    window = round(WINDOW_SECONDS / segment.period)
    if window < LEAST_WINDOW or len(segment) < 2 * window or float(np.mean(clipped(segment).rows)) > 0.01:
        return None
    excitation = _excitation(segment)
    if excitation is None:
        return None
    torque = np.asarray(scipy.signal.detrend(torque_of(segment)))
    speed = np.diff(segment["position"]) / segment.period
    return cross_spectra(
        excitation[:-1], torque[:-1], np.asarray(scipy.signal.detrend(speed)), segment.period, window
    )


def _excitation(segment: Recording) -> Floats | None:
    for name in ("torque_feedforward", "reference"):
        if name not in segment:
            continue
        if name == "reference" and not is_closed(segment):
            continue
        signal = np.asarray(scipy.signal.detrend(segment[name]))
        if name == "reference":
            signal = np.asarray(np.gradient(signal))
        if np.std(signal) > 1e-3 * max(float(np.std(torque_of(segment))), 1e-300) or name == "reference":
            return signal if np.std(signal) > 1e-9 * max(float(np.ptp(guide_of(segment))), 1e-300) else None
    return None


def _fitted(response: Response, period: float) -> HighSpeed:
    """Weighted linear least squares on 1/G = j·Ω·J + σ2, coherent lines below a resonance."""
    resonances = _resonances(response)
    top = 0.5 * min([r.frequency for r in resonances], default=0.2 / period)
    good = (response.relative_error < LARGEST_ERROR) & (response.frequency < top)
    if np.any(good):
        good &= response.coherence > SPOILED * np.median(response.coherence[good])
    if np.count_nonzero(good) < _LEAST_LINES:
        raise NotEnoughExcitation(
            f"torque and speed are coherent at {np.count_nonzero(good)} frequencies below {top:.0f} Hz only; at "
            f"least {_LEAST_LINES} are needed. Excite more strongly or longer"
        )
    omega = _warped(response.frequency[good], period)
    inverse = 1.0 / response.response[good]
    size = np.abs(inverse)
    for _ in range(WEIGHINGS):
        weight = 1.0 / (size * np.maximum(response.relative_error[good], 1e-3))
        inertia, inertia_error = _weighted(omega, inverse.imag, weight)
        viscous, viscous_error = _weighted(np.ones_like(omega), inverse.real, weight)
        size = np.abs(1j * omega * inertia + viscous)
    quantities = {
        "inertia": Quantity(inertia, inertia_error),
        "viscous": Quantity(max(viscous, 0.0), viscous_error),
    }
    rigid = np.asarray(
        1.0 / (1j * _warped(response.frequency, period) * inertia + viscous), dtype=np.complex128
    )
    error = np.abs(response.response[good] - rigid[good])
    relative = float(np.linalg.norm(error) / np.linalg.norm(np.abs(response.response[good])))
    valid = inertia > 0 and inertia_error < 0.25 * inertia
    reason = (
        "" if valid else f"inertia comes out as {inertia:.3g} ± {inertia_error:.2g}; excite more strongly"
    )
    notes = tuple(
        f"mechanical resonance at {one.frequency:.0f} Hz, {one.height:.1f} times the rigid response: a notch "
        "may be needed there"
        for one in resonances
    )
    estimate = Estimate("high_speed", MappingProxyType(quantities), valid, reason, relative, notes)
    lag = _lag(omega, inverse.real, weight, inertia)
    return HighSpeed(estimate, response, rigid, tuple(resonances), lag)


def _lag(omega: Floats, real: Floats, weight: Floats, inertia: float) -> Quantity:
    """τ from the real part σ2 − J·ω²·τ, weighted least squares with σ2 free."""
    design = np.stack([np.ones_like(omega), -inertia * omega**2], axis=1) * weight[:, None]
    target = real * weight
    solution = np.linalg.lstsq(design, target, rcond=None)[0]
    scatter = float(np.sum((target - design @ solution) ** 2)) / max(len(target) - 2, 1)
    spread = math.sqrt(HANN_WIDTH * max(scatter, 1e-300) * float(np.linalg.pinv(design.T @ design)[1, 1]))
    return Quantity(float(solution[1]), spread)


def _warped(frequency: Floats, period: float) -> Floats:
    """Ω = 2/h·tan(ωh/2): exact for the mean velocity over the sample in which the torque is held."""
    return np.asarray(2.0 / period * np.tan(math.pi * frequency * period))


def _weighted(column: Floats, target: Floats, weight: Floats) -> tuple[float, float]:
    """Coefficient and standard error of a straight line through zero, scaled by the scatter.

    Neighbouring lines share the noise under a Hann window, which is 1.5 lines wide.
    """
    power = float(np.sum((weight * column) ** 2))
    value = float(np.sum(weight**2 * column * target)) / power
    scatter = float(np.sum((weight * (target - value * column)) ** 2)) / max(len(column) - 1, 1)
    return value, math.sqrt(HANN_WIDTH * max(scatter, 1e-300) / power)


def _resonances(response: Response) -> list[Resonance]:
    """Peaks of |G|·ω, which is flat for a rigid axis, in coherent lines."""
    level = np.abs(response.response) * response.frequency
    coherent = response.coherence > COHERENT
    if np.count_nonzero(coherent) < _LEAST_LINES:
        return []
    lower = coherent & (response.frequency <= np.median(response.frequency[coherent]))
    flat = float(np.median(level[lower]))
    smooth = np.where(coherent, level / flat, 0.0)
    peaks, _ = scipy.signal.find_peaks(smooth, height=RESONANCE, prominence=0.5 * RESONANCE)
    found = [Resonance(float(response.frequency[i]), float(smooth[i])) for i in peaks]
    return sorted(found, key=lambda one: -one.height)
