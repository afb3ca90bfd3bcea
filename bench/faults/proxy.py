"""Somebody between host and drive: loses, delays, doubles, swaps, corrupts and garbles, or talks himself.

It stands between two pseudo-terminals and knows nothing of either side but where a message ends: a carriage
return (slcan) or a line feed (moteus). An operation is `NAME=SHARE:SECONDS@WHEN`: this share of the messages,
for so long, from the n-th cycle of the host on (WHEN · 1000 of its SYNCs or commands). So long is SECONDS · 1000 of its
cycles, and no longer than SECONDS by the clock: a host that fetches a recorder sends no SYNC, and a simulated drive in
lock-step goes as slowly as its wire.

| operation | what happens to a message |
|---|---|
| lose | it does not arrive |
| delay | it arrives 0.3 to 60 ms late, and so does all behind it |
| double | it arrives twice |
| reorder | it arrives after the next one |
| corrupt | one character of it is another |
| garble | random bytes come before it |
| foreign | another master has said something: NMT, SYNC, control word, or our own words of a while ago |
"""

from __future__ import annotations

import os
import select
import time
import tty
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from random import Random

_READ = 65536
_CYCLE = 1e-3
_ENDS = {"wire": b"\r", "line": b"\n"}
_SYNC = {"wire": b"t080", "line": b"can send"}
_FOREIGN = (
    b"t00020205\r",  # NMT stop
    b"t00028005\r",  # NMT pre-operational
    b"t00028105\r",  # NMT reset node
    b"t0800\r",  # a SYNC of another
    b"t60582B40600006000000\r",  # control word: shutdown
    b"t60582B4060000F010000\r",  # control word: halt
    b"t605823766000E8030000\r",  # rated torque
)


@dataclass(frozen=True, slots=True)
class Operation:
    """What is done to messages, to which share of them, for how long and from when [cycles of the host]."""

    name: str
    share: float
    length: float
    begin: float

    @classmethod
    def parse(cls, text: str) -> Operation:
        name, _, rest = text.partition("=")
        what, _, when = rest.partition("@")
        share, _, seconds = what.partition(":")
        begin = float(when) / _CYCLE
        return cls(name, float(share), float(seconds) / _CYCLE, begin)


class Proxy:
    """Passes messages on between the host's port and the drive's.

    Args:
        kind: `wire` or `line`.
        note: file that says when the first message was touched: monotonic time [s].
    """

    def __init__(
        self, host: Path, drive: Path, kind: str, operation: Operation, seed: int, note: Path
    ) -> None:
        self._end, self._sync = _ENDS[kind], _SYNC[kind]
        self._kind, self._operation, self._random, self._note = kind, operation, Random(seed), note
        self._cycles = 0
        self._begun = 0.0  # monotonic time [s]
        self._touched = False
        self._rest = {True: b"", False: b""}
        self._held: bytes | None = None
        self._earlier: deque[bytes] = deque(maxlen=500)
        master, slave = os.openpty()
        tty.setraw(slave)
        self._slave = slave
        self._host = master
        host.symlink_to(os.ttyname(slave))
        self._drive = os.open(drive, os.O_RDWR | os.O_NOCTTY)
        tty.setraw(self._drive)

    def run(self) -> None:
        """Until it is killed, or a side is gone."""
        while True:
            ready, _, _ = select.select([self._host, self._drive], [], [])
            for source in ready:
                outward = source == self._host
                try:
                    data = os.read(source, _READ)
                    if not data:
                        return
                    self._pass_on(data, outward)
                except OSError:
                    return

    def _pass_on(self, data: bytes, outward: bool) -> None:
        *messages, self._rest[outward] = (self._rest[outward] + data).split(self._end)
        out = b"".join(self._handle(message + self._end, outward) for message in messages)
        target = self._drive if outward else self._host
        while out:
            out = out[os.write(target, out) :]

    def _handle(self, message: bytes, outward: bool) -> bytes:
        if outward and message.startswith(self._sync):
            self._cycles += 1
        if outward:
            self._earlier.append(message)
        operation = self._operation
        if not self._under_way() or self._random.random() >= operation.share:
            held, self._held = self._held, None
            return message + held if held is not None else message
        if not self._touched:
            self._touched = True
            self._note.write_text(repr(time.monotonic()), encoding="ascii")
        return self._touch(message, outward)

    def _under_way(self) -> bool:
        """From the operation's first cycle on, for so many cycles and so many seconds."""
        operation, now = self._operation, time.monotonic()
        if self._cycles < operation.begin:
            return False
        self._begun = self._begun or now
        return (
            self._cycles < operation.begin + operation.length
            and now < self._begun + operation.length * _CYCLE
        )

    def _touch(self, message: bytes, outward: bool) -> bytes:
        name, random = self._operation.name, self._random
        if name == "lose":
            return b""
        if name == "delay":
            time.sleep(random.uniform(3e-4, 6e-2))
        elif name == "double":
            return message + message
        elif name == "reorder":
            held, self._held = self._held, message
            return held or b""
        elif name == "corrupt":
            place = random.randrange(len(message))
            return message[:place] + bytes((random.choice(b"0123456789ABCDEFt"),)) + message[place + 1 :]
        elif name == "garble":
            return random.randbytes(random.randint(1, 30)) + message
        elif name == "foreign" and outward:
            return self._foreign() + message
        return message

    def _foreign(self) -> bytes:
        """What another master says; on a moteus line, what we said a while ago."""
        if self._kind == "line" or self._random.random() < 0.4:
            return self._earlier[0]
        return self._random.choice(_FOREIGN)
