"""A CANopen node in memory, for tests of the master: a link whose far end is a dictionary of objects.

It answers SDO (expedited and segmented), keeps a log of what was written, and answers SYNC with
whatever `on_sync` makes of the RPDOs. Time does not pass in it.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable

from autotune_drivers.canopen.frames import Frame

Objects = dict[tuple[int, int], bytes]


class FakeNode:
    """A `FrameLink` with a node behind it.

    Attributes:
        objects: bytes by (index, sub).
        writes: (index, sub, bytes) in the order in which they came.
        refuse: abort codes by (index, sub, "read" or "write").
        swallow: so many SDO requests are lost.
    """

    name = "fake"
    hint = "the adapter itself answers"

    def __init__(self, objects: Objects, number: int = 5) -> None:
        self.objects = objects
        self.number = number
        self.writes: list[tuple[int, int, bytes]] = []
        self.refuse: dict[tuple[int, int, str], int] = {}
        self.swallow = 0
        self.sent: list[Frame] = []
        self.inbox: deque[list[Frame]] = deque()
        self.on_sync: Callable[[list[Frame]], list[Frame]] = lambda rpdos: []
        self._rpdos: list[Frame] = []
        self._rest = b""
        self._toggle = 0
        self._download: tuple[int, int] | None = None
        self._received = b""

    def send(self, *frames: Frame) -> None:
        self.sent += frames
        for identifier, data in frames:
            if identifier == 0x600 + self.number:
                self._sdo(data)
            elif identifier == 0x80:
                rpdos, self._rpdos = self._rpdos, []
                self.reply(*self.on_sync(rpdos))
            elif 0x200 <= identifier < 0x580:
                self._rpdos.append((identifier, data))

    def reply(self, *frames: Frame) -> None:
        if frames:
            self.inbox.append(list(frames))

    def receive(self, timeout: float) -> list[Frame]:
        return self.inbox.popleft() if self.inbox else []

    def close(self) -> None:
        return

    def _sdo(self, request: bytes) -> None:
        if self.swallow > 0:
            self.swallow -= 1
            return
        if (answer := self._answer(request)) is not None:
            self.reply((0x580 + self.number, answer))

    def _answer(self, request: bytes) -> bytes | None:
        command, index, sub = struct.unpack_from("<BHB", request)
        kind = command >> 5
        if kind == 4:
            return None
        if kind == 3:
            return self._upload_segment(command)
        if kind == 0:
            return self._download_segment(command, request[1:])
        verb = "read" if kind == 2 else "write"
        code = self.refuse.get((index, sub, verb), 0 if (index, sub) in self.objects else 0x06020000)
        if kind not in (1, 2):
            code = 0x05040001
        if code:
            return struct.pack("<BHBL", 0x80, index, sub, code)
        return self._upload(index, sub) if kind == 2 else self._download_begin(command, index, sub, request)

    def _upload(self, index: int, sub: int) -> bytes:
        data = self.objects[index, sub]
        if len(data) <= 4:
            return struct.pack("<BHB4s", 0x43 | (4 - len(data)) << 2, index, sub, data)
        self._rest, self._toggle = data, 0
        return struct.pack("<BHBL", 0x41, index, sub, len(data))

    def _upload_segment(self, command: int) -> bytes:
        part, self._rest = self._rest[:7], self._rest[7:]
        return bytes((command & 0x10 | (7 - len(part)) << 1 | (not self._rest),)) + part.ljust(7, b"\0")

    def _download_begin(self, command: int, index: int, sub: int, request: bytes) -> bytes:
        if command & 2:
            self._store(index, sub, request[4 : 8 - (command >> 2 & 3)])
        else:
            self._download, self._received = (index, sub), b""
        return struct.pack("<BHBL", 0x60, index, sub, 0)

    def _download_segment(self, command: int, data: bytes) -> bytes:
        self._received += data[: 7 - (command >> 1 & 7)]
        if command & 1 and self._download is not None:
            self._store(*self._download, self._received)
        return bytes((0x20 | command & 0x10,)) + bytes(7)

    def _store(self, index: int, sub: int, data: bytes) -> None:
        self.writes.append((index, sub, data))
        self.objects[index, sub] = data
