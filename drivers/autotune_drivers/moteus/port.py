"""A serial port that carries the fdcanusb line protocol, through pyserial."""

from __future__ import annotations

import os
import select
import time
from pathlib import Path
from typing import Any

import serial

from autotune.core.errors import LinkError, LinkTimeout
from autotune_drivers.moteus.line import Line, LineReader
from autotune_drivers.serial_device import lock_device

BAUD = 921600
_BLOCK = 65536
_WRITE_TIMEOUT = 1.0
_BURST = 0.005


class MoteusPort:
    """Writes text, reads lines. One thread; every method may raise LinkError when the port is gone."""

    def __init__(self, port: Any, name: str, lock: int) -> None:
        self.name = name
        self.reader = LineReader()
        self._port = port
        self._lock = lock
        self._closed = False
        self._poll = select.poll()
        self._poll.register(port.fileno(), select.POLLIN)

    @property
    def baud(self) -> int:
        return int(self._port.baudrate)

    def write(self, text: bytes) -> None:
        """Raises LinkTimeout: the port takes nothing. LinkError: gone."""
        try:
            self._port.write(text)
        except serial.SerialTimeoutException as error:
            raise LinkTimeout(
                f"the serial port {self.name} has taken nothing for {_WRITE_TIMEOUT:g} s; it hangs. Unplug it, "
                "plug it in and start again"
            ) from error
        except OSError as error:
            raise self._gone(error) from error

    def lines(self, timeout: float) -> list[Line]:
        """All good lines that are complete; waits up to `timeout` seconds for the first bytes."""
        try:
            if not self._poll.poll(max(timeout, 0.0) * 1e3):
                return []
            return self.reader.feed(self._port.read(_BLOCK))
        except OSError as error:
            raise self._gone(error) from error

    def drain(self) -> None:
        """Forgets what is there; a babbling line cannot hold us for more than 5 ms."""
        end = time.monotonic() + _BURST
        while self._poll.poll(0) and time.monotonic() < end:
            self.lines(0.0)

    def close(self) -> None:
        """Lets go of the port. Idempotent, never raises."""
        if self._closed:
            return
        self._closed = True
        try:
            self._port.close()
        except OSError:
            pass  # it is gone already
        finally:
            os.close(self._lock)

    def _gone(self, error: OSError) -> LinkError:
        return LinkError(
            f"the serial port {self.name} is gone ({error.strerror or error}); it was unplugged, or the "
            "simulator ended. The drive stops by its own watchdog. Plug it in and start again"
        )


def open_port(path: Path, baud: int) -> MoteusPort:
    """Opens a serial port for us alone.

    Raises:
        LinkError: no such device, not a serial port, not permitted, in use.
    """
    lock = lock_device(path, "the serial port")
    try:
        port = serial.Serial(str(path), baud, timeout=0, write_timeout=_WRITE_TIMEOUT)
        return MoteusPort(port, str(path), lock)
    except (OSError, ValueError) as error:
        os.close(lock)
        raise LinkError(
            f"the serial port {path} cannot be opened at {baud} baud: {error}. Check that it is the fdcanusb or "
            "the moteus's serial line, and plug it in again"
        ) from error
