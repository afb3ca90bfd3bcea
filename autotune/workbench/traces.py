"""Traces of a recording on disk, ready to be drawn at any zoom: smallest and largest values of ever longer slots.

Of every column there is a file of its values, and for each step of `STEPS` files of the least and the greatest of so
many rows; a picture reads what its zoom needs and no more, so that a recording of any length takes no memory.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autotune.core.arrays import Floats

STEPS = (16, 256, 4096)
"""Rows that one value of a coarser trace stands for."""
FINE = 8
"""Values that a slot on the screen has at least, where it is made of a coarser trace: its edges are that exact."""

Single = NDArray[np.float32]
Values = NDArray[np.float32] | NDArray[np.float64]


class TraceWriter:
    """Takes the columns of a recording one by one, the time first, into files of a folder that has the recording's id.

    Attributes:
        span: smallest and largest value by column.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.span: dict[str, tuple[float, float]] = {}
        self._ends = (0.0, 0.0)

    def see(self, name: str, values: Floats) -> None:
        """Writes one column.

        Raises:
            OSError: there is no room for it.
        """
        if not len(values):
            return
        self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if name == "time":
            self._ends = float(values[0]), float(values[-1])
            values.tofile(self.folder / "time")
            for step in STEPS:
                values[::step].tofile(self.folder / f"time-{step}")
            return
        low = high = single = values.astype(np.float32)
        single.tofile(self.folder / name)
        self.span[name] = float(np.min(values)), float(np.max(values))
        before = 1
        for step in STEPS:
            edges = np.arange(0, len(low), step // before)
            low, high, before = np.minimum.reduceat(low, edges), np.maximum.reduceat(high, edges), step
            low.tofile(self.folder / f"{name}-{step}-low")
            high.tofile(self.folder / f"{name}-{step}-high")

    def done(self, rows: int) -> Traces:
        """What was written."""
        return Traces(self.folder, rows, tuple(self.span), self._ends)


@dataclass(frozen=True)
class Traces:
    """Files of one recording: how many rows, which columns beside the time, first and last time [s]."""

    folder: Path
    rows: int
    columns: tuple[str, ...]
    ends: tuple[float, float]

    def shown(
        self, columns: tuple[str, ...], *, start: float | None, end: float | None, points: int
    ) -> dict[str, Any]:
        """Smallest and largest value of every slot, one after the other: what a screen of `points` columns can show.

        Returns:
            `time` and each column as lists of equal length, and `whole`, the recording's first and last time [s].
        """
        first = 0 if start is None else self._row_of(start, "left")
        last = self.rows if end is None else self._row_of(end, "right")
        first, last = max(first - 1, 0), min(last + 1, self.rows)
        known = [name for name in columns if name in self.columns]
        if last - first <= 2 * points:
            shown = {name: _finite(self._read(name, first, last)) for name in known}
            return {"time": self._read("time", first, last).tolist(), **shown, "whole": list(self.ends)}
        step = max((one for one in STEPS if last - first > FINE * points * one), default=1)
        begin, stop = first // step, -(-last // step)
        edges = np.unique(np.linspace(0, stop - begin, points + 1).astype(np.int64))[:-1]
        time = self._read("time" if step == 1 else f"time-{step}", begin, stop)
        shown = {}
        for name in known:
            parts = (name, name) if step == 1 else (f"{name}-{step}-low", f"{name}-{step}-high")
            pair = np.empty(2 * len(edges), np.float32)
            pair[0::2] = np.minimum.reduceat(self._read(parts[0], begin, stop), edges)
            pair[1::2] = np.maximum.reduceat(self._read(parts[1], begin, stop), edges)
            shown[name] = _finite(pair)
        return {"time": np.repeat(time[edges], 2).tolist(), **shown, "whole": list(self.ends)}

    def _row_of(self, time: float, side: Any) -> int:
        """Where a time belongs: by the coarser times, and then among the rows between two of them."""
        begin, stop = 0, self.rows
        for step in (*STEPS[::-1], 1):
            name = "time" if step == 1 else f"time-{step}"
            part = self._read(name, begin // step, -(-stop // step))
            found = begin // step + int(np.searchsorted(part, time, side))
            if step == 1:
                return found
            begin, stop = max(found - 1, 0) * step, min(found * step + 1, self.rows)
        return 0

    def _read(self, name: str, begin: int, stop: int) -> Values:
        wide = name.partition("-")[0] == "time"
        kind = np.dtype(np.float64 if wide else np.float32)
        return np.fromfile(self.folder / name, kind, stop - begin, offset=begin * kind.itemsize)


def _finite(values: Values) -> list[float | None]:
    """As JSON has it, with as many digits as a screen can show: what is no number is null."""
    listed: list[float | None] = _short(values).tolist()
    if np.isfinite(values).all():
        return listed
    return [value if value is not None and math.isfinite(value) else None for value in listed]


def _short(values: Values) -> NDArray[np.float64]:
    """Rounded to 1e-6 of the largest."""
    wide = values.astype(np.float64)
    largest = float(np.nanmax(np.abs(wide), initial=0.0))
    return wide if not 0.0 < largest < math.inf else np.round(wide, 6 - math.ceil(math.log10(largest)))
