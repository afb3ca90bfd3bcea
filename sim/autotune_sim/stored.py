"""What a drive in process has stored: a file in the place of its memory."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path

from autotune.core.errors import ConfigurationError, DriveError
from autotune_sim.parameters import Parameters


def keep(memory: Path, values: Mapping[str, float]) -> None:
    """Writes the memory whole, as a drive with two banks does."""
    memory.parent.mkdir(parents=True, exist_ok=True)
    temporary = memory.with_name(f".{memory.name}.{os.getpid()}.part")
    with temporary.open("w", encoding="utf-8") as file:
        json.dump(dict(values), file, indent=2)
        file.flush()
        os.fsync(file.fileno())
    os.replace(temporary, memory)


def recall(memory: Path | None, parameters: Parameters) -> None:
    """Takes the stored parameters from the memory file, if there is one.

    Raises:
        ConfigurationError: the file cannot be used.
    """
    if memory is None or not memory.is_file():
        return
    try:
        parameters.restore(json.loads(memory.read_text(encoding="utf-8")))
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise ConfigurationError(
            f"the simulated drive's memory {memory} cannot be used ({error}); delete it, and the drive "
            "has its factory settings"
        ) from None


def must_be_kept(stored: Mapping[str, float], now: Mapping[str, float]) -> None:
    """What a driver does after storing: reads again what the memory holds. Raises DriveError."""
    lost = [name for name, value in stored.items() if now[name] != value]
    if lost:
        told = ", ".join(f"{name} is {stored[name]:.9g} instead of {now[name]:.9g}" for name in lost[:3])
        raise DriveError(
            f"the simulated drive has confirmed storing, but {told} in its memory: it does not keep what is "
            "stored. Nothing is kept; have the drive's memory checked"
        )
