"""Windowed spectra: frequency response by cross-spectra with the excitation (3.45), and coherence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

Floats = NDArray[np.float64]
Complexes = NDArray[np.complex128]


@dataclass(frozen=True, slots=True)
class Response:
    """A frequency response estimate; arrays of shape (m,).

    Attributes:
        frequency: Hz.
        response: output over input.
        coherence: least of the coherences of excitation with input and with output, 0 to 1.
        averages: how many independent windows went in.
    """

    frequency: Floats
    response: Complexes
    coherence: Floats
    averages: float

    @property
    def relative_error(self) -> Floats:
        """Standard error of the magnitude, relative to it (Bendat and Piersol)."""
        limited = np.clip(self.coherence, 1e-6, 1.0 - 1e-9)
        return np.asarray(np.sqrt((1.0 - limited) / (2.0 * limited * self.averages)))


def frequency_response(
    excitation: Floats, source: Floats, result: Floats, period: float, window: int
) -> Response:
    """G = E[S*Q]/E[S*U] (3.45) with Hann windows of `window` samples, half overlapping.

    `excitation` must not depend on the noise; it may equal `source` in open loop.
    """
    length = min(window, len(excitation))

    def spectrum(one: Floats, other: Floats) -> tuple[Floats, Complexes]:
        frequency, cross = signal.csd(one, other, 1.0 / period, "hann", length, length // 2)
        return np.asarray(frequency), np.asarray(cross, dtype=np.complex128)

    frequency, to_source = spectrum(excitation, source)
    to_result = spectrum(excitation, result)[1]
    power = spectrum(excitation, excitation)[1].real
    source_power = spectrum(source, source)[1].real
    result_power = spectrum(result, result)[1].real
    tiny = np.finfo(float).tiny
    one = np.abs(to_source) ** 2 / np.maximum(power * source_power, tiny)
    two = np.abs(to_result) ** 2 / np.maximum(power * result_power, tiny)
    response = to_result / np.where(np.abs(to_source) > 0, to_source, np.nan)
    averages = max(1.0, 1.8 * (len(excitation) / length - 0.5))
    keep = slice(1, -1)
    return Response(
        np.asarray(frequency[keep]),
        np.asarray(response[keep]),
        np.asarray(np.minimum(one, two)[keep]),
        averages,
    )
