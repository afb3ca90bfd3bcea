"""Opens a drive on a CANopen link: who answers, is it the one expected, is it free.

Nothing is written before all of that has been checked.
"""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

from autotune.core.axis import Axis
from autotune.core.errors import (
    ConfigurationError,
    IdentityMismatch,
    LinkError,
    LinkTimeout,
    StateError,
    TransferAborted,
)
from autotune_drivers.canopen.cia402 import POWERED, describe, state_of
from autotune_drivers.canopen.drive import CanopenDrive
from autotune_drivers.canopen.frames import FrameLink, drain, open_socketcan
from autotune_drivers.canopen.node import PRE_OPERATIONAL, STOPPED, Node
from autotune_drivers.canopen.objects import ObjectRef, Raw
from autotune_drivers.canopen.power import STATUS
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.canopen.session import Backup, Session
from autotune_drivers.canopen.slcan import open_slcan
from autotune_drivers.canopen.wire import Wire
from autotune_drivers.kept import Keeper
from autotune_drivers.left import put_right
from autotune_drivers.profile import Identity, Profile
from autotune_drivers.units import Units, fixed_factor
from autotune_drivers.url import LinkAddress

HOST_NODES = (127, 126)
MONITORED = ObjectRef(0x1017, 0, "u16", "producer heartbeat time")
_FIRST_WORDS = 3
_LISTEN = 0.15
_COUNTS_AGREE = 1e-6
_FREE_WITHIN = 2.0
PERIOD = (
    ObjectRef(0x60C2, 1, "u8", "interpolation time"),
    ObjectRef(0x60C2, 2, "i8", "interpolation time exponent"),
)


def open_slcan_link(address: LinkAddress) -> FrameLink:
    return open_slcan(Path(address.target), address.options["bitrate"])


def open_socketcan_link(address: LinkAddress) -> FrameLink:
    return open_socketcan(address.target)


LINKS: Mapping[str, Callable[[LinkAddress], FrameLink]] = MappingProxyType(
    {"canopen+slcan": open_slcan_link, "canopen+socketcan": open_socketcan_link}
)


@dataclass(frozen=True, slots=True)
class CanopenOpener:
    """Opens the drive of an axis; picklable, so that the cyclic process can call it.

    `keep`: folder for what is changed in the drive, see `kept`.
    """

    address: LinkAddress
    axis: Axis
    profile: Profile
    keep: Path | None = None

    def __call__(self, backup: Backup | None = None) -> CanopenDrive:
        """Opens link and drive; `backup` is what an earlier session left to be put back.

        Raises:
            LinkError: nobody there, the wrong drive. StateError: another master has it.
        """
        link = LINKS[self.address.scheme](self.address)
        try:
            return open_drive(link, self.address.options["node"], self.axis, self.profile, backup, self.keep)
        except BaseException:
            link.close()
            raise


def open_drive(
    link: FrameLink,
    number: int,
    axis: Axis,
    profile: Profile,
    backup: Backup | None = None,
    keep: Path | None = None,
) -> CanopenDrive:
    """Checks the node and prepares a session with it. The link stays the caller's if this raises.

    What an earlier session has left changed is put back first where it is in `keep`, else by this session.
    """
    own = HOST_NODES[number == HOST_NODES[0]]
    wire = Wire(link, own, profile.guard.produce)
    node, sdo = Node(wire, number), Sdo(wire, number)
    identity = expected(node, sdo, axis, profile)
    _must_be_free(node, sdo)
    keeper = Keeper.of(keep, identity) if keep is not None else None
    left = put_right(node, sdo, keeper, _recorder_off(sdo, profile)) if keeper is not None else ()
    session = Session(sdo, backup if keeper is None else None, keeper)
    try:
        drive = _prepare(node, sdo, session, axis, profile, identity)
        drive.left = left
        return drive
    except BaseException:
        session.restore()
        raise


def _recorder_off(sdo: Sdo, profile: Profile) -> Callable[[], None]:
    def off() -> None:
        if profile.recorder is not None:
            sdo.write(profile.recorder.control, profile.recorder.stop)

    return off


