"""An slcan (serial line CAN) adapter, read in blocks.

python-can's own slcan bus reads byte by byte; reading blocks took an SDO from 201 to 49 µs and a
64 kB block upload from 1.2 to 0.07 s. `SlcanBus` stays a python-can bus and is a `FrameLink` too: its
`send_frames` and `receive_frames` speak to the file descriptor directly. Protocol (Lawicel): `t`, three
hex digits of identifier, one of length, data in hex, carriage return; BEL (07h) reports an error.
"""

from __future__ import annotations

import errno
import os
import select
import time
from binascii import Error as HexError
from binascii import hexlify, unhexlify
from pathlib import Path

import can
import serial
from can.interfaces.slcan import slcanBus

from autotune.core.errors import LinkError, LinkTimeout
from autotune_drivers.canopen.frames import Frame, unplugged
from autotune_drivers.serial_device import lock_device

BITRATES: tuple[int, ...] = tuple(sorted(slcanBus._BITRATES))
_BLOCK = 65536
_WRITE_TIMEOUT = 1.0
_DATA_FRAME = ord("t")
_HIGHEST = 0x7FF
_AFTER_DATA = (
    0,
    2,
)  # bytes: nothing, or a time stamp (Lawicel: Z1); anything else has gained or lost a digit
_GONE = select.POLLHUP | select.POLLERR | select.POLLNVAL


class SlcanBus(slcanBus):  # type: ignore[misc]
    """python-can's slcan bus with block reads."""

    def __init__(self, channel: str, bitrate: int) -> None:
        self._rest = b""
        self._backlog: list[bytes] = []
        self.answers = 0
        self.errors = 0
        self.garbled = 0
        self._heads: dict[bytes, tuple[int, int]] = {}
        super().__init__(channel, bitrate=bitrate, sleep_after_open=0)
        self._descriptor: int = self.serialPortOrig.fileno()
        self._poll = select.poll()
        self._poll.register(self._descriptor, select.POLLIN)

    def send_frames(self, *frames: Frame) -> None:
        """Writes frames with one system call.

        Raises:
            OSError: the device is gone.
            TimeoutError: it takes nothing for a second.
        """
        text = b"".join(encode(identifier, data) for identifier, data in frames)
        while text:
            try:
                text = text[os.write(self._descriptor, text) :]
            except BlockingIOError:
                _, ready, _ = select.select([], [self._descriptor], [], _WRITE_TIMEOUT)
                if not ready:
                    raise TimeoutError(f"nothing written for {_WRITE_TIMEOUT} s") from None

    def receive_frames(self, timeout: float) -> list[Frame]:
        """All frames that are there; waits up to `timeout` seconds for the first bytes.

        Raises:
            OSError: the device is gone.
        """
        frames = [frame for line in self._backlog if (frame := self._decode(line)) is not None]
        self._backlog.clear()
        if frames:
            return frames
        lines = self._lines(timeout)
        return [frame for line in lines if (frame := self._decode(line)) is not None]

    def _lines(self, timeout: float) -> list[bytes]:
        events = self._poll.poll(max(timeout, 0.0) * 1e3)
        if not events:
            return []
        try:
            block = os.read(self._descriptor, _BLOCK)
        except BlockingIOError:
            return []
        if not block:  # bytes may be discarded between poll and read; only a hang-up is an end
            if events[0][1] & _GONE:
                raise OSError(errno.EIO, "hung up")
            return []
        lines = (self._rest + block).split(b"\r")
        self._rest = lines.pop()
        return lines

    def _decode(self, line: bytes) -> Frame | None:
        try:
            if line[0] == _DATA_FRAME:
                identifier, length = self._heads.get(line[:5]) or self._head(line)
                data = unhexlify(line[5:])
                if len(data) - length in _AFTER_DATA:
                    return identifier, data[:length]
        except (IndexError, ValueError, HexError):
            pass
        return self._other(line)

    def _head(self, line: bytes) -> tuple[int, int]:
        """Identifier and length of a data frame, kept for the next one alike.

        Raises:
            IndexError, ValueError: there is no such frame.
        """
        head = int.from_bytes(unhexlify(b"0" + line[1:4])), line[4] - 48
        if head[0] > _HIGHEST or not 0 <= head[1] <= 8:
            raise ValueError(line)
        self._heads[line[:5]] = head
        return head

    def _other(self, line: bytes) -> Frame | None:
        """Answers to commands, error bells, extended frames, garbage: counted, not frames for us."""
        before, bell, after = line.rpartition(b"\a")
        if bell:
            self.errors += 1 + before.count(b"\a")
            return self._decode(after) if after else None
        if line in (b"", b"z", b"Z"):
            self.answers += 1
        elif line[:1] not in b"TrRdDbBVNF":
            self.garbled += 1
        return None

    def _read(self, timeout: float | None) -> str | None:
        """One line for python-can's own `recv`, from the same block buffer."""
        end = time.monotonic() + (3600.0 if timeout is None else timeout)
        while not self._backlog:
            left = end - time.monotonic()
            self._backlog += self._lines(left)
            if left <= 0:
                break
        return self._backlog.pop(0).decode("latin-1") + "\r" if self._backlog else None


class SlcanLink:
    """A `FrameLink` over `SlcanBus`, with errors in words."""

    def __init__(self, bus: SlcanBus, name: str, lock: int) -> None:
        self._bus = bus
        self._lock = lock
        self.name = name
        self._closed = False

    @property
    def hint(self) -> str:
        if self._bus.answers or self._bus.errors:
            return "the adapter itself answers"
        return "the adapter itself answered nothing: is it an slcan adapter"

    def send(self, *frames: Frame) -> None:
        try:
            self._bus.send_frames(*frames)
        except TimeoutError as error:
            raise LinkTimeout(
                f"the CAN adapter {self.name} takes no more frames: {error}. It hangs, or it is not an slcan "
                "adapter; unplug it, plug it in and start again"
            ) from error
        except OSError as error:
            raise unplugged(self.name, error) from error

    def receive(self, timeout: float) -> list[Frame]:
        try:
            return self._bus.receive_frames(timeout)
        except OSError as error:
            raise unplugged(self.name, error) from error

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        try:
            self._bus.shutdown()
        except (OSError, can.CanError):
            self._bus.serialPortOrig.close()
        finally:
            os.close(self._lock)


def encode(identifier: int, data: bytes) -> bytes:
    """A data frame as slcan text."""
    return b"t%03X%d%s\r" % (identifier, len(data), hexlify(data).upper())


def open_slcan(path: Path, bitrate: int) -> SlcanLink:
    """Opens an slcan adapter and its CAN channel.

    Raises:
        LinkError: no such device, not a serial port, not permitted, in use, or it does not take commands.
    """
    lock = lock_device(path, "the CAN adapter")
    try:
        return SlcanLink(SlcanBus(str(path), bitrate), str(path), lock)
    except (OSError, serial.SerialException, can.CanError, ValueError) as error:
        os.close(lock)
        raise LinkError(
            f"the CAN adapter {path} cannot be opened: {error}. Check that it is an slcan adapter, and plug it "
            "in again"
        ) from error
