"""A table of speeds with the mean torque at each: no course of time, and no position.

Each row becomes a short stretch of exactly that speed and torque, as `recordings/speed_points` knows measured ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import RecordingError

ROWS, PERIOD = 200, 0.01
"""Of the stretch that a speed becomes, and seconds between them: as many as a stretch needs to be one."""


def as_stretches(columns: Mapping[str, Floats], path: Path, lines: list[str]) -> dict[str, Floats]:
    """Columns with each row held for a stretch, on a clock that starts again with each.

    Raises:
        RecordingError: a row without a number, or at rest, which is no point of the curve.
    """
    kept = {name: values for name, values in columns.items() if name not in ("time", "position", "reference")}
    bad = ~np.all([np.isfinite(values) for values in kept.values()], axis=0) | (kept["velocity"] == 0.0)
    if np.any(bad):
        row = int(np.argmax(bad)) + 1
        raise RecordingError(
            f"{path}: row {row} has no speed, or no torque; leave such rows out of a speed curve"
        )
    speeds = len(kept["velocity"])
    lines.append(f"a speed curve of {speeds} rows: each becomes a stretch of constant speed and torque")
    return {
        "time": np.tile(PERIOD * np.arange(ROWS), speeds),
        **{name: np.repeat(values, ROWS) for name, values in kept.items()},
    }
