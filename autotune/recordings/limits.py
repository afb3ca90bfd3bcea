"""What no axis can do: bounds on the columns of a recording, checked wherever one is read.

Damage, a wrong unit or a foreign column shows here in words before anything is fitted. The bounds are
those of the extremes of engineering with a margin, not those of the usual: a recording that breaks one is
wrong, one that keeps them all is not thereby right.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import RecordingError
from autotune.recordings.recording import Recording


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
    for name in recording.floats:
        _finite(recording, name, where)
    bounds = LIMITS[recording.metadata.motion_unit]
    torque = _torque_bounds(recording, bounds)
    columns = {
        "time": _TIME,
        "position": bounds.position,
        "reference": bounds.position,
        "velocity": bounds.speed,
    }
    for name, allowed in (columns | dict.fromkeys(_TORQUES, torque)).items():
        if name in recording:
            _within(recording, name, allowed, where)
    _temperature(recording, where)
    _counts(recording, where)
    _steps(recording, bounds.speed, where)
    _spacing(recording, where)


def _torque_bounds(recording: Recording, bounds: AxisBounds) -> Bounds:
    limit, unit = recording.metadata.torque_limit, recording.metadata.torque_unit or bounds.torque.unit
    if limit is None or TORQUE_OVER_LIMIT * limit > bounds.torque.most:
        return Bounds(bounds.torque.most, unit, bounds.torque.why)
    return Bounds(
        TORQUE_OVER_LIMIT * limit, unit, f"{TORQUE_OVER_LIMIT:.0f} times the torque_limit of {limit:g}"
    )


def _finite(recording: Recording, name: str, where: str) -> None:
    """Infinity nowhere; nan ("not known") in columns only that a recording can do without."""
    values = recording[name]
    wrong = ~np.isfinite(values) if name in _NEEDED else np.isinf(values)
    if wrong.any():
        row = int(np.argmax(wrong))
        allowed = "a finite number" if name in _NEEDED else "a finite number, or nan where it is not known"
        raise RecordingError(
            f"{where}: column {name} has {int(np.count_nonzero(wrong))} values that are not numbers, the first in "
            f"row {row} ({values[row]:g}); it must be {allowed}: remove those rows or record again"
        )


def _within(recording: Recording, name: str, allowed: Bounds, where: str) -> None:
    wrong = np.abs(recording[name]) > allowed.most
    if wrong.any():
        raise _refusal(where, name, int(np.argmax(wrong)), recording[name], allowed)


def _refusal(where: str, name: str, row: int, values: Floats, allowed: Bounds) -> RecordingError:
    return RecordingError(
        f"{where}: {name} is {values[row]:.6g} {allowed.unit} in row {row}; no axis goes beyond ±{allowed.most:.4g} "
        f"{allowed.unit} ({allowed.why}): a wrong unit, or a damaged file"
    )


def _temperature(recording: Recording, where: str) -> None:
    if "temperature" not in recording:
        return
    values = recording["temperature"]
    wrong = (values < _COLDEST) | (values > _HOTTEST)
    if wrong.any():
        row = int(np.argmax(wrong))
        raise RecordingError(
            f"{where}: temperature is {values[row]:.6g} °C in row {row}; possible are {_COLDEST} to {_HOTTEST:.0f}. "
            "Write nan where the sensor says nothing, or leave the column out"
        )


def _counts(recording: Recording, where: str) -> None:
    if len(recording) and int(recording.missed.min()) < 0:
        row = int(np.argmin(recording.missed))
        raise RecordingError(
            f"{where}: missed is {recording.missed[row]} in row {row}; it counts lost cycles and must be 0 or more"
        )
    refuse_names([segment.experiment for segment in recording.segments()], where)


def refuse_names(names: Iterable[str], where: str) -> None:
    """Raises RecordingError where the name of an experiment is too long or cannot be shown."""
    for name in names:
        if len(name) > LONGEST_NAME or not name.isprintable():
            raise RecordingError(
                f"{where}: an experiment is named {name[:40]!r}; a name has at most {LONGEST_NAME} characters, all "
                "of them printable"
            )


def _steps(recording: Recording, speed: Bounds, where: str) -> None:
    """Time rises from row to row within a segment, and the position moves no faster than an axis can."""
    refuse_time(recording, where)
    for segment in recording.segments():
        for start in range(segment.start, segment.stop, _AT_ONCE):
            _speeds(recording, slice(start, min(start + _AT_ONCE + 1, segment.stop)), speed, where)


def _speeds(recording: Recording, rows: slice, speed: Bounds, where: str) -> None:
    moved = np.abs(np.diff(recording["position"][rows]))
    wrong = moved > speed.most * np.diff(recording["time"][rows])
    if wrong.any():
        row = rows.start + int(np.argmax(wrong)) + 1
        one, other = recording["position"][row - 1 : row + 1].tolist()
        lasted = float(recording["time"][row] - recording["time"][row - 1])
        raise RecordingError(
            f"{where}: position goes from {one:.6g} to {other:.6g} within {lasted:.3g} s in row {row}: "
            f"{abs(other - one) / lasted:.3g} {speed.unit}; no axis goes beyond {speed.most:.4g} {speed.unit} "
            f"({speed.why}). A position that starts anew every turn is unwrapped by 'autotune data import'"
        )


def _spacing(recording: Recording, where: str) -> None:
    """The rows are as far apart as `sample_period` says: else one of the two is in another unit."""
    steps = [np.diff(recording["time"][segment.rows]) for segment in recording.segments()]
    spacing = steps[0] if len(steps) == 1 else np.concatenate(steps) if steps else np.empty(0)
    if not len(spacing):
        return
    usual, period = float(np.median(spacing, overwrite_input=True)), recording.period
    if not period / PERIOD_OFF <= usual <= period * PERIOD_OFF:
        raise RecordingError(
            f"{where}: the rows are {usual:.4g} s apart by their time, but sample_period is {period:.4g} s; one of "
            "them is wrong. Time is in seconds; a file in another unit is read by 'autotune data import'"
        )


def refuse_time(recording: Recording, where: str = "") -> None:
    """Time must rise within a segment; between segments it may start again.

    Raises:
        RecordingError: which row, and what it is most likely to be.
    """
    time, position = recording["time"], recording["position"]
    prefix = f"{where}: " if where else ""
    for segment in recording.segments():
        step = np.diff(time[segment.rows])
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
