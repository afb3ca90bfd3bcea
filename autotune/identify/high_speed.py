"""High speed without reversal (section 3.4.2): inertia, viscous friction and mechanical resonances.

A pseudo-random excitation in closed loop; the response from torque to velocity is the ratio of
cross-spectra with the excitation (3.45), which noise in the loop does not bias. Below the first
resonance its inverse is jω·J + σ2 (3.44). Where the response rises well above that line there is a
resonance that a notch will need.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.signal import detrend, find_peaks

from autotune.core.errors import NotEnoughExcitation
from autotune.core.recording import Recording
from autotune.identify.checks import clipped, guide_of, torque_of
from autotune.identify.controller import is_closed
from autotune.identify.estimate import Estimate, Quantity
from autotune.signals.spectra import Response, frequency_response

Floats = NDArray[np.float64]
COHERENT = 0.6
WINDOW_SECONDS = 0.5
RESONANCE = 3.0
"""The response must rise to this multiple of the rigid axis's to count as a resonance."""
_LEAST_LINES = 8


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
    """

    estimate: Estimate
    response: Response
    rigid: NDArray[np.complex128]
    resonances: tuple[Resonance, ...]


def identify_high_speed(recording: Recording) -> HighSpeed:
    """Frequency response of all passes together.

    Raises:
        NotEnoughExcitation: no excitation, passes too short, torque clipped, or no coherence.
    """
    responses = [_pass(segment) for _, segment in recording.split()]
    usable = [response for response in responses if response is not None]
    if not usable:
        raise NotEnoughExcitation(
            f"no pass at high speed is longer than {2 * WINDOW_SECONDS} s, free of clipping and excited; add a "
            "pseudo-random signal to the torque offset or to the reference"
        )
    response = _averaged(usable)
    return _fitted(response, recording.period)


def _pass(segment: Recording) -> Response | None:
    """Response of one pass; excitation is the torque offset, else what the reference has beside a ramp."""
    window = round(WINDOW_SECONDS / segment.period)
    if len(segment) < 2 * window or float(np.mean(clipped(segment).rows)) > 0.01:
        return None
    excitation = _excitation(segment)
    if excitation is None:
        return None
    torque = np.asarray(detrend(torque_of(segment)))
    speed = np.diff(segment["position"]) / segment.period
    return frequency_response(
        excitation[:-1], torque[:-1], np.asarray(detrend(speed)), segment.period, window
    )


def _excitation(segment: Recording) -> Floats | None:
    for name in ("torque_feedforward", "reference"):
        if name not in segment:
            continue
        if name == "reference" and not is_closed(segment):
            continue
        signal = np.asarray(detrend(segment[name]))
        if name == "reference":
            signal = np.asarray(np.gradient(signal))
        if np.std(signal) > 1e-3 * max(float(np.std(torque_of(segment))), 1e-300) or name == "reference":
            return signal if np.std(signal) > 1e-9 * max(float(np.ptp(guide_of(segment))), 1e-300) else None
    return None


def _averaged(responses: list[Response]) -> Response:
    """Mean over passes of equal length, weighted by what each is worth."""
    first = responses[0]
    same = [r for r in responses if len(r.frequency) == len(first.frequency)]
    weights = np.array([r.averages for r in same])
    return Response(
        first.frequency,
        np.asarray(np.average([r.response for r in same], axis=0, weights=weights)),
        np.asarray(np.average([r.coherence for r in same], axis=0, weights=weights)),
        float(weights.sum()),
    )


def _fitted(response: Response, period: float) -> HighSpeed:
    """Weighted linear least squares on 1/G = j·Ω·J + σ2, coherent lines below a resonance."""
    resonances = _resonances(response)
    top = 0.5 * min([r.frequency for r in resonances], default=0.2 / period)
    good = (response.coherence > COHERENT) & (response.frequency < top)
    if np.count_nonzero(good) < _LEAST_LINES:
        raise NotEnoughExcitation(
            f"torque and speed are coherent at {np.count_nonzero(good)} frequencies below {top:.0f} Hz only; at "
            f"least {_LEAST_LINES} are needed. Excite more strongly or longer"
        )
    omega = _warped(response.frequency[good], period)
    inverse = 1.0 / response.response[good]
    weight = 1.0 / (np.abs(inverse) * np.maximum(response.relative_error[good], 1e-3))
    inertia, inertia_error = _weighted(omega, inverse.imag, weight)
    viscous, viscous_error = _weighted(np.ones_like(omega), inverse.real, weight)
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
    return HighSpeed(estimate, response, rigid, tuple(resonances))


def _warped(frequency: Floats, period: float) -> Floats:
    """Ω = 2/h·tan(ωh/2): exact for the mean velocity over the sample in which the torque is held."""
    return np.asarray(2.0 / period * np.tan(math.pi * frequency * period))


def _weighted(column: Floats, target: Floats, weight: Floats) -> tuple[float, float]:
    """Coefficient and standard error of a straight line through zero, scaled by the scatter."""
    power = float(np.sum((weight * column) ** 2))
    value = float(np.sum(weight**2 * column * target)) / power
    scatter = float(np.sum((weight * (target - value * column)) ** 2)) / max(len(column) - 1, 1)
    return value, math.sqrt(max(scatter, 1e-300) / power)


def _resonances(response: Response) -> list[Resonance]:
    """Peaks of |G|·ω, which is flat for a rigid axis, in coherent lines."""
    level = np.abs(response.response) * response.frequency
    coherent = response.coherence > COHERENT
    if np.count_nonzero(coherent) < _LEAST_LINES:
        return []
    lower = coherent & (response.frequency <= np.median(response.frequency[coherent]))
    flat = float(np.median(level[lower]))
    smooth = np.where(coherent, level / flat, 0.0)
    peaks, _ = find_peaks(smooth, height=RESONANCE, prominence=0.5 * RESONANCE)
    found = [Resonance(float(response.frequency[i]), float(smooth[i])) for i in peaks]
    return sorted(found, key=lambda one: -one.height)
