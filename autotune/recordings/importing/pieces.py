"""One file's columns, cut where its clock is interrupted: each piece on a regular grid, its position without jumps."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from autotune.core.arrays import Flags, Floats, Integers
from autotune.core.errors import RecordingError
from autotune.recordings.importing.cleaning import as_before, unwrapped, wrap_length
from autotune.recordings.importing.clock import (
    GAP_SAMPLES,
    LEAST_ROWS,
    RegularPiece,
    cut_at,
    fitted_period,
    median_period,
    new_segments,
    regular,
    split_gaps,
    split_runs,
)
from autotune.recordings.importing.options import Options
from autotune.recordings.importing.source import Source

_PERIOD_OFF = 0.02  # of a period or a span: stamps that differ more tell another clock
MOST_HELD, LEAST_CHANGES, IN_PHASE = 50, 50, 0.99
"""Rows that may hold one value, changes that tell it, and share of them that must be in step."""


def pieces_of(
    columns: dict[str, Floats], path: Path, source: Source, options: Options, lines: list[str]
) -> tuple[list[RegularPiece], float]:
    """Pieces without a gap in time, and their period in seconds.

    Raises: RecordingError when the stamps deny the period that is said, or no stretch is long enough.
    """
    if options.wishes.period is not None:
        runs = _runs_by_period(columns, path, options.wishes.period, lines)
        return _long_enough(runs, path, lines), options.wishes.period
    runs = split_runs(columns, path, lines)
    median = median_period(columns["time"])
    if source.period is not None and abs(median / source.period - 1.0) > _PERIOD_OFF:
        raise RecordingError(
            f"{path}: the file says {source.period:g} s a sample, but its time stamps step by {median:g} s; export it "
            "again, or say which with --period"
        )
    pieces = [piece for run in runs for piece in split_gaps(run, median)]
    pieces = _long_enough(pieces, path, lines)
    return pieces, fitted_period(pieces, median)


def on_one_grid(
    pieces: list[RegularPiece], period: float, lines: list[str], facts: dict[str, str]
) -> list[RegularPiece]:
    """The pieces on grids of one period; `lines` and `facts` are told what was changed."""
    done = [regular(piece, period) for piece in pieces]
    _tell(pieces, done, period, lines, facts)
    return [piece for piece, _ in done]


def without_held(
    pieces: list[RegularPiece], period: float, lines: list[str], facts: dict[str, str]
) -> tuple[list[RegularPiece], float]:
    """The pieces without rows that only repeat what was read before, and the period of what is left.

    A logger that is faster than what it reads writes each value several times: all columns change together, at
    every n-th row only. Taken for samples they are motion in steps, and torque that is late by half of them.
    """
    times = [np.flatnonzero(_changes(piece)) + 1 for piece in pieces]
    held = _held_rows(times)
    if held == 1:
        return pieces, period
    thinned = []
    for piece, changed in zip(pieces, times, strict=True):
        first = int(np.argmax(np.bincount(changed % held, minlength=held)))
        kept = {name: values[first::held] for name, values in piece.columns.items()}
        thinned.append(RegularPiece(kept, round(piece.missed / held), piece.row + first, piece.run))
    lines.append(
        f"all columns change at every {held}th row only: the file was written {held} times as often as it was read; "
        f"one row of {held} is taken, {held * period:g} s apart"
    )
    facts["held"] = f"one row of {held}: the others repeat it"
    return [piece for piece in thinned if len(piece) >= LEAST_ROWS], held * period


def _changes(piece: RegularPiece) -> Flags:
    """Whether anything but the clock differs from the row before, shape (n − 1,)."""
    changes = np.zeros(len(piece) - 1, dtype=np.bool_)
    for name, values in piece.columns.items():
        if name != "time":
            changes |= ~as_before(values)
    return changes


def _held_rows(changes: list[Integers]) -> int:
    """The largest number of rows of which only one ever differs from that before it; 1 where all may.

    `changes` are the rows of each piece that differ from the one before; few changes tell nothing.
    """
    known = [rows for rows in changes if len(rows) >= LEAST_CHANGES]
    for held in range(MOST_HELD, 1, -1):
        if known and all(_in_phase(rows, held) for rows in known):
            return held
    return 1


def _in_phase(rows: Integers, held: int) -> bool:
    return float(np.bincount(rows % held).max()) >= IN_PHASE * len(rows)


def _runs_by_period(
    columns: dict[str, Floats], path: Path, period: float, lines: list[str]
) -> list[RegularPiece]:
    """With `--period` the rows are regular and stamps only jitter; they must agree on the whole."""
    time = columns["time"]
    if not np.any(np.diff(time) < -GAP_SAMPLES * period):
        runs = cut_at(columns, [0, *new_segments(columns), len(time)])
    else:
        runs = split_runs(columns, path, lines)
    regular_runs = []
    for run in runs:
        stamps = run.columns["time"]
        span, wanted = float(stamps[-1] - stamps[0]), period * (len(stamps) - 1)
        if abs(span - wanted) > max(_PERIOD_OFF * wanted, 5.0 * period):
            raise RecordingError(
                f"{path}: {len(stamps)} rows of --period {period:g} s make {wanted:.6g} s, but the time stamps span "
                f"{span:.6g} s: rows are missing, or the period is another. Leave --period out and gaps are found"
            )
        regular_runs.append(run.with_columns(time=stamps[0] + period * np.arange(len(stamps))))
    lines.append(f"time counts rows of {period:g} s, as --period says")
    return regular_runs


def _long_enough(pieces: list[RegularPiece], path: Path, lines: list[str]) -> list[RegularPiece]:
    kept = [piece for piece in pieces if len(piece) >= LEAST_ROWS]
    if not kept:
        raise RecordingError(
            f"{path}: no stretch of {LEAST_ROWS} rows without a gap in time; is the right column named as time?"
        )
    short = [piece for piece in pieces if len(piece) < LEAST_ROWS]
    if short:
        lines.append(
            f"stretches of fewer than {LEAST_ROWS} rows are left out: {len(short)}, with {sum(map(len, short))} rows "
            f"in all, from row {short[0].row + 1} on; they lie between gaps in time or changes of experiment"
        )
    return kept


def _tell(
    pieces: list[RegularPiece],
    done: list[tuple[RegularPiece, str]],
    period: float,
    lines: list[str],
    facts: dict[str, str],
) -> None:
    gaps = [piece for piece in pieces if piece.missed]
    if gaps:
        lost = sum(piece.missed for piece in gaps)
        lines.append(
            f"{len(gaps)} gaps ({lost} samples lost, first before row {gaps[0].row + 1}): split there"
        )
        facts["gaps"] = f"{len(gaps)} gaps, {lost} samples lost"
    ways = {way for _, way in done}
    if "straightened" in ways:
        lines.append(f"time stamps are rounded; the samples are regular, {period:g} s apart")
        facts["time"] = "rounded stamps replaced by a line"
    if "counted" in ways:
        lines.append(
            f"time stamps jitter, the motion does not: rows are counted, {period:g} s apart, as it is smoother then"
        )
        facts["time"] = "jittering stamps replaced by counted rows"
    if "resampled" in ways:
        text = "cubic for position, velocity, reference; linear for torque"
        lines.append(
            f"time stamps are irregular: resampled to {period:g} s ({text}); with --period if only stamps jitter"
        )
        facts["resampled"] = f"irregular stamps to {period:g} s, {text}"


def positioned(piece: RegularPiece, lines: list[str], facts: dict[str, str]) -> RegularPiece:
    """With a position, integrated from velocity where the file has none."""
    if "position" in piece.columns:
        return piece
    velocity = piece.columns["velocity"]
    steps = 0.5 * (velocity[1:] + velocity[:-1]) * np.diff(piece.columns["time"])
    if "position" not in facts:
        lines.append("there is no position: it is integrated from velocity, from 0 in each segment")
    facts["position"] = "integrated from velocity, from 0 in each segment"
    return piece.with_columns(position=np.concatenate([[0.0], np.cumsum(steps)]))


def continuous(
    piece: RegularPiece, unit: str, factor: float, lines: list[str], facts: dict[str, str]
) -> RegularPiece:
    """The piece with its position unwrapped, before anything is interpolated across a turn's end."""
    if "position" not in piece.columns:
        return piece
    length = wrap_length(piece.columns["position"], factor, unit == "rad")
    if length is None:
        return piece
    if "unwrapped" not in facts:
        lines.append(f"position starts again after {length:.6g} {unit}: unwrapped")
    facts["unwrapped"] = f"{length:.9g} {unit}"
    return _unwrapped(piece, length)


def _unwrapped(piece: RegularPiece, length: float) -> RegularPiece:
    position = unwrapped(piece.columns["position"], length)
    if "reference" not in piece.columns:
        return piece.with_columns(position=position)
    reference = unwrapped(piece.columns["reference"], length)
    turns = np.round(float(np.median(position - reference)) / length)
    return piece.with_columns(position=position, reference=reference + turns * length)
