"""A node beside the master: hears SYNC and the master's set points, sends one PDO with a torque offset.

It never sends SYNC, NMT commands or set points. What it changes in the drive (one receive PDO with its time-out,
one transmit PDO) is noted on disk before and put back at the end, as in any session.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path

from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError, StateError
from autotune_drivers.canopen.cia402 import State, state_of
from autotune_drivers.canopen.frames import FrameLink, drain
from autotune_drivers.canopen.heard import Place, free, places, settings
from autotune_drivers.canopen.known import Known, cycle_of, known
from autotune_drivers.canopen.node import Node
from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.canopen.opening import HOST_NODES
from autotune_drivers.canopen.parameters import DriveParameters
from autotune_drivers.canopen.pdo import RPDO, TPDO, PdoSetting, identifier, layout
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.canopen.session import Session
from autotune_drivers.canopen.wire import SYNC, Wire
from autotune_drivers.kept import Keeper
from autotune_drivers.left import put_right
from autotune_drivers.profile import OffsetGuard, Profile

TIME_OUT = 0.02  # s of our silence until the drive begins to drop the offset
_TIME_OUT_MS = round(TIME_OUT * 1e3)
_LISTEN = 0.3  # s in which another producer is heard
_LOCK_STEP_DROP = 5.0  # s, for a drive whose time waits for SYNC
_SYNCHRONOUS = 1
_SAME = 1e-6


@dataclass(frozen=True, slots=True)
class Target:
    """A set point of the master [rad or m]."""

    position: float


@dataclass(frozen=True, slots=True)
class Synchronised:
    """A SYNC message; `at` is when it was handed over [s]."""

    at: float


@dataclass(frozen=True, slots=True)
class Told:
    """What the drive says: whether it follows set points, and its torque [N m]."""

    following: bool
    torque: float


@dataclass(frozen=True, slots=True)
class Foreign:
    """Somebody else sends the PDO that is ours."""

    cob_id: int


Event = Target | Synchronised | Told | Foreign


class Sidecar:
    """One drive, beside its master. `open_sidecar` makes one; `prepare` before anything is sent.

    Attributes:
        identity: of the drive. lock_step: its time advances with SYNC.
        left: what an earlier session had left and was put back, in words.
        gone_within: s after our last frame, until nothing of the offset is left in the drive.
    """

    def __init__(self, link: FrameLink, number: int, axis: Axis, profile: Profile, keep: Path | None) -> None:
        self._guard = _guard_of(profile)
        self._link, self._number = link, number
        self._axis, self._profile = axis, profile
        wire = Wire(link, HOST_NODES[number == HOST_NODES[0]], profile.guard.produce)
        node, self._sdo = Node(wire, number), Sdo(wire, number)
        self._known: Known = known(node, self._sdo, axis, profile)
        self.identity, self.lock_step = self._known.identity, self._known.lock_step
        keeper = Keeper.of(keep, self.identity) if keep is not None else None
        self.gone_within = TIME_OUT + self._guard.ramp
        self.left = self._put_right(node, keeper) if keeper is not None else ()
        self._session = Session(self._sdo, None, keeper)
        self._prepared = False
        self._offset = profile.commands.torque_feedforward
        self._scale()

    def _put_right(self, node: Node, keeper: Keeper) -> tuple[str, ...]:
        """What a session before has left is put back, once the drive has had the time to drop its offset."""
        if keeper.path.exists():
            self._let_drop()
        return put_right(node, self._sdo, keeper, commands=False)

    def _scale(self) -> None:
        units, profile = self._known.units, self._profile
        self._per_offset = units.signed(self._offset.unit)
        self._per_position = units.signed(profile.commands.position.unit)
        self._per_torque = units.signed(profile.signals.torque.unit)
        self._report = layout([profile.signals.status.ref, profile.signals.torque.ref])
        self._target = layout([profile.commands.position.ref])

    def own_share(self) -> dict[str, float] | None:
        """Parameters of the feedforward that the drive plays by itself; None where it plays none."""
        prefix = "feedforward."
        names = [name for name in self._profile.parameters if name.startswith(prefix)]
        if self._profile.friction_table is not None:
            names += self._profile.friction_table.places()
        if not names:
            return None
        held = DriveParameters(self._sdo, self._profile, self._known.units).read(names)
        values = {name.removeprefix(prefix): value for name, value in held.items()}
        enabled = values.pop("enabled", 1.0)
        values.pop("reference_filter", None)
        return values if enabled else None

    def prepare(self) -> None:
        """Maps the two PDOs and sets the time-out.

        Raises:
            StateError: the master is not there, has the torque offset itself, or uses all PDOs; somebody sends what
                would be ours; an offset stands in the drive; the drive holds another time-out than was written.
            LinkError: the drive refuses.
        """
        sdo, number = self._sdo, self._number
        receive, transmit = settings(sdo, RPDO), settings(sdo, TPDO)
        self._place = self._target_place(receive)
        index, other = free(receive, RPDO, number), free(transmit, TPDO, number)
        self._own, self._told = identifier(RPDO, index, number), identifier(TPDO, other, number)
        self._must_be_alone()
        signals = self._profile.signals
        mapped = PdoSetting(RPDO, index, self._own, _SYNCHRONOUS, (self._offset.ref.mapping(),))
        report = (signals.status.ref.mapping(), signals.torque.ref.mapping())
        self._prepared = True
        timer = self._timer(index)
        self._session.write(timer, _TIME_OUT_MS)
        self._session.map(PdoSetting(TPDO, other, self._told, _SYNCHRONOUS, report))
        self._session.map(mapped)
        self._must_be_timed(timer)
        self._session.settle()  # what the master maps there after our death is the master's

    def _must_be_timed(self, timer: ObjectRef) -> None:
        """Without that time-out a drive keeps the offset of a dead sender, or drops it at another time than is told."""
        held = self._sdo.read(timer)
        if held != _TIME_OUT_MS:
            raise StateError(
                f"{timer} holds {held} ms, where {_TIME_OUT_MS} were written: node {self._number} would not drop the "
                "offset of a silent sender in time; nothing was sent. See [offset_guard] in the profile, or export the "
                "model to the master ('autotune export')"
            )

    def _timer(self, index: int) -> ObjectRef:
        if isinstance(self._guard.timer, ObjectRef):
            return self._guard.timer
        return ObjectRef(RPDO + index, 5, "u16", f"event timer of RPDO{index + 1}")

    def _target_place(self, receive: list[PdoSetting]) -> Place:
        if places(receive, self._offset.ref):
            raise StateError(
                f"the master of node {self._number} sends {self._offset.ref} itself; nothing was written. Take it out "
                "of the master's mapping, or let the master play the feedforward (autotune export)"
            )
        found = places(receive, self._profile.commands.position.ref)
        if len(found) != 1:
            raise StateError(
                f"set points ({self._profile.commands.position.ref}) are mapped to {len(found)} PDOs of node "
                f"{self._number}, one is needed; nothing was written. Start the master first"
            )
        return found[0]

    def _must_be_alone(self) -> None:
        """Nobody sends our PDO, SYNC is heard, and no offset stands."""
        heard = [cob_id for cob_id, _ in drain(self._link, _LISTEN)]
        if self._own in heard:
            raise StateError(
                f"somebody sends {self._own:03X}h already, the PDO with the torque offset of node {self._number}; "
                "nothing was written. Is another 'autotune play' on this bus? Stop it first"
            )
        if SYNC not in heard or self._place.cob_id not in heard:
            what = "SYNC" if SYNC not in heard else f"set point ({self._place.cob_id:03X}h)"
            raise StateError(
                f"no {what} was heard within {_LISTEN:g} s; nothing was written. Start the master first, and let it "
                "enable the axis"
            )
        standing = self._sdo.read(self._offset.ref)
        if standing:
            raise StateError(
                f"{self._offset.ref} is {standing}, not 0: somebody has set an offset; nothing was written. Set it to 0"
            )

    def listen(self, timeout: float) -> list[Event]:
        """What was heard; waits up to `timeout` seconds for the first frame. Raises LinkError."""
        now = time.monotonic()
        events = [self._event(cob_id, data, now) for cob_id, data in self._link.receive(timeout)]
        return [event for event in events if event is not None]

    def _event(self, cob_id: int, data: bytes, now: float) -> Event | None:
        if cob_id == SYNC:
            return Synchronised(now)
        if cob_id == self._place.cob_id and len(data) >= self._place.byte + self._target.size:
            return Target(self._target.unpack_from(data, self._place.byte)[0] * self._per_position)
        if cob_id == self._told and len(data) >= self._report.size:
            status, torque = self._report.unpack_from(data)
            return Told(state_of(int(status)) is State.ENABLED, torque * self._per_torque)
        return Foreign(cob_id) if cob_id == self._own else None

    def send(self, torque: float) -> None:
        """Sends the offset [N m]; it acts with the next SYNC. Raises LinkError."""
        ref = self._offset.ref
        self._link.send((self._own, ref.encode(ref.raw(torque / self._per_offset))))

    def close(self, dropped: bool) -> list[str]:
        """Puts the drive's settings back and lets go of the link; what could not be put back, in words.

        Args:
            dropped: the offset is known to be out. Otherwise the drive is given its time to drop it.
        """
        try:
            if not dropped:
                self._let_drop()
            if self._prepared and self._sdo.read(
                self._offset.ref
            ):  # a mapping that goes would leave it for ever
                self._sdo.write(self._offset.ref, 0)
            return self._session.restore()
        finally:
            self._link.close()

    def _let_drop(self) -> None:
        """Waits until the drive has dropped an offset whose sender is silent."""
        heard = [cob_id for cob_id, _ in drain(self._link, self.gone_within)]
        end = time.monotonic() + _LOCK_STEP_DROP
        while self.lock_step and time.monotonic() < end:
            if heard.count(SYNC) * self._axis.cycle >= self.gone_within:
                break
            heard += [cob_id for cob_id, _ in self._link.receive(_LISTEN)]


def open_sidecar(link: FrameLink, number: int, axis: Axis, profile: Profile, keep: Path | None) -> Sidecar:
    """Looks who answers, and puts back what an earlier session has left; the link stays the caller's if this raises.

    Raises:
        ConfigurationError: the profile names no time-out, the drive's cycle is another one than the axis's.
        IdentityMismatch: not a drive of this profile. LinkError: nobody answers.
    """
    sidecar = Sidecar(link, number, axis, profile, keep)
    period = cycle_of(sidecar._sdo)
    if period is not None and abs(period - axis.cycle) > _SAME:
        raise ConfigurationError(
            f"the drive's cycle (60C2h) is {period * 1e3:g} ms, the axis's {axis.cycle * 1e3:g} ms; the model is for "
            "that. Set the master's cycle to it, or tune with the master's"
        )
    return sidecar


def _guard_of(profile: Profile) -> OffsetGuard:
    if profile.offset_guard is None:
        raise ConfigurationError(
            f"profile {profile.name!r} names no time-out for the torque offset ([offset_guard]): if this program "
            "died, the drive would keep the last offset for ever. Where the drive has such a time-out, name it in a "
            "profile of your own; otherwise export the model to the master ('autotune export')"
        )
    return profile.offset_guard
