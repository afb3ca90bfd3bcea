"""A CiA 402 drive on a CANopen bus as a `Drive`: what the profile says, in SI, one cycle at a time.

Power is on only while the drive guards us: object 1016h watches our heartbeat from `enable` to
`disable`, and the heartbeat is sent by the thread that steps. A host that dies or hangs therefore
stops the axis. What a session changes is put back by `close`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping, Sequence
from contextlib import suppress
from types import MappingProxyType

from autotune.core.axis import Axis
from autotune.core.drive import Command, Mode, Sample, Standing
from autotune.core.drive_recording import DriveRecording
from autotune.core.errors import DriveError, DriveFault, LinkError, LinkTimeout, StateError, TransferAborted
from autotune.core.stopping import StopLimits
from autotune_drivers.canopen import storing
from autotune_drivers.canopen.cia402 import (
    ENABLE_OPERATION,
    ENABLED_MASK,
    ENABLED_VALUE,
    FAULTY,
    MODE_CODES,
    POWERED,
    describe,
    state_of,
)
from autotune_drivers.canopen.codes import error_text
from autotune_drivers.canopen.drive_recorder import DriveRecorder
from autotune_drivers.canopen.exchange import SLOW_LOST, Exchange
from autotune_drivers.canopen.foreign import Foreigners
from autotune_drivers.canopen.node import OPERATIONAL, PRE_OPERATIONAL, STOPPED, Node
from autotune_drivers.canopen.objects import ObjectRef, Raw
from autotune_drivers.canopen.parameters import DriveParameters
from autotune_drivers.canopen.power import ERROR_CODE, STATUS, Power
from autotune_drivers.canopen.read_back import ReadBack
from autotune_drivers.canopen.scaling import Scaling, Told
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.canopen.session import Backup, Session
from autotune_drivers.profile import Profile
from autotune_drivers.signals import Signal
from autotune_drivers.stopping import MAY_BE_ON, close_down, off_after, tell_unconfirmed
from autotune_drivers.units import Units

MODE_WANTED = ObjectRef(0x6060, 0, "i8", "mode of operation")
MODE_SHOWN = ObjectRef(0x6061, 0, "i8", "mode of operation display")
FAULT_REACTION = ObjectRef(0x605E, 0, "i16", "fault reaction option code")
HEARTBEAT_CONSUMER = 0x1016
ROUNDED_UP = 1.05
"""By so much a drive may make the time longer after which it stops."""
SUPPORTED_MODES = ObjectRef(0x6502, 0, "u32", "supported drive modes")
INCLUDES = "torque.demand_includes_feedforward"
"""Not in the drive, but how it is read: 1 or 0, where the profile says that it has to be found."""
_TARGET, _OFFSET = 1, 2  # their places in the outputs of a cycle
_MODE_TIMEOUT = 0.5
_TORQUE_OFF = 0  # of 605Eh: the drive function is disabled, the motor is free to turn


class CanopenDrive:
    """One drive; made by `canopen_open.open_drive`, which has checked who it is.

    `left`: what earlier sessions had left and was put right, in words.
    """

    left: tuple[str, ...] = ()

    def __init__(
        self,
        node: Node,
        sdo: Sdo,
        session: Session,
        profile: Profile,
        axis: Axis,
        units: Units,
        identity: Mapping[str, int | str],
        lock_step: bool,
        nmt_before: str,
        settings: Sequence[tuple[ObjectRef, Raw]],
    ) -> None:
        self.lock_step = lock_step
        self._node, self._sdo, self._session = node, sdo, session
        self._profile, self._units, self._period = profile, units, axis.cycle
        self._identity = MappingProxyType(dict(identity))
        self._nmt_before = nmt_before
        self._settings = tuple(settings)
        self._parameters = DriveParameters(sdo, profile, units)
        self._exchange = Exchange(node, profile, axis.cycle, lock_step)
        stop = axis.limits.speed / axis.limits.deceleration
        self._power = Power(
            node,
            sdo,
            self._exchange,
            profile,
            limits=StopLimits.of(axis),
            stop_seconds=stop,
            scale=(units.signed(profile.signals.position.unit), units.signed(profile.signals.velocity.unit)),
        )
        self._foreigners = Foreigners(node.wire, node.number)
        self._read_back = ReadBack(sdo, axis.cycle)
        self._recorder = DriveRecorder(sdo, session, profile, units, axis.cycle)
        self._marks: list[tuple[int, int]] | None = None
        self._guard, self._guarded = _guard(profile, units, node.wire.own_node)
        self._mode = Mode.POSITION
        self._held: Raw = 0
        self._mapped: Mode | None = None
        self._live = self._asked_for_power = self._closed = self._blind = self._unsure = False
        self._loss: LinkError | None = None  # that has told of a lost link
        self._scaling = Scaling(profile, units)

    def note(self) -> None:
        """Notes everything that will be changed, so that `backup` is complete from the beginning."""
        self._parameters.find_ripple()
        self._session.remember(self._guard)
        self._session.remember(MODE_WANTED)
        with suppress(TransferAborted):
            self._session.remember(FAULT_REACTION)
        for setting in self._exchange.settings(self._profile.commands.position.ref):
            self._session.remember_pdo(setting)

    @property
    def period(self) -> float:
        return self._period

    @property
    def identity(self) -> Mapping[str, int | str]:
        return self._identity

    def backup(self) -> Backup:
        """What may have to be put back; for a process that has to do it in our place."""
        return self._session.backup()

    def look(self) -> Standing:
        signals = self._profile.signals
        position, velocity = (self._sdo.read(one.ref) for one in (signals.position, signals.velocity))
        return self._scaling.standing(position, velocity)

    # Power

    def enable(self, mode: Mode) -> None:
        if self._live:
            self.disable()
            raise StateError("enable was asked for while power was on; power is off now: disable first")
        self._live, self._loss, self._unsure = True, None, False
        try:
            self._prepare(mode)
            self._asked_for_power = True
            self._held = self._power.on(mode)
        except BaseException as error:
            self._loss = error if isinstance(error, LinkError) else None
            off_after(error, self.disable)
            raise

    def _prepare(self, mode: Mode) -> None:
        self._mode = mode
        self._must_be_alone()
        if self._mapped is not mode:
            self._map(mode)
        self._select(mode)
        self._choose_reaction(mode)
        if self._exchange.slow_signal is not None:
            self._exchange.told_slow(self._sdo.read(self._exchange.slow_signal))
        self._node.command(OPERATIONAL)
        self._be_guarded()
        offset = self._profile.commands.torque_feedforward.ref
        self._read_back.begin([(self._target(mode).ref, _TARGET), (offset, _OFFSET)])
        self._node.wire.start_heartbeat()  # watching begins with the first one after this

    def _be_guarded(self) -> None:
        """Raises LinkError: the drive would not stop in time if this host fell silent."""
        held = self._session.write(self._guard, self._guarded)
        node = int(self._guarded) & ~0xFFFF if self._guard.index == HEARTBEAT_CONSUMER else 0
        if not 0 < held - node <= ROUNDED_UP * (self._guarded - node):
            raise LinkError(
                f"node {self._node.number}: {self._guard} is {held} after {self._guarded} was written, so the drive "
                "would not stop in time if this host fell silent. Power stays off; look at adapter and cable"
            )

    def _must_be_alone(self) -> None:
        self._node.wire.drain()
        stranger = self._foreigners.accuse()
        if stranger is not None:
            raise stranger

    def _map(self, mode: Mode) -> None:
        self._mapped = None
        self._node.command(PRE_OPERATIONAL)
        for setting in self._exchange.settings(self._target(mode).ref):
            self._session.map(setting)
        self._mapped = mode

    def _target(self, mode: Mode) -> Signal:
        commands = self._profile.commands
        return {
            Mode.POSITION: commands.position,
            Mode.VELOCITY: commands.velocity,
            Mode.TORQUE: commands.torque,
        }[mode]

    def _select(self, mode: Mode) -> None:
        wanted = MODE_CODES[mode]
        self._session.write(MODE_WANTED, wanted)
        shown = self._sdo.read(MODE_SHOWN)
        if shown != wanted:
            self._node.wire.wait(_MODE_TIMEOUT, lambda: self._sdo.read(MODE_SHOWN) == wanted)
            shown = self._sdo.read(MODE_SHOWN)
        if shown != wanted:
            raise StateError(
                f"node {self._node.number} stays in mode {shown} when asked for {wanted} (cyclic synchronous "
                f"{mode.value}); see object 6502h for the modes that it has"
            )

    def _choose_reaction(self, mode: Mode) -> None:
        """In torque mode a drive in fault takes its torque away; in the other modes it does what it always does.

        Within friction nothing is seen of an encoder that lies, a drive brakes by it in a loop that nobody can stop,
        and there is no speed to brake. A drive that lacks the object, or does not take the value, is left as it is.
        """
        if mode is not Mode.TORQUE:
            self._session.undo(FAULT_REACTION)
            return
        with suppress(TransferAborted):
            self._session.write(FAULT_REACTION, _TORQUE_OFF)

    def disable(self) -> None:
        """See `Drive.disable`.

        Raises:
            DriveFault: power is off, but a fault came with it that was not told before. LinkError: the drive
                did not confirm, and no cycle had failed before. StateError: power stays on.
        """
        if not self._live:
            return
        trouble: DriveError | None = None
        try:
            if self._asked_for_power:
                trouble = self._power_off()
        except LinkError as error:
            told, self._loss = self._loss, self._loss or error
            self._unsure = not self._power.abandon(self._mode, not self._blind)
            tell_unconfirmed(error, told, self._unsure)
            return
        finally:
            self._live = self._asked_for_power = False
        self._unguard()
        self._power.look_back()
        if trouble is not None:
            raise trouble

    def cut(self) -> None:
        """See `autotune.core.drive.CutsPower`."""
        self._blind = True
        try:
            self.disable()
        finally:
            self._blind = False

    def _unguard(self) -> None:
        """Without power nobody has to watch us; what cannot be put back now is tried again by `close`."""
        with suppress(LinkError):
            self._session.undo(self._guard)

    def _power_off(self) -> DriveError | None:
        """What was wrong with it; the guard is put back before it is told, where power is off."""
        try:
            self._power.off(self._mode, brake=not self._blind)
        except DriveFault as fault:
            return fault
        except StateError:
            self._unsure = not self._power.abandon(self._mode, not self._blind)
            raise
        return None

    # The cycle

    def step(self, command: Command) -> Sample:
        if not self._live:
            raise StateError("a cycle was asked for while power is off; enable the drive first")
        try:
            target = self._scaling.target(self._mode, command, self._held)
            if self._mode is Mode.POSITION:
                self._held = target
            feedforward = self._scaling.feedforward(command)
            outputs = (ENABLE_OPERATION, target, feedforward)
            missed = self._exchange.cycle(outputs)
        except LinkError as error:
            self._loss = error
            raise
        except (ValueError, OverflowError, struct.error) as error:
            raise DriveError(
                f"{command} cannot be sent to node {self._node.number}: {error}; every value must be finite "
                "and within the range of its object"
            ) from error
        if int(self._exchange.values[0]) & ENABLED_MASK != ENABLED_VALUE or self._node.emergencies:
            self._check_power()
        self._read_back.cycle(outputs)
        if self._foreigners.suspect:
            self._must_be_alone()
        if self._exchange.slow_overdue:
            raise self._stale()
        if self._marks is not None:
            self._mark(self._marks)
        time = (self._exchange.count - 1) * self._period
        return self._scaling.sample(self._mode, time, target, feedforward, self._told(), missed)

    def _told(self) -> Told:
        """What the drive has told in this cycle."""
        values = self._exchange.values
        if not all(map(math.isfinite, values)):
            raise DriveFault(
                f"node {self._node.number} tells a value that is no number ({values}); its position sensor or its "
                "measurement is not valid. Check the sensor's cable and the drive"
            )
        return Told(values, self._exchange.slow)

    def _stale(self) -> LinkTimeout:
        age, period = self._exchange.slow_seconds
        degrees = self._scaling.temperature(self._exchange.slow)
        return LinkTimeout(
            f"node {self._node.number} has not told its temperature ({self._exchange.slow_signal}) for {age:.2g} s, "
            f"though it is to come every {period:.2g} s; the last one, {degrees:.1f} °C, is too old to "
            f"guard the axis with (allowed are {SLOW_LOST} lost in a row). Check the bus for lost frames, and what "
            "else changes the drive's PDOs"
        )

    def _mark(self, marks: list[tuple[int, int]]) -> None:
        """Notes where our count of cycles and the drive's SYNC counter have moved against each other."""
        count, sync = self._exchange.count, self._exchange.sync
        if sync is not None and (not marks or (count - sync - marks[-1][0] + marks[-1][1]) & 0xFFFF):
            marks.append((count, sync))

    def _check_power(self) -> None:
        """An emergency that only says "error gone" is no reason to stop."""
        running = int(self._exchange.values[0]) & ENABLED_MASK == ENABLED_VALUE
        if running and all(emergency.code == 0 for emergency in self._node.emergencies):
            self._node.take_emergencies()
            return
        raise self._power.lost()

    # At rest

    def read_parameters(self, names: Sequence[str] | None = None) -> dict[str, float]:
        found: dict[str, float] = {}
        if self._profile.torque.find and (names is None or INCLUDES in names):
            found[INCLUDES] = float(self._scaling.demand_has_feedforward)
        rest = None if names is None else [name for name in names if name not in found]
        return self._parameters.read(rest) | found

    def write_parameters(self, values: Mapping[str, float]) -> None:
        rest = dict(values)
        includes = rest.pop(INCLUDES, None) if self._profile.torque.find else None
        self._parameters.write(rest)
        if includes is not None:
            self._scaling.demand_has_feedforward = bool(includes)

    def store(self) -> None:
        store = self._profile.store
        if store is None:
            raise DriveError(
                f"profile {self._profile.name!r} does not say how this drive stores parameters; "
                "store them with the vendor's tool"
            )
        if self._live:
            raise StateError("parameters are stored with power off only; disable the drive first")
        self._put_back()  # what a session changes must not survive it
        try:
            storing.save(self._node, self._sdo, self._parameters, store)
            if store.verify != "none":
                storing.verify(self._node, self._parameters, store, lambda: self._reset(store.verify))
        finally:
            for setting in self._settings:
                self._session.write_if_there(*setting)
            self._node.monitor(self._profile.guard.monitor)

    def _reset(self, how: str) -> None:
        """Resets the node. Raises LinkTimeout: it did not come back."""
        seconds = self._profile.transition_seconds
        booted = self._node.reset(how, seconds)
        self._mapped = None
        self._session.forget_present()
        if not booted and not self._answers():
            raise LinkTimeout(
                f"node {self._node.number} did not come back within {seconds:g} s after "
                "the reset that follows storing; switch it off and on, and start again"
            )
        self._node.take_emergencies()

    def recorder_seconds(self) -> float:
        """How long the drive's own recorder can record without a gap [s]; 0 where it cannot."""
        return self._recorder.seconds

    def begin_recording(self, seconds: float) -> None:
        """Starts the drive's recorder. Raises ConfigurationError (too long), LinkError."""
        self._marks = []  # from here on it may be armed, whatever becomes of the start
        self._recorder.begin(seconds)

    def end_recording(self) -> DriveRecording:
        """Stops the recorder and fetches it, with power off. Raises LinkError."""
        if self._live:
            raise StateError("the recorder is fetched with power off only; disable the drive first")
        marks, self._marks = self._marks or [], None
        return self._recorder.end(tuple(marks))

    def faults(self) -> list[str]:
        self._node.wire.drain()
        status = int(self._sdo.read(STATUS))
        if state_of(status) not in FAULTY:
            return []
        code = int(self._sdo.read(ERROR_CODE))
        return [f"{error_text(code, self._profile.fault_texts)} in {describe(status)}"]

    def powered(self) -> bool | None:
        """What the drive says of its power now; None where it does not answer."""
        try:
            return state_of(int(self._sdo.read(STATUS, attempts=1))) in POWERED
        except LinkError:
            return None

    def idle(self) -> None:
        """To be called now and then between routines: heartbeat out, messages in. Raises LinkError."""
        self._node.wire.pump(0.0)

    def close(self) -> None:
        if self._closed:
            return
        self._closed = True
        hang_up, who = self._node.wire.link.close, f"node {self._node.number}"
        close_down(self.disable, self._restore, hang_up, lambda: self._loss is not None, who)

    def _restore(self) -> list[str]:
        if self._loss is not None and not self._answers():
            return []
        self._loss = None
        if self._unsure and not self._power.abandon(self._mode, not self._blind):
            return [MAY_BE_ON]
        self._power.acknowledge()
        self._node.wire.stop_heartbeat()
        troubles = self._recorder_off()
        troubles += [*self._session.restore(self._leave_operational), *self._sdo.strays()]
        known = self._nmt_before in (OPERATIONAL, STOPPED)
        self._node.command(self._nmt_before if known else PRE_OPERATIONAL)
        return troubles

    def _recorder_off(self) -> list[str]:
        """An armed recorder refuses that its settings are put back. Raises LinkTimeout."""
        if self._marks is None:
            return []
        self._marks = None
        try:
            self._recorder.stop()
        except TransferAborted as error:
            return [f"the drive's recorder could not be stopped: {error}"]
        return []

    def _leave_operational(self) -> None:
        """PDOs are set with the node pre-operational."""
        self._node.command(PRE_OPERATIONAL)
        self._mapped = None

    def _put_back(self) -> None:
        troubles = self._session.restore(self._leave_operational)
        if troubles:
            raise LinkError(f"nothing was stored in node {self._node.number}, as {'; '.join(troubles)} first")

    def _answers(self) -> bool:
        try:
            self._sdo.read(STATUS)
        except LinkError:
            return False
        return True


def _guard(profile: Profile, units: Units, own_node: int) -> tuple[ObjectRef, Raw]:
    """What makes the drive stop by itself when we fall silent: the object, and its value."""
    watchdog = profile.guard.watchdog
    if watchdog is not None:
        ref = watchdog.named("communication watchdog").ref
        return ref, ref.raw(profile.guard.consume / units.factor(watchdog.unit))
    milliseconds = round(profile.guard.consume * 1e3)
    return ObjectRef(HEARTBEAT_CONSUMER, 1, "u32", "consumer heartbeat time"), own_node << 16 | milliseconds
