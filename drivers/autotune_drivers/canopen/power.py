"""Power on and off through the CiA 402 state machine, cycle by cycle.

On: the axis holds where it is (the target is the measured position until power is there). Off: quick
stop, which the drive itself carries out on its ramp, then no voltage; what the axis does meanwhile is
watched (`stopping`). Every way out leaves power off, and a fault that nobody has told yet is raised after.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

from autotune.core.drive import Mode
from autotune.core.errors import AutotuneError, DriveFault, HostLate, LinkError, StateError, TransferAborted
from autotune.core.stopping import StopLimits, StopWatch
from autotune_drivers.canopen.cia402 import (
    DISABLE_VOLTAGE,
    FAULT_RESET,
    FAULTY,
    POWERED,
    QUICK_STOP,
    TOWARDS_ENABLED,
    State,
    describe,
    state_of,
    what_is_missing,
)
from autotune_drivers.canopen.codes import HEARTBEAT_LOST, error_text, is_communication, is_motion, not_ours
from autotune_drivers.canopen.exchange import Exchange
from autotune_drivers.canopen.node import Node
from autotune_drivers.canopen.objects import ObjectRef, Raw
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.profile import Profile
from autotune_drivers.punctuality import BLAMED, host_late, warn

ERROR_REGISTER = ObjectRef(0x1001, 0, "u8", "error register")
ERROR_CODE = ObjectRef(0x603F, 0, "u16", "error code")
CONTROL = ObjectRef(0x6040, 0, "u16", "control word")
STATUS = ObjectRef(0x6041, 0, "u16", "status word")
_REST_CYCLES = 20
_ACTS_WITHIN = 0.05  # s; a drive takes a control word within a few cycles
_SDO_TIMEOUT = 0.05


class Power:
    """Takes one drive through its power states.

    Args:
        stop_seconds: how long the longest quick stop takes.
        scale: SI units in one count of position, and of velocity, as the drive tells them.
    """

    def __init__(
        self,
        node: Node,
        sdo: Sdo,
        exchange: Exchange,
        profile: Profile,
        *,
        limits: StopLimits,
        stop_seconds: float,
        scale: tuple[float, float],
    ) -> None:
        self._node = node
        self._sdo = sdo
        self._exchange = exchange
        self._texts = profile.fault_texts
        self._position = profile.signals.position.ref
        self._seconds = profile.transition_seconds
        self._patience = math.ceil(profile.transition_seconds / limits.period)
        self._stop_patience = math.ceil((stop_seconds + profile.transition_seconds) / limits.period)
        self._acts_within = math.ceil(_ACTS_WITHIN / limits.period)
        self._limits = limits
        self._to_position, self._to_velocity = scale
        self._guard = profile.guard
        self._warned = False
        self._told: set[int] = set()

    # On

    def on(self, mode: Mode) -> Raw:
        """To operation enabled, holding the present position, which is returned as the drive counts it.

        Raises:
            DriveFault: in fault. StateError: the state is not reached. LinkError.
        """
        self._node.take_emergencies()
        self._told.clear()
        hold = self._sdo.read(self._position)
        control, acknowledged = DISABLE_VOLTAGE, False
        self._exchange.restart()
        for _ in range(self._patience):
            self._exchange.cycle(_outputs(control, hold, mode))
            state = self._state
            if state is State.ENABLED:
                return hold
            hold = self._exchange.values[1]
            if state is State.FAULT:
                acknowledged = self._may_acknowledge(acknowledged)
                control = DISABLE_VOLTAGE if control == FAULT_RESET else FAULT_RESET
            else:
                control = TOWARDS_ENABLED[state]
        raise self._stuck()

    @property
    def _status(self) -> int:
        return int(self._exchange.values[0])

    @property
    def _state(self) -> State:
        return state_of(self._status)

    def _may_acknowledge(self, acknowledged: bool) -> bool:
        """Only a fault that a silent master has caused is acknowledged by a live one, and only once."""
        if not acknowledged:
            code = int(self._sdo.read(ERROR_CODE))
            harmless = is_communication(code) and not self._other_cause()
            self._exchange.restart()
            if not harmless:
                raise self.fault(code, "when power was asked for")
        return True

    def _stuck(self) -> AutotuneError:
        status = self._status
        code = self._code()
        if state_of(status) in FAULTY:
            return self.fault(code, "and it cannot be acknowledged")
        error = f"; {error_text(code, self._texts)}" if code else ""
        return StateError(
            f"node {self._node.number} stays in {describe(status)} instead of 'operation enabled' for "
            f"{self._seconds:g} s{error}; {what_is_missing(status)}"
        )

    # Loss

    def _we_were_late(self) -> bool:
        self._node.wire.look_at_the_clock()
        return self._node.wire.punctuality.blamed(self._guard.consume, self._guard.produce)

    def _late(self, codes: Sequence[int]) -> HostLate:
        """The error for an axis that its drive has stopped because this host was silent."""
        silent = self._node.wire.punctuality.recent + self._guard.produce
        said = " and ".join(error_text(code, self._texts) for code in codes if code)
        then = f"stopped its axis{': ' + said if said else ''}, now in {describe(self._status)}"
        return host_late(f"node {self._node.number}", silent, self._guard.consume, then)

    def look_back(self) -> None:
        """Says once a session that this host was nearly too late; to be called without power."""
        silent = self._node.wire.punctuality.worst + self._guard.produce
        if not self._warned and silent >= BLAMED * self._guard.consume:
            self._warned = True
            warn(f"node {self._node.number}", silent, self._guard.consume)

    def lost(self) -> AutotuneError:
        """The error for a drive that has left operation enabled by itself, or sent an emergency."""
        codes = self._emergencies() or [self._code()]
        if self._we_were_late() and all(code == 0 or is_communication(code) for code in codes):
            self._told.update(codes)
            return self._late(codes)
        fault = self._fault(codes, "while it was running")
        if fault is not None:
            return fault
        self._told.add(0)
        return DriveFault(
            f"node {self._node.number} has left 'operation enabled' by itself and is in "
            f"{describe(self._status)} without an error code; {what_is_missing(self._status)}"
        )

    def _emergencies(self) -> list[int]:
        """Codes of the emergencies that have come since the last look; what only says "error gone" is none."""
        return [emergency.code for emergency in self._node.take_emergencies() if emergency.code]

    def _fault(self, codes: Sequence[int], when: str) -> DriveFault | None:
        """One error for all codes that nobody has told yet, the gravest first; None: there are none.

        What motion or communication cause is reset more easily than anything else, so it comes last.
        """
        new = [code for code in dict.fromkeys(codes) if code and code not in self._told]
        if not new:
            return None
        first, *others = sorted(new, key=lambda code: is_motion(code) or is_communication(code))
        self._told.update(others)
        also = "".join(f", and {error_text(code, self._texts)}" for code in others)
        if HEARTBEAT_LOST in new and not self._we_were_late():
            late = self._node.wire.punctuality.recent * 1e3
            also += (
                f" (this host sent every heartbeat, at most {late:.0f} ms late: look at adapter and cable)"
            )
        return self.fault(first, when, also)

    def fault(self, code: int, when: str, also: str = "") -> DriveFault:
        """A fault in words; `also`: those that came with it."""
        self._told.add(code)
        state = f" in {describe(self._status)}" if self._exchange.healthy else ""
        return DriveFault(
            f"node {self._node.number} reports a fault {when}: {error_text(code, self._texts)}{also}{state}. "
            "Remove its cause, reset the fault at the drive (or switch it off and on), and start again",
            code,
        )

    def _code(self) -> int:
        try:
            return int(self._sdo.read(ERROR_CODE, attempts=1))
        except LinkError:
            return 0

    # Off

    def off(self, mode: Mode, brake: bool = True) -> None:
        """Quick stop on the drive's own ramp, then no voltage; without `brake` no voltage at once.

        Raises:
            LinkError: the drive or the adapter does not answer. StateError: power stays on. DriveFault:
                power is off, and in taking it off a fault came that nobody has told yet, or the axis did
                not brake.
        """
        if not self._exchange.healthy:
            status = int(self._sdo.read(STATUS, 1))
            if state_of(status) not in POWERED:
                self._tell(state_of(status), None)
                return
        watch = self._stop(mode) if brake else self._cut(mode)
        if self._state in POWERED:
            raise StateError(
                f"node {self._node.number} stays in {describe(self._status)} although quick stop and disable "
                "voltage were commanded; switch its power supply off"
            )
        self._tell(self._state, watch)

    def _stop(self, mode: Mode) -> StopWatch:
        """Quick stop until the axis rests, then no voltage; what was seen of it."""
        if not self._exchange.values:
            self._exchange.cycle(_outputs(QUICK_STOP, self._sdo.read(self._position), mode))
        hold = self._exchange.values[1]
        moved = self._exchange.ways.longest * self._to_position / self._limits.period
        watch = StopWatch(self._limits, self._motion[1], moved, late=self._exchange.ways.late)
        self._exchange.restart()
        still = 0
        for turn in range(self._stop_patience):
            missed = self._exchange.cycle(_outputs(QUICK_STOP, hold, mode))
            hold = self._exchange.values[1]
            if self._state not in POWERED:
                break
            watch.see(*self._motion, missed, self._exchange.ways.passed)
            at_rest = abs(self._exchange.values[4]) <= 1.0 and self._state is State.QUICK_STOP
            still = still + 1 if at_rest else 0
            deaf = self._deaf(turn, QUICK_STOP)
            if still >= _REST_CYCLES or watch.runs_away or deaf:
                break
        self._play(DISABLE_VOLTAGE, hold, mode, lambda state: state not in POWERED)
        return watch

    def _cut(self, mode: Mode) -> StopWatch:
        """No voltage at once; nothing is to be seen of a stop that is none."""
        hold = self._exchange.values[1] if self._exchange.values else self._sdo.read(self._position)
        self._exchange.restart()
        self._play(DISABLE_VOLTAGE, hold, mode, lambda state: state not in POWERED)
        return StopWatch(self._limits, 0.0)

    @property
    def _motion(self) -> tuple[float, float]:
        """Position and velocity, SI."""
        values = self._exchange.values
        return values[1] * self._to_position, values[4] * self._to_velocity

    def _tell(self, state: State, watch: StopWatch | None) -> None:
        """Raises what was wrong while power was taken off; it is off by now. Raises DriveFault.

        Object 603Fh may still show an old error of a drive that is in order, so only a faulty one is asked.
        """
        when = "while power was taken off"
        self._node.wire.drain()
        codes = self._emergencies()
        if state in FAULTY:
            codes.append(self._code())
        if watch is None and self._we_were_late() and all(map(is_communication, codes)):
            self._told.update(codes)  # the silence itself has been told already
            return
        fault = self._fault(codes, when)
        if fault is None and state in FAULTY and not self._told:
            fault = self.fault(0, when)
        if watch is not None and watch.trouble:
            text = f"node {self._node.number} did not bring its axis to rest as it should: {watch.trouble}"
            if fault is None:
                raise DriveFault(text)
            fault.add_note(text)
        if fault is not None:
            raise fault

    def acknowledge(self) -> None:
        """Acknowledges a fault that this session's motion or silence has caused; others stay.

        Every fault told and the one that the drive shows now have to be of that kind: an emergency that came
        first says nothing about the ones that came after it.
        """
        if self._told and state_of(int(self._sdo.read(STATUS))) is State.FAULT:
            codes = {emergency.code for emergency in self._node.take_emergencies()} - {0}
            codes |= self._told | {int(self._sdo.read(ERROR_CODE))}
            ours = all(is_motion(code) or is_communication(code) for code in codes)
            if ours and not self._other_cause():
                for control in (DISABLE_VOLTAGE, FAULT_RESET, DISABLE_VOLTAGE):
                    self._sdo.write(CONTROL, control)
        self._node.take_emergencies()
        self._told.clear()

    def _other_cause(self) -> bool:
        """True where the error register shows a fault that no master causes, or where it cannot be read."""
        try:
            return not_ours(int(self._sdo.read(ERROR_REGISTER)))
        except TransferAborted:
            return True

    def abandon(self, mode: Mode, brake: bool = True) -> bool:
        """For a drive that does not answer in its cycles: quick stop blind, our heartbeat ends, and power off by SDO.

        Where the SDO does not come through either, the drive's own heartbeat consumer does the rest. Never raises
        LinkError.

        Returns:
            Whether the drive has confirmed that power is off.
        """
        self._node.wire.stop_heartbeat()
        try:
            self._exchange.shout(_outputs(QUICK_STOP if brake else DISABLE_VOLTAGE, 0, mode), 3)
            if brake and self._off_by_sdo(QUICK_STOP, self._stop_patience):
                return True
            return self._off_by_sdo(DISABLE_VOLTAGE, self._patience)
        except LinkError:
            return False

    def _off_by_sdo(self, control: int, cycles: int) -> bool:
        """Commands that again and again until power is off, for so many cycles' time. Raises LinkError: no answer."""
        end = time.monotonic() + cycles * self._limits.period
        while (state := state_of(int(self._sdo.read(STATUS, 1)))) in POWERED:
            if time.monotonic() > end or (control == QUICK_STOP and self._rests(state)):
                return False
            with suppress(TransferAborted):
                self._sdo.write(CONTROL, control)
        return True

    def _rests(self, state: State) -> bool:
        """A drive that holds its axis after its quick stop, and holds it still. Raises LinkError."""
        if state is not State.QUICK_STOP:
            return False
        before = int(self._sdo.read(self._position, 1))
        self._node.wire.wait(_ACTS_WITHIN, lambda: False)
        return abs(int(self._sdo.read(self._position, 1)) - before) <= 1

    def _play(self, control: int, hold: Raw, mode: Mode, until: Callable[[State], bool]) -> None:
        for turn in range(self._patience):
            self._exchange.cycle(_outputs(control, hold, mode))
            if until(self._state) or self._deaf(turn, control):
                return

    def _deaf(self, turn: int, control: int) -> bool:
        """True where the drive goes on as if it were not told to stop, by process data and then by SDO.

        Its process data may not arrive, or be another master's. Some cycles after the SDO the last resort is
        better than waiting: our heartbeat ends.
        """
        if self._state is not State.ENABLED or (turn + 1) % self._acts_within:
            return False
        if turn + 1 > self._acts_within:
            return True
        with suppress(LinkError):
            self._sdo.write(CONTROL, control, _SDO_TIMEOUT)
        self._exchange.restart()
        return False


def _outputs(control: int, hold: Raw, mode: Mode) -> tuple[Raw, Raw, Raw]:
    return control, hold if mode is Mode.POSITION else 0, 0
