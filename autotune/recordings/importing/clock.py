"""Time stamps as others write them → stretches on a regular grid.

A clock that starts again begins a new stretch, and so does a gap of more than three samples. Stamps
that only carry the rounding of their digits are replaced by the line through them. Of stamps that jitter the
motion tells whether the samples do: what moves smoothly is smoother over its own times than over any others
(`smoother_by_rows`). Where the samples are regular, rows are counted and lost ones interpolated; where the stamps
are the times of the samples, these are interpolated onto a regular grid: position,
velocity and temperature by cubic pieces with three-point derivatives (error of order h³, overshoot
beside an encoder step at most a tenth of it), torque linearly.
"""

from __future__ import annotations

import itertools
import math
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
_BEYOND_DOUBT = 3.0
"""Standard errors by which the motion is smoother over counted rows than over its stamps, where rows are counted."""
_PARTS = 24


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
        what_to_do = "sort the rows, or give separate recordings separate files"
        if float(-step[backward].min()) < GAP_SAMPLES * period:
            what_to_do = (
                "the stamps jitter by more than the samples are apart. If the samples are regular, rows are counted "
                f"with --period {_round(period, 3):g}; else {what_to_do}"
            )
        raise RecordingError(
            f"{path}: time decreases at row {row + 1}: {time[row]:.9g} s after {time[row - 1]:.9g} s "
            f"({len(backward)} times in all); {what_to_do}"
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
    """The piece on a regular grid, and what was done: nothing, `straightened`, `counted` or `resampled`."""
    time = piece.columns["time"]
    line = time[0] + period * np.arange(len(time))
    away = time - line
    middle = 0.5 * float(away.max() + away.min())
    spread = float(np.max(np.abs(away - middle)))
    if spread <= REGULAR * period:
        return piece, ""
    if _rounded_only(time, period):
        return piece.with_columns(time=line + middle), "straightened"
    counted = _by_rows(piece, period)
    if counted is not None:
        return counted, "counted"
    return resampled(piece, period), "resampled"


def _by_rows(piece: RegularPiece, period: float) -> RegularPiece | None:
    """The piece with its rows counted, lost ones filled in, where the motion says that only its stamps jitter."""
    time = piece.columns["time"]
    rows = np.arange(len(time), dtype=np.float64)
    if abs((time[-1] - time[0]) / period - rows[-1]) >= 1.0:  # some were lost
        rows = np.concatenate([[0.0], np.cumsum(np.round(np.diff(time) / period))])
    if len(time) < LEAST_ROWS or np.any(np.diff(rows) < 1.0):
        return None
    away = time - time[0] - period * rows
    drifts = float(np.ptp(away)) > 2.0 * period
    moving = next((piece.columns[name] for name in ("position", "velocity") if name in piece.columns), None)
    if drifts or moving is None or not smoother_by_rows(moving, time, rows * period):
        return None
    regular_rows = piece.with_columns(time=time[0] + 0.5 * float(away.max() + away.min()) + period * rows)
    return regular_rows if np.all(np.diff(rows) == 1.0) else resampled(regular_rows, period)


def smoother_by_rows(values: Floats, stamps: Floats, counted: Floats) -> bool:
    """Whether values of shape (n,) are smoother over counted times than over their stamps, beyond doubt.

    Each is predicted from its four neighbours by the cubic through them. Over times that are not its own a motion
    misses that by its speed times the error of the stamp; noise and counts of an encoder miss it over either.
    """
    by_stamp, by_count = (_missed(values, time) ** 2 for time in (stamps, counted))
    parts = [part for part in np.array_split(by_stamp - by_count, _PARTS) if len(part)]
    sums = np.array([float(part.sum()) for part in parts])
    if len(sums) < _PARTS:
        return False
    error = float(np.std(sums, ddof=1)) / math.sqrt(len(sums))
    return bool(float(sums.mean()) > _BEYOND_DOUBT * error)


def _missed(values: Floats, time: Floats) -> Floats:
    """By how much each value misses the cubic through its two neighbours on each side, shape (n − 4,)."""
    centre = time[2:-2]
    nodes = [time[2 + k : len(time) - 2 + k] - centre for k in (-2, -1, 1, 2)]
    predicted = np.zeros(len(centre))
    for i, k in enumerate((-2, -1, 1, 2)):
        weight = np.ones(len(centre))
        for j, other in enumerate(nodes):
            if j != i:
                weight *= other / (other - nodes[i])
        predicted += weight * values[2 + k : len(values) - 2 + k]
    return np.asarray(values[2:-2] - predicted)


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
