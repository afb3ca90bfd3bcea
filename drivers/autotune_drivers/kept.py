"""What a session is about to change in a drive, on disk before it is changed.

A folder for each axis, a file in it for each drive (vendor, product, serial number), there while anything of
that drive may be changed. Both processes of a run may die, or the link may be lost: the next session on that
drive finds the file and puts back what is in it. Another drive in its place finds no file, and is left alone.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from autotune.core.durable import read_checked, remove, write_checked
from autotune.core.errors import ConfigurationError

SCHEMA_VERSION = 1
_WHO = ("vendor", "product", "serial")


@dataclass(frozen=True, slots=True)
class Keeper:
    """The file of one drive."""

    path: Path
    identity: Mapping[str, int | str]

    @classmethod
    def of(cls, folder: Path, identity: Mapping[str, int | str]) -> Keeper:
        """The file of the drive that has said who it is."""
        name = "-".join(re.sub(r"[^0-9A-Za-z]+", "_", str(identity.get(key, "none"))) for key in _WHO)
        return cls(folder / f"{name}.json", dict(identity))

    def read(self) -> dict[str, Any] | None:
        """What an earlier session has left; None where it left nothing.

        Raises:
            ConfigurationError: damaged.
        """
        if not self.path.exists():
            return None
        try:
            content = read_checked(self.path, "session file")
        except ConfigurationError as error:
            raise self.damaged(error) from error
        if content.get("schema") != SCHEMA_VERSION:
            raise ConfigurationError(
                f"session file {self.path} has the schema {content.get('schema')!r}, known is {SCHEMA_VERSION}; use "
                "the autotune that wrote it"
            )
        return content

    def damaged(self, error: Exception) -> ConfigurationError:
        """The error for a file that says what nobody can use."""
        return ConfigurationError(
            f"{error}. An earlier session may have left communication settings of this drive changed ({self.path}); "
            "nothing was written. Switch the drive off and on, which brings back what it has stored, then delete that "
            "file"
        )

    def write(self, content: Mapping[str, Any]) -> None:
        """Notes what is or will be changed.

        Raises:
            ConfigurationError: the disk does not take it; then it must not be changed.
        """
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_checked(self.path, {"schema": SCHEMA_VERSION, "identity": dict(self.identity), **content})
        except OSError as error:
            raise ConfigurationError(
                f"{self.path} cannot be written ({error.strerror}); what cannot be noted is not changed in the drive. "
                "Make room or give write access there"
            ) from error

    def clear(self) -> None:
        """Everything is as it was. A file that cannot be removed says what is so already."""
        with suppress(OSError):
            remove(self.path)

    def others(self) -> list[str]:
        """What is still to be put back in other drives of this axis, in words."""
        found = sorted(path for path in self.path.parent.glob("*.json") if path != self.path)
        return [
            f"a session on another drive of this axis has ended without putting its settings back ({path.stem}, which "
            "are vendor, product and serial number). They are put back when that drive is connected again; where it "
            f"will not be, delete {path}"
            for path in found
        ]
