"""Files that must survive a crash in any line: written whole, synced, then renamed; read with suspicion."""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import suppress
from pathlib import Path
from typing import Any

from autotune.core.documents import parse_json, read_limited
from autotune.core.errors import ConfigurationError

CHECKSUM = "checksum"


def write_json(path: Path, content: dict[str, Any]) -> None:
    """Writes `content` so that a reader sees the old file or the new one, also after a power cut.

    Raises:
        OSError: it could not be written; the old file is as it was.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with temporary.open("w", encoding="utf-8") as file:
            json.dump(content, file, indent=2, allow_nan=False)
            file.write("\n")
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise
    _sync_directory(path.parent)


def write_checked(path: Path, content: dict[str, Any]) -> None:
    """As `write_json`, with a checksum that `read_checked` asks for. Raises OSError."""
    write_json(path, content | {CHECKSUM: checksum(content)})


def read_json(path: Path, kind: str) -> dict[str, Any]:
    """Reads a JSON object.

    Raises:
        ConfigurationError: missing, unreadable, not an object, too large or too deep, or with a number that is
            not finite; `kind` names it in the message.
    """
    try:
        content = parse_json(read_limited(path))
    except FileNotFoundError:
        raise ConfigurationError(f"there is no {kind} {path}") from None
    except (OSError, ValueError) as error:
        raise ConfigurationError(f"{kind} {path} is damaged: {error}") from error
    if not isinstance(content, dict):
        raise ConfigurationError(
            f"{kind} {path} is damaged: it holds {type(content).__name__}, not an object"
        )
    return content


def read_checked(path: Path, kind: str) -> dict[str, Any]:
    """Reads what `write_checked` wrote, without the checksum.

    Raises:
        ConfigurationError: as `read_json`, or the checksum does not match.
    """
    content = read_json(path, kind)
    stated = content.pop(CHECKSUM, "")
    if checksum(content) != stated:
        raise ConfigurationError(f"{kind} {path} is damaged: it does not match its checksum")
    return content


def checksum(content: dict[str, Any]) -> str:
    """SHA-256 of a JSON object in canonical form."""
    return hashlib.sha256(json.dumps(content, sort_keys=True, allow_nan=False).encode()).hexdigest()


def remove(path: Path) -> None:
    """Removes a file for good, also after a power cut; one that is not there is no error. Raises OSError."""
    path.unlink(missing_ok=True)
    _sync_directory(path.parent)


def _sync_directory(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
