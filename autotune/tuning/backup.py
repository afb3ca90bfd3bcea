"""Backups of what a drive held before something was written to it; each with a checksum."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from autotune.core.documents import numbers_of, texts_of
from autotune.core.durable import read_checked, write_checked
from autotune.core.errors import ConfigurationError
from autotune.tuning.files import stamp_after

SCHEMA_VERSION = 1


@dataclass(frozen=True, slots=True)
class Backup:
    """Parameters of one drive at one time. `identity` tells drives of the same axis name apart.

    `alignment`: what moves the zero from which the drive counts a turn, where it holds torque over position.
    """

    id: str
    axis: str
    taken: str
    identity: Mapping[str, int | str]
    parameters: Mapping[str, float]
    alignment: Mapping[str, float] = field(default_factory=dict)


def take_backup(
    store: Path,
    axis: str,
    identity: Mapping[str, int | str],
    parameters: Mapping[str, float],
    now: datetime,
    alignment: Mapping[str, float] | None = None,
) -> Backup:
    """Writes a backup below `store` and reads it back before anything may rely on it.

    Raises:
        ConfigurationError: it cannot be written, or the drive holds what is no number.
    """
    folder = store / "backups" / axis
    folder.mkdir(parents=True, exist_ok=True)
    stamp = stamp_after(backup_ids(store, axis), now)
    backup = Backup(
        f"{stamp}-1",
        axis,
        now.isoformat(timespec="seconds"),
        dict(identity),
        dict(parameters),
        dict(alignment or {}),
    )
    content = {
        "schema": SCHEMA_VERSION,
        "axis": axis,
        "taken": backup.taken,
        "identity": dict(identity),
        "parameters": dict(parameters),
    } | ({"alignment": dict(alignment)} if alignment else {})
    path = folder / f"{backup.id}.json"
    try:
        write_checked(path, content)
    except (OSError, ValueError) as error:
        raise ConfigurationError(
            f"the backup {path} cannot be written ({error}); nothing was changed in the drive. Make room or give write "
            "access there; a value that is no number must be set at the drive first"
        ) from error
    return load_backup(store, axis, backup.id)


def load_backup(store: Path, axis: str, identifier: str) -> Backup:
    """Reads a backup.

    Raises:
        ConfigurationError: no such backup (the ids there are named), or its checksum does not match.
    """
    path = store / "backups" / axis / f"{identifier}.json"
    if identifier not in backup_ids(store, axis):
        there = ", ".join(backup_ids(store, axis)[-5:]) or "none"
        raise ConfigurationError(f"there is no backup {identifier!r} of axis {axis}; there are: {there}")
    try:
        content = read_checked(path, "backup")
        texts = texts_of(content, "axis", "taken")
        parameters, identity = numbers_of(content["parameters"]), dict(content["identity"])
        alignment = numbers_of(content.get("alignment", {}))
        return Backup(identifier, texts["axis"], texts["taken"], identity, parameters, alignment)
    except (ConfigurationError, KeyError, TypeError, ValueError) as error:
        raise ConfigurationError(
            f"backup {path} is damaged and is not used ({error}); choose another one with --to"
        ) from error


def backup_ids(store: Path, axis: str) -> list[str]:
    """Ids of the backups of an axis, oldest first."""
    return sorted(path.stem for path in (store / "backups" / axis).glob("[0-9]*.json"))
