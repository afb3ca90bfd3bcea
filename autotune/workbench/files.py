"""Recordings that a page has given, by the hash of their content, with traces ready to be drawn at any zoom."""

from __future__ import annotations

import hashlib
import math
import os
import secrets
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError, RecordingError
from autotune.core.units import torque_symbol
from autotune.recordings.columnwise import Outline, walk_recording
from autotune.recordings.importing import FORMATS
from autotune.workbench.import_child import import_apart
from autotune.workbench.traces import Traces, TraceWriter

MOST_SENT = 1_000_000_000
"""Bytes of a file that a page sends; larger ones are named on the command line."""
MOST_KEPT = 4_000_000_000
"""Bytes on disk of what pages have sent, with its traces; the oldest is given up first, a page sends it again."""
_ENDINGS = (".parquet", ".csv")


@dataclass(frozen=True)
class Held:
    """One recording: where it is, what it was called, what a page says of it, and its traces.

    Attributes:
        bytes: on disk, in the workbench's own folder; 0 of a file that was named on the command line.
    """

    id: str
    name: str
    path: Path
    about: dict[str, Any]
    traces: Traces
    bytes: int


class Incoming:
    """A file on its way here, on disk: of any size, it takes no memory."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._digest = hashlib.sha256()
        self._file = os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb")

    def write(self, part: bytes) -> None:
        """The next bytes.

        Raises:
            ConfigurationError: there is no room for them.
        """
        try:
            self._file.write(part)
        except OSError as error:
            raise _no_room(self.path.parent, error) from error
        self._digest.update(part)

    def end(self) -> str:
        """All has come; the hash of it."""
        try:
            self._file.close()
        except OSError as error:
            raise _no_room(self.path.parent, error) from error
        return self._digest.hexdigest()


class Files:
    """The workbench's recordings, in a folder of its own; a name from outside is never a path."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._held: dict[str, Held] = {}
        self._lock = threading.Lock()  # one is looked through at a time: memory is that of one

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
        if not path.is_file():
            walk_recording(path, lambda name, values: None)  # says so
        with path.open("rb") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()[:32]
        return self._held.get(digest) or self._keep(digest, path.name, path.resolve(), sent=False)

    @contextmanager
    def incoming(self) -> Iterator[Incoming]:
        """A place for a file that a page sends; what is not added by the end is gone.

        Raises:
            ConfigurationError: there is no room.
        """
        path = self.folder / f"incoming-{secrets.token_hex(8)}"
        try:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            given = Incoming(path)
        except OSError as error:
            raise _no_room(self.folder, error) from error
        try:
            yield given
        finally:
            given.end()
            path.unlink(missing_ok=True)

    def add_sent(self, given: Incoming, name: str) -> Held:
        """What a page has sent, as a recording of this program.

        Raises:
            RecordingError, ConfigurationError: what is wrong with it, in a sentence.
        """
        digest = given.end()[:32]
        if digest in self._held:
            return self._held[digest]
        ending = Path(name).suffix.lower()
        path = self.folder / f"{digest}{ending if ending in _ENDINGS else '.csv'}"
        os.replace(given.path, path)
        return self._keep(digest, _plain(name), path, sent=True)

    def add_foreign(self, given: Incoming, name: str, options: dict[str, Any]) -> Held:
        """What a page has sent, as a file of somebody else.

        Raises:
            RecordingError, ConfigurationError: what is wrong with it, or what has to be said about it.
        """
        digest = hashlib.sha256((given.end() + repr(sorted(options.items()))).encode()).hexdigest()[:32]
        foreign = given.path.with_suffix(Path(name).suffix.lower() or ".csv")
        path = self.folder / f"{digest}.parquet"
        os.replace(given.path, foreign)
        try:
            import_apart(foreign, _plain(name), path, options)
        except BaseException:
            path.unlink(missing_ok=True)
            raise
        finally:
            foreign.unlink(missing_ok=True)
        return self._keep(digest, _plain(name), path, sent=True)

    def trace(
        self, id: str, columns: tuple[str, ...], *, start: float | None, end: float | None, points: int
    ) -> dict[str, Any]:
        """What a picture of `points` columns shows of a recording, see `Traces.shown`.

        Raises:
            KeyError: it is not, or no longer, here.
        """
        try:
            return self._held[id].traces.shown(columns, start=start, end=end, points=points)
        except FileNotFoundError:
            raise KeyError(id) from None

    def _keep(self, digest: str, name: str, path: Path, *, sent: bool) -> Held:
        folder = self.folder / digest
        try:
            with self._lock:
                if digest in self._held:
                    return self._held[digest]
                outline, writer = _walked(path, name, folder)
                traces = writer.done(outline.rows)
                size = path.stat().st_size + _size(folder) if sent else 0
                held = Held(digest, name, path, _about(outline, traces, writer), traces, size)
                self._held[digest] = held
                self._make_room(held)
            return held
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            if sent:
                path.unlink(missing_ok=True)
            raise

    def _make_room(self, newest: Held) -> None:
        for one in [one for one in self._held.values() if one.bytes and one is not newest]:
            if sum(other.bytes for other in self._held.values()) <= MOST_KEPT:
                return
            del self._held[one.id]
            one.path.unlink(missing_ok=True)
            shutil.rmtree(one.traces.folder, ignore_errors=True)


def known_formats() -> tuple[str, ...]:
    """Kinds of foreign files that can be imported."""
    return tuple(FORMATS)


def _walked(path: Path, name: str, folder: Path) -> tuple[Outline, TraceWriter]:
    """Checks a recording, with its traces in `folder`."""
    writer = TraceWriter(folder)

    def see(column: str, values: Floats) -> None:
        try:
            writer.see(column, values)
        except OSError as error:
            raise _no_room(folder.parent, error) from error

    outline = walk_recording(path, see)
    if not outline.rows:
        raise RecordingError(f"{name} has no rows; there is nothing to show")
    return outline, writer


def _no_room(folder: Path, error: OSError) -> ConfigurationError:
    return ConfigurationError(
        f"the recording cannot be kept in {folder} ({error.strerror}); free some space there"
    )


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.iterdir())


def _about(outline: Outline, traces: Traces, writer: TraceWriter) -> dict[str, Any]:
    metadata = outline.metadata
    low, high = writer.span["position"]
    return {
        "rows": outline.rows,
        "seconds": traces.ends[1] - traces.ends[0],
        "period": metadata.sample_period,
        "motion_unit": metadata.motion_unit,
        "torque_unit": torque_symbol(metadata.motion_unit, metadata.torque_unit),
        "axis": metadata.axis,
        "fingerprint": metadata.fingerprint,
        "controller": str(metadata.controller) if metadata.controller else None,
        "columns": list(outline.columns),
        "experiments": list(dict.fromkeys(segment.experiment for segment in outline.segments)),
        "travel": high - low,
        "position": [low, high],
        "speed": _speed(writer),
        "torque_limit": metadata.torque_limit,
        "largest_torque": max(abs(value) for value in writer.span["torque"]),
        "remarks": list(metadata.remarks),
    }


def _speed(writer: TraceWriter) -> float | None:
    """The largest; None where velocity was not recorded, or not throughout."""
    found = max(map(abs, writer.span.get("velocity", (math.nan,))))
    return found if math.isfinite(found) else None


def _plain(name: str) -> str:
    shown = "".join(letter if letter.isprintable() else "?" for letter in Path(name).name)
    return shown[:120] or "recording"
