"""A drive without a wire for tests of the cyclic process: it counts, and can be told to misbehave."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from autotune.core.drive import Command, Mode, Sample, Standing
from autotune.core.errors import LinkError, StateError

SILENT = "silent"
"""A file in a drive's folder: nobody answers as long as it is there."""


@dataclass
class FakeDrive:
    """Notes power and restoring in files, so that tests see them from another process."""

    directory: Path
    inherited: Any = None
    lock_step: bool = True
    pause: float = 0.0
    closing: float = 0.0
    power: bool | None = False
    period: float = 1e-3
    identity: Mapping[str, int | str] = field(default_factory=lambda: {"vendor": 1, "product": 2})

    def __post_init__(self) -> None:
        self._count = 0
        self._power = False
        self._parameters = {"controller.kp": 60.0}
        self._note("opened" if self.inherited is None else "inherited")

    def _note(self, text: str) -> None:
        with (self.directory / "log").open("a") as file:
            file.write(text + "\n")

    def look(self) -> Standing:
        return Standing(float(self._count), 0.0)

    def enable(self, mode: Mode) -> None:
        self._power = True
        self._note("on")

    def step(self, command: Command) -> Sample:
        if not self._power:
            raise StateError("power is off")
        if self.pause:
            time.sleep(self.pause)
        self._count += 1
        position = float(self._count)
        return Sample(self._count * 1e-3, position, position, 0.0, 0.0, 0.0, 0.0, 0.0, 20.0, 0)

    def disable(self) -> None:
        if self._power:
            self._power = False
            self._note("off")

    def read_parameters(self, names: Sequence[str] | None = None) -> dict[str, float]:
        return {name: self._parameters[name] for name in names or self._parameters}

    def write_parameters(self, values: Mapping[str, float]) -> None:
        self._parameters.update(values)

    def store(self) -> None:
        self._note("stored")

    def faults(self) -> list[str]:
        return []

    def powered(self) -> bool | None:
        return self.power

    def idle(self) -> None:
        return

    def backup(self) -> Any:
        return {"old": 1}

    def close(self) -> None:
        self.disable()
        time.sleep(self.closing)
        self._note("closed")


@dataclass(frozen=True)
class FakeOpener:
    """Opens the drive, unless a file `SILENT` is in its folder."""

    directory: Path
    pause: float = 0.0
    closing: float = 0.0
    error: str = ""
    power: bool | None = False

    def __call__(self, backup: Any = None) -> FakeDrive:
        if self.error:
            raise LinkError(self.error)
        if (self.directory / SILENT).exists():
            raise LinkError("nobody answers")
        return FakeDrive(self.directory, backup, pause=self.pause, closing=self.closing, power=self.power)

    @property
    def log(self) -> list[str]:
        return (self.directory / "log").read_text().split()
