"""What is told when power is taken off and something is wrong with it."""

from __future__ import annotations

from collections.abc import Callable

from autotune.core.errors import AutotuneError, DriveFault, LinkError


def off_after(error: BaseException, disable: Callable[[], None]) -> None:
    """Power off because of `error`, which stays the one that is told; what `disable` says is added to it."""
    try:
        disable()
    except AutotuneError as second:
        error.add_note(f"and while power was taken off: {second}")


def fault_in(disable: Callable[[], None]) -> DriveFault | None:
    """The fault that came with taking power off, so that the rest can be put back first."""
    try:
        disable()
    except DriveFault as fault:
        return fault
    return None


def unconfirmed(error: LinkError) -> LinkError:
    """The error for a drive that went silent while power was taken off: nobody knows that the axis rests."""
    return LinkError(
        f"the end of the motion was not confirmed: {error}. The drive stops its axis by its own guard for a silent "
        "host; look whether the axis rests, and use the emergency stop if it does not"
    )
