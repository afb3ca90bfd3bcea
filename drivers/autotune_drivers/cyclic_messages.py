"""What the cyclic process and its owner say to each other, and what a drive must offer to be served."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from autotune.core.drive import Drive
from autotune.core.errors import AutotuneError
from autotune.core.loop import Routine


class LinkedDrive(Drive, Protocol):
    """A drive on a real link."""

    lock_step: bool

    def backup(self) -> Any:
        """What `close` will put back; picklable, handed to the opener of the next process."""

    def idle(self) -> None:
        """Called every few milliseconds between routines. Raises LinkError."""


class Opener(Protocol):
    """Opens the drive inside the cyclic process; picklable. Raises AutotuneError."""

    def __call__(self, backup: Any = None) -> LinkedDrive: ...


@dataclass(frozen=True, slots=True)
class Call:
    """A method of the drive, by name."""

    method: str
    arguments: tuple[Any, ...] = ()


@dataclass(frozen=True, slots=True)
class Play:
    routine: Routine[Any]


@dataclass(frozen=True, slots=True)
class Opened:
    """The drive is open. `priority` says in words how the process is scheduled."""

    period: float
    identity: Mapping[str, int | str]
    priority: str
    backup: Any


@dataclass(frozen=True, slots=True)
class Returned:
    value: Any
    backup: Any = None


@dataclass(frozen=True, slots=True)
class Failed:
    error: Exception
    backup: Any = None


@dataclass(frozen=True, slots=True)
class Ended:
    """The last word of the process: the drive is closed, asked for or because it was terminated.

    A message of its own, so that nobody takes it for the answer to a request that came too late.
    `backup` is None where every changed setting was put back, `error` says what was not.
    """

    error: AutotuneError | None
    backup: Any = None


Reply = Opened | Returned | Failed | Ended
