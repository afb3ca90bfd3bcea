"""One exception tree; each leaf knows the exit code of the command line.

```
AutotuneError
├── ConfigurationError (ValueError)      2  axis file, profile, option
├── RecordingError (ValueError)          2  a file of measurements, or what is in it
├── NotEnoughExcitation (ValueError)     3  a normal result: the data cannot tell
├── GuardStop                            4  the guard stopped the axis before a limit
├── LinkError (ConnectionError)          5  nobody there, or not what was expected
│   ├── LinkTimeout (TimeoutError)       5
│   ├── TransferAborted                  5  an SDO abort, with object and reason
│   └── IdentityMismatch                 5  another drive than the profile is for
├── DriveError                           5
│   ├── DriveFault                       5  the drive reports a fault
│   └── StateError                       5  the state machine does not reach a state
└── Interrupted                        130  a person or a signal ended it; axis at rest
```

A message says what, where, the value, the allowed range, and what to do next.
"""

from __future__ import annotations


class AutotuneError(Exception):
    """Root of every error that a user may see; `exit_code` is the command line's answer."""

    exit_code = 2


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
    """The guard ended an experiment before a limit would have been broken."""

    exit_code = 4


class LinkError(AutotuneError, ConnectionError):
    """The wire, the adapter or the node does not answer as it should."""

    exit_code = 5


class LinkTimeout(LinkError, TimeoutError):
    """No answer within the time allowed."""


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
    """A person or a signal ended the run; the axis is at rest and without power."""

    exit_code = 130
