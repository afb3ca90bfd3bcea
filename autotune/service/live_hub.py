"""Live traces of the service's axes: the last minute kept, passed on to whoever looks on, nobody waited for.

A worker writes messages (`view.messages`) to a pipe of its own, never waiting; a thread of the service reads
it whatever its followers do. A follower that does not read in time loses the oldest rows, never a note.
"""

from __future__ import annotations

import struct
import threading
from collections import deque
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, BinaryIO

from autotune.view.messages import HEADER, NOTE, ROWS, decode_note, read_message

KEPT_SECONDS = 60.0
MOST_BYTES = 12_000_000
"""Of rows that are kept for an axis, and that may wait for a follower."""
MOST_FOLLOWERS = 16
MOST_AXES = 8
"""Whose last minute is kept; of further ones only what has moved last."""
_FIRST = struct.Struct("<d")


class Follower:
    """What waits for one who looks on."""

    def __init__(self) -> None:
        self._waiting: deque[bytes] = deque()
        self._bytes = 0
        self._lock = threading.Lock()

    def put(self, message: bytes) -> None:
        """Adds a message; rows are dropped, the oldest first, where too much waits."""
        with self._lock:
            self._waiting.append(message)
            self._bytes += len(message)
            if self._bytes > MOST_BYTES:
                self._drop()

    def take(self) -> bytes:
        """All that waits."""
        with self._lock:
            found = b"".join(self._waiting)
            self._waiting.clear()
            self._bytes = 0
        return found

    def _drop(self) -> None:
        kept: deque[bytes] = deque()
        while self._waiting:
            message = self._waiting.popleft()
            if message[:1] == ROWS and self._bytes > MOST_BYTES:
                self._bytes -= len(message)
            else:
                kept.append(message)
        self._waiting = kept


class AxisHub:
    """The last minute of one axis, and those who look on. `writers`: workers that are heard now."""

    def __init__(self) -> None:
        self.writers = 0
        self._lock = threading.Lock()
        self._rows: deque[tuple[float, bytes]] = deque()
        self._bytes = 0
        self._shown = 0.0
        self._clock: float | None = None
        self._notes: dict[str, bytes] = {}
        self._followers: list[Follower] = []

    def take(self, kind: bytes, columns: int, payload: bytes) -> None:
        """A message of the worker."""
        if not payload:
            return
        message = HEADER.pack(kind, len(payload), columns) + payload
        with self._lock:
            if kind == ROWS:
                self._keep(columns, payload, message)
            else:
                self._remember(payload, message)
            followers = list(self._followers)
        for follower in followers:
            follower.put(message)

    def begin(self) -> None:
        """Another job begins: what the one before found is past, its rows with it."""
        with self._lock:
            self._notes.clear()
            self._rows.clear()
            self._bytes, self._clock = 0, None

    def follow(self) -> Follower | None:
        """One more who looks on, given what is known and the last minute; None where there are too many."""
        with self._lock:
            if len(self._followers) >= MOST_FOLLOWERS:
                return None
            follower = Follower()
            for message in [*self._notes.values(), *(message for _, message in self._rows)]:
                follower.put(message)
            self._followers.append(follower)
        return follower

    def leave(self, follower: Follower) -> None:
        """Ends following. Idempotent."""
        with self._lock, suppress(ValueError):
            self._followers.remove(follower)

    @property
    def busy(self) -> bool:
        """A worker writes to it, or somebody looks on."""
        return self.writers > 0 or bool(self._followers)

    @property
    def bytes_kept(self) -> int:
        """Of rows."""
        return self._bytes

    def _keep(self, columns: int, payload: bytes, message: bytes) -> None:
        """Rows by a time that runs on where the drive's clock starts again."""
        (last,) = _FIRST.unpack_from(payload, len(payload) - 8 * columns)
        if self._clock is not None and last > self._clock:
            self._shown += last - self._clock
        self._clock = last
        self._rows.append((self._shown, message))
        self._bytes += len(message)
        while self._rows and (self._rows[0][0] < self._shown - KEPT_SECONDS or self._bytes > MOST_BYTES):
            self._bytes -= len(self._rows.popleft()[1])

    def _remember(self, payload: bytes, message: bytes) -> None:
        if note := decode_note(payload):
            self._notes[_name(note)] = message


class LiveHubs:
    """The hubs of all axes."""

    def __init__(self) -> None:
        self._hubs: dict[str, AxisHub] = {}
        self._lock = threading.Lock()

    def of(self, axis: str) -> AxisHub:
        """The hub of an axis; made where there is none yet."""
        with self._lock:
            hub = self._hubs.pop(axis, None) or AxisHub()
            self._hubs[axis] = hub
            idle = [name for name, one in self._hubs.items() if not one.busy and name != axis]
            for name in idle[: max(0, len(self._hubs) - MOST_AXES)]:
                del self._hubs[name]
        return hub

    def listen(self, axis: str, source: BinaryIO) -> threading.Thread:
        """Reads a worker's pipe to its end, in a thread."""
        hub = self.of(axis)
        hub.begin()
        thread = threading.Thread(target=_read, args=(hub, source), name=f"live-{axis}", daemon=True)
        thread.start()
        return thread


def _read(hub: AxisHub, source: BinaryIO) -> None:
    hub.writers += 1
    try:
        with suppress(OSError, ValueError), source:
            while (message := read_message(source)) is not None:
                hub.take(*message)
    finally:
        hub.writers -= 1


def _name(note: Mapping[str, Any]) -> str:
    page = note.get("page")
    return f"page {page.get('name')}" if isinstance(page, Mapping) else str(note.get("kind"))


ALIVE = HEADER.pack(NOTE, 2, 0) + b"{}"
"""Says that the service is there while nothing moves."""
