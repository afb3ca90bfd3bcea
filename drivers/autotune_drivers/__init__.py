"""Links and drives: CAN and CiA 402, moteus, profiles, the cyclic loop.

`open_loop` is the door: from an axis to a loop that plays routines on its drive. Nothing else is
imported before it is called.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Protocol

from autotune.core.axis import Axis
from autotune.core.loop import Loop

if TYPE_CHECKING:
    from autotune_drivers.cyclic.messages import Opener
    from autotune_drivers.moteus.profile import MoteusProfile
    from autotune_drivers.profile import Profile
    from autotune_drivers.url import LinkAddress

    AnyProfile = Profile | MoteusProfile

__all__ = ["OPENERS", "SCHEMES", "open_loop"]


class MakesOpener(Protocol):
    """Makes what opens a drive behind links of one scheme."""

    def __call__(
        self, address: LinkAddress, axis: Axis, directory: Path, profile: AnyProfile | None, keep: Path | None
    ) -> Opener: ...


def _canopen(
    address: LinkAddress, axis: Axis, directory: Path, profile: AnyProfile | None, keep: Path | None
) -> Opener:
    from autotune_drivers.canopen.opening import CanopenOpener
    from autotune_drivers.profile import Profile, read_profile

    found = profile if isinstance(profile, Profile) else read_profile(axis.profile, directory)
    return CanopenOpener(address, axis, found, keep)


def _moteus(
    address: LinkAddress, axis: Axis, directory: Path, profile: AnyProfile | None, keep: Path | None
) -> Opener:
    from autotune_drivers.moteus.opening import MoteusOpener
    from autotune_drivers.moteus.profile import MoteusProfile, read_moteus_profile

    found = profile if isinstance(profile, MoteusProfile) else read_moteus_profile(axis.profile, directory)
    return MoteusOpener(address, axis, found, keep)


OPENERS: Mapping[str, MakesOpener] = MappingProxyType(
    {"canopen+slcan": _canopen, "canopen+socketcan": _canopen, "moteus+serial": _moteus}
)
SCHEMES: tuple[str, ...] = tuple(OPENERS)


def open_loop(
    axis: Axis, axis_directory: Path, profile: AnyProfile | None = None, keep: Path | None = None
) -> Loop:
    """Opens the axis's link in a cyclic process of its own.

    Relative paths in the link and the profile's name are relative to `axis_directory`. `keep`: a folder for what
    the session changes in the drive, on disk before it is changed; what an earlier one has left there is put back.

    Raises:
        ConfigurationError: the link or the profile. LinkError: nobody there, or the wrong drive.
        StateError: another master has the drive.
    """
    from autotune_drivers.cyclic.loop import CyclicLoop
    from autotune_drivers.url import parse_link

    address = parse_link(axis.link, axis_directory)
    return CyclicLoop.open(OPENERS[address.scheme](address, axis, axis_directory, profile, keep))
