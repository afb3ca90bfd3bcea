"""Time stamps as others write them → stretches on a regular grid.

A clock that starts again begins a new stretch, and so does a gap of more than three samples. Stamps
that only carry the rounding of their digits are replaced by the line through them; stamps that really
jitter are the times of the samples, and the samples are interpolated onto a regular grid: position,
velocity and temperature by cubic pieces with three-point derivatives (error of order h³, overshoot
beside an encoder step at most a tenth of it), torque linearly.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.core.errors import RecordingError

GAP_SAMPLES = 3
LEAST_ROWS = 10
REGULAR = 0.05
"""Stamps within this share of the period of a straight line are regular."""
_WINDOW = 25
"""Samples over which a jittering clock is averaged; most such windows must be without a lost sample."""
_CHUNK = 1 << 19
_CLOSEST = 1e-9
"""Of the period: what two stamps at least are apart; jitter of any clock is larger by decades."""
_SMOOTH = ("position", "reference", "velocity", "temperature")


@dataclass(frozen=True, slots=True)
class RegularPiece:
    """A contiguous, regular piece: columns of shape (n,), `time` among them.

    Attributes:
        missed: samples lost just before it.
        row: of the file, where it starts, from 0.
        run: number of the run (the clock has started again) it belongs to.
    """

    columns: Mapping[str, Floats]
    missed: int = 0
    row: int = 0
    run: int = 0

    def __len__(self) -> int:
        return len(self.columns["time"])

    def with_columns(self, **columns: Floats) -> RegularPiece:
        return replace(self, columns={**self.columns, **columns})


def median_period(time: Floats) -> float:
    """Median of the steps forward; 0 where there are none. A million rows tell it."""
    step = np.diff(time[: 1 << 20])
    forward = step[step > 0]
    return float(np.median(forward)) if len(forward) else 0.0


def split_runs(columns: Mapping[str, Floats], path: Path, notes: list[str]) -> list[RegularPiece]:
    """Stretches between restarts of the clock, and where `repeat` or the label of the experiment changes.

    Raises:
        RecordingError: time stands still or runs backwards without starting again.
    """
    time = columns["time"]
    period = median_period(time)
    if period == 0.0:
        raise RecordingError(f"{path}: time never increases ({time[0]:g} at row 1); name the right column")
    step = np.diff(time)
    backward = np.flatnonzero(step < 0)
    starts = [0, *(backward + 1).tolist(), len(time)]
    if len(backward) > max(1000, len(time) // LEAST_ROWS) or not _restarts(time, starts, period):
        row = int(backward[0]) + 1
        _refuse_mixed(columns, path)
        raise RecordingError(
            f"{path}: time decreases at row {row + 1}: {time[row]:.9g} s after {time[row - 1]:.9g} s "
            f"({len(backward)} times in all); sort the rows, or give separate recordings separate files"
        )
    _refuse_duplicates(columns, step, path)
    if len(backward):
        notes.append(f"the clock starts again {len(backward)} times: {len(starts) - 1} segments")
    return cut_at(columns, sorted({*starts, *new_segments(columns)}))


def new_segments(columns: Mapping[str, Floats]) -> list[int]:
    """Rows at which `repeat` or the label of the experiment changes; none where the file has neither."""
    told = [columns[name] for name in ("experiment", "repeat") if name in columns]
    changes = [np.flatnonzero(np.diff(values) != 0) + 1 for values in told]
    return sorted({int(row) for rows in changes for row in rows})


def cut_at(columns: Mapping[str, Floats], edges: Sequence[int]) -> list[RegularPiece]:
    """A run from each edge to the next."""
    return [
        RegularPiece({name: values[a:b] for name, values in columns.items()}, row=a, run=number)
        for number, (a, b) in enumerate(itertools.pairwise(edges))
    ]


def split_gaps(run: RegularPiece, period: float) -> list[RegularPiece]:
    """Pieces of one run between gaps of more than `GAP_SAMPLES` missing samples."""
    time = run.columns["time"]
    step = np.diff(time)
    gaps = np.flatnonzero(step >= (GAP_SAMPLES + 1.5 - 1e-6) * period) + 1
    edges = [0, *gaps.tolist(), len(time)]
    pieces = []
    for a, b in itertools.pairwise(edges):
        missed = round(step[a - 1] / period) - 1 if a else run.missed
        cut = {name: values[a:b] for name, values in run.columns.items()}
        pieces.append(RegularPiece(cut, missed, run.row + a, run.run))
    return pieces


def fitted_period(pieces: list[RegularPiece], median: float) -> float:
    """Mean step of the longest piece where that is regular, else its median over windows of samples.

    A piece that will be resampled gets a period of as few digits as possible within 1e-3; its grid
    follows the stamps all the same.
    """
    time = max(pieces, key=len).columns["time"]
    mean = _slope(time)
    if abs(mean / median - 1.0) < 0.5 and _rounded_only(time, mean):
        return _round(mean, 6 if len(time) < 1 << 20 else 9)
    window = min(_WINDOW, len(time) - 1)
    usual = float(np.median(time[window:] - time[:-window])) / window
    short = (_round(usual, digits) for digits in range(1, 6))
    return next((value for value in short if abs(value / usual - 1.0) < 1e-3), _round(usual, 6))


def regular(piece: RegularPiece, period: float) -> tuple[RegularPiece, str]:
    """The piece on a regular grid, and what was done: nothing, `straightened` or `resampled`."""
    time = piece.columns["time"]
    line = time[0] + period * np.arange(len(time))
    away = time - line
    middle = 0.5 * float(away.max() + away.min())
    spread = float(np.max(np.abs(away - middle)))
    if spread <= REGULAR * period:
        return piece, ""
    if _rounded_only(time, period):
        return piece.with_columns(time=line + middle), "straightened"
    return resampled(piece, period), "resampled"


def resampled(piece: RegularPiece, period: float) -> RegularPiece:
    """All columns interpolated onto the grid that starts at the piece's first stamp."""
    time = piece.columns["time"]
    closest = float(np.min(np.diff(time), initial=period))
    if closest < _CLOSEST * period:
        raise RecordingError(
            f"two time stamps are {closest:.3g} s apart, in a file with {period:.3g} s from row to row: rows that were "
            "stamped twice, or damage; remove one of them, or name the period with --period"
        )
    count = int(np.floor((time[-1] - time[0]) / period + 1e-6)) + 1
    grid = time[0] + period * np.arange(count)
    columns = {"time": grid}
    for name, values in piece.columns.items():
        if name != "time":
            columns[name] = _interpolated(name, time, values, grid)
    return replace(piece, columns=columns)


