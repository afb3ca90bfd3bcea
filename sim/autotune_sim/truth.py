"""What was true on the simulated axis, whatever its drive says: for those who judge a run.

One row a servo period, written by the compiled loop, and a few events in words: power, parameters as they
are, what was broken and when. In memory, or in two files that outlast any process: `FILE` (rows, sparse)
and `FILE.events` (one JSON object a line).
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

CAPACITY = 1 << 20  # rows: 17 minutes of 1 ms; the oldest are overwritten
_FINE = ("time", "wall")
_COARSE = ("position", "velocity", "acceleration", "torque", "push", "demanded", "reading", "shown_velocity",
           "target", "temperature", "shown_temperature")  # fmt: skip
ROW = np.dtype(
    [(name, np.float64) for name in _FINE]
    + [(name, np.float32) for name in _COARSE]
    + [("mode", np.int8), ("live", np.int8)],
    align=True,
)
"""Truth at the end of one servo period.

`time`: of the axis, `wall`: monotonic clock of the host [s]; `position`, `velocity`, `acceleration` of the
motor's shaft; `torque` at the shaft, `push` from outside, `demanded` by the servo loop [N m]; `reading` of
the encoder, `shown_velocity` and `target` (of the present mode) as the drive has them; `temperature` of the
motor and as shown [°C]; `mode`: 0 position, 1 velocity, 2 torque, −1 without power; `live`: whether the
output stage gives torque.
"""
Rows = NDArray[np.void]
NO_TRUTH: Rows = np.zeros(0, ROW)


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened: `time` of the axis and `wall` clock [s], and its particulars."""

    kind: str
    time: float
    wall: float
    details: Mapping[str, Any] = field(default_factory=dict)


class Truth:
    """The log of one simulated axis.

    Args:
        path: file of the rows; None keeps them in memory. An earlier log there is replaced.
        capacity: rows.
    """

    def __init__(self, path: Path | None = None, capacity: int = CAPACITY) -> None:
        self._path = path
        self.events: list[Event] = []
        if path is None:
            self._rows: Rows = np.zeros(capacity, ROW)
        else:
            self._rows = np.memmap(path, ROW, "w+", shape=(capacity,))
            _events_of(path).write_bytes(b"")

    @property
    def buffer(self) -> Rows:
        """Where the servo loop writes, row by row and round again."""
        return self._rows

    def note(self, kind: str, at: float, **details: Any) -> None:
        """An event at axis time `at` [s]."""
        event = Event(kind, at, time.monotonic(), details)
        self.events.append(event)
        if self._path is not None:
            line = {"kind": kind, "time": at, "wall": event.wall, **details}
            with _events_of(self._path).open("a", encoding="utf-8") as file:
                file.write(json.dumps(line) + "\n")

    def rows(self) -> Rows:
        """All rows in order of time."""
        return _in_order(self._rows)


@dataclass(frozen=True)
class TruthFile:
    """A log that was read: rows in order of time, and events."""

    rows: Rows
    events: tuple[Event, ...]


def read_truth(path: Path) -> TruthFile:
    """Reads what a `Truth` with that path wrote, also while it is being written.

    Raises:
        OSError: no such file.
    """
    rows = _written(np.memmap(path, ROW, "r"))
    events = [_event(line) for line in _events_of(path).read_text(encoding="utf-8").splitlines() if line]
    return TruthFile(_in_order(rows), tuple(events))


def powered(path: Path) -> bool:
    """Whether the axis has power in the last row of a log that is being written.

    Raises:
        OSError: no such file.
    """
    rows = np.memmap(path, ROW, "r")
    number = _number(rows)
    if number == len(rows):
        return bool(_in_order(np.array(rows))["mode"][-1] >= 0)
    return number > 0 and bool(rows["mode"][number] >= 0)


def _written(rows: Rows) -> Rows:
    """The part of a file that was written; it is sparse, and most of it is not read."""
    number = _number(rows)
    return np.array(rows if number == len(rows) else rows[1 : number + 1])


def _number(rows: Rows) -> int:
    """Rows 1 to this one are written; all of them where the log has gone round."""
    wall = rows["wall"]
    if len(rows) == 0 or wall[0] > 0.0 or wall[-1] > 0.0:
        return len(rows)
    low, high = 0, len(rows) - 1  # `high` is not written
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if wall[middle] > 0.0 else (low, middle)
    return low


def _event(line: str) -> Event:
    content = json.loads(line)
    return Event(content.pop("kind"), content.pop("time"), content.pop("wall"), content)


def _events_of(path: Path) -> Path:
    return path.with_name(path.name + ".events")


def _in_order(rows: Rows) -> Rows:
    written = rows[rows["wall"] > 0.0]
    return written[np.argsort(written["time"], kind="stable")]
