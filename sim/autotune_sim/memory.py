"""Non-volatile memory of the drive: parameters that survive power-off, in one JSON file.

The file is replaced in one step, so that power lost while it is written leaves the old content.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from pathlib import Path

SCHEMA = 1


class Memory:
    """Stored parameters by "index:subindex" in hexadecimal, each as bytes on the wire in hexadecimal.

    Args:
        path: of the state file; None keeps the content only as long as the process lives.
        log: told where the file cannot be used.
        axis: whose memory it is; a file of another axis is not used.
    """

    def __init__(self, path: Path | None, log: Callable[[str], None], axis: str = "") -> None:
        self._path = path
        self._axis = axis
        self._log = log
        self._content: dict[str, str] | None = None
        self.lossy = False

    def read(self) -> dict[tuple[int, int], bytes]:
        """What was stored last; empty where there is nothing or nothing that can be read."""
        if self._content is None:
            self._content = self._load()
        return {_key(name): bytes.fromhex(value) for name, value in self._content.items()}

    def write(self, values: Mapping[tuple[int, int], bytes]) -> None:
        """Replaces the content. A lossy memory says nothing and keeps nothing.

        Raises:
            OSError: the state file cannot be written.
        """
        if self.lossy:
            return
        self._content = {f"{index:04X}:{sub:02X}": data.hex() for (index, sub), data in values.items()}
        if self._path is None:
            return
        temporary = self._path.with_name(self._path.name + ".part")
        document = {"schema": SCHEMA, "axis": self._axis, "parameters": self._content}
        text = json.dumps(document, indent=1, sort_keys=True)
        with temporary.open("w", encoding="ascii") as file:
            file.write(text + "\n")
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(self._path)

    def _load(self) -> dict[str, str]:
        if self._path is None or not self._path.exists():
            return {}
        try:
            document = json.loads(self._path.read_text(encoding="ascii"))
            if document["schema"] != SCHEMA:
                raise ValueError(f"schema {document['schema']}, known is {SCHEMA}")
            if document["axis"] != self._axis:
                raise ValueError(f"it is of axis {document['axis']!r}, this is {self._axis!r}")
            content = {str(name): str(value) for name, value in document["parameters"].items()}
            for name, value in content.items():
                _key(name)
                bytes.fromhex(value)
        except (OSError, ValueError, KeyError, AttributeError, TypeError) as error:
            self._log(f"memory: {self._path} cannot be used ({error}); factory settings instead")
            return {}
        return content


def _key(name: str) -> tuple[int, int]:
    index, _, subindex = name.partition(":")
    return int(index, 16), int(subindex, 16)
