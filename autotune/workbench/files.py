"""Recordings that a page has given, by the hash of their content, with traces ready to be drawn at any zoom."""

from __future__ import annotations

import hashlib
import math
import os
import tempfile
import threading
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autotune.core.errors import ConfigurationError
from autotune.recordings.files import read_recording, write_recording
from autotune.recordings.importing import FORMATS
from autotune.recordings.recording import FLOAT_COLUMNS, Recording

LEVEL = 64
"""Rows that one entry of the coarse trace stands for."""
MOST_MEMORY = 400_000_000
"""Bytes of traces that stay in memory; one of ten million rows and four columns has 250 million."""
_ENDINGS = (".parquet", ".csv")

Single = NDArray[np.float32]


@dataclass(frozen=True)
class Held:
    """One recording in the folder: where it is, what it was called, and what a page says of it."""

    id: str
    name: str
    path: Path
    about: dict[str, Any]


@dataclass(frozen=True)
class _Trace:
    time: NDArray[np.float64]
    columns: dict[str, Single]
    low: dict[str, Single]
    high: dict[str, Single]

    @property
    def bytes(self) -> int:
        every = (self.columns, self.low, self.high)
        return self.time.nbytes + sum(values.nbytes for table in every for values in table.values())


class Files:
    """The workbench's recordings, in a folder of its own; a name from outside is never a path."""

    def __init__(self, folder: Path) -> None:
        self.folder = self._folder = folder
        self._held: dict[str, Held] = {}
        self._traces: OrderedDict[str, _Trace] = OrderedDict()
        self._lock = threading.Lock()

    def list(self) -> list[Held]:
        """All recordings, in the order they came."""
        return list(self._held.values())

    def get(self, id: str) -> Held:
        """One recording.

        Raises:
            KeyError: it is not, or no longer, here.
        """
        return self._held[id]

    def add_path(self, path: Path) -> Held:
        """A file of this machine.

        Raises:
            RecordingError, ConfigurationError: what is wrong with it, in a sentence.
        """
        recording = read_recording(path)
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()[:32]
        return self._keep(digest, path.name, path.resolve(), recording)

    def add_bytes(self, content: bytes, name: str) -> Held:
        """What a page has sent, as a recording of this program.

        Raises:
            RecordingError, ConfigurationError: what is wrong with it, in a sentence.
        """
        digest = hashlib.sha256(content).hexdigest()[:32]
        if digest in self._held:
            return self._held[digest]
        ending = Path(name).suffix.lower()
        path = self._folder / f"{digest}{ending if ending in _ENDINGS else '.csv'}"
        self._write(path, content)
        try:
            return self._keep(digest, _plain(name), path, read_recording(path))
        except BaseException:
            path.unlink(missing_ok=True)
            raise

    def add_foreign(self, content: bytes, name: str, options: dict[str, Any]) -> Held:
        """What a page has sent, as a file of somebody else.

        Raises:
            RecordingError, ConfigurationError: what is wrong with it, or what has to be said about it.
        """
        from autotune.api.files import import_recording

        ending = Path(name).suffix.lower()
        self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=self._folder, suffix=ending or ".csv") as file:
            file.write(content)
            file.flush()
            recording = import_recording(file.name, **options)
        digest = hashlib.sha256(content + repr(sorted(options.items())).encode()).hexdigest()[:32]
        path = self._folder / f"{digest}.parquet"
        write_recording(recording, path)
        return self._keep(digest, _plain(name), path, recording)

    def trace(
        self, id: str, columns: tuple[str, ...], *, start: float | None, end: float | None, points: int
    ) -> dict[str, Any]:
        """Smallest and largest value of every slot, one after the other: what a screen of `points` columns can show.

        Returns:
            `time` and each column as lists of equal length, and `whole`, the recording's first and last time [s].
        """
        trace = self._trace(id)
        time = trace.time
        first = 0 if start is None else int(np.searchsorted(time, start))
        last = len(time) if end is None else int(np.searchsorted(time, end, side="right"))
        first, last = max(first - 1, 0), min(last + 1, len(time))
        whole = [float(time[0]), float(time[-1])]
        known = [name for name in columns if name in trace.columns]
        if last - first <= 2 * points:
            rows = slice(first, last)
            shown = {name: _finite(trace.columns[name][rows]) for name in known}
            return {"time": time[rows].tolist(), **shown, "whole": whole}
        coarse = last - first > 8 * points * LEVEL
        step = LEVEL if coarse else 1
        edges = np.unique(np.linspace(first // step, -(-last // step), points + 1).astype(np.int64))[:-1]
        at = np.repeat(time[np.minimum(edges * step, len(time) - 1)], 2)
        shown = {}
        for name in known:
            low, high = (trace.low[name], trace.high[name]) if coarse else (trace.columns[name],) * 2
            stop = -(-last // step)
            pair = np.empty(2 * len(edges), np.float32)
            pair[0::2] = np.minimum.reduceat(low[:stop], edges)
            pair[1::2] = np.maximum.reduceat(high[:stop], edges)
            shown[name] = _finite(pair)
        return {"time": at.tolist(), **shown, "whole": whole}

    def _trace(self, id: str) -> _Trace:
        with self._lock:
            known = self._traces.get(id)
            if known is not None:
                self._traces.move_to_end(id)
                return known
            return self._remember(id, read_recording(self._held[id].path))

    def _remember(self, id: str, recording: Recording) -> _Trace:
        """Its trace, kept in memory; the ones that were not looked at for longest make room."""
        trace = self._traces[id] = _traced(recording)
        while len(self._traces) > 1 and sum(one.bytes for one in self._traces.values()) > MOST_MEMORY:
            self._traces.popitem(last=False)
        return trace

    def _keep(self, digest: str, name: str, path: Path, recording: Recording) -> Held:
        held = self._held[digest] = Held(digest, name, path, _about(recording))
        with self._lock:
            self._remember(digest, recording)
        return held

    def _write(self, path: Path, content: bytes) -> None:
        try:
            self._folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600), "wb") as file:
                file.write(content)
        except OSError as error:
            path.unlink(missing_ok=True)
            raise ConfigurationError(
                f"the recording cannot be kept in {self._folder} ({error.strerror}); free some space there"
            ) from error


def known_formats() -> tuple[str, ...]:
    """Kinds of foreign files that can be imported."""
    return tuple(FORMATS)


def _traced(recording: Recording) -> _Trace:
    columns = {name: recording[name].astype(np.float32) for name in FLOAT_COLUMNS[1:] if name in recording}
    edges = np.arange(0, len(recording), LEVEL)
    low = {name: np.minimum.reduceat(values, edges) for name, values in columns.items()}
    high = {name: np.maximum.reduceat(values, edges) for name, values in columns.items()}
    return _Trace(recording["time"], columns, low, high)


def _about(recording: Recording) -> dict[str, Any]:
    metadata = recording.metadata
    experiments = list(dict.fromkeys(segment.experiment for segment in recording.segments()))
    position, torque = recording["position"], recording["torque"]
    return {
        "rows": len(recording),
        "seconds": float(recording["time"][-1] - recording["time"][0]),
        "period": recording.period,
        "motion_unit": metadata.motion_unit,
        "torque_unit": "N m" if metadata.motion_unit == "rad" else "N",
        "axis": metadata.axis,
        "controller": str(metadata.controller) if metadata.controller else None,
        "columns": [name for name in FLOAT_COLUMNS if name in recording],
        "experiments": experiments,
        "travel": float(np.ptp(position)),
        "largest_torque": float(np.abs(torque).max()),
        "remarks": list(metadata.remarks),
    }


def _finite(values: Single) -> list[float | None]:
    """As JSON has it, with as many digits as a screen can show: what is no number is null."""
    listed: list[float | None] = _short(values).tolist()
    if np.isfinite(values).all():
        return listed
    return [value if math.isfinite(value) else None for value in _short(values).tolist()]


def _short(values: Single) -> NDArray[np.float64]:
    """Rounded to 1e-6 of the largest."""
    wide = values.astype(np.float64)
    largest = float(np.nanmax(np.abs(wide), initial=0.0))
    return wide if not 0.0 < largest < math.inf else np.round(wide, 6 - math.ceil(math.log10(largest)))


def _plain(name: str) -> str:
    shown = "".join(letter if letter.isprintable() else "?" for letter in Path(name).name)
    return shown[:120] or "recording"
