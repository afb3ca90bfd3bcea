"""Links and drives: CAN, CiA 402, profiles, the cyclic loop.

`open_loop` is the door: from an axis to a loop that plays routines on its drive. Nothing else is
imported before it is called.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from autotune.core.axis import Axis
from autotune.core.loop import Loop

if TYPE_CHECKING:
    from autotune_drivers.cyclic_messages import Opener
    from autotune_drivers.profile import Profile
    from autotune_drivers.url import LinkAddress

__all__ = ["OPENERS", "SCHEMES", "open_loop"]


def _canopen(address: LinkAddress, axis: Axis, profile: Profile) -> Opener:
    from autotune_drivers.canopen_open import CanopenOpener

    return CanopenOpener(address, axis, profile)


OPENERS: Mapping[str, Callable[[LinkAddress, Axis, Profile], Opener]] = MappingProxyType(
    {"canopen+slcan": _canopen, "canopen+socketcan": _canopen}
)
SCHEMES: tuple[str, ...] = tuple(OPENERS)


def open_loop(axis: Axis, axis_directory: Path, profile: Profile | None = None) -> Loop:
    """Opens the axis's link in a cyclic process of its own.

    Relative paths in the link and the profile's name are relative to `axis_directory`.

    Raises:
        ConfigurationError: the link or the profile. LinkError: nobody there, or the wrong drive.
        StateError: another master has the drive.
    """
    from autotune_drivers.cyclic import CyclicLoop
    from autotune_drivers.profile import read_profile
    from autotune_drivers.url import parse_link

    address = parse_link(axis.link, axis_directory)
    found = profile or read_profile(axis.profile, axis_directory)
    return CyclicLoop.open(OPENERS[address.scheme](address, axis, found))
