"""Multiplex frames: registers written and read in chosen forms, and the diagnostic stream.

A frame is a row of subframes: a kind, the number of registers (in the kind's two lowest bits where it is
one to three), the first register, and their values, all little endian. Values are SI-like in moteus's own
units (revolutions, N m); as integers they are multiples of a step, and the lowest integer means nan.
Sources: moteus manual, "CAN protocol" and "Register usage"; mjlib `multiplex/format.h`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Mapping, Sequence
from enum import IntEnum
from types import MappingProxyType
from typing import NamedTuple


class Form(IntEnum):
    """How a register travels."""

    INT8 = 0
    INT16 = 1
    INT32 = 2
    FLOAT = 3


class Kind(NamedTuple):
    """A kind of quantity: the step of an int8, int16 and int32; 0 for what is a number by itself."""

    int8: float = 0.0
    int16: float = 0.0
    int32: float = 0.0


INTEGER = Kind()
POSITION = Kind(0.01, 0.0001, 0.00001)
VELOCITY = Kind(0.1, 0.00025, 0.00001)
ACCELERATION = Kind(0.05, 0.001, 0.00001)
TORQUE = Kind(0.5, 0.01, 0.001)
CURRENT = Kind(1.0, 0.1, 0.001)
VOLTAGE = Kind(0.5, 0.1, 0.001)
TEMPERATURE = Kind(1.0, 0.1, 0.001)
TIME = Kind(0.01, 0.001, 0.000001)
SCALE = Kind(1 / 127, 1 / 32767, 1 / 2147483647)

MODE, FAULT = 0x000, 0x00F
MODEL, FIRMWARE_VERSION, MAP_VERSION, SERIAL_NUMBER = 0x100, 0x101, 0x102, 0x120
KINDS: Mapping[int, Kind] = MappingProxyType(
    {
        0x001: POSITION, 0x002: VELOCITY, 0x003: TORQUE, 0x004: CURRENT, 0x005: CURRENT,
        0x00A: TEMPERATURE, 0x00D: VOLTAGE, 0x00E: TEMPERATURE,
        0x020: POSITION, 0x021: VELOCITY, 0x022: TORQUE, 0x023: SCALE, 0x024: SCALE, 0x025: TORQUE,
        0x026: POSITION, 0x027: TIME, 0x028: VELOCITY, 0x029: ACCELERATION, 0x02A: VOLTAGE, 0x02B: SCALE,
        0x02C: CURRENT,
        0x030: TORQUE, 0x031: TORQUE, 0x032: TORQUE, 0x033: TORQUE, 0x034: TORQUE,
        0x038: POSITION, 0x039: VELOCITY, 0x03A: TORQUE, 0x03B: POSITION, 0x03C: VELOCITY, 0x03D: TORQUE,
    }
)  # fmt: skip
"""Kinds of the registers; the others are numbers by themselves."""

_PACKERS = tuple(struct.Struct(form) for form in ("<b", "<h", "<i", "<f"))
_HIGHEST = (127, 32767, 2147483647)
_WRITE, _READ, _REPLY = 0x00, 0x10, 0x20
_WRITE_ERROR, _READ_ERROR = 0x30, 0x31
_CLIENT_DATA, _SERVER_DATA, _POLL = 0x40, 0x41, 0x42
_SERVER_FLOW, _POLL_FLOW = 0x43, 0x44
_NOP = 0x50
CHUNK = 61
"""Bytes of the diagnostic stream that fit into one frame."""


class Reply(NamedTuple):
    """What a frame from the controller says.

    Attributes:
        values: by register, decoded.
        errors: registers that could not be read or written, with the error's number.
        stream: bytes of the diagnostic stream, None where the frame has none; packet: with flow control.
    """

    values: dict[int, float]
    errors: dict[int, int]
    stream: bytes | None = None
    packet: int | None = None


def encode_value(kind: Kind, form: Form, value: float) -> bytes:
    """A value in a form; what does not fit is limited, nan becomes the lowest integer.

    Raises:
        OverflowError: a float too large for single precision.
    """
    if form is Form.FLOAT:
        return _PACKERS[form].pack(value)
    highest = _HIGHEST[form]
    if math.isnan(value):
        return _PACKERS[form].pack(-highest - 1)
    raw = value / kind[form] if kind[form] else value
    return _PACKERS[form].pack(round(max(-highest, min(highest, raw))))


def decode_value(kind: Kind, form: int, raw: int | float) -> float:
    """The inverse of `encode_value`; a number by itself has no nan."""
    if form == Form.FLOAT:
        return float(raw)
    if not kind[form]:
        return raw
    return math.nan if raw == -_HIGHEST[form] - 1 else raw * kind[form]


def varuint(value: int) -> bytes:
    """Seven bits a byte, lowest first."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _head(kind: int, form: Form, register: int, count: int) -> bytes:
    short = count if count <= 3 else 0
    return bytes((kind | form << 2 | short,)) + (b"" if short else varuint(count)) + varuint(register)


