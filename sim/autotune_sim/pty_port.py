"""A serial port that is not there: a pseudo-terminal in raw mode, with a symbolic link to find it by.

The link is replaced in one step where it is one of ours, left alone where it is anything else, and
removed at the end. That no other simulated drive serves the same path is held by an abstract socket,
which dies with its process.
"""

from __future__ import annotations

import hashlib
import os
import socket
import termios
import tty
from contextlib import suppress
from pathlib import Path

from autotune.core.errors import ConfigurationError

_READ = 65536
_TERMINALS = "/dev/pts/"


class PtyPort:
    """Host's serial port at `path`; nothing is opened before `plug`."""

    def __init__(self, path: Path) -> None:
        self.path = Path(os.path.abspath(path))
        self.device = ""
        self._master = -1
        self._slave = -1
        self._lock: socket.socket | None = None

    @property
    def plugged(self) -> bool:
        return self._master >= 0

    def fileno(self) -> int:
        return self._master

    def plug(self) -> None:
        """Opens the pseudo-terminal and sets the link.

        Raises:
            ConfigurationError: something that must not be replaced is in the way, another simulated
                drive has the path, or the folder cannot be written.
        """
        self._reserve()
        try:
            self._check_path()
            self._master, self._slave = os.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self._master, False)
            self.device = os.ttyname(self._slave)
            self._link()
        except OSError as error:
            self.unplug()
            raise ConfigurationError(
                f"port {self.path} of the simulated drive cannot be made: {error}; choose another path"
            ) from error
        except ConfigurationError:
            self.unplug()
            raise

    def unplug(self) -> None:
        """Closes the pseudo-terminal and removes the link if it is still ours. Idempotent."""
        if self.device:
            with suppress(OSError):
                if os.readlink(self.path) == self.device:
                    self.path.unlink()
        for descriptor in (self._master, self._slave):
            if descriptor >= 0:
                os.close(descriptor)
        self._master = self._slave = -1
        self.device = ""
        if self._lock is not None:
            self._lock.close()
            self._lock = None

    def read(self) -> bytes:
        """What the host has written; empty where there is nothing."""
        try:
            return os.read(self._master, _READ)
        except BlockingIOError:
            return b""

    def write(self, data: bytearray) -> None:
        """Writes as much as the host's buffer takes and removes it from `data`."""
        with suppress(BlockingIOError):
            written = os.write(self._master, data)
            del data[:written]

    def speed(self) -> int:
        """The line's speed as the host has set it, as a `termios` constant."""
        return int(termios.tcgetattr(self._slave)[5])

    def discard(self) -> None:
        """Throws away what the host has not read yet."""
        termios.tcflush(self._slave, termios.TCIFLUSH)

    def _reserve(self) -> None:
        digest = hashlib.sha256(str(self.path.parent.resolve() / self.path.name).encode()).hexdigest()
        lock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        try:
            lock.bind(f"\0autotune-sim-{digest[:32]}")
        except OSError:
            lock.close()
            raise ConfigurationError(
                f"another simulated drive already serves {self.path}; stop it or choose another path"
            ) from None
        self._lock = lock

    def _check_path(self) -> None:
        if self.path.is_symlink():
            target = os.readlink(self.path)
            if not target.startswith(_TERMINALS):
                raise ConfigurationError(
                    f"port {self.path} is a link to {target}, which is not a simulated drive's; "
                    "remove it or choose another path"
                )
        elif self.path.exists():
            raise ConfigurationError(
                f"port {self.path} exists and is not a link of a simulated drive; "
                "remove it or choose another path"
            )
        if not self.path.parent.is_dir():
            raise ConfigurationError(
                f"there is no folder {self.path.parent} for port {self.path.name}; make it"
            )

    def _link(self) -> None:
        temporary = self.path.with_name(f".{self.path.name}.{os.getpid()}")
        with suppress(FileNotFoundError):
            temporary.unlink()
        temporary.symlink_to(self.device)
        temporary.replace(self.path)
