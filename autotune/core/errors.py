"""One exception tree; each leaf knows the exit code of the command line.

```
AutotuneError
├── ConfigurationError (ValueError)      2  axis file, profile, option
├── RecordingError (ValueError)          2  a file of measurements, or what is in it
├── NotEnoughExcitation (ValueError)     3  a normal result: the data cannot tell
├── GuardStop                            4  the guard stopped the axis before a limit
├── LinkError (ConnectionError)          5  nobody there, or not what was expected
│   ├── LinkTimeout (TimeoutError)       5
│   ├── HostLate                         5  this host was too slow; nothing else is wrong
│   ├── TransferAborted                  5  an SDO abort, with object and reason
│   └── IdentityMismatch                 5  another drive than the profile is for
├── DriveError                           5
│   ├── DriveFault                       5  the drive reports a fault
│   └── StateError                       5  the state machine does not reach a state
└── Interrupted                        130  a person or a signal ended it; axis at rest
```

A message says what, where, the value, the allowed range, and what to do next. It may quote a file or a wire,
so what a terminal would obey is not in its text, and neither is a book.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

LONGEST_NAME = 40
"""Characters of a name in a message."""
LONGEST_MESSAGE = 6000
"""A page and a half; a service file with twenty wrong axes has 4000."""


def plain(text: str) -> str:
    """The text without control characters but line breaks, cut where nobody reads on."""
    shown = text if len(text) <= LONGEST_MESSAGE else text[: LONGEST_MESSAGE - 1] + "…"
    if shown.isprintable():
        return shown
    return "".join(letter if letter.isprintable() or letter == "\n" else "?" for letter in shown)


class AutotuneError(Exception):
    """Root of every error that a user may see; `exit_code` is the command line's answer."""

    exit_code = 2

    def __str__(self) -> str:
        return plain(super().__str__())


class ConfigurationError(AutotuneError, ValueError):
    """A file or an option says something that is not allowed."""

    exit_code = 2


class RecordingError(AutotuneError, ValueError):
    """A recording cannot be read, or its content cannot be what it says."""

    exit_code = 2


class NotEnoughExcitation(AutotuneError, ValueError):
    """The measurement does not contain what is asked of it. A normal result."""

    exit_code = 3


class GuardStop(AutotuneError):
    """The guard ended an experiment before a limit would have been broken.

    Attributes:
        blind: the position sensor is not to be trusted: a drive that brakes by it may drive its axis instead.
    """

    exit_code = 4
    blind: bool = False


class LinkError(AutotuneError, ConnectionError):
    """The wire, the adapter or the node does not answer as it should."""

    exit_code = 5


class LinkTimeout(LinkError, TimeoutError):
    """No answer within the time allowed."""


class HostLate(LinkError):
    """This host did not keep its time, and the drive has stopped its axis as it should.

    Attributes:
        seconds: how long the drive heard nothing.
    """

    def __init__(self, message: str, seconds: float = 0.0) -> None:
        super().__init__(message)
        self.seconds = seconds

    def __reduce__(self) -> tuple[type[HostLate], tuple[str, float], dict[str, Any]]:
        return type(self), (str(self), self.seconds), self.__dict__


class TransferAborted(LinkError):
    """The drive refused an SDO transfer.

    Attributes:
        code: CiA 301 abort code.
    """

    def __init__(self, message: str, code: int = 0) -> None:
        super().__init__(message)
        self.code = code


class IdentityMismatch(LinkError):
    """The drive that answers is not the one that the profile describes."""


class DriveError(AutotuneError):
    """The drive is there but cannot or may not do what is asked."""

    exit_code = 5


class DriveFault(DriveError):
    """The drive reports a fault.

    Attributes:
        code: error code of object 603F, or 0.
    """

    def __init__(self, message: str, code: int = 0) -> None:
        super().__init__(message)
        self.code = code


class StateError(DriveError):
    """The drive's state machine does not reach the state asked for."""


class Interrupted(AutotuneError):
    """A person or a signal ended the run; the message says whether the drive confirms that power is off."""

    exit_code = 130


def a_few(names: Sequence[str], most: int = 8) -> str:
    """Names in one line of a message: a wrong file may have hundreds.

    >>> a_few(["a", "b", "c"], 2)
    'a, b and 1 more'
    """
    shown = [name if len(name) <= LONGEST_NAME else f"{name[:LONGEST_NAME]}…" for name in names[:most]]
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"{', '.join(shown)}{more}"
