"""Power on and off through the CiA 402 state machine, cycle by cycle.

On: the axis holds where it is (the target is the measured position until power is there). Off: quick
stop, which the drive itself carries out on its ramp, then no voltage. Every way out leaves power off.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from autotune.core.drive import Mode
from autotune.core.errors import AutotuneError, DriveFault, LinkError, StateError
from autotune_drivers.cia402 import (
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
from autotune_drivers.codes import error_text, is_communication, is_motion
from autotune_drivers.exchange import Exchange
from autotune_drivers.node import Node
from autotune_drivers.objects import ObjectRef, Raw
from autotune_drivers.profile import Profile
from autotune_drivers.sdo import Sdo

ERROR_CODE = ObjectRef(0x603F, 0, "u16", "error code")
CONTROL = ObjectRef(0x6040, 0, "u16", "control word")
STATUS = ObjectRef(0x6041, 0, "u16", "status word")
_REST_CYCLES = 20


class Power:
    """Takes one drive through its power states.

    Args:
        stop_seconds: how long the longest quick stop takes.
    """

    def __init__(
        self, node: Node, sdo: Sdo, exchange: Exchange, profile: Profile, period: float, stop_seconds: float
    ) -> None:
        self._node = node
        self._sdo = sdo
        self._exchange = exchange
        self._texts = profile.fault_texts
        self._position = profile.signals.position.ref
        self._seconds = profile.transition_seconds
        self._patience = math.ceil(profile.transition_seconds / period)
        self._stop_patience = math.ceil((stop_seconds + profile.transition_seconds) / period)
        self.last_fault = 0

    # On

    def on(self, mode: Mode) -> Raw:
        """To operation enabled, holding the present position, which is returned as the drive counts it.

        Raises:
            DriveFault: in fault. StateError: the state is not reached. LinkError.
        """
        self._node.take_emergencies()
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
            self._exchange.restart()
            if not is_communication(code):
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

    def lost(self) -> DriveFault:
        """The error for a drive that has left operation enabled by itself, or sent an emergency."""
        codes = [emergency.code for emergency in self._node.take_emergencies() if emergency.code]
        code = codes[0] if codes else self._code()
        if code:
            return self.fault(code, "while it was running")
        return DriveFault(
            f"node {self._node.number} has left 'operation enabled' by itself and is in "
            f"{describe(self._status)} without an error code; {what_is_missing(self._status)}"
        )

    def fault(self, code: int, when: str) -> DriveFault:
        """A fault in words."""
        self.last_fault = code
        state = f" in {describe(self._status)}" if self._exchange.values else ""
        return DriveFault(
            f"node {self._node.number} reports a fault {when}: {error_text(code, self._texts)}{state}. "
            "Remove its cause, reset the fault at the drive (or switch it off and on), and start again",
            code,
        )

    def _code(self) -> int:
        try:
            return int(self._sdo.read(ERROR_CODE, attempts=1))
        except LinkError:
            return 0

    # Off

    def off(self, mode: Mode) -> None:
        """Quick stop on the drive's own ramp, then no voltage.

        Raises:
            LinkError: the drive or the adapter does not answer. StateError: power stays on.
        """
        if not self._exchange.healthy and state_of(int(self._sdo.read(STATUS, 1))) not in POWERED:
            return
        hold = self._exchange.values[1] if self._exchange.values else self._sdo.read(self._position)
        self._exchange.restart()
        still = 0
        for _ in range(self._stop_patience):
            self._exchange.cycle(_outputs(QUICK_STOP, hold, mode))
            hold = self._exchange.values[1]
            at_rest = abs(self._exchange.values[4]) <= 1.0 and self._state is State.QUICK_STOP
            still = still + 1 if at_rest else 0
            if self._state not in POWERED or still >= _REST_CYCLES:
                break
        self._play(DISABLE_VOLTAGE, hold, mode, lambda state: state not in POWERED)
        if self._state in POWERED:
            raise StateError(
                f"node {self._node.number} stays in {describe(self._status)} although quick stop and disable "
                "voltage were commanded; switch its power supply off"
            )

    def acknowledge(self) -> None:
        """Acknowledges a fault that this session's motion or silence has caused; others stay."""
        ours = is_motion(self.last_fault) or is_communication(self.last_fault)
        if ours and state_of(int(self._sdo.read(STATUS))) is State.FAULT:
            for control in (DISABLE_VOLTAGE, FAULT_RESET, DISABLE_VOLTAGE):
                self._sdo.write(CONTROL, control)
        self._node.take_emergencies()
        self.last_fault = 0

    def abandon(self, mode: Mode) -> None:
        """Best effort for a drive that does not answer: quick stop blind, and our heartbeat ends.

        The drive's own heartbeat consumer does the rest. Never raises LinkError.
        """
        self._node.wire.stop_heartbeat()
        try:
            self._exchange.shout(_outputs(QUICK_STOP, 0, mode), 3)
        except LinkError:
            return

    def _play(self, control: int, hold: Raw, mode: Mode, until: Callable[[State], bool]) -> None:
        for _ in range(self._patience):
            self._exchange.cycle(_outputs(control, hold, mode))
            if until(self._state):
                return


def _outputs(control: int, hold: Raw, mode: Mode) -> tuple[Raw, Raw, Raw]:
    return control, hold if mode is Mode.POSITION else 0, 0
