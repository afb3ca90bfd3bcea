"""Multiplex frames of a moteus controller, the controller's side: subframes in, answers out.

Sources: mjlib `multiplex/format.h` (subframes) and the moteus reference manual, "Register usage"
(scales). This is written independently of `autotune_drivers`, so that each can prove the other wrong.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from typing import NamedTuple

INT8, INT16, INT32, FLOAT = range(4)
SIZES = (1, 2, 4, 4)
_PACKERS = (struct.Struct("<b"), struct.Struct("<h"), struct.Struct("<i"), struct.Struct("<f"))
_HIGHEST = (127, 32767, 2147483647)

WRITE, READ, REPLY = 0x00, 0x10, 0x20
WRITE_ERROR, READ_ERROR = 0x30, 0x31
CLIENT_TO_SERVER, SERVER_TO_CLIENT, CLIENT_POLL = 0x40, 0x41, 0x42
SERVER_TO_CLIENT_FLOW, CLIENT_POLL_FLOW = 0x43, 0x44
NOP = 0x50
LONGEST = 64

SCALES: dict[str, tuple[float, float, float]] = {
    "position": (0.01, 0.0001, 0.00001),
    "velocity": (0.1, 0.00025, 0.00001),
    "acceleration": (0.05, 0.001, 0.00001),
    "torque": (0.5, 0.01, 0.001),
    "current": (1.0, 0.1, 0.001),
    "voltage": (0.5, 0.1, 0.001),
    "temperature": (1.0, 0.1, 0.001),
    "time": (0.01, 0.001, 0.000001),
    "scale": (1 / 127, 1 / 32767, 1 / 2147483647),
    "power": (10.0, 0.05, 0.0001),
}
"""Smallest step of a kind of quantity as int8, int16, int32; the kind `int` has none."""


class Write(NamedTuple):
    """A register to be written: `raw` as it was on the wire."""

    register: int
    form: int
    raw: int | float


class Read(NamedTuple):
    """Registers to be read, in one form."""

    form: int
    start: int
    number: int


class Stream(NamedTuple):
    """Bytes for a diagnostic channel, or (poll) at most `limit` bytes wanted from it.

    A poll with flow control says which packet came last (`acknowledged`); others have −1 there.
    """

    channel: int
    data: bytes
    poll: bool
    limit: int
    acknowledged: int = -1


Subframe = Write | Read | Stream


def subframes(data: bytes) -> Iterator[Subframe]:
    """What a frame asks for, in order. Ends at what is not understood, as the controller does."""
    cursor = _Cursor(data)
    try:
        while cursor.left:
            yield from _subframe(cursor)
    except _Malformed:
        return


def _subframe(cursor: _Cursor) -> Iterator[Subframe]:
    kind = cursor.varuint()
    if kind == NOP:
        return
    if kind in (CLIENT_TO_SERVER, CLIENT_POLL):
        channel, size = cursor.varuint(), cursor.varuint()
        poll = kind == CLIENT_POLL
        yield Stream(channel, b"" if poll else cursor.take(size), poll, size)
        return
    if kind == CLIENT_POLL_FLOW:
        channel, packet = cursor.varuint(), cursor.take(1)[0]
        yield Stream(channel, b"", True, cursor.varuint(), packet)
        return
    if kind >= REPLY:
        raise _Malformed
    form, count = kind >> 2 & 3, kind & 3 or cursor.varuint()
    start = cursor.varuint()
    if kind >= READ:
        yield Read(form, start, count)
        return
    packer = _PACKERS[form]
    for register in range(start, start + count):
        yield Write(register, form, packer.unpack(cursor.take(packer.size))[0])


class _Malformed(Exception):
    """The rest of the frame cannot be used."""


class _Cursor:
    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    @property
    def left(self) -> int:
        return len(self._data) - self._at

    def take(self, size: int) -> bytes:
        if size > self.left:
            raise _Malformed
        self._at += size
        return self._data[self._at - size : self._at]

    def varuint(self) -> int:
        value = 0
        for shift in range(0, 35, 7):
            byte = self.take(1)[0]
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
        raise _Malformed


def varuint(value: int) -> bytes:
    """Seven bits a byte, lowest first."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def head(kind: int, form: int, start: int, count: int) -> bytes:
    """Beginning of a write, read or reply subframe; up to three registers are counted in its first byte."""
    short = count if count <= 3 else 0
    return bytes((kind | form << 2 | short,)) + (b"" if short else varuint(count)) + varuint(start)


def decode(kind: str, form: int, raw: int | float) -> float:
    """SI-like value (revolutions, N m, …) of a raw one; the lowest integer means nan."""
    if form == FLOAT:
        return float(raw)
    if raw == -_HIGHEST[form] - 1:
        return math.nan
    return float(raw) if kind == "int" else raw * SCALES[kind][form]


def encode(kind: str, form: int, value: float) -> bytes:
    """A value as it goes out: clamped where the form is narrower, nan as the lowest integer."""
    if form == FLOAT:
        return _PACKERS[FLOAT].pack(value)
    if not math.isfinite(value):
        return _PACKERS[form].pack(-_HIGHEST[form] - 1)
    scaled = value if kind == "int" else value / SCALES[kind][form]
    highest = _HIGHEST[form]
    return _PACKERS[form].pack(int(max(-highest - (kind == "int"), min(highest, scaled))))