def write(form: Form, register: int, values: Sequence[float]) -> bytes:
    """A subframe that writes registers from `register` on."""
    pairs = enumerate(values, register)
    content = b"".join(encode_value(KINDS.get(number, INTEGER), form, value) for number, value in pairs)
    return _head(_WRITE, form, register, len(values)) + content


def read(form: Form, register: int, count: int = 1) -> bytes:
    """A subframe that asks for registers from `register` on."""
    return _head(_READ, form, register, count)


def reply_head(form: Form, register: int, count: int = 1) -> bytes:
    """How the answer to `read` begins, where all of it could be read."""
    return _head(_REPLY, form, register, count)


def stream_data(data: bytes, channel: int = 1) -> bytes:
    """A subframe with bytes for the diagnostic stream."""
    return bytes((_CLIENT_DATA,)) + varuint(channel) + varuint(len(data)) + data


def stream_poll(limit: int, acknowledged: int | None = None, channel: int = 1) -> bytes:
    """A subframe that asks for the stream's bytes; with flow control if a packet is acknowledged."""
    if acknowledged is None:
        return bytes((_POLL,)) + varuint(channel) + varuint(limit)
    return bytes((_POLL_FLOW,)) + varuint(channel) + bytes((acknowledged,)) + varuint(limit)


def parse(data: bytes) -> Reply:
    """Reads a frame as far as it makes sense."""
    reply = Reply({}, {})
    cursor = _Cursor(data)
    try:
        while cursor.at < len(data):
            reply = _subframe(cursor, reply)
    except (IndexError, struct.error):
        pass  # the rest is missing or is not for us
    return reply


def missing(reply: Reply, registers: Iterable[int]) -> list[int]:
    """Registers that a reply does not have."""
    return [register for register in registers if register not in reply.values]


class _Cursor:
    def __init__(self, data: bytes) -> None:
        self.data = data
        self.at = 0

    def varuint(self) -> int:
        value = 0
        for shift in range(0, 35, 7):
            byte = self.data[self.at]
            self.at += 1
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
        raise IndexError

    def take(self, size: int) -> bytes:
        if self.at + size > len(self.data):
            raise IndexError
        self.at += size
        return self.data[self.at - size : self.at]


def _subframe(cursor: _Cursor, reply: Reply) -> Reply:
    kind = cursor.varuint()
    if _REPLY <= kind < _WRITE_ERROR:
        form, count = kind >> 2 & 3, kind & 3 or cursor.varuint()
        register = cursor.varuint()
        for number in range(register, register + count):
            packer = _PACKERS[form]
            raw = packer.unpack(cursor.take(packer.size))[0]
            reply.values[number] = decode_value(KINDS.get(number, INTEGER), form, raw)
    elif kind in (_WRITE_ERROR, _READ_ERROR):
        register = cursor.varuint()
        reply.errors[register] = cursor.varuint()
    elif kind in (_SERVER_DATA, _SERVER_FLOW):
        cursor.varuint()
        packet = cursor.take(1)[0] if kind == _SERVER_FLOW else None
        return reply._replace(stream=(reply.stream or b"") + cursor.take(cursor.varuint()), packet=packet)
    elif kind != _NOP:
        raise IndexError
    return reply
