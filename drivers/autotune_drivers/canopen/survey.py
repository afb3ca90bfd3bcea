"""Which CANopen nodes answer on a bus, and what they say of themselves: uploads (reads) only.

First the bus is listened to: where SYNC or process data pass, a master is at work and nothing is asked.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping

from autotune.core.axis import Axis
from autotune.core.errors import (
    ConfigurationError,
    IdentityMismatch,
    LinkError,
    LinkTimeout,
    StateError,
    TransferAborted,
)
from autotune.core.paths import config_directory
from autotune_drivers.canopen.frames import FrameLink, drain
from autotune_drivers.canopen.node import Node
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.canopen.opening import (
    HOST_NODES,
    LINKS,
    compare,
    optional,
    optional_text,
    ratio,
    units_of,
)
from autotune_drivers.canopen.parameters import DriveParameters
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.canopen.wire import SYNC, Wire
from autotune_drivers.profile import Profile, read_profile
from autotune_drivers.seen import Seen, with_number
from autotune_drivers.url import LinkAddress

LISTEN = 0.4
"""s of silence on our side; masters send SYNC every few milliseconds."""
_ANSWERS = 0.15
_BEAT = 1.0
_PROCESS_DATA = range(0x181, 0x580)
_SAME = 1e-9


def survey(address: LinkAddress, wanted: int | None) -> list[Seen]:
    """What answers there; `wanted`: only this node.

    Raises:
        LinkError: no such adapter, or nobody answers. StateError: another master is at work.
    """
    link = LINKS[address.scheme](address)
    try:
        return survey_over(link, address, wanted)
    finally:
        link.close()


def survey_over(link: FrameLink, address: LinkAddress, wanted: int | None) -> list[Seen]:
    """As `survey`, over a link that is there."""
    _must_be_quiet(link)
    numbers = [number for number in _answering(link) if wanted in (None, number)]
    if not numbers:
        which = "no node answers" if wanted is None else f"node {wanted} does not answer"
        hint = f" ({link.hint})" if link.hint else ""
        raise LinkTimeout(
            f"{which} on {link.name}{hint}. Check the drives' power, the cable, the termination at both ends, and "
            "that the bit rate is theirs"
        )
    return [_seen(link, address, number) for number in numbers]


def _must_be_quiet(link: FrameLink) -> None:
    busy = sum(identifier == SYNC or identifier in _PROCESS_DATA for identifier, _ in drain(link, LISTEN))
    if busy:
        raise StateError(
            f"a master is at work on {link.name}: {busy} frames of SYNC and process data in {LISTEN:g} s. Nothing was "
            "asked. Stop that master first"
        )


def _answering(link: FrameLink) -> list[int]:
    """Nodes that answer when asked for their device type (1000h)."""
    found: set[int] = set()
    for first in range(1, 128, 16):
        link.send(
            *(
                (0x600 + number, b"\x40\x00\x10\x00\x00\x00\x00\x00")
                for number in range(first, min(first + 16, 128))
            )
        )
        time.sleep(0.005)  # 16 frames at 1 Mbit/s take 2 ms
    for identifier, _ in drain(link, _ANSWERS):
        if 0x581 <= identifier <= 0x5FF:
            found.add(identifier - 0x580)
    return sorted(found)


def _seen(link: FrameLink, address: LinkAddress, number: int) -> Seen:
    wire = Wire(link, HOST_NODES[number == HOST_NODES[0]], _BEAT)
    sdo = Sdo(wire, number)
    identity = _identity(sdo)
    profiles = [one for one in _profiles() if _is_for(identity, one, number)]
    counts = _counts(sdo) if any(one.encoder == "608F" for one in profiles) or not profiles else ()
    limits: dict[str, float] = {}
    remarks: tuple[str, ...] = ()
    if len(counts) == 1 and profiles:
        limits, remarks = _limits(Node(wire, number), sdo, profiles, counts[0])
    elif profiles:
        remarks = (
            "the drive's own limits are in counts and are not told here: how many counts a revolution has is open",
        )
    return Seen(
        with_number(address, "node", number), identity, tuple(one.name for one in profiles), counts, limits,
        None, remarks,
    )  # fmt: skip


def _identity(sdo: Sdo) -> dict[str, int | str]:
    found: dict[str, int | str] = {
        name: optional(sdo, ObjectRef(0x1018, sub, "u32", name))
        for sub, name in enumerate(("vendor", "product", "revision", "serial"), 1)
    }
    for index, name in ((0x1008, "name"), (0x100A, "firmware")):
        found[name] = optional_text(sdo, ObjectRef(index, 0, "u8", name))
    return found


def _profiles() -> list[Profile]:
    """Those that are for one kind of drive; the general one fits everything and says nothing."""
    found = []
    for path in sorted((config_directory() / "profiles").glob("*.toml")):
        try:
            profile = read_profile(path.stem)
        except ConfigurationError:
            continue  # of another kind of link
        if profile.identity.vendor is not None:
            found.append(profile)
    return found


def _is_for(identity: Mapping[str, int | str], profile: Profile, number: int) -> bool:
    try:
        compare(identity, profile, number)
    except IdentityMismatch:
        return False
    return True


def _counts(sdo: Sdo) -> tuple[float, ...]:
    """Counts in one turn of the motor: of the encoder (608Fh), and of user units where a feed is set (6092h)."""
    encoder, feed, gear = (ratio(sdo, index) for index in (0x608F, 0x6092, 0x6091))
    if encoder is None or encoder <= 1.0:
        return ()
    told = [encoder]
    if feed is not None and feed > 1.0:
        told.append(feed / (gear or 1.0))
    return tuple(dict.fromkeys(told))


def _limits(
    node: Node, sdo: Sdo, profiles: list[Profile], counts: float
) -> tuple[dict[str, float], tuple[str, ...]]:
    """Limits in force in the drive that all its profiles read alike."""
    every = [_read(node, sdo, profile, counts) for profile in profiles]
    first = every[0]
    alike = {
        name: value
        for name, value in first.items()
        if all(math.isclose(other.get(name, math.nan), value, rel_tol=_SAME) for other in every[1:])
    }
    if alike or not first:
        return alike, () if first else ("the drive's own limits could not be read",)
    return {}, ("the drive's own limits are read differently by its profiles and are not told here",)


def _read(node: Node, sdo: Sdo, profile: Profile, counts: float) -> dict[str, float]:
    axis = _rotary(counts, profile.name)
    try:
        parameters = DriveParameters(sdo, profile, units_of(node, sdo, axis, profile))
    except (TransferAborted, ConfigurationError):
        return {}
    found: dict[str, float] = {}
    for name in (name for name in profile.parameters if name.startswith("limit.")):
        try:
            found |= parameters.read([name])
        except TransferAborted:
            continue
        except LinkError:
            break
    return found


def _rotary(counts: float, profile: str) -> Axis:
    """What turns counts into rad; its limits are never used."""
    unused = {"position_min": -1.0, "position_max": 1.0, "speed": 1.0, "torque": 1.0, "following_error": 1.0,
              "deceleration": 1.0, "temperature": 1.0, "machine_seconds": 1.0}  # fmt: skip
    return Axis.model_validate(
        {
            "name": "unknown", "link": "none", "profile": profile, "mechanics": {"counts_per_revolution": counts},
            "limits": unused, "benchmark": {"amplitude": 1.0, "frequency": 1.0},
        }
    )  # fmt: skip
