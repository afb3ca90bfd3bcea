"""A coarsely sampled recording put on a finer raster, so that differences between samples are derivatives.

Central differences are short by 5 % at a tenth of the sampling rate, the mean of two torques by 4 %, and a
torque moved by half a sample by 4 % again: together they look like an elastic transmission, or friction that
grows with torque. Quintic splines through the samples have none of that up to a third of the rate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.interpolate import make_interp_spline

from autotune.core.arrays import Floats
from autotune.estimation.data import known_resolution, stretches_of
from autotune.recordings.recording import Recording

FINE = 20.0
"""Samples a period of the highest frequency compared, from which differences do: within 1.6 %."""
MOST = 4
DEGREE = 5


def needed(cutoff: float, period: float) -> int:
    """By what the raster must be finer where everything up to `cutoff` [Hz] is compared."""
    return min(MOST, max(1, math.ceil(FINE * cutoff * period - 1e-9)))


def finer(recording: Recording, factor: int) -> Recording:
    """The recording with `factor` rows for each one, interpolated between cuts; itself for 1."""
    if factor == 1:
        return recording
    old = np.arange(len(recording), dtype=np.float64)
    new = np.arange((len(recording) - 1) * factor + 1) / factor
    stretches = [stretch.rows for stretch in stretches_of(recording, 0)]
    columns = {
        name: np.interp(new, old, values) if name == "time" else _through(values, stretches, factor, old, new)
        for name, values in recording.floats.items()
    }
    row = np.floor(new + 1e-9).astype(np.int64)
    missed = np.zeros(len(new), dtype=np.int64)
    missed[::factor] = recording.missed
    metadata = recording.with_metadata(
        sample_period=recording.period / factor,
        position_resolution=known_resolution(recording.metadata, recording["position"]),
    ).metadata
    return Recording.from_columns(columns, metadata, recording.experiment[row], recording.repeat[row], missed)


def _through(values: Floats, stretches: Sequence[slice], factor: int, old: Floats, new: Floats) -> Floats:
    """Values on the new raster: splines within each stretch, straight lines elsewhere."""
    result = np.asarray(np.interp(new, old, values), dtype=np.float64)
    for rows in stretches:
        inside = slice(rows.start * factor, (rows.stop - 1) * factor + 1)
        spline = make_interp_spline(old[rows], values[rows], DEGREE)
        result[inside] = spline(new[inside])
    return result
