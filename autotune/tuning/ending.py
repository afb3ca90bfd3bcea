"""How a run that did not come to its end by itself is told: what is in the drive first, then what went wrong."""

from __future__ import annotations

from autotune.core.errors import AutotuneError, Interrupted, NotEnoughExcitation
from autotune.tuning.outcome import Outcome

KEPT = "Kept: the drive holds the proved parameters. But after that"


class KeptBut(AutotuneError):
    """The parameters were kept, and something went wrong after that; its exit code is that of what did."""

    def __init__(self, message: str, exit_code: int) -> None:
        super().__init__(message)
        self.exit_code = exit_code


def ending(error: BaseException, kept: bool) -> tuple[Outcome, str]:
    """Outcome and verdict of a run that `error` has ended; `kept`: after the drive had kept the parameters."""
    notes = "; ".join(getattr(error, "__notes__", []))
    message = _in_words(error) + (f" ({notes})" if notes else "")
    if kept:
        return Outcome.KEPT, f"{KEPT}: {message}"
    if isinstance(error, NotEnoughExcitation):
        if notes:  # of settings that are not as before, so that "nothing" would say too much
            return (
                Outcome.NOT_APPLIED,
                f"No parameters were applied: {_in_words(error).rstrip('.')}. But beside that: {notes}",
            )
        return Outcome.NOT_APPLIED, f"Nothing was applied: {message}"
    if isinstance(error, (Interrupted, KeyboardInterrupt)):
        return Outcome.ABORTED, f"Stopped: {message}"
    return Outcome.ABORTED, f"The run was stopped: {message}"


def is_beside(error: BaseException, kept: bool) -> bool:
    """A kept commit is what was asked for; that the disk does not take what is written about it is said beside it."""
    return kept and isinstance(error, OSError) and not isinstance(error, AutotuneError)


def to_raise(error: BaseException, verdict: str) -> BaseException:
    """What the caller of a run gets that had kept its parameters: `verdict`, which tells both."""
    if isinstance(error, KeyboardInterrupt):
        return Interrupted(verdict)
    return KeptBut(verdict, getattr(error, "exit_code", KeptBut.exit_code))


def _in_words(error: BaseException) -> str:
    if isinstance(error, KeyboardInterrupt):
        return "interrupted before the drive was opened"
    if isinstance(error, OSError) and not isinstance(error, AutotuneError):
        return f"{error.strerror or error}" + (f": {error.filename}" if error.filename else "")
    return str(error)
