"""What the cyclic process and its owner say to each other, and what a drive must offer to be served."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol

from autotune.core.drive import Drive
from autotune.core.errors import AutotuneError
from autotune.core.loop import Routine

STEPS_WITHIN = 5.0
"""Longest time between two steps, or two looks for a request [s]; a cycle has 10 ms at most."""
SWITCHES_WITHIN = 60.0
"""Longest time for power on or off, alignment of the motor and the stop included [s]."""
ANSWERS_WITHIN = 90.0
"""Longest time for one call at rest, storing and fetching a recorder included [s]."""
PREPARES_WITHIN = 180.0
"""Longest time until a routine that was sent is imported, compiled and begun [s]."""


class LinkedDrive(Drive, Protocol):
    """A drive on a real link.

    It may have `left`, sentences on what earlier sessions had left and was put right, and `powered()`, which asks
    the drive: True, False, or None where it does not answer.
    """

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
    """The drive is open. `priority` says in words how the process is scheduled; `left`: see `LinkedDrive`.

    In every reply `power` is what the drive has told of its power just before; None: it was not asked, or is silent.
    """

    period: float
    identity: Mapping[str, int | str]
    priority: str
    backup: Any
    left: tuple[str, ...] = ()
    power: bool | None = None


@dataclass(frozen=True, slots=True)
class Returned:
    value: Any
    backup: Any = None
    power: bool | None = None


@dataclass(frozen=True, slots=True)
class Failed:
    error: Exception
    backup: Any = None
    power: bool | None = None


@dataclass(frozen=True, slots=True)
class Ended:
    """The last word of the process: the drive is closed, asked for or because it was terminated.

    A message of its own, so that nobody takes it for the answer to a request that came too late.
    `backup` is None where every changed setting was put back, `error` says what was not.
    """

    error: AutotuneError | None
    backup: Any = None
    power: bool | None = None


Reply = Opened | Returned | Failed | Ended