def _prepare(
    node: Node, sdo: Sdo, session: Session, axis: Axis, profile: Profile, identity: Mapping[str, int | str]
) -> CanopenDrive:
    nmt_before = session.nmt = _monitor(node, session, profile.guard.monitor)
    units = units_of(node, sdo, axis, profile)
    settings = [*_period(sdo, axis.cycle), *_settings(axis, profile, units)]
    for setting in settings:
        session.write_if_there(*setting)
    settings.append((MONITORED, round(profile.guard.monitor * 1e3)))
    node.count_syncs(_sync_overflow(sdo))
    lock_step = lock_step_of(profile, sdo)
    drive = CanopenDrive(node, sdo, session, profile, axis, units, identity, lock_step, nmt_before, settings)
    drive.note()
    return drive


# Who is there


def expected(node: Node, sdo: Sdo, axis: Axis, profile: Profile) -> dict[str, int | str]:
    """Identity of the drive, if it is one of the profile, set up as that and the axis file assume."""
    identity = _identify(node, sdo)
    compare(identity, profile, node.number)
    _must_be_as_expected(node, sdo, profile)
    _must_count_alike(node, sdo, axis, profile)
    return identity


def _identify(node: Node, sdo: Sdo) -> dict[str, int | str]:
    identity: dict[str, int | str] = {"vendor": _vendor(node, sdo)}
    for sub, name in enumerate(("product", "revision", "serial"), 2):
        identity[name] = optional(sdo, ObjectRef(0x1018, sub, "u32", name))
    for index, name in ((0x1008, "name"), (0x100A, "firmware")):
        identity[name] = optional_text(sdo, ObjectRef(index, 0, "u8", name))
    return identity


def _vendor(node: Node, sdo: Sdo) -> int:
    """The first word with the node. A stopped one serves no SDO: if its heartbeat says so, it is woken."""
    vendor = ObjectRef(0x1018, 1, "u32", "vendor")
    for _ in range(_FIRST_WORDS):
        try:
            return int(sdo.read(vendor, attempts=1))
        except TransferAborted:
            return 0
        except LinkTimeout as error:
            silence = error
            if node.nmt_state == STOPPED:
                node.woken = True
                node.command(PRE_OPERATIONAL)
    raise _nobody(node, silence) from None


def _nobody(node: Node, error: LinkTimeout) -> LinkError:
    """Asks every node for its device type, to name those that answer."""
    link = node.wire.link
    for number in range(1, 128):
        link.send((0x600 + number, b"\x40\x00\x10\x00\x00\x00\x00\x00"))
        if number % 16 == 0:
            time.sleep(0.005)  # 16 frames at 1 Mbit/s take 2 ms
    answers = {frame[0] - 0x580 for frame in drain(link, _LISTEN) if 0x581 <= frame[0] <= 0x5FF}
    answers.discard(node.number)
    if answers:
        found = ", ".join(map(str, sorted(answers)))
        return LinkTimeout(
            f"node {node.number} does not answer on {link.name}, but node {found} does; is the node number "
            f"in the link wrong? Write node={min(answers)} there, or set the drive's node number"
        )
    hint = f" ({link.hint})" if link.hint else ""
    return LinkTimeout(
        f"node {node.number} is silent on {link.name}, and no other node answers{hint}. Check the drive's "
        f"power, the cable, the termination at both ends, and that the bit rate is the drive's. {error}"
    )


def optional(sdo: Sdo, ref: ObjectRef) -> int:
    """The value of an object, 0 where the drive has none."""
    try:
        return int(sdo.read(ref))
    except TransferAborted:
        return 0


def optional_text(sdo: Sdo, ref: ObjectRef) -> str:
    """The text of an object, empty where the drive has none."""
    try:
        return sdo.read_bytes(ref).rstrip(b"\0 ").decode("latin-1")
    except TransferAborted:
        return ""


