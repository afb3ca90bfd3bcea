"""Samples from the cyclic process to its owner: a ring buffer in shared memory.

One writer, one reader, no locks: the writer alone moves the head, the reader alone the tail. The
writer never waits; when the ring is full, rows are dropped, counted, and the next row that fits says in
its `missed` how many are not there. The memory is anonymous (a file descriptor without a name), so
nothing is left over however either side dies.
"""

from __future__ import annotations

import mmap
import os
import struct
import tempfile
import threading
from typing import Any

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.loop import ROW_FIELDS

CAPACITY = 1 << 17  # rows; two minutes at 1 kHz
_WIDTH = len(ROW_FIELDS)
_MISSED = ROW_FIELDS.index("missed")
_ROW = struct.Struct(f"<{_WIDTH}d")
# each counter in a cache line of its own; in words, which are written whole (bytes are not: `struct`
# packs a standard size byte by byte, and the other side would read half of one count, half of the next)
_HEAD, _TAIL, _DROPPED, _INTERRUPT, _BEATS, _ALLOWED = 0, 8, 16, 24, 32, 40
_START = 512


def create_memory(capacity: int = CAPACITY) -> int:
    """A file descriptor of anonymous shared memory for `capacity` rows; the caller closes it."""
    size = _START + capacity * _ROW.size
    if hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("autotune-ring", os.MFD_CLOEXEC)
    else:
        with tempfile.TemporaryFile() as file:  # has no name either
            descriptor = os.dup(file.fileno())
    os.ftruncate(descriptor, size)
    return descriptor


class Ring:
    """One side's view of the shared memory behind `descriptor` (which may be closed afterwards)."""

    def __init__(self, descriptor: int) -> None:
        size = os.fstat(descriptor).st_size
        self._capacity = (size - _START) // _ROW.size
        self._memory = mmap.mmap(descriptor, size)
        self._counts = memoryview(self._memory)[:_START].cast("Q")
        self._fence = threading.Lock()
        self._head = self._tail = self._gap = self._beat = 0

    # The writer's side

    def put(self, row: tuple[Any, ...]) -> None:
        """Appends a row of `ROW_FIELDS`, or drops it where the ring is full."""
        memory, head = self._memory, self._head
        if head - self._tail >= self._capacity:
            self._tail = self._counts[_TAIL]
            if head - self._tail >= self._capacity:
                self._gap += 1
                self._counts[_DROPPED] += 1
                return
        if self._gap:
            row = (*row[:_MISSED], row[_MISSED] + self._gap, *row[_MISSED + 1 :])
            self._gap = 0
        _ROW.pack_into(memory, _START + head % self._capacity * _ROW.size, *row)
        with self._fence:  # orders the row before the head on every processor
            self._head = head + 1
        self._counts[_HEAD] = self._head

    @property
    def interrupted(self) -> bool:
        """The reader wants the routine to end."""
        return self._counts[_INTERRUPT] != 0

    def beat(self, allowed: float | None = None) -> None:
        """A sign of life; where `allowed` is given, the next one may take so many seconds from now on."""
        if allowed is not None:
            self._counts[_ALLOWED] = round(1e3 * allowed)
        self._beat += 1
        self._counts[_BEATS] = self._beat

    # The reader's side

    @property
    def beats(self) -> int:
        """Signs of life of the writer so far."""
        return self._counts[_BEATS]

    @property
    def allowed(self) -> float:
        """How long the writer has asked to be waited for [s]; 0 before its first sign of life."""
        return 1e-3 * self._counts[_ALLOWED]

    def take(self) -> Floats:
        """All rows that have come since the last call, shape (k, len(ROW_FIELDS))."""
        head = self._counts[_HEAD]
        with self._fence:
            tail = self._tail
        first, last = tail % self._capacity, head % self._capacity
        if head == tail:
            return np.empty((0, _WIDTH))
        parts = [(first, last)] if first < last else [(first, self._capacity), (0, last)]
        rows = b"".join(self._memory[_START + a * _ROW.size : _START + b * _ROW.size] for a, b in parts)
        self._tail = head
        self._counts[_TAIL] = head
        return np.frombuffer(rows, np.float64).reshape(-1, _WIDTH)

    def interrupt(self, wanted: bool = True) -> None:
        """Asks the routine to end, or takes that back. Safe in a signal handler."""
        self._counts[_INTERRUPT] = int(wanted)

    @property
    def dropped(self) -> int:
        """Rows that found the ring full, since the beginning."""
        return self._counts[_DROPPED]

    def close(self) -> None:
        self._counts.release()
        self._memory.close()
