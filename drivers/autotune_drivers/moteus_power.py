"""Power on and off, cycle by cycle: the axis holds where it is, and comes to rest before power goes.

On: position commands at the measured position until the controller is in position mode. Off: a ramp that
we play from where the axis is and how fast, on the axis's deceleration; then stop. If we die in it, the
watchdog of the last command ends it.
"""

from __future__ import annotations

import math
import time

from autotune.core.errors import AutotuneError, DriveFault, LinkError, StateError
from autotune_drivers.moteus_exchange import MoteusExchange, State, Target
from autotune_drivers.moteus_faults import LIMITED, STARTING, Mode, fault_text, is_motion, mode_text
from autotune_drivers.moteus_profile import MoteusProfile

_REST_CYCLES = 20
_REST_SPEED = 1e-3  # rev/s
_STOP_TIMEOUT = 0.25
_LOOK = 0.005
_REST_LOOKS = 4


class MoteusPower:
    """Takes one controller to power and back.

    Args:
        deceleration: of a stop [rev/s²]; speed: the fastest that the axis may be [rev/s].
    """

    def __init__(
        self,
        number: int,
        exchange: MoteusExchange,
        profile: MoteusProfile,
        period: float,
        deceleration: float,
        speed: float,
    ) -> None:
        self._number = number
        self._exchange = exchange
        self._texts = profile.fault_texts
        self._watchdog = profile.guard.watchdog
        self._period = period
        self._deceleration = deceleration
        self._seconds = profile.transition_seconds
        self._patience = math.ceil(profile.transition_seconds / period)
        self._ramp_cycles = math.ceil(speed / deceleration / period) + self._patience
        self.last_fault = 0

    def on(self) -> float:
        """To position mode, holding the present position, which is returned [rev].

        Raises:
            DriveFault: in fault. StateError: the mode is not reached. LinkError.
        """
        state = self._exchange.look()
        if state.mode == Mode.FAULT:
            raise self.fault(state.fault, "when power was asked for")
        if state.mode != Mode.STOPPED:
            state = self._stopped()
        self._exchange.restart()
        for _ in range(self._patience):
            hold = state.position
            self._exchange.cycle(Target(hold))
            state = self._state
            if state.mode == Mode.POSITION:
                return hold
            if state.mode == Mode.FAULT:
                raise self.fault(state.fault, "when power was switched on")
        raise StateError(
            f"controller {self._number} stays in {mode_text(state.mode)} instead of 'position' for "
            f"{self._seconds:g} s; check safe torque off, enable input and the supply"
            + (" (it still calibrates)" if state.mode in STARTING else "")
        )

    def _stopped(self) -> State:
        state = self._exchange.stop(_STOP_TIMEOUT)
        if state is None:
            raise LinkError(f"controller {self._number} does not answer a stop command; check its line")
        return state

    @property
    def _state(self) -> State:
        state = self._exchange.state
        if state is None:
            raise LinkError(f"controller {self._number} has told nothing yet; open the link again")
        return state

    def lost(self) -> AutotuneError:
        """The error for a controller that is no longer in position mode."""
        state = self._state
        if state.mode == Mode.FAULT:
            return self.fault(state.fault, "while it was running")
        if state.mode == Mode.TIMEOUT:
            return DriveFault(
                f"controller {self._number} has stopped its axis by itself: no command has reached it for "
                f"{self._watchdog * 1e3:g} ms (its watchdog). Look for what delays the host, or for a bad line"
            )
        return DriveFault(
            f"controller {self._number} has left position mode by itself and is in {mode_text(state.mode)}; "
            "another program commands it, or its supply was interrupted. Stop that program and start again"
        )

    def fault(self, number: int, when: str) -> DriveFault:
        """A fault in words."""
        self.last_fault = number
        return DriveFault(
            f"controller {self._number} reports a fault {when}: {fault_text(number, self._texts)}. Remove its "
            "cause, clear the fault ('d stop' in its console, or switch it off and on), and start again",
            number,
        )

    def off(self, position: float, velocity: float) -> None:
        """A ramp from `position` [rev] at `velocity` [rev/s], rest, then stop.

        Raises:
            LinkError: the controller or the line does not answer. StateError: power stays on.
        """
        if not self._exchange.healthy:
            self._exchange.look()
        if self._state.mode == Mode.POSITION:
            self._exchange.restart()
            self._brake(position, velocity)
        if self._state.mode == Mode.TIMEOUT:
            self._await_rest()
        if self._state.mode == Mode.FAULT:
            return  # power is off already; the fault stays for whoever looks
        state = self._exchange.stop(_STOP_TIMEOUT)
        if state is None:
            raise LinkError(f"controller {self._number} has not confirmed its stop; its watchdog stops it")
        if state.mode not in (Mode.STOPPED, Mode.FAULT):
            raise StateError(
                f"controller {self._number} stays in {mode_text(state.mode)} although stop was commanded; switch "
                "its power supply off"
            )

    def _brake(self, position: float, velocity: float) -> None:
        still = 0
        for _ in range(self._ramp_cycles):
            slower = max(abs(velocity) - self._deceleration * self._period, 0.0)
            position += math.copysign(0.5 * (abs(velocity) + slower) * self._period, velocity)
            velocity = math.copysign(slower, velocity)
            self._exchange.cycle(Target(position, velocity))
            state = self._state
            if state.mode != Mode.POSITION:
                return
            still = still + 1 if slower == 0.0 and abs(state.velocity) < _REST_SPEED else 0
            if still >= _REST_CYCLES:
                return

    def _await_rest(self) -> None:
        """The controller brakes by itself; power goes when the axis rests, or after the longest stop."""
        end = time.monotonic() + self._ramp_cycles * self._period
        still = 0
        while still < _REST_LOOKS and time.monotonic() < end:
            time.sleep(_LOOK)
            state = self._exchange.look()
            if state.mode != Mode.TIMEOUT:
                return
            still = still + 1 if abs(state.velocity) < _REST_SPEED else 0

    def acknowledge(self) -> None:
        """Clears a fault that this session's motion has caused; others stay. Raises LinkError."""
        if is_motion(self.last_fault) and self._exchange.look().mode == Mode.FAULT:
            self._exchange.stop(_STOP_TIMEOUT)
        self.last_fault = 0

    def present_faults(self) -> list[str]:
        """Faults in words. Raises LinkError."""
        state = self._exchange.look()
        if state.mode != Mode.FAULT or state.fault in LIMITED:
            return []
        return [fault_text(state.fault, self._texts)]

    def abandon(self) -> None:
        """Best effort for a controller that does not answer; its watchdog does the rest. Never raises LinkError."""
        try:
            self._exchange.stop(0.01)
        except LinkError:
            return