def compare(identity: Mapping[str, int | str], profile: Profile, number: int) -> None:
    """Raises IdentityMismatch: not a drive of the profile."""
    wanted = profile.identity
    wrong = [
        f"{name} is {found:#010x}, the profile is for {expected:#010x}"
        for name, expected in (("vendor", wanted.vendor), ("product", wanted.product))
        if expected is not None and (found := int(identity[name])) != expected
    ]
    if not wrong:
        wrong = _revision(int(identity["revision"]), wanted) or _firmware(str(identity["firmware"]), wanted)
    if wrong:
        name = f" ({identity['name']})" if identity["name"] else ""
        raise IdentityMismatch(
            f"node {number}{name} is not a drive of profile {profile.name!r}: {'; '.join(wrong)}. Nothing "
            "was written. Choose the profile of this drive in the axis file"
        )


def _revision(found: int, wanted: Identity) -> list[str]:
    if wanted.revision_min <= found <= wanted.revision_max:
        return []
    return [
        f"revision {found:#010x} is outside {wanted.revision_min:#010x} to {wanted.revision_max:#010x}, "
        "which the profile was checked with"
    ]


def _firmware(found: str, wanted: Identity) -> list[str]:
    """Compares dotted numbers; a drive that tells no version cannot be compared."""
    if wanted.firmware_min is None and wanted.firmware_max is None:
        return []
    match = re.search(r"\d+(?:\.\d+)*", found)
    low, high = wanted.firmware_min or "0", wanted.firmware_max or "any"
    if match is None:
        return [f"firmware {found!r} has no number, the profile was checked with {low} to {high}"]
    version = _numbers(match[0])
    inside = _numbers(low) <= version and (high == "any" or version <= _numbers(high))
    return (
        [] if inside else [f"firmware {found} is outside {low} to {high}, which the profile was checked with"]
    )


def _numbers(version: str) -> tuple[int, ...]:
    """`1.2` and `1.2.0` are the same version."""
    numbers = [int(part) for part in version.split(".")]
    while numbers and numbers[-1] == 0:
        numbers.pop()
    return tuple(numbers)


def _must_be_free(node: Node, sdo: Sdo) -> None:
    """A powered drive belongs to another master, or to one of ours that has just died."""

    def status() -> int:
        return int(sdo.read(STATUS))

    end = time.monotonic() + _FREE_WITHIN
    while state_of(found := status()) in POWERED:
        if time.monotonic() > end:
            raise StateError(
                f"node {node.number} is already in {describe(found)}: another master moves it. Nothing was "
                "written. Stop that master first"
            )
        node.wire.wait(0.05, lambda: False)


def _must_be_as_expected(node: Node, sdo: Sdo, profile: Profile) -> None:
    """The objects on which the profile's units rest."""
    wrong = []
    for text, wanted in profile.expects.items():
        ref = ObjectRef.parse(text)
        found = sdo.read(ref)
        if found != wanted:
            wrong.append(
                f"{ref} is {found:g} ({int(found):#x}), the profile is for {wanted:g} ({int(wanted):#x})"
            )
    if wrong:
        raise IdentityMismatch(
            f"node {node.number} is set up otherwise than profile {profile.name!r} assumes: {'; '.join(wrong)}. "
            "Nothing was written. Set the drive's units back with the vendor's tool, or write an own profile"
        )


def _must_count_alike(node: Node, sdo: Sdo, axis: Axis, profile: Profile) -> None:
    """Counts in one turn of the motor as the drive has them (CiA 402-2: 608Fh; with 6091h and 6092h).

    Positions are in user units where a feed constant is set: (feed/shaft) · (shaft/motor) of them in one turn.
    A drive that was never told its encoder (one increment) says nothing.

    Raises:
        ConfigurationError: it counts otherwise than the axis file.
    """
    axis_counts = axis.mechanics.counts_per_revolution
    if profile.encoder == "none" or axis.motion_unit != "rad" or axis_counts is None:
        return
    encoder, feed, gear = (ratio(sdo, index) for index in (0x608F, 0x6092, 0x6091))
    if encoder is None or encoder <= 1.0:
        return
    candidates = [encoder]
    if feed is not None and feed > 1.0:
        candidates.append(feed / (gear or 1.0))
    if any(abs(counts - axis_counts) <= _COUNTS_AGREE * counts for counts in candidates):
        return
    told = " or ".join(f"{counts:.9g}" for counts in candidates)
    raise ConfigurationError(
        f"mechanics.counts_per_revolution is {axis_counts:.9g} in the axis file, but node {node.number} counts {told} "
        "in one revolution (608Fh, with 6091h and 6092h where they are set): every position and speed would be "
        f"{candidates[-1] / axis_counts:.3g} times what it is taken for, limits too. Nothing was written. Correct "
        'the axis file or the drive; where its positions do not follow 608Fh, write encoder = "none" in a profile '
        "of your own"
    )


