"""Before power is on: the axis stands, and it stands inside its travel.

A drive tells its position and velocity without power too (`Drive.look`). Several looks are taken and the
median counts, because one count of a coarse encoder looks like a speed. What is refused here has moved
nothing: the message says so, and what to do.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from autotune.core.axis import Limits
from autotune.core.drive import Drive, Standing
from autotune.core.errors import GuardStop
from autotune.core.loop import Loop, Publish

LOOKS = 5
AT_REST = 0.05  # of limits.speed: what an encoder's noise may look like, and nobody takes for motion


@dataclass(frozen=True)
class Standstill:
    """A routine that looks, and raises where power must not come on. Moves nothing.

    Attributes:
        limits: in force, the tighter of axis file and drive.
    """

    limits: Limits

    @property
    def labels(self) -> Sequence[str]:
        return ()

    def __call__(self, drive: Drive, publish: Publish) -> Standing:
        return stands(drive, self.limits)


def standing(loop: Loop, limits: Limits) -> Standing:
    """Where the axis of a loop stands. Raises as `stands`."""
    return loop.play(Standstill(limits))


def stands(drive: Drive, limits: Limits) -> Standing:
    """Where the axis stands, without power.

    Raises:
        GuardStop: outside its travel, moving, or no number; nothing was powered.
        LinkError: from the drive.
    """
    looks = [drive.look() for _ in range(LOOKS)]
    found = Standing(*(statistics.median(values) for values in zip(*looks, strict=True)))
    if not (math.isfinite(found.position) and math.isfinite(found.velocity)):
        raise GuardStop(
            f"power was not switched on: the drive tells position {found.position} and velocity "
            f"{found.velocity}, which are not finite numbers; check encoder, cable and the drive's scaling"
        )
    _inside(found, limits)
    if abs(found.velocity) > AT_REST * limits.speed:
        raise GuardStop(
            f"power was not switched on: the axis moves with {found.velocity:.4g} at {found.position:.6g}, but "
            f"{AT_REST * limits.speed:.4g} ({AT_REST:g} of limits.speed) counts as rest; let it come to rest, or "
            "look for a master that moves it, for vibration, or for a wrong unit of velocity in the profile"
        )
    return found


def _inside(found: Standing, limits: Limits) -> None:
    if limits.position_min <= found.position <= limits.position_max:
        return
    below = found.position < limits.position_min
    name, allowed = ("position_min", limits.position_min) if below else ("position_max", limits.position_max)
    raise GuardStop(
        f"power was not switched on: the axis stands at {found.position:.6g}, but limits.{name} allows "
        f"{allowed:.6g}; move the axis well inside its travel by hand, home the drive if its zero is lost, or "
        "correct the limit in the axis file or the drive"
    )