def _interpolated(name: str, time: Floats, values: Floats, grid: Floats) -> Floats:
    if name not in _SMOOTH or len(time) < 4 or not np.all(np.isfinite(values)):
        return np.asarray(np.interp(grid, time, values))
    result = np.empty_like(grid)
    for rows, part in _chunks(time, grid):
        slope = np.gradient(values[part], time[part], edge_order=2)
        pieces = scipy.interpolate.CubicHermiteSpline(time[part], values[part], slope)
        result[rows] = pieces(np.minimum(grid[rows], time[-1]))
    return result


def _chunks(time: Floats, grid: Floats) -> Iterator[tuple[slice, slice]]:
    """Pieces of the grid with the samples they need, so that memory stays bounded."""
    for a in range(0, len(grid), _CHUNK):
        b = min(a + _CHUNK, len(grid))
        first = max(int(np.searchsorted(time, grid[a])) - 4, 0)
        last = min(int(np.searchsorted(time, grid[b - 1])) + 4, len(time))
        yield slice(a, b), slice(first, last)


def _rounded_only(time: Floats, period: float) -> bool:
    """True where the stamps leave a regular line by no more than half of their last digit.

    The last digit must be coarse against the period, else the deviation is not rounding.
    """
    away = time - (time[0] + period * np.arange(len(time)))
    spread = 0.5 * float(away.max() - away.min())
    if spread <= REGULAR * period:
        return True
    digit = _last_digit(time)
    return 0.05 * period < digit and spread <= 0.55 * digit


def _last_digit(time: Floats) -> float:
    """The decimal that all stamps are whole multiples of, at most 0.1 s; 0 if there is none."""
    sample = time[:: max(1, len(time) // 5000)]
    for exponent in range(-1, -8, -1):
        scaled = sample * 10.0**-exponent
        if np.all(np.abs(scaled - np.round(scaled)) < 1e-4 + 1e-9 * np.abs(scaled)):
            return float(10.0**exponent)
    return 0.0


def _restarts(time: Floats, starts: list[int], period: float) -> bool:
    """Every backward step leads to where the first run started, or to zero; runs are long enough."""
    if min(b - a for a, b in itertools.pairwise(starts)) < LEAST_ROWS:
        return len(starts) == 2
    heads = time[starts[:-1]]
    return bool(np.all((np.abs(heads - heads[0]) <= 3 * period) | (np.abs(heads) <= 3 * period)))


def _refuse_duplicates(columns: Mapping[str, Floats], step: NDArray[np.float64], path: Path) -> None:
    still = np.flatnonzero(step == 0.0)
    if not len(still):
        return
    _refuse_mixed(columns, path)
    row, time = int(still[0]) + 1, columns["time"]
    if len(still) > 0.1 * len(step):
        raise RecordingError(
            f"{path}: time has too few digits: {len(still)} stamps repeat the one before (first at row {row + 1}: "
            f"{time[row]:.9g} s). If the samples are regular, leave the column and say --period SECONDS"
        )
    raise RecordingError(
        f"{path}: time is duplicated at row {row + 1}: {time[row]:.9g} s twice ({len(still)} times in all); remove "
        "the copies"
    )


def _refuse_mixed(columns: Mapping[str, Floats], path: Path) -> None:
    """Two axes row by row: neighbours differ much more than every second row."""
    time = columns["time"]
    position = columns.get("position", columns.get("velocity"))
    if position is None or len(time) < 20 or np.mean(np.diff(time) <= 0) < 0.3:
        return
    near, second = np.abs(np.diff(position)), np.abs(position[2:] - position[:-2])
    if np.median(near) > 3.0 * np.median(second):
        raise RecordingError(
            f"{path}: every time occurs twice with different positions (row 2: {position[0]:.6g} and "
            f"{position[1]:.6g}): two axes are mixed in one file. Separate them and import each by itself"
        )


def _slope(time: Floats) -> float:
    """Least squares: the mean step, insensitive to how the two ends are rounded."""
    centred = np.arange(len(time)) - 0.5 * (len(time) - 1)
    return float(centred @ (time - time[0])) / float(centred @ centred)


def _round(value: float, digits: int) -> float:
    return float(f"{value:.{digits}g}")
