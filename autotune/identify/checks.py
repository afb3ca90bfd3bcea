"""What a recording must be before anything is fitted to it.

Everything here raises with a sentence that names the row, the value and what to do; a recording that
passes has finite numbers, increasing time and enough rows that move.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from autotune.core.errors import NotEnoughExcitation, RecordingError
from autotune.core.recording import Recording

Floats = NDArray[np.float64]
LEAST_SECONDS = 0.5
LEAST_ROWS = 200
GRAVE_CLIPPING = 0.05
GRAVE_LIMITING = 0.3
"""Share of rows at the torque limit: where nothing says that the flat tops are a limit, and where it is known."""
_FLAT_TOP = 5


@dataclass(frozen=True, slots=True)
class Clipping:
    """Rows whose torque sits at a limit: shape (n,) of bool, and the limit [N m]."""

    rows: NDArray[np.bool_]
    limit: float

    @property
    def share(self) -> float:
        return float(np.mean(self.rows)) if len(self.rows) else 0.0


def check_recording(recording: Recording) -> None:
    """Refuses what cannot be a recording of one moving axis.

    Raises:
        RecordingError: empty, NaN, time that stands still or runs backwards, two axes in one file.
        NotEnoughExcitation: too short, or position or torque never changes.
    """
    rows = len(recording)
    if rows == 0:
        raise RecordingError("the recording is empty; record the programme again")
    for name in ("time", "position", "torque", "reference", "torque_command", "torque_feedforward"):
        if name in recording:
            _finite(name, recording[name], recording["time"])
    _time(recording)
    if rows < LEAST_ROWS or rows * recording.period < LEAST_SECONDS:
        raise NotEnoughExcitation(
            f"the recording is too short: {rows} rows, {rows * recording.period:.3g} s; at least "
            f"{LEAST_ROWS} rows and {LEAST_SECONDS} s are needed"
        )
    for name in ("position", "torque"):
        if np.ptp(recording[name]) == 0.0:
            raise NotEnoughExcitation(
                f"{name} is {recording[name][0]:g} in all {rows} rows; the axis was not excited. "
                "Check that power was on and that the column is the right one"
            )


def torque_of(recording: Recording) -> Floats:
    """The torque that acts during each sample: the demand where recorded, else the measured torque."""
    return recording["torque_command"] if "torque_command" in recording else recording["torque"]


def guide_of(recording: Recording) -> Floats:
    """The reference where there is one, else the measured position."""
    return recording["reference" if "reference" in recording else "position"]


def clipped(recording: Recording) -> Clipping:
    """Rows at the torque limit: of the metadata, else where the torque has flat tops."""
    torque = torque_of(recording)
    limit = recording.metadata.torque_limit
    if limit is not None:
        return Clipping(np.abs(torque) >= limit * (1.0 - 1e-3), limit)
    peak = float(np.max(np.abs(torque)))
    at_peak = np.abs(np.abs(torque) - peak) <= 1e-6 * peak
    return Clipping(_flat(at_peak), peak)


def refuse_clipping(recording: Recording) -> Clipping:
    """Raises NotEnoughExcitation where the torque sits at its limit for a grave share of the time.

    At a limit that the recording names, the demand is what the drive delivers: such rows are only left out.
    """
    found = clipped(recording)
    allowed = GRAVE_CLIPPING if recording.metadata.torque_limit is None else GRAVE_LIMITING
    if found.share > allowed:
        first = recording["time"][int(np.argmax(found.rows))]
        raise NotEnoughExcitation(
            f"the torque is clipped at {found.limit:.4g} in {100 * found.share:.0f} % of the rows (first at "
            f"{first:.3f} s); at most {100 * allowed:.0f} % are allowed. Record with gentler motion"
        )
    return found


def _flat(at_peak: NDArray[np.bool_]) -> NDArray[np.bool_]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], at_peak, [False]]).astype(np.int8)))
    rows = np.zeros(len(at_peak), dtype=np.bool_)
    for start, stop in edges.reshape(-1, 2):
        if stop - start >= _FLAT_TOP:
            rows[start:stop] = True
    return rows


def _finite(name: str, values: Floats, time: Floats) -> None:
    wrong = np.flatnonzero(~np.isfinite(values))
    if len(wrong):
        raise RecordingError(
            f"column {name} has {len(wrong)} values that are not numbers, the first in row {wrong[0]} "
            f"(time {time[wrong[0]]:.6g} s); remove those rows or record again"
        )


def _time(recording: Recording) -> None:
    """Time must rise within a segment; between segments it may start again."""
    time, position = recording["time"], recording["position"]
    for segment in recording.segments():
        step = np.diff(time[segment.rows])
        still = np.flatnonzero(step == 0.0)
        if len(still) > 0.3 * len(step) and _interleaved(position[segment.rows]):
            raise RecordingError(
                f"every time occurs twice with different positions (row {segment.start + still[0]}): two "
                "axes are mixed in one file. Separate them and fit each axis by itself"
            )
        wrong = np.flatnonzero(step <= 0.0)
        if len(wrong):
            row = segment.start + int(wrong[0]) + 1
            kind = "is duplicated" if step[wrong[0]] == 0.0 else "decreases"
            raise RecordingError(
                f"time {kind} at row {row} ({time[row]:.6g} s after {time[row - 1]:.6g} s), {len(wrong)} "
                "times in all; sort the rows, remove the copies, or give separate recordings separate files"
            )


def _interleaved(position: Floats) -> bool:
    alternating = np.median(np.abs(np.diff(position)))
    same = np.median(np.abs(position[2:] - position[:-2]))
    return bool(alternating > 3.0 * same)
