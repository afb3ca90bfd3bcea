"""Which wave over place a signal in time holds: the strongest line over the wavenumber, and how it stands out.

Inner products of the signal with exp(i·k·y) along a motion y(t) are the Fourier transform of the signal as a histogram
over place, so that a hundred thousand wavenumbers cost one transform.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from autotune.core.arrays import Floats

FINEST, PLACES = 19, 2.0
"""Of the histogram: as a power of two the most places, and places for each count."""
NEIGHBOURS = 401
"""Lines of noise among which one must stand out."""
FINE = 41


@dataclass(frozen=True, slots=True)
class PlaceLine:
    """A wave over place: radians per motion unit, and its power over the median power around."""

    wavenumber: float
    contrast: float


def strongest_line(
    place: Floats, signal: Floats, bounds: tuple[float, float], least: float = 0.0
) -> PlaceLine | None:
    """The line that stands out most between two wavenumbers; None where none does.

    Args:
        place, signal: arrays of shape (n,).
        bounds: radians per unit of place.
        least: contrast from which on a line stands out.
    """
    span = float(np.ptp(place))
    if span <= 0.0 or bounds[1] <= bounds[0]:
        return None
    count = 1 << min(FINEST, max(1, int(np.ceil(np.log2(PLACES * span * bounds[1] / np.pi)))))
    bins = np.rint((place - place.min()) / span * (count - 1)).astype(np.int64)
    power = np.abs(np.fft.rfft(np.bincount(bins, weights=signal, minlength=count), 2 * count)) ** 2
    wavenumber = np.pi * np.arange(len(power)) / count * (count - 1) / span
    contrast = power / np.maximum(scipy.ndimage.median_filter(power, NEIGHBOURS, mode="nearest"), 1e-300)
    contrast[(wavenumber < bounds[0]) | (wavenumber > bounds[1])] = 0.0
    best = int(np.argmax(contrast))
    if contrast[best] == 0.0 or contrast[best] < least:
        return None
    near = wavenumber[best] + np.linspace(-1.0, 1.0, FINE) * np.pi / span
    finest = max(near, key=lambda k: abs(np.dot(signal, np.exp(1j * k * place))))
    return PlaceLine(float(finest), float(contrast[best]))
