"""The fdcanusb line protocol as a moteus controller speaks it on its own serial line.

`can send 8001 HEX *XX` is answered by `OK *XX`, and where a reply was asked for by `rcv 00000100 HEX *XX`.
The checksum is a CRC-8 (polynomial 97h) over everything before its asterisk; after the first one all
lines need one. Source: moteus `fw/uart_fdcanusb_micro_server.h` and its manual, "UART".

At a wrong speed a real line carries garbage both ways; so does this one.
"""

from __future__ import annotations

import re
import termios
from collections.abc import Callable

SPEED = termios.B921600
_UNSET = termios.B38400  # of a pseudo-terminal whose speed nobody has set
_LONGEST = 254
_BACKLOG = 1 << 18  # bytes that may wait for a host that does not read
_SEND = re.compile(rb"can send ([0-9A-Fa-f]{1,8}) ((?:[0-9A-Fa-f]{2})*)(?: .*)?")
_CHECKED = re.compile(rb"\*[0-9A-Fa-f]{2}\Z")


def _table() -> bytes:
    values = []
    for byte in range(256):
        for _ in range(8):
            byte = (byte << 1 ^ 0x97) & 0xFF if byte & 0x80 else byte << 1
        values.append(byte)
    return bytes(values)


_TABLE = _table()


def crc8(data: bytes) -> int:
    """CRC-8 with polynomial 97h, from zero."""
    table, crc = _TABLE, 0
    for byte in data:
        crc = table[crc ^ byte]
    return crc


class UartServer:
    """The serial line of one controller.

    Args:
        deliver: takes frames for any node, as (identifier, data).
        speed: the line's speed as the host has set it (a `termios` constant).

    Attributes:
        output: bytes that wait for the host.
        flush: never called; the line has no channel that opens.
    """

    def __init__(self, deliver: Callable[[int, bytes], None], speed: Callable[[], int]) -> None:
        self.output = bytearray()
        self.flush: Callable[[], None] = lambda: None
        self._deliver = deliver
        self._speed = speed
        self._checked = False
        self._input = b""

    def reset(self) -> None:
        """As after plugging it in."""
        self._checked = False
        self._input = b""
        self.output.clear()

    def feed(self, data: bytes) -> None:
        """Takes what the host has written."""
        if self._speed() not in (SPEED, _UNSET):
            self.output += bytes(byte * 7 & 0x7F | 0x80 for byte in data[::3])
            return
        *lines, rest = (self._input + data).replace(b"\r", b"\n").split(b"\n")
        self._input = rest if len(rest) < _LONGEST else b""
        for line in lines:
            if line:
                self._handle(line)

    def transmit(self, identifier: int, data: bytes) -> None:
        """Sends the host a frame."""
        if len(self.output) < _BACKLOG:
            self._say(b"rcv %08x %s" % (identifier, data.hex().encode()))

    def _handle(self, line: bytes) -> None:
        if len(line) >= _LONGEST:
            return  # longer than the controller's buffer
        content = self._verified(line)
        if content is None:
            self._say(b"ERR checksum")
            return
        match = _SEND.fullmatch(content)
        if match is None:
            self._say(b"ERR malformed data" if content.startswith(b"can send ") else b"ERR unknown command")
            return
        self._say(b"OK")
        self._deliver(int(match[1], 16), bytes.fromhex(match[2].decode()))

    def _verified(self, line: bytes) -> bytes | None:
        if _CHECKED.search(line) is None:
            return None if self._checked else line
        if crc8(line[:-3]) != int(line[-2:], 16):
            return None
        self._checked = True
        return line[:-3].rstrip(b" ")

    def _say(self, text: bytes) -> None:
        if self._checked:
            text += b" "
            text += b"*%02X" % crc8(text)
        self.output += text + b"\r\n"
