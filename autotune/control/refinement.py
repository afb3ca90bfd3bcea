"""Refinement of the feedforward on measured periods: the part of u_PID that repeats is taken over.

The adaptation laws of section 5.1.4 stop where three correlations vanish, which is not where the
tracking error is smallest. Here all parameters that the benchmark excites are moved so that the
predicted error is small: changing the feedforward by Δu changes the error of the closed loop by

    Δe = −G Δu,   G(jω) = 1 / (C(jω) + (jω)² J),

with the controller C known from its gains. The offset needs no search: it takes the mean of u_PID, as
(5.14) does, which an integrating controller keeps out of the error anyway. The cost is an 8-norm of the
period-averaged error, close to its peak (the quadrant glitch) yet smooth, plus a share of the rms of
u_PID. The step is predicted, then measured, and only kept if the measurement agrees.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from autotune.control.feedforward import LugreParameters, feedforward_along
from autotune.core.arrays import Floats
from autotune.recordings.recording import Controller

Complexes = NDArray[np.complex128]

NORM = 8
MOVED = ("stiffness", "coulomb", "micro_damping")
FEEDBACK_WEIGHT = 0.5


@dataclass(frozen=True, slots=True)
class PeriodAverage:
    """One period of the benchmark, averaged over the repeats.

    Attributes:
        reference, error: shape (n,) [rad]; error = reference − position.
        feedback, feedforward: u_PID and the feedforward in force, shape (n,) [N m].
        period: sample period [s].
        count: how many periods were averaged.
        noise: standard deviation of the averaged error, from period to period [rad]; 0 where not known.
    """

    reference: Floats
    error: Floats
    feedback: Floats
    feedforward: Floats
    period: float
    count: int
    noise: float = 0.0

    @property
    def peak_error(self) -> float:
        """Peak of the averaged error: the quadrant glitch [rad]."""
        return float(np.max(np.abs(self.error)))

    @property
    def smooth_peak(self) -> float:
        """8-norm of the averaged error: follows the peak, without the grain of the sensor [rad]."""
        return smooth_peak(self.error)


def smooth_peak(error: Floats) -> float:
    """(mean |e|⁸)^⅛, shape (n,) in."""
    largest = float(np.max(np.abs(error)))
    return largest * float(np.mean((np.abs(error) / largest) ** NORM) ** (1.0 / NORM)) if largest else 0.0


def controller_response(controller: Controller, omega: Floats, period: float) -> Complexes:
    """C(e^{jωh}) of the discrete PID of `Controller`; complex, shape of `omega`."""
    z = np.exp(1j * omega * period)
    derivative = controller.derivative_filter / (1.0 - (1.0 - controller.derivative_filter) / z)
    difference = (1.0 - 1.0 / z) / period
    with np.errstate(divide="ignore", invalid="ignore"):
        integral = np.where(np.abs(z - 1.0) > 0, period / (1.0 - 1.0 / z), np.inf)
    return np.asarray(controller.kp + controller.kd * derivative * difference + controller.ki * integral)


def error_response(controller: Controller, inertia: float, samples: int, period: float) -> Complexes:
    """G(jω) from feedforward to error on the frequencies of `numpy.fft.rfft`; complex, (n//2+1,)."""
    omega: Floats = np.asarray(2.0 * np.pi * np.fft.rfftfreq(samples, period), dtype=np.float64)
    response = np.zeros(len(omega), dtype=np.complex128)
    with np.errstate(invalid="ignore", divide="ignore"):
        full = 1.0 / (controller_response(controller, omega, period) - inertia * omega**2)
    np.copyto(response, full, where=np.isfinite(full))
    if controller.ki == 0.0:
        response[0] = 1.0 / controller.kp
    return response


def periodic_feedforward(parameters: LugreParameters, reference: Floats, period: float) -> Floats:
    """Feedforward along one period of a periodic reference in its steady cycle; shape (n,)."""
    ahead, behind = np.roll(reference, -1), np.roll(reference, 1)
    velocity = (ahead - behind) / (2.0 * period)
    acceleration = (ahead - 2.0 * reference + behind) / period**2
    twice = feedforward_along(parameters, np.tile(velocity, 2), np.tile(acceleration, 2), period)
    return twice[len(reference) :]


@dataclass(frozen=True, slots=True)
class Refinement:
    """A proposed step, and the peak and smooth peak of the error that it should give [rad]."""

    parameters: LugreParameters
    predicted_peak: float
    predicted_smooth_peak: float


def refine(
    measured: PeriodAverage,
    current: LugreParameters,
    controller: Controller,
    low: LugreParameters,
    high: LugreParameters,
    step: float = 0.5,
) -> Refinement:
    """Parameters within bounds that minimise the predicted error of the benchmark.

    Args:
        measured: the averaged period with the feedforward of `current` in force.
        current: where the step starts.
        controller: the drive's position controller.
        low, high: bounds of each parameter.
        step: largest relative change of a parameter in one step.
    """
    response = error_response(controller, current.inertia, len(measured.reference), measured.period)
    applied = periodic_feedforward(current, measured.reference, measured.period)
    scale = np.array([_scale(current, name) for name in MOVED])
    start = np.array([getattr(current, name) for name in MOVED])
    lower = np.maximum([getattr(low, name) for name in MOVED], start - step * scale)
    upper = np.minimum([getattr(high, name) for name in MOVED], start + step * scale)

    def predicted(values: Floats) -> tuple[LugreParameters, Floats, Floats]:
        moved = _moved(current, values)
        change = periodic_feedforward(moved, measured.reference, measured.period) - applied
        effect = np.asarray(np.fft.irfft(response * np.fft.rfft(change), len(change)))
        feedback = measured.feedback - change
        offset = current.offset + float(feedback.mean())
        balanced = replace(moved, offset=min(max(offset, low.offset), high.offset))
        return balanced, measured.error - effect, feedback - feedback.mean()

    def cost(x: Floats) -> float:
        _, error, feedback = predicted(np.clip(start + x * scale, lower, upper))
        peak = smooth_peak(error) / measured.peak_error
        return float(peak + FEEDBACK_WEIGHT * np.sqrt(np.mean(feedback**2)) / current.coulomb)

    simplex = np.vstack([np.zeros(len(MOVED)), 0.15 * np.eye(len(MOVED))])
    options: Any = {"maxfev": 1200, "xatol": 1e-4, "fatol": 1e-6, "initial_simplex": simplex}
    found = scipy.optimize.minimize(cost, np.zeros(len(MOVED)), method="Nelder-Mead", options=options)
    parameters, error, _ = predicted(np.clip(start + found.x * scale, lower, upper))
    return Refinement(parameters, float(np.max(np.abs(error))), smooth_peak(error))


def _moved(current: LugreParameters, values: Floats) -> LugreParameters:
    changed = dict(zip(MOVED, (float(value) for value in values), strict=True))
    ratio = current.break_away / current.coulomb
    return replace(current, **changed, break_away=changed["coulomb"] * ratio)


def _scale(current: LugreParameters, name: str) -> float:
    if name == "micro_damping":
        return max(current.micro_damping, 1e-3 * current.stiffness)
    return float(getattr(current, name))
