"""Files that must survive a crash in any line: written whole, synced, then renamed."""

from __future__ import annotations

import fcntl
import hashlib
import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

from autotune.core.errors import ConfigurationError

_FORMAT = "%Y%m%d-%H%M%S"


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Writes `content` so that a reader sees the old file or the new one, also after a power cut."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    with temporary.open("w", encoding="utf-8") as file:
        json.dump(content, file, indent=2, allow_nan=False)
        file.write("\n")
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, path)
    _sync_directory(path.parent)


def read_json(path: Path, kind: str) -> dict[str, Any]:
    """Reads a JSON object.

    Raises:
        ConfigurationError: missing, unreadable or not an object; `kind` names it in the message.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ConfigurationError(f"there is no {kind} {path}") from None
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{kind} {path} is damaged: {error}") from error
    if not isinstance(content, dict):
        raise ConfigurationError(
            f"{kind} {path} is damaged: it holds {type(content).__name__}, not an object"
        )
    return content


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


def checksum(content: dict[str, Any]) -> str:
    """SHA-256 of a JSON object in canonical form."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, allow_nan=False).encode()).hexdigest()


def _sync_directory(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def finite(value: Any) -> Any:
    """The same with nan and infinities replaced by None, recursively: JSON knows neither."""
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


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
