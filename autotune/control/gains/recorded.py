"""Hunting recognised in what was measured: the position swings on while its set point stands still."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from autotune.control.gains.hunting import LimitCycle, recognised
from autotune.core.arrays import Floats
from autotune.core.errors import RecordingError
from autotune.recordings.recording import Recording

LEAST_SECONDS = 0.6
"""Of a set point that is held: at 10 Hz there are two swings in each third of it."""


@dataclass(frozen=True, slots=True)
class HeldSetPoints:
    """What the held set points of a recording show: how long they are together, and the largest limit cycle."""

    seconds: float
    cycle: LimitCycle | None


def held_set_points(recording: Recording, resolution: float) -> HeldSetPoints:
    """Looks at every stretch of `LEAST_SECONDS` and more with a constant reference.

    Args:
        resolution: of the position sensor [rad or m].

    Raises:
        RecordingError: no set points in the recording, or none that is held long enough.
    """
    if "reference" not in recording:
        raise RecordingError(
            "the recording has no set points (column 'reference'): whether the axis hunts cannot be told from it. "
            "Import it with one: autotune data import FILE --column reference=FIELD"
        )
    least = round(LEAST_SECONDS / recording.period)
    found: list[LimitCycle | None] = []
    seconds = 0.0
    for _, rows in recording.split():
        reference, position = rows["reference"], rows["position"]
        controlled = (
            float(np.mean(reference != position)) > 0.05 or float(np.ptp(position)) <= 2.0 * resolution
        )
        for start, stop in _held(reference, resolution):
            if stop - start >= least and controlled:
                seconds += (stop - start) * recording.period
                found.append(recognised(position[start:stop], recording.period, resolution))
    if not found:
        raise RecordingError(
            f"no set point of the recording is held for {LEAST_SECONDS} s under position control: record a standstill, "
            "or moves with rests between them"
        )
    cycles = [one for one in found if one is not None]
    return HeldSetPoints(seconds, max(cycles, key=lambda one: one.amplitude) if cycles else None)


def _held(reference: Floats, resolution: float) -> list[tuple[int, int]]:
    """Stretches in which the reference stays within a count [rad or m], one after the other.

    A motion that is slow beside the counts, a triangle on a coarse encoder, is none: the axis swings as it is asked to.
    """
    edges, low, high = [0], math.inf, -math.inf
    for k, place in enumerate(reference.tolist()):
        low, high = min(low, place), max(high, place)
        if high - low > resolution:
            edges.append(k)
            low = high = place
    return list(pairwise([*edges, len(reference)]))
