"""One owner per drive on this machine: the service, or one command of the command line.

The owner holds a lock file named after the drive's place on its link, in a folder that all programs of
the machine share. The lock is the kernel's (flock): it goes with the process, however that ends. What is
in the file says who it is and, for a service, where it can be asked.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qsl, urlsplit

from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError

SHARED = Path("/run/lock")
ALONE = ("sim", "canopen+socketcan")
"""Schemes on which jobs of several axes can run at the same time."""


@dataclass(frozen=True, slots=True)
class Key:
    """`drive`: which node on which link; `bus`: what only one process at a time can open."""

    drive: str
    bus: str


@dataclass(frozen=True, slots=True)
class Owner:
    """Who holds a drive. `address` is empty where it cannot be asked."""

    process: int
    what: str
    address: str = ""
    token_file: str = ""


def key_of(axis: Axis, axis_file: Path) -> Key:
    """Where the axis's drive is, the same for every way of writing it."""
    scheme, _, _ = axis.link.partition(":")
    if scheme == "sim":
        place = f"sim:{axis_file.resolve()}"
        return Key(place, place)
    parts = urlsplit(axis.link)
    target = parts.path if parts.path and not parts.netloc else parts.netloc + parts.path
    if parts.path and not parts.netloc:
        target = _device(axis_file.resolve().parent / target.lstrip() if target[:1] != "/" else Path(target))
    query = dict(parse_qsl(parts.query))
    node = query.get("node") or query.get("id") or ""
    drive = f"{scheme}:{target}#{node}"
    return Key(drive, drive if scheme in ALONE else f"{scheme}:{target}")


def _device(path: Path) -> str:
    """Names below /dev are resolved (by-id is the same device), others may be links that move."""
    return os.path.realpath(path) if path.is_relative_to("/dev") else os.path.abspath(path)


def lock_folder() -> Path:
    """Where the lock files are: shared by all users where the system has such a place."""
    if os.environ.get("AUTOTUNE_LOCKS"):
        return Path(os.environ["AUTOTUNE_LOCKS"])
    return SHARED if os.access(SHARED, os.W_OK) else Path(tempfile.gettempdir())


def owner_of(key: Key) -> Owner | None:
    """Who holds the drive now; None where nobody does."""
    path = _path(key)
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _read(descriptor)
    else:
        return None
    finally:
        os.close(descriptor)


class Ownership:
    """A drive that is held. Release it with `release`; the end of the process does it as well."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor = descriptor

    @classmethod
    def take(cls, key: Key, name: str, owner: Owner) -> Ownership:
        """Takes a drive.

        Raises:
            ConfigurationError: another process has it; says which.
        """
        descriptor = _open(_path(key))
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            other = _read(descriptor)
            os.close(descriptor)
            raise ConfigurationError(
                f"axis {name} is held by {other.what or 'another program'} (process {other.process or 'unknown'})"
                f"{' at ' + other.address if other.address else ''}; wait until it has ended, or stop it"
            ) from None
        held = cls(descriptor)
        held.say(owner)
        return held

    def say(self, owner: Owner) -> None:
        """Writes who holds it."""
        text = json.dumps(
            {
                "process": owner.process,
                "what": owner.what,
                "address": owner.address,
                "token_file": owner.token_file,
            }
        )
        os.ftruncate(self._descriptor, 0)
        os.pwrite(self._descriptor, text.encode(), 0)

    def release(self) -> None:
        """Lets go. Idempotent."""
        if self._descriptor >= 0:
            os.ftruncate(self._descriptor, 0)
            os.close(self._descriptor)
            self._descriptor = -1


@contextmanager
def owned(axis: Axis, axis_file: Path, what: str) -> Iterator[None]:
    """Holds the axis's drive for a command of the command line.

    Raises:
        ConfigurationError: another process has it.
    """
    held = Ownership.take(key_of(axis, axis_file), axis.name, Owner(os.getpid(), what))
    try:
        yield
    finally:
        held.release()


def _path(key: Key) -> Path:
    return lock_folder() / f"autotune-{hashlib.sha256(key.drive.encode()).hexdigest()[:20]}.lock"


def _open(path: Path) -> int:
    """Opens the lock file; one that another user made is not created anew (sticky folders forbid that)."""
    with suppress(OSError):
        return os.open(path, os.O_RDWR | os.O_CLOEXEC)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    except OSError as error:
        raise ConfigurationError(
            f"the lock file {path} cannot be used ({error.strerror}); check the rights on {path.parent}"
        ) from error
    with suppress(OSError):
        os.fchmod(descriptor, 0o666)
    return descriptor


def _read(descriptor: int) -> Owner:
    try:
        content = json.loads(os.pread(descriptor, 4096, 0).decode() or "{}")
        return Owner(
            int(content.get("process", 0)),
            str(content.get("what", "")),
            str(content.get("address", "")),
            str(content.get("token_file", "")),
        )
    except (ValueError, TypeError, AttributeError):
        return Owner(0, "")
