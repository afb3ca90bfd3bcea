"""Serial ports: found, permitted, not in use by anybody else; what is wrong with one, in words."""

from __future__ import annotations

import fcntl
import os
import stat
from pathlib import Path

from autotune.core.errors import LinkError
from autotune_drivers.letting_go import when_let_go


def lock_device(path: Path, what: str) -> int:
    """Takes a device for us alone, before a single byte could disturb who has it now.

    Waits a little for a process that is about to end.

    Args:
        what: how errors call it ("the CAN adapter").

    Returns:
        The descriptor that holds the lock; to be closed.

    Raises:
        LinkError: no such device, not a serial port, not permitted, or in use.
    """
    _check(path, what)
    descriptor = -1
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        when_let_go(lambda: fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB))
    except OSError as error:
        if descriptor >= 0:
            os.close(descriptor)
        raise LinkError(
            f"{what} {path} is in use or broken: {error.strerror}. Stop the other program that uses it "
            "(another autotune, a terminal, a modem manager) and start again"
        ) from error
    return descriptor


def _check(path: Path, what: str) -> None:
    try:
        mode = path.stat().st_mode
    except PermissionError as error:
        raise LinkError(f"{what} {path} may not be looked at: {error}. Ask for the right") from error
    except OSError as error:
        raise LinkError(_missing(path, what)) from error
    if not stat.S_ISCHR(mode):
        raise LinkError(f"{path} is not a serial port; name the device in the link{_candidates()}")
    if not os.access(path, os.R_OK | os.W_OK):
        raise LinkError(
            f"{what} {path} may not be used by this user; add the user to the group that owns it "
            "(on Debian: 'adduser NAME dialout', then log in again)"
        )


def _missing(path: Path, what: str) -> str:
    if path.is_symlink():
        return (
            f"{what} {path} points to {os.readlink(path)}, which is gone: the simulator has ended. "
            "Start it again with 'autotune sim AXIS.toml'"
        )
    return (
        f"there is no {what.removeprefix('the ')} {path}; check that it is plugged in and the name in the link"
        f"{_candidates()}. A simulated drive is started with 'autotune sim AXIS.toml'"
    )


def _candidates() -> str:
    found = sorted(str(port) for pattern in ("ttyACM*", "ttyUSB*") for port in Path("/dev").glob(pattern))
    return f" (serial ports here: {', '.join(found)})" if found else " (no USB serial port is plugged in)"
