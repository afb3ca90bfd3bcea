"""Recordings with several rows to each cycle of their controller: a scope that is faster than the host or the drive.

Each set point stands in the file for as many rows, and so does the torque that it asked for. A law of the controller is
one of its cycles: what it read as one began, and what it asked for until the next.
"""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType

import numpy as np

from autotune.core.arrays import Floats
from autotune.recordings.recording import Recording

LEAST_CHANGES = 100
"""Rows with a new set point, from which on their distances tell a cycle."""
LATE_COLUMNS = ("torque", "torque_command", "torque_feedforward")
"""Columns that are read as a cycle ends: a current loop has followed the demand by then."""
SET_POINTS_STAND = "Each set point stands in "
EVERY = SET_POINTS_STAND + (
    "{rows} rows of the file, and so does the torque: the controller works every {period:.3g} ms, and one row for each "
    "of its cycles is compared."
)
STEPS_TOGETHER = 0.5
"""Times what a torque changes by in one row of each cycle that it changes by in another, in squares: a drive that works
in between changes it as much in each."""

MOST_LATE, MOST_LOOKED_AT, MOSTLY = 5, 40_000, 0.5
"""Rows by which a drive may answer late; rows that are looked at; and the part of their steps that must be nothing, or
explained by the motion. What a current loop of 300 Hz to 2 kHz does of a host's demand is explained to a fifth."""


def rows_a_cycle(reference: Floats) -> tuple[int, int]:
    """Rows for which every set point of a reference, shape (n,), is held, and the first one with a new one.

    (1, 0) where some are new in the row after.
    """
    changed = np.flatnonzero(np.diff(reference) != 0.0) + 1
    if len(changed) < LEAST_CHANGES:
        return 1, 0
    rows = int(np.gcd.reduce(np.diff(changed)))
    return rows, int(changed[0]) % rows


def _steps_by_row(torque: Floats, rows: int) -> list[float]:
    """Mean square of what a torque, shape (n,), changes by after each row of a cycle."""
    steps = np.diff(torque) ** 2
    return [float(np.mean(steps[row::rows])) for row in range(rows)]


def _steps_once(torque: Floats, rows: int) -> bool:
    """Whether a torque, shape (n,), changes in one row of each cycle far more than in another."""
    each = _steps_by_row(torque, rows)
    return min(each) < STEPS_TOGETHER * max(each)


def _answers_between(recording: Recording, rows: int) -> bool:
    """Whether the torque answers to the motion in the rows in which it steps less, as that of a drive does that works
    oftener than its set points come.

    A demand that stands does not; a torque that follows one does with a part of what it follows with.
    """
    torque = recording["torque_command" if "torque_command" in recording else "torque"]
    steps, moved = np.diff(torque), np.diff(recording["position"])
    inside = np.arange(MOST_LATE, len(steps))
    inside = inside[inside % rows != int(np.argmax(_steps_by_row(torque, rows)))][:MOST_LOOKED_AT]
    if len(inside) < LEAST_CHANGES or np.mean(steps[inside] == 0.0) > MOSTLY:
        return False
    lags = [moved[inside - late] for late in range(MOST_LATE + 1)]
    columns = np.column_stack([*lags, np.ones(len(inside))])
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    rest = steps[inside] - columns @ np.linalg.lstsq(columns, steps[inside], rcond=None)[0]
    return float(np.var(rest)) < (1.0 - MOSTLY) * float(np.var(steps[inside]))


def one_row_a_cycle(recording: Recording) -> Recording:
    """The recording with one row for each cycle of its controller; itself where that works as often or oftener."""
    if "reference" not in recording:
        return recording
    rows, first = rows_a_cycle(recording["reference"])
    begins = np.arange(first, len(recording) - rows + 1, rows)
    if rows == 1 or len(begins) == 0 or not _steps_once(recording["torque"], rows):
        return recording
    if _answers_between(recording, rows):
        return recording
    taken = recording.rows(begins)
    late = {name: recording[name][begins + rows - 1] for name in LATE_COLUMNS if name in recording}
    period = rows * recording.period
    said = EVERY.format(rows=rows, period=1e3 * period)
    taken = replace(taken, floats=MappingProxyType({**taken.floats, **late}))
    return taken.with_metadata(sample_period=period, remarks=(*recording.metadata.remarks, said))
