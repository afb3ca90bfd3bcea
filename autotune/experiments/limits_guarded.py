"""Sets the drive's own limits before experiments and restores them afterwards, whatever happens.

The drive gets the tighter of its own limit and the axis file's: nothing is ever widened. The values
before are handed to `journal` before anything is written, so that a killed run can be put right.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

from autotune.core.axis import Axis, Limits
from autotune.core.errors import AutotuneError, ConfigurationError, DriveError
from autotune.core.loop import Loop

PREFIX = "limit."
LOWER, UPPER = "position_min", "position_max"
NAMES = (LOWER, UPPER, "speed", "torque", "following_error")
AGREES = 1e-6  # relative


@dataclass(frozen=True, slots=True)
class LimitsInForce:
    """`limits` for guard and experiments; `before`, the drive's values by name, that are put back."""

    limits: Limits
    before: Mapping[str, float]


@contextmanager
def limits_guarded(
    loop: Loop, axis: Axis, journal: Callable[[Mapping[str, float]], None] | None = None
) -> Iterator[LimitsInForce]:
    """Holds the drive to the axis's limits inside the `with` block.

    Args:
        loop: of the drive, at rest.
        axis: its limits.
        journal: called once with the values that will be changed, before they are.

    Raises:
        ConfigurationError: drive and axis file leave no travel, or the drive allows no motion at all.
        DriveError: the limits could not be put back (after a block that ended well; otherwise the
            block's own error gets a note).
    """
    drive = {name: value for name, value in loop.read_parameters().items() if name.startswith(PREFIX)}
    limits = tighter(axis.limits, drive)
    wanted = {f"{PREFIX}{name}": float(getattr(limits, name)) for name in NAMES}
    changes = {name: wanted[name] for name in drive if name in wanted and _differs(drive[name], wanted[name])}
    before = {name: drive[name] for name in changes}
    if journal is not None and before:
        journal(before)
    try:
        if changes:
            loop.write_parameters(changes)
        yield LimitsInForce(limits, before)
    except BaseException as error:
        if problem := _restore(loop, before):
            error.add_note(problem)
        raise
    if problem := _restore(loop, before):
        raise DriveError(problem)


def tighter(limits: Limits, drive: Mapping[str, float]) -> Limits:
    """Axis limits narrowed by what the drive has; a drive whose travel is empty or not a number has none.

    Raises:
        ConfigurationError: what is left allows no motion.
    """
    low, high = (drive.get(f"{PREFIX}{name}", math.nan) for name in (LOWER, UPPER))
    values: dict[str, float] = {}
    if low < high:
        values = {LOWER: max(limits.position_min, low), UPPER: min(limits.position_max, high)}
        if values[LOWER] >= values[UPPER]:
            raise ConfigurationError(
                f"the drive's travel {low:g} to {high:g} and the axis file's {limits.position_min:g} to "
                f"{limits.position_max:g} have nothing in common; correct limits.position_min and "
                "limits.position_max"
            )
    for name in NAMES[2:]:
        own = drive.get(f"{PREFIX}{name}", math.nan)
        if own <= 0.0:
            raise ConfigurationError(f"the drive's limit.{name} is {own:g}; set it above 0 before tuning")
        values[name] = min(getattr(limits, name), own) if math.isfinite(own) else getattr(limits, name)
    return limits.model_copy(update=values)


def _differs(one: float, other: float) -> bool:
    return not math.isclose(one, other, rel_tol=AGREES, abs_tol=1e-12)


def _restore(loop: Loop, before: Mapping[str, float]) -> str:
    """Writes the old values back, each by itself if not together; returns what went wrong, or nothing."""
    if not before:
        return ""
    try:
        loop.write_parameters(before)
        return ""
    except AutotuneError:
        failed = {name: reason for name, value in before.items() if (reason := _write(loop, name, value))}
    if not failed:
        return ""
    values = ", ".join(f"{name} = {before[name]:g}" for name in failed)
    reason = next(iter(failed.values()))
    return (
        f"the drive's own limits could not be put back ({reason}); they are tighter than before until the "
        f"drive is switched off and on, or set by hand: {values}"
    )


def _write(loop: Loop, name: str, value: float) -> str:
    try:
        loop.write_parameters({name: value})
    except AutotuneError as error:
        return str(error)
    return ""
