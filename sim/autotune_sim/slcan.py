"""slcan: the ASCII protocol of serial CAN adapters (Lawicel CANUSB manual), adapter's side.

Commands end with CR. Answers: CR for done, `z`/`Z` and CR for a frame sent, BELL for refused.
"""

from __future__ import annotations

from binascii import hexlify
from collections.abc import Callable

BITRATES = {
    ord("0"): 10_000, ord("1"): 20_000, ord("2"): 50_000, ord("3"): 100_000, ord("4"): 125_000,
    ord("5"): 250_000, ord("6"): 500_000, ord("7"): 800_000, ord("8"): 1_000_000,
}  # fmt: skip
OK, REFUSED = b"\r", b"\a"
VERSION, SERIAL = b"V1013\r", b"NA402\r"
_FIFO_FULL, _BUS_ERROR = 0x01, 0x80
_LONGEST_COMMAND = 64
_BACKLOG = 1 << 18  # bytes that may wait for a host that does not read


class SlcanAdapter:
    """Adapter between a host's byte stream and one CAN bus.

    Args:
        deliver: takes frames that the host sends, as (COB-ID, data).
        clock: monotonic time [s].
        bitrate: of the bus; at another one the adapter hears and says nothing.

    Attributes:
        output: bytes that wait for the host.
        flush: called when the channel opens: what the host has not read by then is stale.
    """

    def __init__(
        self, deliver: Callable[[int, bytes], None], clock: Callable[[], float], bitrate: int = 1_000_000
    ) -> None:
        self.output = bytearray()
        self.flush: Callable[[], None] = lambda: None
        self._deliver = deliver
        self._clock = clock
        self._bus_bitrate = bitrate
        self._bitrate = 0
        self._open = self._listening = self._stamped = False
        self._errors = 0
        self._input = b""
        self._headers: dict[bytes, tuple[int, int]] = {}
        self._prefixes: dict[tuple[int, int], bytes] = {}

    @property
    def connected(self) -> bool:
        """The channel is open, at the bus's bit rate."""
        return self._open and self._bitrate == self._bus_bitrate

    def reset(self) -> None:
        """As after plugging it in."""
        self._open = self._listening = self._stamped = False
        self._bitrate = self._errors = 0
        self._input = b""
        self.output.clear()

    def feed(self, data: bytes) -> None:
        """Takes what the host has written."""
        *commands, rest = (self._input + data).split(b"\r")
        if len(rest) > _LONGEST_COMMAND:
            rest = b""
            self.output += REFUSED
        self._input = rest
        for command in commands:
            try:
                answer = self._handle(command)
            except (ValueError, IndexError):
                answer = REFUSED
            self.output += answer

    def transmit(self, cob_id: int, data: bytes) -> None:
        """Takes a frame from the bus."""
        if not self.connected:
            return
        if len(self.output) > _BACKLOG:
            self._errors |= _FIFO_FULL
            return
        key = cob_id, len(data)
        prefix = self._prefixes.get(key)
        if prefix is None:
            prefix = self._prefixes[key] = b"t%03X%d" % key
        stamp = b"%04X" % (int(self._clock() * 1e3) % 60_000) if self._stamped else b""
        self.output += b"%b%b%b\r" % (prefix, hexlify(data).upper(), stamp)

    def _handle(self, command: bytes) -> bytes:
        if not command:
            return OK
        letter = command[:1]
        if letter == b"t":
            return self._send(command)
        if letter in b"TrR":
            return self._send_other(command)
        if letter in b"OLC":
            return self._channel(letter)
        if letter in b"SsZ":
            return self._configure(letter, command)
        return self._tell(letter)

    def _send(self, command: bytes) -> bytes:
        header = self._headers.get(command[:5])
        if header is None:
            header = int(command[1:4], 16), int(command[4:5])
            if header[0] > 0x7FF or header[1] > 8:
                return REFUSED
            self._headers[command[:5]] = header
        data = bytes.fromhex(command[5:].decode("ascii"))
        if not self._open or self._listening or len(data) != header[1]:
            return REFUSED
        if self._bitrate != self._bus_bitrate:
            self._errors |= _BUS_ERROR
            return REFUSED
        position = len(self.output)
        self._deliver(header[0], data)
        self.output[position:position] = b"z\r"
        return b""

    def _send_other(self, command: bytes) -> bytes:
        """Remote and extended frames: they go out, but nobody on this bus answers them."""
        extended = command[:1] in b"TR"
        end = 9 if extended else 4
        identifier, length = int(command[1:end], 16), int(command[end : end + 1])
        payload = len(bytes.fromhex(command[end + 1 :].decode("ascii")))
        wanted = length if command[:1] == b"T" else 0
        highest = 0x1FFFFFFF if extended else 0x7FF
        if not self.connected or self._listening or identifier > highest or length > 8 or payload != wanted:
            return REFUSED
        return b"Z\r" if extended else b"z\r"

    def _channel(self, letter: bytes) -> bytes:
        if letter == b"C":
            self._open = False
            return OK
        if self._open or not self._bitrate:
            return REFUSED
        self._open, self._listening = True, letter == b"L"
        self._errors = 0
        self.output.clear()
        self.flush()
        return OK

    def _configure(self, letter: bytes, command: bytes) -> bytes:
        if self._open:
            return REFUSED
        if letter == b"Z" and command[1:] in (b"0", b"1"):
            self._stamped = command[1:] == b"1"
            return OK
        if letter == b"S" and len(command) == 2 and command[1] in BITRATES:
            self._bitrate = BITRATES[command[1]]
            return OK
        if letter == b"s" and len(command) == 5:
            return self._registers(int(command[1:3], 16), int(command[3:5], 16))
        return REFUSED

    def _registers(self, btr0: int, btr1: int) -> bytes:
        """Bit timing registers of an SJA1000 at 8 MHz (16 MHz crystal)."""
        quanta = 1 + (btr1 & 0x0F) + 1 + (btr1 >> 4 & 0x07) + 1
        self._bitrate = round(8_000_000 / ((btr0 & 0x3F) + 1) / quanta)
        return OK

    def _tell(self, letter: bytes) -> bytes:
        if letter == b"V":
            return VERSION
        if letter == b"N":
            return SERIAL
        if letter == b"F" and self._open:
            errors, self._errors = self._errors, 0
            return b"F%02X\r" % errors
        return REFUSED
