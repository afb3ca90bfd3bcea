"""What a drive says of itself to a node that is not its master: nothing is written, nothing is commanded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from autotune.core.axis import Axis
from autotune.core.errors import TransferAborted
from autotune_drivers.canopen.node import Node
from autotune_drivers.canopen.opening import PERIOD, expected, lock_step_of, units_of
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.profile import Profile
from autotune_drivers.units import Units


@dataclass(frozen=True, slots=True)
class Known:
    """What a drive says of itself, without anything being written."""

    identity: Mapping[str, int | str]
    units: Units
    lock_step: bool


def known(node: Node, sdo: Sdo, axis: Axis, profile: Profile) -> Known:
    """Asks a drive that may be in motion under another master; nothing is written.

    Raises:
        LinkError: nobody answers, or the wrong drive. ConfigurationError: it counts otherwise than the axis file.
    """
    identity = expected(node, sdo, axis, profile)
    return Known(identity, units_of(node, sdo, axis, profile), lock_step_of(profile, sdo))


def cycle_of(sdo: Sdo) -> float | None:
    """Interpolation period [s] (60C2h); None where the drive has none."""
    try:
        value, exponent = (int(sdo.read(ref)) for ref in PERIOD)
    except TransferAborted:
        return None
    return float(value * 10.0**exponent)
