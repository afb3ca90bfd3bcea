"""What no axis can do: bounds on the columns of a recording, checked wherever one is read.

Damage, a wrong unit or a foreign column shows here in words before anything is fitted. The bounds are
those of the extremes of engineering with a margin, not those of the usual: a recording that breaks one is
wrong, one that keeps them all is not thereby right.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.core.errors import RecordingError
from autotune.recordings.recording import Metadata, Recording, Segment


@dataclass(frozen=True, slots=True)
class Bounds:
    """The most that a column's size may be, in `unit`; `why` is the extreme that the bound stands beyond."""

    most: float
    unit: str
    why: str


@dataclass(frozen=True, slots=True)
class AxisBounds:
    """Bounds of one motion unit.

    Attributes:
        position: more would need a century at full speed; beyond it a double no longer resolves a count.
        speed: of the velocity column, and of the position from row to row.
    """

    position: Bounds
    speed: Bounds
    torque: Bounds


_TIME = Bounds(1e10, "s", "three centuries; seconds since 1970 are 2e9")
LIMITS: Mapping[str, AxisBounds] = MappingProxyType(
    {
        "rad": AxisBounds(
            Bounds(1e11, "rad", "a spindle at 20 000 rpm turns 7e10 rad in a year"),
            Bounds(1e6, "rad/s", "ten times the fastest motor built, 1 million rpm"),
            Bounds(1e8, "N m", "ten times a wind turbine's main shaft"),
        ),
        "m": AxisBounds(
            Bounds(1e6, "m", "a thousand kilometres of rail"),
            Bounds(1e3, "m/s", "ten times an aircraft's catapult"),
            Bounds(1e9, "N", "ten times the largest press"),
        ),
    }
)
TORQUE_OVER_LIMIT = 10.0
"""A drive's current loop overshoots its limit by half; where the limit is per phase or rms, by 2."""
PERIOD_OFF = 1.25
"""Median row spacing over `sample_period`: clocks of drives err by parts in a thousand."""
_COLDEST, _HOTTEST = -273.15, 1500.0  # °C; windings end at 250, steel melts at 1500
LONGEST_NAME = 200
_AT_ONCE = 1 << 19
"""Rows that are compared at a time: what is computed on the way need not be as long as the recording."""
_TORQUES = ("torque", "torque_command", "torque_feedforward", "torque_feedback")
_NEEDED = ("time", "position", "torque")


def refuse_impossible(recording: Recording, where: str) -> None:
    """Refuses a recording with values that no axis can have.

    Args:
        where: the file, for the message.

    Raises:
        RecordingError: which column, row, value, and what is allowed.
    """
    for name, values in recording.floats.items():
        refuse_column(name, values, recording.metadata, where)
    refuse_missed(recording.missed, where)
    segments = recording.segments()
    refuse_names([segment.experiment for segment in segments], where)
    refuse_motion(recording["time"], recording["position"], segments, recording.metadata, where)


def refuse_column(name: str, values: Floats, metadata: Metadata, where: str) -> None:
    """What of `refuse_impossible` concerns one column of numbers by itself.

    Raises:
        RecordingError: see there.
    """
    _finite(name, values, where)
    bounds = LIMITS[metadata.motion_unit]
    columns = {
        "time": _TIME,
        "position": bounds.position,
        "reference": bounds.position,
        "velocity": bounds.speed,
    }
    allowed = _torque_bounds(metadata, bounds) if name in _TORQUES else columns.get(name)
    if allowed is not None:
        _within(name, values, allowed, where)
    if name == "temperature":
        _temperature(values, where)


def refuse_missed(missed: NDArray[np.int64], where: str, start: int = 0) -> None:
    """Raises RecordingError where a count of lost cycles is negative; `start` is the first one's row."""
    if len(missed) and int(missed.min()) < 0:
        row = int(np.argmin(missed))
        raise RecordingError(
            f"{where}: missed is {missed[row]} in row {start + row}; it counts lost cycles and must be 0 or more"
        )


def refuse_motion(
    time: Floats, position: Floats, segments: Sequence[Segment], metadata: Metadata, where: str
) -> None:
    """Time rises from row to row within a segment, as `sample_period` says, and the position as an axis can.

    Raises:
        RecordingError: see `refuse_impossible`.
    """
    _refuse_times(time, position, segments, f"{where}: ")
    speed = LIMITS[metadata.motion_unit].speed
    for segment in segments:
        for start in range(segment.start, segment.stop, _AT_ONCE):
            rows = slice(start, min(start + _AT_ONCE + 1, segment.stop))
            _speeds(time[rows], position[rows], start, speed, where)
    _spacing(time, segments, metadata.sample_period, where)


def _torque_bounds(metadata: Metadata, bounds: AxisBounds) -> Bounds:
    limit, unit = metadata.torque_limit, metadata.torque_unit or bounds.torque.unit
    if limit is None or TORQUE_OVER_LIMIT * limit > bounds.torque.most:
        return Bounds(bounds.torque.most, unit, bounds.torque.why)
    return Bounds(
        TORQUE_OVER_LIMIT * limit, unit, f"{TORQUE_OVER_LIMIT:.0f} times the torque_limit of {limit:g}"
    )


