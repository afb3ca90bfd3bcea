"""What is told when power is taken off and something is wrong with it."""

from __future__ import annotations

from collections.abc import Callable

from autotune.core.errors import AutotuneError, DriveFault, LinkError

LOOK = "look whether the axis rests, and use the emergency stop if it does not"
MAY_BE_ON = (
    f"its power may still be on, and all that this session has set, its own guard for a silent host too, was left as "
    f"it is: {LOOK}"
)


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


def close_down(
    disable: Callable[[], None],
    restore: Callable[[], list[str]],
    hang_up: Callable[[], None],
    is_lost: Callable[[], bool],
    who: str,
) -> None:
    """The end of a session: power off, everything put back, the link closed whatever happens.

    Args:
        restore: puts back what the session has changed; what it could not, in words.
        is_lost: whether the link was lost before, so that nobody needs to be told once more.
        who: for errors, such as "node 5".

    Raises:
        LinkError: it was not left as it was found. DriveFault: it reported a fault while power was taken off.
    """
    fault: DriveFault | None = None
    try:
        fault = fault_in(disable)
        troubles = restore()
    except LinkError as error:
        troubles = [str(error)]
    finally:
        hang_up()
    if troubles and not is_lost():
        raise LinkError(f"{who} was not left as it was found: {'; '.join(troubles)}")
    if fault is not None:
        raise fault


def tell_unconfirmed(error: LinkError, told: LinkError | None, unsure: bool) -> None:
    """Says that power was not taken off in the usual way: in an error of its own, or beside the one that was told.

    Args:
        error: why not. told: the error that has told of the lost link already.
        unsure: nor in any other way; nobody knows that the axis rests.

    Raises:
        LinkError: nobody has been told yet.
    """
    if told is None and not unsure:
        raise error
    if told is None:
        raise _unconfirmed(error) from error
    if unsure:
        told.add_note(str(_unconfirmed(error)))


def _unconfirmed(error: LinkError) -> LinkError:
    """The error for a drive that went silent while power was taken off: nobody knows that the axis rests."""
    return LinkError(
        f"the end of the motion was not confirmed: {error}. The drive stops its axis by its own guard for a silent "
        f"host; {LOOK}"
    )
