"""Leaps of the position: a sensor that was set anew, or a wrong value.

What an axis does, it does for more than one row: a mass that reaches a speed keeps some of it. The highest
speed that lasted for two rows, anywhere in the files, tells what this axis can do; a single step many times
as long, after which nothing goes on in its direction, is no motion. Counts of a coarse encoder are none
either, nor steps that come again and again (moves faster than the sampling).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import RecordingError
from autotune.recordings.importing.clock import RegularPiece

TIMES = 10.0
"""Over the fastest motion seen: between two rows that three lost samples part, an axis goes four times as far."""
ALONE = 0.1
"""Of a leap: at most so much goes on in its direction in the rows beside it."""
OF_TRAVEL = 0.01
"""A smaller leap spoils nothing that could be identified from the rest; it is said and kept."""
_HABIT = 8
"""So many steps of one size are what the axis does."""
_LEAST_STEPS = 50


@dataclass(frozen=True, slots=True)
class Leap:
    """The step [rad or m] to `row`, counted from 1, from one position to another."""

    row: int
    before: float
    after: float

    @property
    def size(self) -> float:
        return abs(self.after - self.before)


@dataclass(frozen=True, slots=True)
class Steps:
    """How the position of one file goes from row to row.

    Attributes:
        speed: the highest that lasted for two rows, or that comes again and again [rad/s or m/s].
        count: the smallest step, which may be one of the encoder.
        alone: the longest steps that stand alone, longest first.
    """

    path: Path
    period: float
    travel: float
    speed: float
    count: float
    alone: tuple[Leap, ...]


def steps_of(pieces: Sequence[RegularPiece], path: Path, period: float) -> Steps | None:
    """The steps of a file's continuous pieces; None without position or where there are too few.

    The position is as it was sampled: interpolation would spread a leap over two rows.
    """
    pieces = [piece for piece in pieces if "position" in piece.columns]
    steps = [np.diff(piece.columns["position"]) for piece in pieces]
    sizes = np.abs(np.concatenate(steps)) if steps else np.empty(0)
    if len(sizes) < _LEAST_STEPS or not np.any(sizes):
        return None
    along = [_along(step) for step in steps]
    lasting = float(np.max(np.minimum(sizes, np.concatenate(along))))
    rank = max(len(sizes) // 1000, _HABIT)
    habit = float(np.partition(sizes, -rank)[-rank])
    low = min(float(piece.columns["position"].min()) for piece in pieces)
    high = max(float(piece.columns["position"].max()) for piece in pieces)
    leaps = [
        leap
        for piece, step, beside in zip(pieces, steps, along, strict=True)
        for leap in _alone(piece, step, beside)
    ]
    leaps.sort(key=lambda leap: -leap.size)
    speed = max(lasting, habit) / period
    return Steps(path, period, high - low, speed, float(sizes[sizes > 0].min()), tuple(leaps[:_HABIT]))


def _along(step: Floats) -> Floats:
    """How far the rows beside each step go on in its direction, shape (n,)."""
    direction = np.sign(step)
    along = np.zeros(len(step))
    along[1:] = step[:-1] * direction[1:]
    np.maximum(along[:-1], step[1:] * direction[:-1], out=along[:-1])
    return np.maximum(along, 0.0, out=along)


def _alone(piece: RegularPiece, step: Floats, along: Floats) -> list[Leap]:
    """The longest steps of one piece that stand alone."""
    sizes = np.where(along < ALONE * np.abs(step), np.abs(step), 0.0)
    longest = np.argsort(sizes)[::-1][:_HABIT]
    position = piece.columns["position"]
    return [
        Leap(piece.row + int(k) + 2, float(position[k]), float(position[k + 1]))
        for k in longest
        if sizes[k] > 0.0
    ]


def judge_leaps(files: Sequence[Steps], unit: str, keep: bool) -> list[str]:
    """A line for each file with leaps that are kept.

    Raises:
        RecordingError: a leap that no axis can make, and that nobody has looked at (`keep`).
    """
    if not files:
        return []
    speed, travel = max(one.speed for one in files), max(one.travel for one in files)
    lines = []
    for one in files:
        least = TIMES * max(speed * one.period, one.count)
        leaps = [leap for leap in one.alone if leap.size > least]
        if not leaps:
            continue
        if leaps[0].size > OF_TRAVEL * travel and not keep:
            raise _refusal(one, leaps[0], speed, unit)
        most = f"{leaps[0].size:.4g} {unit} ({100.0 * leaps[0].size / travel:.2g} % of the travel)"
        lines.append(f"position leaps {len(leaps)} times, at most by {most} at row {leaps[0].row}: kept")
    return lines


def _refusal(file: Steps, leap: Leap, speed: float, unit: str) -> RecordingError:
    return RecordingError(
        f"{file.path}: position jumps from {leap.before:.6g} to {leap.after:.6g} in one sample at row {leap.row}, "
        f"{leap.size / (speed * file.period or file.count):.2g} times as far as at the fastest motion seen "
        f"({speed:.3g} {unit}/s): a sensor that was set anew, or a wrong value. Cut the file there or remove the row; "
        "or say --keep-leaps if the axis did that"
    )
