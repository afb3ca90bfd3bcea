"""The drive's application (CiA 402): state machine, modes, limits and faults over the servo loop.

Counts, counts/s and per mille end here; the servo loop knows SI. One call of `cycle` is one servo period.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from autotune_sim.aborts import Abort, AbortCode
from autotune_sim.emergency import Emergency, ErrorCode
from autotune_sim.object_dictionary import Entry, ObjectDictionary, Value
from autotune_sim.offset_guard import OffsetGuard
from autotune_sim.ramp import Ramp
from autotune_sim.servo import Servo, ServoMode, ServoState
from autotune_sim.state_machine import FAULTY, POWERED, TRANSITIONS, State, Word, command, fault_reset
from autotune_sim.supervision import Supervision

MODES = {8: ServoMode.POSITION, 9: ServoMode.VELOCITY, 10: ServoMode.TORQUE}
_TORQUE_OFF = frozenset({ErrorCode.ENABLE_INPUT})
STOP_FAULT = 3e-3  # s into a controlled stop, of a rehearsed fault


class Firmware:
    """State and motion of the drive.

    Args:
        log: told of every transition, fault and stop.

    Attributes:
        state: of the power state machine.
        sample: what the servo loop saw last.
        supervision: what is watched.
        cycles: servo periods played; enabled_time: those with operation enabled [s].
        offset_guard: drops an offset whose sender is silent.
        host_offset: torque offset from the host in the last period [N m].
        stop_fault: code of a fault in the middle of the next controlled stop (0: none);
            foreign_target: position that another master commands [rad]; false_word: a status word that is told
            instead of the true one. For rehearsals.
    """

    def __init__(
        self, objects: ObjectDictionary, servo: Servo, emergency: Emergency, log: Callable[[str], None]
    ) -> None:
        self.servo = servo
        self.state = State.NOT_READY
        self.cycles = 0
        self.error_code = 0
        self.limited = False
        self.enabled_time = 0.0
        self.stop_fault = 0
        self.foreign_target: float | None = None
        self.false_word: int | None = None
        self.offset_guard: OffsetGuard | None = None
        self._objects = objects
        self._emergency = emergency
        self._log = log
        self.counts_per_rad = servo.preset.plant.counts / (2.0 * math.pi)
        self.rad_per_count = 1.0 / self.counts_per_rad
        self.supervision = Supervision(objects, servo, self.rad_per_count)
        self._ramp: Ramp | None = None
        self._after_ramp = State.SWITCH_ON_DISABLED
        self._bind()
        self.reset()

    def _bind(self) -> None:
        """Keeps the entries that every cycle needs, and hooks those that act."""
        objects = self._objects
        self._controlword = objects[0x6040]
        self._mode = objects[0x6060]
        self._target_position = objects[0x607A]
        self._target_velocity = objects[0x60FF]
        self._target_torque = objects[0x6071]
        self._velocity_offset = objects[0x60B1]
        self._torque_offset = objects[0x60B2]
        self._fine_offset = objects[0x2200, 3]
        self._fine_target = objects[0x2200, 4]
        self._rated = objects[0x6076]
        self._lowest, self._highest = objects[0x607D, 1], objects[0x607D, 2]
        self._fastest = objects[0x607F]
        self._period = (objects[0x60C2, 1], objects[0x60C2, 2])
        self._controlword.write = self._write_controlword
        self._mode.write = self._write_mode
        self._target_position.write = self._write_target
        for entry in self._period:
            entry.write = self._period_writer(entry)

    def refresh(self) -> None:
        """Takes the interpolation period (60C2) as it stands in the dictionary."""
        value, index = self._period
        self.parts = max(round(int(value.value) * 10.0 ** int(index.value) / self.servo.period), 1)

    def reset(self) -> None:
        """As at power-up: power off, process data at their defaults, faults forgotten."""
        self.refresh()
        self.servo.power(False)
        self.sample: ServoState = self.servo.idle()
        self._ramp = None
        if self.offset_guard is not None:
            self.offset_guard.reset()
        self.error_code = 0
        self.limited = self._fresh = False
        self.supervision.reset()
        self._demand = self._start = self._goal = self.sample.position
        self.demand_velocity = 0.0
        self._part = 0
        self.host_offset = 0.0
        self._enter(State.SWITCH_ON_DISABLED, "power-up")

    # Objects

    @property
    def rated_torque(self) -> float:
        """1000 per mille [N m]."""
        return int(self._rated.value) * 1e-3

    @property
    def mode(self) -> int:
        return int(self._mode.value)

    @property
    def temperature(self) -> float:
        """Of the motor [°C]."""
        return self.supervision.temperature(self.sample)

    @property
    def powered(self) -> bool:
        return self.state in POWERED

    @property
    def stopping(self) -> bool:
        """A controlled stop is under way, or holds the axis."""
        return self._ramp is not None

    def statusword(self) -> int:
        """Object 6041."""
        if self.false_word is not None:
            return self.false_word
        word = self.state.value | 0x0200
        if self.supervision.enable_input:
            word |= 0x0010
        if self.supervision.warm(self.sample):
            word |= 0x0080
        if self.limited or self.sample.saturated:
            word |= 0x0800
        if self.state is State.OPERATION_ENABLED and self._ramp is None:
            word |= 0x1000
        if self.supervision.following_error:
            word |= 0x2000
        return word

    def _write_target(self, _: Value) -> None:
        self._fresh = True

    def _write_mode(self, value: Value) -> None:
        number = int(value)
        if number and number not in MODES:
            raise Abort(AbortCode.RANGE)
        if number == self.mode or self.state is not State.OPERATION_ENABLED:
            return
        if number == 0 or self._ramp is not None:
            raise Abort(AbortCode.STATE)
        self._mode.value = value
        self._engage()

    def _period_writer(self, entry: Entry) -> Callable[[Value], None]:
        def write(value: Value) -> None:
            parts = [int(value if other is entry else other.value) for other in self._period]
            cycles = parts[0] * 10.0 ** parts[1] / self.servo.period
            if self.powered:
                raise Abort(AbortCode.STATE)
            if (entry is self._period[0] and abs(cycles - round(cycles)) > 1e-6) or cycles > 255:
                raise Abort(AbortCode.RANGE)
            entry.value = value
            self.refresh()

        return write

    # State machine

    def _write_controlword(self, value: Value) -> None:
        before, after = int(self._controlword.value), int(value)
        self._controlword.value = value
        if self.state in FAULTY:
            if self.state is State.FAULT and fault_reset(before, after):
                self._reset_fault()
            return
        word = command(after)
        target = TRANSITIONS.get((self.state, word))
        if self.state is State.OPERATION_ENABLED and word is Word.ENABLE_OPERATION:
            self._resume()
        elif target is not None:
            self._transit(word, target)

    def reset_fault(self) -> None:
        """What a person does at the drive: a fault whose cause is gone is forgotten."""
        if self.state is State.FAULT:
            self._reset_fault()

    def _reset_fault(self) -> None:
        if self.supervision.standing(self.sample, False) is not None:
            self._log("fault reset refused: its cause is still there")
            return
        self.error_code = 0
        self.supervision.reset()
        self._emergency.clear()
        self._enter(State.SWITCH_ON_DISABLED, "fault reset")

    def _resume(self) -> None:
        """A slow-down that a command has begun is called off."""
        if self._ramp is not None:
            self._ramp = None
            self._engage()

    def _transit(self, word: Word, target: State) -> None:
        if target is State.READY_TO_SWITCH_ON and not self.supervision.enable_input:
            return
        if target is State.OPERATION_ENABLED:
            if self.state is not State.QUICK_STOP_ACTIVE or self._after_ramp is State.QUICK_STOP_ACTIVE:
                self._enable()
        elif word is Word.QUICK_STOP and self.state is State.OPERATION_ENABLED:
            self.quick_stop("controlword")
        elif self.state is State.OPERATION_ENABLED and word is Word.SWITCH_ON:
            self._stop(self._option(0x605C), target, "disable operation")
        elif self.state is State.OPERATION_ENABLED and word is Word.SHUTDOWN:
            self._stop(self._option(0x605B), target, "shutdown")
        else:
            self._enter(target, word.value)

    def _enable(self) -> None:
        if self.mode not in MODES:
            return
        if not self.supervision.brake_input:
            self.fault(ErrorCode.BRAKE)
            return
        self._ramp = None
        self._engage()
        self._enter(State.OPERATION_ENABLED, Word.ENABLE_OPERATION.value)

    def _engage(self) -> None:
        """Gives power to the loop of the present mode, holding where the axis is."""
        self.servo.power(True, MODES[self.mode])
        self._demand = self._start = self._goal = self.servo.position
        self.demand_velocity = 0.0
        self._fresh = False
        self.supervision.reset()

    def quick_stop(self, why: str) -> None:
        """Quick stop as option code 605A says."""
        if self.state is not State.OPERATION_ENABLED:
            return
        option = self._option(0x605A)
        if option == 0:
            self._enter(State.SWITCH_ON_DISABLED, f"quick stop ({why}), power off")
            return
        then = State.QUICK_STOP_ACTIVE if option >= 5 else State.SWITCH_ON_DISABLED
        self._begin_ramp(1 if option in (1, 5) else 2, then)
        self._log(f"quick stop begun ({why})")
        self._change(State.QUICK_STOP_ACTIVE, why)

    def fault(self, code: int, detail: int = 0, at_once: bool = False) -> None:
        """Reacts to a fault as option code 605E says, or by taking power off; the first code stays in 603F."""
        if self.state in FAULTY:
            return
        self.error_code = code
        self._emergency.report(code, detail)
        self._log(f"fault {code:04X}h")
        self._note("fault", code=code)
        option = self._option(0x605E)
        if not self.powered or option == 0 or code in _TORQUE_OFF or at_once:
            self._enter(State.FAULT, f"fault {code:04X}h")
            return
        self._begin_ramp(option, State.FAULT)
        self._log(f"quick stop begun (fault {code:04X}h)")
        self._change(State.FAULT_REACTION_ACTIVE, f"fault {code:04X}h")

    def disable(self, why: str) -> None:
        """Takes power off at once."""
        if self.powered:
            self._enter(State.SWITCH_ON_DISABLED, why)

    def _stop(self, option: int, then: State, why: str) -> None:
        if option == 0:
            self._enter(then, why)
        elif self._ramp is None or self._after_ramp is not then:
            self._begin_ramp(1, then)

    def _begin_ramp(self, option: int, then: State) -> None:
        deceleration = self._objects.number(0x6085 if option == 2 else 0x6084) * self.rad_per_count
        near = abs(self.sample.following_error) < 0.5 * self.supervision.window
        position, velocity = self._demand, self.demand_velocity
        if self.mode != 8 or not near:
            self.servo.power(True, ServoMode.POSITION)
            position, velocity = self.servo.position, self.sample.velocity
            self._demand = position
        fastest = int(self._fastest.value) * self.rad_per_count
        velocity = max(-fastest, min(fastest, velocity))  # a leap is no speed
        self._ramp, self._after_ramp = Ramp(position, velocity, deceleration), then

    def _option(self, index: int) -> int:
        return self._objects.number(index)

    def _enter(self, state: State, why: str) -> None:
        """Changes the state; outside of the powered states the loop has no power."""
        if state not in POWERED:
            self._ramp = None
            self._fresh = self.limited = False
            if self.servo.powered:
                self.servo.power(False)
        self._change(state, why)

    def _change(self, state: State, why: str) -> None:
        if state is not self.state:
            self._log(f"state {self.state.name} -> {state.name} ({why})")
            if (state in POWERED) != (self.state in POWERED):
                self._note("enabled" if state in POWERED else "disabled", why=why)
            self.state = state

    def _note(self, kind: str, **details: object) -> None:
        if self.servo.truth is not None:
            self.servo.truth.note(kind, self.servo.time, **details)

    # One servo period

    def cycle(self) -> ServoState:
        """Plays one servo period; what was true at its beginning."""
        if self.state not in POWERED:
            self.host_offset = 0.0
            self.sample = sample = self.servo.idle()
        elif self._ramp is not None:
            before, self._demand = self._demand, self._ramp.step(self.servo.period)
            self.demand_velocity = (self._demand - before) / self.servo.period
            self.host_offset = 0.0
            self.sample = sample = self.servo.cycle(self._demand)
            if self.stop_fault and self._ramp.elapsed >= STOP_FAULT:
                code, self.stop_fault = self.stop_fault, 0
                self.fault(code, at_once=True)
        else:
            self.sample = sample = self._move()
        self.cycles += 1
        self._watch(sample)
        return sample

    def _move(self) -> ServoState:
        offset = int(self._torque_offset.value) * 1e-6 * int(self._rated.value)
        if self.offset_guard is not None:
            offset *= self.offset_guard.cycle()
        offset += int(self._fine_offset.value) * 1e-6
        self.host_offset = offset
        self.enabled_time += self.servo.period
        if self.servo.mode is ServoMode.POSITION:
            return self.servo.cycle(self._interpolate(), 0.0, 0.0, offset)
        self.limited = False
        if self.servo.mode is ServoMode.VELOCITY:
            return self.servo.cycle(0.0, self._velocity_target(), 0.0, offset)
        torque = int(self._target_torque.value) * 1e-6 * int(self._rated.value)
        return self.servo.cycle(0.0, 0.0, torque + int(self._fine_target.value) * 1e-6, offset)

    def _velocity_target(self) -> float:
        wanted = int(self._target_velocity.value) + int(self._velocity_offset.value)
        fastest = int(self._fastest.value)
        self.limited = abs(wanted) > fastest
        return max(-fastest, min(fastest, wanted)) * self.rad_per_count

    def _interpolate(self) -> float:
        before = self._demand
        if self._fresh:
            target = int(self._target_position.value)
            if self.foreign_target is not None:
                target = round(self.foreign_target * self.counts_per_rad)
                self._target_position.value = target  # whoever wrote last is read back
            allowed = max(int(self._lowest.value), min(int(self._highest.value), target))
            self.limited = allowed != target
            self._start, self._goal, self._part = before, allowed * self.rad_per_count, 0
            self._fresh = False
        self._part = min(self._part + 1, self.parts)
        self._demand = self._start + (self._goal - self._start) * (self._part / self.parts)
        self.demand_velocity = (self._demand - before) / self.servo.period
        return self._demand

    def _watch(self, sample: ServoState) -> None:
        code: int | None = None
        if self.state in POWERED:
            if self.state is not State.FAULT_REACTION_ACTIVE:
                code = self.supervision.motion(sample)
            if self._ramp is not None and self._ramp.done:
                self._end_ramp()
        if code is None:
            code = self.supervision.standing(sample, self.powered)
        if code is not None:
            self.fault(code)
        if not self.supervision.enable_input and self.state in (State.READY_TO_SWITCH_ON, State.SWITCHED_ON):
            self._enter(State.SWITCH_ON_DISABLED, "enable input missing")

    def _end_ramp(self) -> None:
        if self._after_ramp is not State.QUICK_STOP_ACTIVE:
            self._enter(self._after_ramp, "axis at rest")
