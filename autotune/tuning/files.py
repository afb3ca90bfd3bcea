"""Files of the service: durable JSON (see `core.durable`), stamps that sort, locks that go with a process."""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from datetime import datetime, timedelta
from pathlib import Path

from autotune.core.documents import finite as finite
from autotune.core.durable import checksum as checksum
from autotune.core.durable import read_json as read_json
from autotune.core.durable import write_json as write_json
from autotune.core.errors import ConfigurationError

_FORMAT = "%Y%m%d-%H%M%S"


def stamp_after(present: Iterable[str], now: datetime) -> str:
    """`YYYYMMDD-HHMMSS` of now; where the clock was put back, a second after the latest of those present.

    Names that begin with it sort in the order in which they were made, whatever the clock does.
    """
    stamp = now.strftime(_FORMAT)
    for name in sorted(present, reverse=True):
        if name[: len(stamp)] < stamp:
            break
        with suppress(ValueError, OverflowError):  # somebody else's name
            return (datetime.strptime(name[: len(stamp)], _FORMAT) + timedelta(seconds=1)).strftime(_FORMAT)
    return stamp


@contextmanager
def file_lock(path: Path, *, unusable: str, taken: str) -> Iterator[None]:
    """Holds a file for this process; the lock goes with the process, however it ends.

    Args:
        path: of the lock file; its folder is made where it is missing.
        unusable: what to do where the folder cannot be used.
        taken: the sentence where another process has it; `{owner}` stands for that process.

    Raises:
        ConfigurationError: the folder cannot be used, or another process has the lock.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
    except OSError as error:
        raise ConfigurationError(
            f"the folder {path.parent} cannot be used ({error.strerror}); {unusable}"
        ) from error
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.pread(descriptor, 32, 0).decode(errors="replace").strip()
            raise ConfigurationError(taken.replace("{owner}", owner or "unknown")) from None
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
        yield
    finally:
        os.close(descriptor)
