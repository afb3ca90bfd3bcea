"""The fdcanusb line protocol: CAN-FD frames as lines of text, with checksums where the line has them.

    can send 8001 HEX *XX        the host's command; answered by `OK` or `ERR reason`
    rcv 100 HEX FLAGS *XX        a frame for the host

The checksum is a CRC-8 (polynomial 97h, from zero) over everything before its asterisk. An adapter on USB
sends none; a moteus on its own serial line does after the first command that has one, and then demands
them. Sources: mjbots fdcanusb README; moteus manual, "UART"; compared in tests with the `moteus` package.

The reader never loses its place for long: a line that makes no sense is searched for the beginning of a
good one within it, and what has no end is forgotten but for a line's length.
"""

from __future__ import annotations

import re
from binascii import Error as HexError
from binascii import unhexlify
from typing import NamedTuple

LONGEST_FRAME = 64
_LONGEST_LINE = 256
_SIZES = (*range(9), 12, 16, 20, 24, 32, 48, 64)
_NOP = b"\x50"
_FLAG = re.compile(rb"[EeBbFfRr]+|[tf]-?[0-9]+|")
_BEGINNINGS = (b"rcv ", b"OK", b"ERR")


class Line(NamedTuple):
    """One line of the adapter.

    Attributes:
        kind: `OK`, `ERR` or `rcv`.
        identifier, data: of a frame; 0 and empty otherwise.
        text: reason of an `ERR`.
        checked: it had a checksum, which was right.
    """

    kind: str
    identifier: int = 0
    data: bytes = b""
    text: str = ""
    checked: bool = False


def _table() -> bytes:
    values = []
    for byte in range(256):
        for _ in range(8):
            byte = (byte << 1 ^ 0x97) & 0xFF if byte & 0x80 else byte << 1
        values.append(byte)
    return bytes(values)


_TABLE = _table()


def crc8(data: bytes) -> int:
    """CRC-8 with polynomial 97h, from zero, highest bit first."""
    table, crc = _TABLE, 0
    for byte in data:
        crc = table[crc ^ byte]
    return crc


def padded(data: bytes) -> bytes:
    """A frame's data filled with NOP to a length that CAN-FD has. Raises ValueError: more than 64 bytes."""
    if len(data) > LONGEST_FRAME:
        raise ValueError(f"a frame of {len(data)} bytes is longer than CAN-FD's {LONGEST_FRAME}")
    size: int = next(size for size in _SIZES if size >= len(data))
    return data + _NOP * (size - len(data))


def encode(identifier: int, data: bytes, checked: bool) -> bytes:
    """A frame as a command line."""
    line = b"can send %04x %s" % (identifier, padded(data).hex().encode())
    if checked:
        line += b" "
        line += b"*%02X" % crc8(line)
    return line + b"\n"


class LineReader:
    """Bytes in, lines out.

    Attributes:
        demands_checksums: lines without one are not believed.
        received: bytes so far; understood: lines; garbled: lines that made no sense.
    """

    def __init__(self) -> None:
        self.demands_checksums = False
        self.received = 0
        self.understood = 0
        self.garbled = 0
        self._rest = b""

    def feed(self, data: bytes) -> list[Line]:
        """The good lines that are complete now."""
        self.received += len(data)
        *complete, rest = (self._rest + data).replace(b"\r", b"\n").split(b"\n")
        self._rest = rest[-_LONGEST_LINE:]
        return [line for text in complete if text and (line := self._line(text)) is not None]

    @property
    def unfinished(self) -> bool:
        """A line has begun and not ended."""
        return bool(self._rest)

    def forget(self) -> None:
        """What has come of an unfinished line is no longer waited for."""
        self._rest = b""

    def give_up(self) -> None:
        """The end of a line is lost: garbled."""
        self.garbled += 1
        self.forget()

    def _line(self, text: bytes) -> Line | None:
        line = self._decode(text)
        if line is None:
            self.garbled += 1
            line = self._within(text)
        if line is not None:
            self.understood += 1
        return line

    def _within(self, text: bytes) -> Line | None:
        """A good line that follows on garbage without an end."""
        starts = [at for word in _BEGINNINGS if (at := text.rfind(word, 1)) > 0]
        for start in sorted(starts, reverse=True):
            line = self._decode(text[start:])
            if line is not None:
                return line
        return None

    def _decode(self, text: bytes) -> Line | None:
        checked = False
        if text[-3:-2] == b"*":
            try:
                checked = int(text[-2:], 16) == crc8(text[:-3])
            except ValueError:
                return None
            if not checked:
                return None
            text = text[:-3].rstrip(b" ")
        elif self.demands_checksums:
            return None
        return _meaning(text.strip(b" "), checked)


def _meaning(text: bytes, checked: bool) -> Line | None:
    if text == b"OK":
        return Line("OK", checked=checked)
    words = text.split(b" ")
    if words[0] == b"ERR" and b"rcv " not in text:
        return Line("ERR", text=text[4:].decode("ascii", "replace"), checked=checked)
    if (
        words[0] != b"rcv"
        or len(words) < 2
        or not 0 < len(words[1]) <= 8
        or not all(map(_FLAG.fullmatch, words[3:]))
    ):
        return None
    try:
        data = unhexlify(words[2]) if len(words) > 2 else b""
        if len(data) > LONGEST_FRAME:
            return None
        return Line("rcv", int.from_bytes(unhexlify(words[1].rjust(8, b"0"))), data, checked=checked)
    except HexError:
        return None
