"""Recordings at constant speeds, one speed a segment: only the mean torque at each speed is compared.

What such files show is the curve of friction over speed, nothing else; ripple and noise average out. Each
segment becomes a short stretch of exactly constant motion with its mean torque, so that the same routine
fits it; inertia, stiffness and damping cannot be told and are held.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from autotune.recordings.checks import torque_of
from autotune.recordings.recording import CONDITIONING, RESERVED_EXPERIMENTS, Recording

LEAST_SPEEDS = 6
LEAST_SHARE = 0.8
UNEVEN = 0.25
PIECES = 8
ROWS = 400
SETTLING = 340
PERIOD = 0.01
FINE = 1e-15


@dataclass(frozen=True, slots=True)
class Point:
    """One segment: mean velocity and torque; `steady` where the velocity hardly changed."""

    name: str
    velocity: float
    torque: float
    steady: bool


def speed_points(recordings: Sequence[Recording]) -> list[Point]:
    """The points of the speed curve; empty where the recordings are something else.

    Not those of segments whose names say that they are not fitted: at one speed each there is nothing to hold out.
    """
    points = [_point(part) for recording in recordings for _, part in recording.split()]
    steady = [point for point in points if point.steady]
    fitted = [point for point in steady if point.name not in RESERVED_EXPERIMENTS]
    speeds = {round(float(np.log10(abs(p.velocity) + 1e-12)), 1) * np.sign(p.velocity) for p in fitted}
    if len(speeds) < LEAST_SPEEDS or len(steady) < LEAST_SHARE * len(points):
        return []
    return fitted


def as_steady_recordings(recordings: Sequence[Recording], points: Sequence[Point]) -> list[Recording]:
    """One recording of constant motion for each point."""
    metadata = (
        recordings[0]
        .with_metadata(sample_period=PERIOD, position_resolution=FINE, controller=None, torque_limit=None)
        .metadata
    )
    time = np.arange(ROWS, dtype=np.float64) * PERIOD
    return [
        Recording.from_columns(
            {
                "time": np.asarray(time, dtype=np.float64),
                "position": np.asarray(point.velocity * time, dtype=np.float64),
                "torque": np.full(ROWS, point.torque),
            },
            metadata,
            [CONDITIONING] * SETTLING + [f"{point.name} {number}"] * (ROWS - SETTLING),
        )
        for number, point in enumerate(points)
    ]


def _point(part: Recording) -> Point:
    n = len(part)
    if n < 2 * PIECES:
        return Point("", 0.0, 0.0, False)
    position = part["position"]
    edges = np.linspace(0, n - 1, PIECES + 1).astype(int)
    speeds = np.diff(position[edges]) / (np.diff(edges) * part.period)
    mean = float(np.mean(speeds))
    even = bool(np.std(speeds) < UNEVEN * abs(mean))
    return Point(str(part.experiment[0]), mean, float(np.mean(torque_of(part))), even)
