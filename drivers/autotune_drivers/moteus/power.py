"""Power on and off, cycle by cycle: the axis holds where it is, and comes to rest before power goes.

On: position commands at the measured position until the controller is in position mode. Off: a ramp that
we play from where the axis is and how fast, on the axis's deceleration; then stop. If we die in it, the
watchdog of the last command ends it. What the axis does meanwhile is watched (`stopping`), and a fault that
nobody has told yet is raised when power is off.
"""

from __future__ import annotations

import math
import time
from contextlib import suppress

from autotune.core.errors import AutotuneError, DriveFault, LinkError, StateError
from autotune.core.stopping import StopLimits, StopWatch
from autotune_drivers.moteus.exchange import TEMPERATURE_AGE, MoteusExchange, State, Target
from autotune_drivers.moteus.faults import LIMITED, STARTING, Mode, fault_text, is_motion, mode_text
from autotune_drivers.moteus.profile import MoteusProfile
from autotune_drivers.punctuality import BLAMED, host_late, warn

_REST_CYCLES = 20
_REST_SPEED = 1e-3  # rev/s
_STOP_TIMEOUT = 0.25
_AT_ONCE = 0.01
_LOOK = 0.005
_REST_LOOKS = 4


class MoteusPower:
    """Takes one controller to power and back.

    Args:
        deceleration: of a stop [rev/s²]; speed: the fastest that the axis may be [rev/s].
        scale: rad in one revolution as the controller counts it.
    """

    def __init__(
        self,
        number: int,
        exchange: MoteusExchange,
        profile: MoteusProfile,
        *,
        limits: StopLimits,
        deceleration: float,
        speed: float,
        scale: float,
    ) -> None:
        self._number = number
        self._exchange = exchange
        self._texts = profile.fault_texts
        self._watchdog = profile.guard.watchdog
        self._limits, self._scale = limits, scale
        self._period = period = limits.period
        self._deceleration = deceleration
        self._seconds = profile.transition_seconds
        self._patience = math.ceil(profile.transition_seconds / period)
        self._ramp_cycles = math.ceil(speed / deceleration / period) + self._patience
        self._warned = False
        self._told: set[int] = set()

    def on(self) -> float:
        """To position mode, holding the present position, which is returned [rev].

        Raises:
            DriveFault: in fault. StateError: the mode is not reached. LinkError.
        """
        self._told.clear()
        self._exchange.punctuality.begin()
        state = self._exchange.look()
        if state.mode == Mode.FAULT:
            raise self.fault(state.fault, "when power was asked for")
        self.must_see()
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
        punctuality = self._exchange.punctuality
        if state.mode == Mode.TIMEOUT and punctuality.blamed(self._watchdog):
            then = "stopped its axis by itself (its watchdog)"
            silent = punctuality.recent + self._period
            return host_late(f"controller {self._number}", silent, self._watchdog, then)
        if state.mode == Mode.TIMEOUT:
            return DriveFault(
                f"controller {self._number} has stopped its axis by itself: no command has reached it for "
                f"{self._watchdog * 1e3:g} ms (its watchdog). Look for what delays the host, or for a bad line"
            )
        return DriveFault(
            f"controller {self._number} has left position mode by itself and is in {mode_text(state.mode)}; "
            "another program commands it, or its supply was interrupted. Stop that program and start again"
        )

    def must_see(self) -> None:
        """What the controller tells of the motion has to be numbers. Raises DriveFault."""
        state = self._state
        if not math.isfinite(state.position + state.velocity + state.torque):
            raise DriveFault(
                f"controller {self._number} does not know where its axis is (position {state.position:g} rev, "
                f"velocity {state.velocity:g} rev/s, torque {state.torque:g}): its encoder is not valid. Check its "
                "cable and magnet, and run 'moteus_tool --calibrate' where it was never set up"
            )

    def must_be_warm(self) -> None:
        """A temperature that was there has to stay there. Raises DriveFault."""
        if self._exchange.temperature_overdue:
            raise DriveFault(
                f"controller {self._number} has told no temperature for more than {TEMPERATURE_AGE:g} s; the last "
                f"one, {self._exchange.last_temperature:.1f} °C, is too old to guard the axis with. Check the "
                "thermistor and its cable"
            )

    def look_back(self) -> None:
        """Says once a session that this host was nearly too late; to be called without power."""
        worst = self._exchange.punctuality.worst
        if not self._warned and worst >= BLAMED * self._watchdog:
            self._warned = True
            warn(f"controller {self._number}", worst, self._watchdog)

    def fault(self, number: int, when: str) -> DriveFault:
        """A fault in words."""
        self._told.add(number)
        return DriveFault(
            f"controller {self._number} reports a fault {when}: {fault_text(number, self._texts)}. Remove its "
            "cause, clear the fault ('d stop' in its console, or switch it off and on), and start again",
            number,
        )

    def off(self, position: float, velocity: float, brake: bool = True) -> None:
        """A ramp from `position` [rev] at `velocity` [rev/s], rest, then stop; without `brake` stop at once.

        Raises:
            LinkError: the controller or the line does not answer. StateError: power stays on. DriveFault:
                power is off, and in taking it off a fault came that nobody has told yet, or the axis did
                not brake.
        """
        waits_at = self._exchange.waits_at if brake else math.nan
        waits = math.isfinite(waits_at)
        if waits:
            position, velocity = waits_at, 0.0
        if waits or not self._exchange.healthy:
            self._exchange.look()
        ways = self._exchange.ways
        moved = ways.longest * self._scale / self._period
        watch = StopWatch(self._limits, self._motion[1], moved, velocity * self._scale, ways.late)
        if not math.isfinite(velocity):
            velocity = 0.0  # nothing to begin a ramp with; the watch ends it at once
        if self._state.mode == Mode.POSITION and brake:
            self._exchange.restart()
            self._brake(position, velocity, watch)
        if self._state.mode == Mode.TIMEOUT:
            self._await_rest()
        if self._state.mode != Mode.FAULT:  # there, power is off already; stop would clear it
            self._take_off()
        self._tell(watch)

    def _take_off(self) -> None:
        state = self._exchange.stop(_STOP_TIMEOUT)
        if state is None:
            raise LinkError(f"controller {self._number} has not confirmed its stop; its watchdog stops it")
        if state.mode not in (Mode.STOPPED, Mode.FAULT):
            raise StateError(
                f"controller {self._number} stays in {mode_text(state.mode)} although stop was commanded; switch "
                "its power supply off"
            )

    @property
    def _motion(self) -> tuple[float, float]:
        """Position and velocity, SI."""
        return self._state.position * self._scale, self._state.velocity * self._scale

    def _tell(self, watch: StopWatch) -> None:
        """Raises what was wrong while power was taken off; it is off by now. Raises DriveFault."""
        state = self._state
        fault: DriveFault | None = None
        if state.mode == Mode.FAULT and state.fault not in self._told:
            fault = self.fault(state.fault, "while power was taken off")
        if watch.trouble:
            text = f"controller {self._number} did not bring its axis to rest as it should: {watch.trouble}"
            if fault is None:
                raise DriveFault(text)
            fault.add_note(text)
        if fault is not None:
            raise fault

    def _brake(self, position: float, velocity: float, watch: StopWatch) -> None:
        still = 0
        for _ in range(self._ramp_cycles):
            slower = max(abs(velocity) - self._deceleration * self._period, 0.0)
            position += math.copysign(0.5 * (abs(velocity) + slower) * self._period, velocity)
            velocity = math.copysign(slower, velocity)
            missed = self._exchange.cycle(Target(position, velocity))
            state = self._state
            if state.mode != Mode.POSITION:
                return
            watch.see(*self._motion, missed, self._exchange.ways.passed)
            if watch.runs_away:
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
        """Clears a fault that this session's motion has caused; others stay. Raises LinkError.

        The controller's present fault decides: what was told first may not be all.
        """
        if self._told and all(map(is_motion, self._told)):
            state = self._exchange.look()
            if state.mode == Mode.FAULT and is_motion(state.fault):
                self._exchange.stop(_STOP_TIMEOUT)
        self._told.clear()

    def present_faults(self) -> list[str]:
        """Faults in words. Raises LinkError."""
        state = self._exchange.look()
        if state.mode != Mode.FAULT or state.fault in LIMITED:
            return []
        return [fault_text(state.fault, self._texts)]

    def abandon(self) -> bool:
        """Best effort for a controller that does not answer; its watchdog does the rest. Never raises LinkError.

        Returns:
            Whether the controller has confirmed that power is off.
        """
        for patience in (_AT_ONCE, _STOP_TIMEOUT):
            with suppress(LinkError):
                state = self._exchange.stop(patience)
                if state is not None and state.mode in (Mode.STOPPED, Mode.FAULT):
                    return True
        return False
