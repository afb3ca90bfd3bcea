"""How the run speaks to the streamer process: length-prefixed messages over a pipe.

A message is one byte of kind, four bytes of length, two of the number of columns (little endian) and the
payload: rows as float64, or a note as JSON. The writer never waits longer than it is told to; the
reader's memory is bounded.
"""

from __future__ import annotations

import json
import os
import select
import struct
import threading
import time
from collections import deque
from collections.abc import Mapping
from typing import Any, BinaryIO

import numpy as np

from autotune.core.arrays import Floats

ROWS, NOTE = b"R", b"N"
HEADER = struct.Struct("<cIH")
LARGEST = 64 * 1024 * 1024
NOTES_KEPT = 1000


class RowQueue:
    """Rows waiting for a slow reader: bounded, drops the oldest, counts what it dropped.

    One thread puts, one takes; neither ever waits for the other (each counter has one writer).
    """

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._blocks: deque[Floats] = deque()
        self._put = self._taken = self._dropped = 0

    @property
    def waiting(self) -> int:
        """Rows in the queue, about."""
        return self._put - self._taken - self._dropped

    @property
    def dropped(self) -> int:
        """Rows dropped so far."""
        return self._dropped

    def put(self, rows: Floats) -> None:
        """Adds rows, shape (k, fields); the array must not change afterwards."""
        self._blocks.append(rows)
        self._put += len(rows)
        while self.waiting > self._limit:
            try:
                self._dropped += len(self._blocks.popleft())
            except IndexError:
                return

    def take(self, most: int) -> list[Floats]:
        """Removes and returns blocks, oldest first, of about `most` rows in total."""
        blocks: list[Floats] = []
        count = 0
        while count < most:
            try:
                block = self._blocks.popleft()
            except IndexError:
                break
            self._taken += len(block)
            count += len(block)
            blocks.append(block)
        return blocks


def encode_rows(rows: Floats) -> bytes:
    payload = np.ascontiguousarray(rows, dtype="<f8").tobytes()
    return HEADER.pack(ROWS, len(payload), rows.shape[1]) + payload


def encode_note(note: Mapping[str, Any]) -> bytes:
    payload = json.dumps(note).encode()
    return HEADER.pack(NOTE, len(payload), 0) + payload


def decode_rows(payload: bytes, columns: int) -> Floats:
    return np.frombuffer(payload, dtype="<f8").reshape(-1, columns)


def decode_note(payload: bytes) -> dict[str, Any]:
    """A note; an empty one where it is none."""
    try:
        note = json.loads(payload)
    except ValueError:
        return {}
    return note if isinstance(note, dict) else {}


def read_message(source: BinaryIO) -> tuple[bytes, int, bytes] | None:
    """Kind, columns and payload of the next message; None at the end, or where it is none."""
    header = source.read(HEADER.size)
    if len(header) < HEADER.size:
        return None
    kind, length, columns = HEADER.unpack(header)
    if (
        kind not in (ROWS, NOTE)
        or length > LARGEST
        or (kind == ROWS and (not columns or length % (8 * columns)))
    ):
        return None
    payload = source.read(length)
    return None if len(payload) < length else (kind, columns, payload)


def write_all(descriptor: int, data: bytes, patience_s: float) -> bool:
    """Writes to a non-blocking pipe; False when the reader takes nothing for so long.

    Raises:
        OSError: the reader is gone.
    """
    view = memoryview(data)
    while view:
        _, ready, _ = select.select([], [descriptor], [], patience_s)
        if not ready:
            return False
        try:
            view = view[os.write(descriptor, view) :]
        except BlockingIOError:
            time.sleep(0.005)
    return True


class Inbox:
    """The streamer's end: a thread reads the pipe at once, whatever the viewer does.

    Attributes:
        ended: set when the writer is gone or has said that it is done.
    """

    def __init__(self, source: BinaryIO, limit: int) -> None:
        self.rows = RowQueue(limit)
        self.notes: deque[dict[str, Any]] = deque(maxlen=NOTES_KEPT)
        self.ended = threading.Event()
        self._source = source

    def start(self) -> None:
        threading.Thread(target=self._read, name="inbox", daemon=True).start()

    def _read(self) -> None:
        try:
            while self._one():
                pass
        finally:
            self.ended.set()

    def _one(self) -> bool:
        message = read_message(self._source)
        if message is None:
            return False
        kind, columns, payload = message
        if kind == ROWS:
            self.rows.put(decode_rows(payload, columns))
        else:
            self.notes.append(json.loads(payload))
        return True
