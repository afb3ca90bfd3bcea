"""SDO server (CiA 301, 7.2.4): expedited, segmented and block transfers of one client.

The server knows bytes and the object dictionary, nothing of time but what `poll` tells it: a write
that takes long (1010) is answered when it is done.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from autotune_sim.aborts import Abort, AbortCode
from autotune_sim.object_dictionary import Entry, ObjectDictionary, Value
from autotune_sim.sdo_block import BlockDownload, BlockUpload

_HEADER = struct.Struct("<BHB")
_LONG = struct.Struct("<I")
_ABORT = struct.Struct("<BHBI")
_TOGGLE = 0x10
_LIMIT = 1 << 20

Refuse = Callable[[Entry, bool], int]
"""Asked before each transfer with the entry and whether it is a write; an abort code or 0."""


class SdoServer:
    """Answers requests through `send`, which takes the eight data bytes of a frame."""

    def __init__(self, objects: ObjectDictionary, send: Callable[[bytes], None], refuse: Refuse) -> None:
        self._objects = objects
        self._send = send
        self._refuse = refuse
        self._due: float | None = None
        self._pending: tuple[Entry, Value, bytes] | None = None
        self._forget()

    def _forget(self) -> None:
        self._index = 0
        self._subindex = 0
        self._toggle = 0
        self._upload: memoryview | None = None
        self._download: bytearray | None = None
        self._announced = 0
        self._block: BlockUpload | BlockDownload | None = None

    def reset(self) -> None:
        """Forgets every transfer, as at power-up."""
        self._forget()
        self._due, self._pending = None, None

    @property
    def due(self) -> float | None:
        """When `poll` must be called [s]; None where nothing is waiting."""
        return self._due

    def poll(self, now: float) -> None:
        """Ends a write that takes its time."""
        if self._pending is None or self._due is None or now < self._due:
            return
        entry, value, answer = self._pending
        self._due, self._pending = None, None
        self._index, self._subindex = entry.index, entry.subindex
        try:
            entry.put(value)
        except Abort as abort:
            self._abort(abort.code)
        else:
            self._send(answer)

    def receive(self, data: bytes, now: float) -> None:
        """Handles one request."""
        if len(data) != 8 or self._pending is not None:
            return
        try:
            self._dispatch(data, now)
        except Abort as abort:
            self._abort(abort.code)

    def _dispatch(self, data: bytes, now: float) -> None:
        command = data[0] >> 5
        if data[0] == 0x80:
            self._forget()
        elif isinstance(self._block, BlockDownload) and self._block.receiving:
            self._answer(self._block.segment(data))
        elif command == 0:
            self._download_segment(data, now)
        elif command == 1:
            self._initiate_download(data, now)
        elif command == 2:
            self._initiate_upload(data)
        elif command == 3:
            self._upload_segment(data)
        elif command == 5:
            self._block_upload(data)
        elif command == 6:
            self._block_download(data, now)
        else:
            raise Abort(AbortCode.COMMAND)

    def _initiate(self, data: bytes, writing: bool) -> Entry:
        self._forget()
        _, self._index, self._subindex = _HEADER.unpack_from(data)
        entry = self._objects[self._index, self._subindex]
        code = self._refuse(entry, writing)
        if code:
            raise Abort(code)
        if writing and "w" not in entry.access:
            raise Abort(AbortCode.READ_ONLY)
        return entry

    def _initiate_upload(self, data: bytes) -> None:
        value = self._initiate(data, False).upload()
        self._start_upload(value)

    def _start_upload(self, value: bytes) -> None:
        if 0 < len(value) <= 4:
            command = 0x43 | (4 - len(value)) << 2
            self._reply(command, value.ljust(4, b"\0"))
        else:
            self._upload = memoryview(value)
            self._reply(0x41, _LONG.pack(len(value)))

    def _upload_segment(self, data: bytes) -> None:
        if self._upload is None:
            raise Abort(AbortCode.COMMAND)
        if data[0] & _TOGGLE != self._toggle:
            raise Abort(AbortCode.TOGGLE)
        part, self._upload = bytes(self._upload[:7]), self._upload[7:]
        last = len(self._upload) == 0
        command = self._toggle | (7 - len(part)) << 1 | last
        self._toggle ^= _TOGGLE
        if last:
            self._upload = None
        self._send(bytes((command,)) + part.ljust(7, b"\0"))

    def _initiate_download(self, data: bytes, now: float) -> None:
        entry = self._initiate(data, True)
        if data[0] & 0x02:
            length = 4 - (data[0] >> 2 & 3) if data[0] & 0x01 else entry.size or 4
            self._write(entry, data[4 : 4 + length], now, self._packet(0x60))
            return
        self._announced = _LONG.unpack_from(data, 4)[0] if data[0] & 0x01 else 0
        self._check_announced(entry, self._announced)
        self._download = bytearray()
        self._reply(0x60)

    def _check_announced(self, entry: Entry, announced: int) -> None:
        if announced > (entry.size or _LIMIT):
            raise Abort(AbortCode.TOO_LONG)
        if entry.size and 0 < announced < entry.size:
            raise Abort(AbortCode.TOO_SHORT)

    def _download_segment(self, data: bytes, now: float) -> None:
        if self._download is None:
            raise Abort(AbortCode.COMMAND)
        if data[0] & _TOGGLE != self._toggle:
            raise Abort(AbortCode.TOGGLE)
        self._download += data[1 : 8 - (data[0] >> 1 & 7)]
        if len(self._download) > (self._announced or _LIMIT):
            raise Abort(AbortCode.TOO_LONG)
        answer = bytes((0x20 | self._toggle, 0, 0, 0, 0, 0, 0, 0))
        self._toggle ^= _TOGGLE
        if not data[0] & 0x01:
            self._send(answer)
            return
        content, self._download = bytes(self._download), None
        if self._announced and len(content) != self._announced:
            raise Abort(AbortCode.LENGTH)
        self._write(self._objects[self._index, self._subindex], content, now, answer)

    def _write(self, entry: Entry, content: bytes, now: float, answer: bytes) -> None:
        value = entry.decode(content)
        delay = entry.delay(value) if entry.delay is not None else 0.0
        if delay > 0:
            self._pending, self._due = (entry, value, answer), now + delay
            return
        entry.put(value)
        self._send(answer)

    def _block_upload(self, data: bytes) -> None:
        if data[0] & 0x03 == 0:
            content = self._initiate(data, False).upload()
            if data[5] > 0 and len(content) <= data[5]:
                self._start_upload(content)
                return
            self._block = BlockUpload(content, data[4], bool(data[0] & 0x04))
            self._reply(self._block.command, _LONG.pack(len(content)))
        elif isinstance(self._block, BlockUpload):
            for frame in self._block.answer(data):
                self._send(frame)
            if self._block.finished:
                self._forget()
        else:
            raise Abort(AbortCode.COMMAND)

    def _block_download(self, data: bytes, now: float) -> None:
        if data[0] & 0x01 == 0:
            entry = self._initiate(data, True)
            announced = _LONG.unpack_from(data, 4)[0] if data[0] & 0x02 else 0
            self._check_announced(entry, announced)
            self._block = BlockDownload(announced or _LIMIT, bool(announced), bool(data[0] & 0x04))
            self._reply(self._block.command, bytes((self._block.size, 0, 0, 0)))
        elif isinstance(self._block, BlockDownload):
            content, self._block = self._block.end(data), None
            entry = self._objects[self._index, self._subindex]
            self._write(entry, content, now, bytes((0xA1, 0, 0, 0, 0, 0, 0, 0)))
        else:
            raise Abort(AbortCode.COMMAND)

    def _answer(self, frame: bytes | None) -> None:
        if frame is not None:
            self._send(frame)

    def _packet(self, command: int, data: bytes = b"\0\0\0\0") -> bytes:
        return _HEADER.pack(command, self._index, self._subindex) + data

    def _reply(self, command: int, data: bytes = b"\0\0\0\0") -> None:
        self._send(self._packet(command, data))

    def _abort(self, code: int) -> None:
        frame = _ABORT.pack(0x80, self._index, self._subindex, code)
        self._forget()
        self._send(frame)