def ratio(sdo: Sdo, index: int) -> float | None:
    """First over second sub-index; None where the drive has no such object, or zeros in it."""
    first, second = (optional(sdo, ObjectRef(index, sub, "u32", "counting")) for sub in (1, 2))
    return first / second if first and second else None


def units_of(node: Node, sdo: Sdo, axis: Axis, profile: Profile) -> Units:
    """Rated torque and torque constant as the drive has them."""
    constant = math.nan
    if profile.torque.constant is not None:
        at = profile.torque.constant.named("torque constant")
        constant = float(sdo.read(at.ref)) * (fixed_factor(at.unit) or 1.0)
        if not constant > 0.0:
            raise ConfigurationError(
                f"{at.ref} of node {node.number} is {constant:g}; torques cannot be scaled. Set it at the drive "
                "to the motor's torque constant"
            )
    rated = profile.torque.rated.named("rated torque")
    units = Units.of(axis, math.nan, constant)
    torque = float(sdo.read(rated.ref)) * units.factor(rated.unit)
    if not torque > 0.0:
        raise ConfigurationError(
            f"{rated.ref} of node {node.number} is {torque}; torques cannot be scaled. Set it at the drive to "
            "the motor's rated torque"
        )
    return Units.of(axis, torque, constant)


# What the session needs


def _monitor(node: Node, session: Session, period: float) -> str:
    """Has the node send its heartbeat; the NMT state that it was in."""
    if not session.write_if_there(MONITORED, round(period * 1e3)):
        return node.nmt_state
    node.monitor(period)
    node.wire.wait(3 * period, lambda: node.told)
    return STOPPED if node.woken else node.nmt_state


def _period(sdo: Sdo, period: float) -> list[tuple[ObjectRef, Raw]]:
    value, exponent = PERIOD
    try:
        present = int(sdo.read(exponent))
    except TransferAborted:
        return []  # this drive takes its cycle from SYNC alone
    for candidate in (present, -3, -4, -5, -6):
        units = period / 10.0**candidate
        if 1 <= round(units) <= 255 and abs(units - round(units)) < 1e-6:
            return [(exponent, candidate), (value, round(units))]
    raise ConfigurationError(
        f"a cycle of {period * 1e3:g} ms cannot be told to the drive (60C2h); choose 1, 2 or 4 ms"
    )


def _settings(axis: Axis, profile: Profile, units: Units) -> list[tuple[ObjectRef, Raw]]:
    """What the profile wants while a session lasts, and the quick-stop ramp of the axis file."""
    refs = [(ObjectRef.parse(text), value) for text, value in profile.session.items()]
    settings = [(ref, ref.raw(value)) for ref, value in refs]
    quick = profile.quick_stop_deceleration
    if quick is not None:
        ref = quick.named("quick stop deceleration").ref
        settings.append((ref, ref.raw(axis.limits.deceleration / units.factor(quick.unit))))
    return settings


def _sync_overflow(sdo: Sdo) -> int:
    overflow = optional(sdo, ObjectRef(0x1019, 0, "u8", "SYNC counter overflow"))
    return overflow if 2 <= overflow <= 240 else 0


def lock_step_of(profile: Profile, sdo: Sdo) -> bool:
    """True where the drive says that its time advances with SYNC."""
    clock = profile.clock
    return clock is not None and bool(int(sdo.read(clock.at)) & clock.lock_step_mask)