def _finite(name: str, values: Floats, where: str) -> None:
    """Infinity nowhere; nan ("not known") in columns only that a recording can do without."""
    wrong = ~np.isfinite(values) if name in _NEEDED else np.isinf(values)
    if wrong.any():
        row = int(np.argmax(wrong))
        allowed = "a finite number" if name in _NEEDED else "a finite number, or nan where it is not known"
        raise RecordingError(
            f"{where}: column {name} has {int(np.count_nonzero(wrong))} values that are not numbers, the first in "
            f"row {row} ({values[row]:g}); it must be {allowed}: remove those rows or record again"
        )


def _within(name: str, values: Floats, allowed: Bounds, where: str) -> None:
    for start in range(0, len(values), _AT_ONCE):
        wrong = np.abs(values[start : start + _AT_ONCE]) > allowed.most
        if wrong.any():
            row = start + int(np.argmax(wrong))
            raise RecordingError(
                f"{where}: {name} is {values[row]:.6g} {allowed.unit} in row {row}; no axis goes beyond "
                f"±{allowed.most:.4g} {allowed.unit} ({allowed.why}): a wrong unit, or a damaged file"
            )


def _temperature(values: Floats, where: str) -> None:
    wrong = (values < _COLDEST) | (values > _HOTTEST)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise RecordingError(
            f"{where}: temperature is {values[row]:.6g} °C in row {row}; possible are {_COLDEST} to {_HOTTEST:.0f}. "
            "Write nan where the sensor says nothing, or leave the column out"
        )


def refuse_names(names: Iterable[str], where: str) -> None:
    """Raises RecordingError where the name of an experiment is too long or cannot be shown."""
    for name in names:
        if len(name) > LONGEST_NAME or not name.isprintable():
            raise RecordingError(
                f"{where}: an experiment is named {name[:40]!r}; a name has at most {LONGEST_NAME} characters, all "
                "of them printable"
            )


def _speeds(time: Floats, position: Floats, start: int, speed: Bounds, where: str) -> None:
    moved = np.abs(np.diff(position))
    wrong = moved > speed.most * np.diff(time)
    if wrong.any():
        row = int(np.argmax(wrong)) + 1
        one, other = position[row - 1 : row + 1].tolist()
        lasted = float(time[row] - time[row - 1])
        raise RecordingError(
            f"{where}: position goes from {one:.6g} to {other:.6g} within {lasted:.3g} s in row {start + row}: "
            f"{abs(other - one) / lasted:.3g} {speed.unit}; no axis goes beyond {speed.most:.4g} {speed.unit} "
            f"({speed.why}). A position that starts anew every turn is unwrapped by 'autotune data import'"
        )


def _spacing(time: Floats, segments: Sequence[Segment], period: float, where: str) -> None:
    """The rows are as far apart as `sample_period` says: else one of the two is in another unit."""
    steps = [np.diff(time[segment.rows]) for segment in segments]
    spacing = steps[0] if len(steps) == 1 else np.concatenate(steps) if steps else np.empty(0)
    if not len(spacing):
        return
    usual = float(np.median(spacing, overwrite_input=True))
    if not period / PERIOD_OFF <= usual <= period * PERIOD_OFF:
        raise RecordingError(
            f"{where}: the rows are {usual:.4g} s apart by their time, but sample_period is {period:.4g} s; one of "
            "them is wrong. Time is in seconds; a file in another unit is read by 'autotune data import'"
        )


def refuse_time(recording: Recording) -> None:
    """Time must rise within a segment; between segments it may start again.

    Raises:
        RecordingError: which row, and what it is most likely to be.
    """
    _refuse_times(recording["time"], recording["position"], recording.segments(), "")


def _refuse_times(time: Floats, position: Floats, segments: Sequence[Segment], prefix: str) -> None:
    for segment in segments:
        step = np.diff(time[segment.rows])
        if not len(step) or step.min() > 0.0:
            continue
        still = np.flatnonzero(step == 0.0)
        if len(still) > 0.3 * len(step) and _interleaved(position[segment.rows]):
            raise RecordingError(
                f"{prefix}every time occurs twice with different positions (row {segment.start + still[0]}): two "
                "axes are mixed in one file. Separate them and fit each axis by itself"
            )
        wrong = np.flatnonzero(step <= 0.0)
        if len(wrong):
            row = segment.start + int(wrong[0]) + 1
            kind = "is duplicated" if step[wrong[0]] == 0.0 else "decreases"
            raise RecordingError(
                f"{prefix}time {kind} at row {row} ({time[row]:.6g} s after {time[row - 1]:.6g} s), {len(wrong)} "
                "times in all; sort the rows, remove the copies, or give separate recordings separate files"
            )


def _interleaved(position: Floats) -> bool:
    if len(position) < 3:
        return False
    alternating = np.median(np.abs(np.diff(position)))
    same = np.median(np.abs(position[2:] - position[:-2]))
    return bool(alternating > 3.0 * same)
