"""Rows without numbers, counters that overflow, positions that wrap."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.core.errors import RecordingError

MOST_MISSING = 0.01
"""Share of the rows that may lack a number; more is no recording."""
MOST = 1e12
_NEEDED = ("time", "position", "velocity", "torque", "reference", "torque_command")
_REGISTERS = (2.0**16, 2.0**24, 2.0**32)

_GRAIN_ROWS = 50_000
_FINEST = 1e-7  # of the travel
_OFF_GRID, _ON_GRID = 0.05, 0.99
LEAST_STEPS = 50
_COUNTS = (3.0, 30.0, 300.0, math.inf)
"""How many counts a step has at most from which one is told, time after time."""


def without_missing(columns: Mapping[str, Floats], path: Path, notes: list[str]) -> dict[str, Floats]:
    """The rows that have all numbers.

    Raises:
        RecordingError: more than one row in a hundred lacks one, or a column has none at all.
    """
    rows = len(next(iter(columns.values())))
    if not rows:
        raise RecordingError(f"{path} has no rows; export the measurement again")
    uneven = [f"{name} {len(values)}" for name, values in columns.items() if len(values) != rows]
    if uneven:
        raise RecordingError(
            f"{path}: the first column has {rows} rows, but {', '.join(uneven)}: the file is damaged; export it again"
        )
    good = np.ones(rows, dtype=np.bool_)
    for name in _NEEDED:
        if name in columns:
            finite = np.isfinite(columns[name])
            _refuse_many(name, int(rows - np.count_nonzero(finite)), rows, finite, path)
            good &= finite
    lost = rows - int(np.count_nonzero(good))
    if not lost:
        return dict(columns)
    first = int(np.argmin(good)) + 1
    notes.append(f"{lost} rows without a number are dropped, the first is row {first}")
    return {name: values[good] for name, values in columns.items()}


def as_before(values: Floats) -> Flags:
    """Whether each value but the first is that of the row before, shape (n − 1,); where both are missing they are."""
    return np.asarray((values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1])))


def without_copies(columns: dict[str, Floats], notes: list[str]) -> dict[str, Floats]:
    """The rows without those that repeat the one before to the last digit, its time too: a logger wrote it twice."""
    same = np.diff(columns["time"]) == 0.0
    if not np.any(same):
        return columns
    for values in columns.values():
        same &= as_before(values)
    copies = int(np.count_nonzero(same))
    if not copies:
        return columns
    notes.append(
        f"{copies} rows repeat the row before with its time and are dropped, the first is row "
        f"{int(np.argmax(same)) + 2}"
    )
    good = np.concatenate([[True], ~same])
    return {name: values[good] for name, values in columns.items()}


def _refuse_many(
    name: str, lost: int, rows: int, finite: np.ndarray[tuple[int], np.dtype[np.bool_]], path: Path
) -> None:
    if lost <= max(MOST_MISSING * rows, 1.0) and lost < rows:
        return
    first = int(np.argmin(finite)) + 1
    raise RecordingError(
        f"{path}: {name} has {lost} of {rows} values that are not numbers, the first in row {first}; at most "
        f"{100 * MOST_MISSING:.0f} % may be missing. Name another column, or export again without the holes"
    )


def refuse_absurd(columns: Mapping[str, Floats], path: Path) -> None:
    """Raises RecordingError where a value is beyond any axis, in SI: a wrong factor or a damaged file."""
    for name in _NEEDED:
        if name in columns and float(np.max(np.abs(columns[name]))) > MOST:
            row = int(np.argmax(np.abs(columns[name])))
            raise RecordingError(
                f"{path}: {name} is {columns[name][row]:g} at row {row + 1}, more than any axis can have; check the "
                "unit or the factor, or remove the row"
            )


def unwrap_clock(raw: Floats, notes: list[str]) -> Floats:
    """A counter of 16, 24 or 32 bits that overflowed, in ticks, goes on counting."""
    there = np.isfinite(raw)
    if not np.all(there):
        whole = raw.copy()
        whole[there] = unwrap_clock(raw[there], notes)
        return whole
    step = np.diff(raw)
    back = np.flatnonzero(step < 0)
    if not len(back) or not np.all(raw[:1000] == np.round(raw[:1000])):
        return raw
    usual = float(np.median(step))
    for size in _REGISTERS:
        if raw.max() < size and np.all(np.abs(step[back] + size - usual) <= 5.0 * abs(usual) + 1.0):
            notes.append(f"the clock's counter of {round(math.log2(size))} bits overflows; unwrapped")
            turns = np.zeros(len(raw))
            turns[back + 1] = size
            return np.asarray(raw + np.cumsum(turns))
    return raw


def wrap_length(values: Floats, factor: float, rotary: bool) -> float | None:
    """After how much the position starts again, where that is beyond doubt.

    A turn (rotary axes) or a register of 16 to 32 bits (times the factor to SI). Beyond doubt: the
    values stay within one length, they jump by nearly all of it, and without the jumps no step is
    longer than a quarter of it.
    """
    step = np.diff(values)
    if not len(step):
        return None
    range_ = float(np.ptp(values))
    candidates = [2.0 * math.pi] if rotary else []
    candidates += [size * abs(factor) for size in _REGISTERS]
    for length in candidates:
        far = np.abs(step) > 0.5 * length
        if range_ <= length * (1.0 + 1e-6) and np.any(far):
            left = np.abs(step - np.round(step / length) * length)
            if float(left.max()) < 0.25 * length and float(np.abs(step[far]).min()) > 0.75 * length:
                return length
    return None


def unwrapped(values: Floats, length: float) -> Floats:
    """Continuous values; the first stays."""
    return np.asarray(np.unwrap(values, period=length))


def grain(position: Floats) -> float | None:
    """One count of the sensor, or of the digits in the file, where all steps are whole multiples of it.

    Found as the smallest step, then from those of a few counts, of more, and of all: what the file's digits take off
    the smallest would be whole counts in the largest. None where positions lie on no grid, or on one too fine to
    matter.
    """
    step = np.abs(np.diff(position[:_GRAIN_ROWS]))
    travel = float(np.ptp(position))
    step = step[step > _FINEST * travel]
    if len(step) < LEAST_STEPS:
        return None
    count = float(np.percentile(step, 1.0))
    for most in _COUNTS:
        whole = np.round(step / count)
        near = (whole >= 1.0) & (whole <= most)
        if not near.any():
            return None
        count = float(step[near] @ whole[near]) / float(whole[near] @ whole[near])
    off = np.abs(step / count - np.round(step / count))
    return count if float(np.mean(off < _OFF_GRID)) >= _ON_GRID else None
