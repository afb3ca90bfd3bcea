"""Windowed spectra: frequency response by cross-spectra with the excitation (3.45), and coherence."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from numpy.typing import NDArray

from autotune.core.arrays import Floats

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


@dataclass(frozen=True, slots=True)
class Spectra:
    """Averaged spectra of excitation S, source U and result Q; arrays of shape (m,).

    Attributes:
        frequency: Hz.
        to_source, to_result: E[S*U], E[S*Q].
        excitation, source, result: E[|S|²], E[|U|²], E[|Q|²].
        averages: how many independent windows went in.
    """

    frequency: Floats
    to_source: Complexes
    to_result: Complexes
    excitation: Floats
    source: Floats
    result: Floats
    averages: float

    def response(self) -> Response:
        """G = E[S*Q]/E[S*U] (3.45): one ratio of the averages, so that noise averages out before it divides."""
        tiny = np.finfo(float).tiny
        one = np.abs(self.to_source) ** 2 / np.maximum(self.excitation * self.source, tiny)
        two = np.abs(self.to_result) ** 2 / np.maximum(self.excitation * self.result, tiny)
        response = self.to_result / np.where(np.abs(self.to_source) > 0, self.to_source, np.nan)
        coherence = np.minimum(one, two)
        return Response(self.frequency, np.asarray(response), np.asarray(coherence), self.averages)


def cross_spectra(excitation: Floats, source: Floats, result: Floats, period: float, window: int) -> Spectra:
    """Spectra with Hann windows of `window` samples, half overlapping, without the ends of the frequencies."""
    length = min(window, len(excitation))

    def spectrum(one: Floats, other: Floats) -> Complexes:
        cross = scipy.signal.csd(one, other, 1.0 / period, "hann", length, length // 2)[1]
        return np.asarray(cross[1:-1], dtype=np.complex128)

    return Spectra(
        np.asarray(np.fft.rfftfreq(length, period)[1:-1]),
        spectrum(excitation, source),
        spectrum(excitation, result),
        spectrum(excitation, excitation).real,
        spectrum(source, source).real,
        spectrum(result, result).real,
        max(1.0, 1.8 * (len(excitation) / length - 0.5)),
    )


def together(parts: Sequence[Spectra]) -> Spectra:
    """Mean of the spectra of several records of equal window, each weighted by its number of averages."""
    weights = np.array([part.averages for part in parts])

    def mean(name: str) -> Any:
        return np.average([getattr(part, name) for part in parts], axis=0, weights=weights)

    return Spectra(
        parts[0].frequency,
        mean("to_source"),
        mean("to_result"),
        mean("excitation"),
        mean("source"),
        mean("result"),
        float(weights.sum()),
    )


def frequency_response(
    excitation: Floats, source: Floats, result: Floats, period: float, window: int
) -> Response:
    """G = E[S*Q]/E[S*U] (3.45) of one record; see `cross_spectra`.

    `excitation` must not depend on the noise; it may equal `source` in open loop.
    """
    return cross_spectra(excitation, source, result, period, window).response()
