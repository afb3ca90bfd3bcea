"""SDO block transfers (CiA 301, 7.2.4.3.9 ff.): up to 127 segments to one acknowledgement, with CRC.

The CRC is CRC-16-CCITT with polynomial 1021h and start value 0, over the data alone.
"""

from __future__ import annotations

from binascii import crc_hqx

from autotune_sim.aborts import Abort, AbortCode

SEGMENT = 7
LARGEST = 127
_LAST = 0x80


class BlockUpload:
    """Server's side of one block upload."""

    def __init__(self, content: bytes, size: int, with_crc: bool) -> None:
        self._content = content
        self._position = 0
        self._with_crc = with_crc
        self._sent = 0
        self._ended = False
        self.finished = False
        self.command = 0xC6 if with_crc else 0xC2
        self._resize(size)

    def _resize(self, size: int) -> None:
        if not 1 <= size <= LARGEST:
            raise Abort(AbortCode.BLOCK_SIZE)
        self._size = size

    def answer(self, data: bytes) -> list[bytes]:
        """Frames that follow a request of the client: start, acknowledgement or end."""
        phase = data[0] & 0x03
        if phase == 3 and self._sent == 0:
            return self._segments()
        if phase == 2 and self._sent > 0:
            return self._acknowledged(data[1], data[2])
        if phase == 1 and self._ended:
            self.finished = True
            return []
        raise Abort(AbortCode.COMMAND)

    def _acknowledged(self, sequence: int, size: int) -> list[bytes]:
        if sequence > self._sent:
            raise Abort(AbortCode.SEQUENCE)
        self._position += sequence * SEGMENT
        self._resize(size)
        if self._position < len(self._content) or (not self._content and sequence == 0):
            return self._segments()
        self._ended = True
        unused = -len(self._content) % SEGMENT if self._content else SEGMENT
        crc = crc_hqx(self._content, 0) if self._with_crc else 0
        return [bytes((0xC1 | unused << 2, crc & 0xFF, crc >> 8, 0, 0, 0, 0, 0))]

    def _segments(self) -> list[bytes]:
        view = self._content[self._position : self._position + self._size * SEGMENT]
        last = self._position + len(view) >= len(self._content)
        starts = range(0, max(len(view), 1), SEGMENT)
        frames = [
            bytes((number,)) + view[start : start + SEGMENT].ljust(SEGMENT, b"\0")
            for number, start in enumerate(starts, 1)
        ]
        if last:
            frames[-1] = bytes((frames[-1][0] | _LAST,)) + frames[-1][1:]
        self._sent = len(frames)
        return frames


class BlockDownload:
    """Server's side of one block download."""

    def __init__(self, limit: int, exact: bool, with_crc: bool) -> None:
        self.size = LARGEST
        self.command = 0xA4
        self.receiving = True
        self._limit = limit
        self._exact = exact
        self._with_crc = with_crc
        self._content = bytearray()
        self._sequence = 0

    def segment(self, data: bytes) -> bytes | None:
        """Takes a segment; the acknowledgement where one is due."""
        number, last = data[0] & 0x7F, bool(data[0] & _LAST)
        if number == 0:
            raise Abort(AbortCode.SEQUENCE)
        in_order = number == self._sequence + 1
        if in_order:
            self._sequence = number
            self._content += data[1:8]
        if len(self._content) > self._limit + SEGMENT:
            raise Abort(AbortCode.TOO_LONG)
        if not last and number < self.size:
            return None
        self.receiving = not (last and in_order)
        acknowledged, self._sequence = self._sequence, 0
        return bytes((0xA2, acknowledged, self.size, 0, 0, 0, 0, 0))

    def end(self, data: bytes) -> bytes:
        """The whole content, checked."""
        unused = data[0] >> 2 & 7
        content = bytes(self._content[: len(self._content) - unused])
        if self._exact and len(content) != self._limit:
            raise Abort(AbortCode.LENGTH)
        if self._with_crc and crc_hqx(content, 0) != data[1] | data[2] << 8:
            raise Abort(AbortCode.CRC)
        return content
