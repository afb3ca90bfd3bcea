"""The simulated drive behind a moteus controller's interface: the same plant, servo and firmware.

In lock-step every position command advances the axis by one period (`autotune.period_s`); in real time
the wall clock moves it. The registers of an answer are of the control period that the command began.
A command is valid for its watchdog time (027h; 0: `servo.default_timeout_s`, nan: for ever). After it
the controller brakes on its deceleration and holds (mode 11) until it is told to stop, or lets go at once
where `servo.timeout_mode` is 0.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from pathlib import Path

from autotune_sim.aborts import Abort
from autotune_sim.device import STORE_TIME, Device
from autotune_sim.emergency import ErrorCode
from autotune_sim.memory import Memory
from autotune_sim.moteus_conf import SCALE, TABLE, TORQUE_FACTOR, TURN, Console, plain_values
from autotune_sim.moteus_frames import (
    LONGEST,
    NOP,
    READ_ERROR,
    REPLY,
    SERVER_TO_CLIENT,
    SERVER_TO_CLIENT_FLOW,
    WRITE_ERROR,
    Read,
    Stream,
    Write,
    decode,
    encode,
    head,
    subframes,
    varuint,
)
from autotune_sim.moteus_registers import COMMANDS, MODE, MODEL, readable
from autotune_sim.moteus_trajectory import PositionCommand, Trajectory
from autotune_sim.own_ripple import POINTS
from autotune_sim.servo import Servo, ServoMode
from autotune_sim.state_machine import FAULTY, State

STOPPED, FAULT, POSITION, TIMEOUT, ZERO_VELOCITY, BRAKE = 0, 1, 10, 11, 12, 15
HOST_MASK, REPLY_WANTED = 0x7F, 0x80
_UNKNOWN, _NOT_WRITABLE, _BAD_MODE = 1, 2, 3
_LIMITED = 102
FAULT_NUMBERS = {
    int(ErrorCode.MOTOR_TEMPERATURE): 38,
    int(ErrorCode.ENABLE_INPUT): 44,
    int(ErrorCode.FOLLOWING_ERROR): 49,
    int(ErrorCode.BRAKE): 120,
    int(ErrorCode.SPEED): 121,
    int(ErrorCode.POSITION_LIMIT): 122,
}
_OTHER_FAULT = 33  # motor driver fault
_SHUTDOWN, _SWITCH_ON, _ENABLE, _RESET = 0x06, 0x07, 0x0F, 0x80
_HOLD_AFTER_QUICK_STOP = 6
_POSITION_MODE, _TORQUE_MODE = 8, 10
_NO_SCALES = (1.0, 1.0, 1.0)
_PLAIN_INDEX = 0xFE00  # where the memory keeps values that have no object


class MoteusDevice(Device):
    """One controller on its serial line. `receive` takes frames, `poll` the passing of time.

    Attributes:
        command: the position command in force.
        trajectory: the demand that follows from it [rev].
    """

    def __init__(
        self,
        servo: Servo,
        eds: Path,
        node_id: int,
        send: Callable[[int, bytes], None],
        memory: Memory,
        log: Callable[[str], None],
        *,
        real_time: bool = False,
    ) -> None:
        super().__init__(servo, eds, node_id, lambda *_: None, memory, log, real_time=real_time)
        self._transmit = send
        self.command = PositionCommand(position=math.nan)
        self.trajectory = Trajectory()
        self._watchdog: float | None = None
        self._allowed: float | None = None
        self._own_fault = 0
        self._scales = (math.nan,) * 4
        self._plain = plain_values(node_id, not real_time)
        self._fresh_plain = {name: place.value for name, place in self._plain.items()}
        actions = {"write": self._store_all, "load": self._load_all, "default": self._default_all}
        self.console = Console(
            self.objects, self.firmware, self._plain, actions, self._refuse, self._apply_ripple
        )
        self._zero = float(servo.ripple["offset"][0])
        self._cells = [self._plain[f"{TABLE}.{k}"] for k in range(POINTS)]
        self._console_ready = 0.0
        self._answering = False
        self._packet = 0
        self._pending = b""
        self._registers = readable(self)

    # Bus

    def receive(self, cob_id: int, data: bytes, now: float) -> None:
        """Handles one frame: identifier = source (with the wish for a reply) and destination."""
        self.now = now
        if self.silent or self._boot_at is not None or self._lost():
            return
        if cob_id >> 16 or cob_id & 0xFF not in (self.node.node_id, 0x7F):
            return
        source = cob_id >> 8
        self._answering = bool(source & REPLY_WANTED)
        reply = self._handle(data)
        if self._answering and not self._lost():
            self._transmit(self.node.node_id << 8 | source & HOST_MASK, reply or bytes((NOP,)))

    def _handle(self, data: bytes) -> bytes:
        reply = bytearray()
        command: PositionCommand | None = None
        moving = False
        for subframe in subframes(data):
            if isinstance(subframe, Write):
                if subframe.register == MODE:
                    command = self._mode_written(subframe, reply)
                else:
                    self._field_written(subframe, command, reply)
                continue
            if command is not None and not moving:
                moving = True
                self._obey(command)
            if isinstance(subframe, Read):
                self._read(subframe, reply)
            else:
                self._stream(subframe, reply)
        if command is not None and not moving:
            moving = True
            self._obey(command)
        if moving:
            self.end_cycle()
        return bytes(reply)

    def _mode_written(self, write: Write, reply: bytearray) -> PositionCommand | None:
        mode = int(write.raw)
        if mode == STOPPED:
            self._stop()
        elif mode in (ZERO_VELOCITY, BRAKE):
            self._watchdog = self._allowed = None
            self._unscale()
            if mode == ZERO_VELOCITY:
                self.firmware.quick_stop("zero velocity commanded")
            else:
                self.firmware.disable("brake commanded")
        elif mode == POSITION:
            return PositionCommand()
        else:
            reply += bytes((WRITE_ERROR,)) + varuint(write.register) + varuint(_BAD_MODE)
        return None

    def _field_written(self, write: Write, command: PositionCommand | None, reply: bytearray) -> None:
        place = COMMANDS.get(write.register)
        if place is None:
            error = _NOT_WRITABLE if write.register in self._registers else _UNKNOWN
            reply += bytes((WRITE_ERROR,)) + varuint(write.register) + varuint(error)
        elif command is not None:
            setattr(command, place[0], decode(place[1], write.form, write.raw))

    def _read(self, read: Read, reply: bytearray) -> None:
        answer = head(REPLY, read.form, read.start, read.number)
        for register in range(read.start, read.start + read.number):
            place = self._registers.get(register)
            if place is None:
                answer = bytes((READ_ERROR,)) + varuint(register) + varuint(_UNKNOWN)
                break
            kind, value = place
            answer += encode(kind, read.form, value())
            if len(answer) > LONGEST:
                break
        if len(reply) + len(answer) <= LONGEST:
            reply += answer

    def _stream(self, stream: Stream, reply: bytearray) -> None:
        if stream.channel != 1:
            return
        if not stream.poll:
            self.console.feed(stream.data)
        if not self._answering:
            return
        limit = min(stream.limit if stream.poll else LONGEST, LONGEST - len(reply) - 4)
        if stream.acknowledged >= 0:
            reply += self._flow(stream.acknowledged, limit)
            return
        self._pending = b""
        taken = self._said(limit)
        reply += bytes((SERVER_TO_CLIENT, 1)) + varuint(len(taken)) + taken

    def _flow(self, acknowledged: int, limit: int) -> bytes:
        """What the console says next; again what it said last, where that was not acknowledged."""
        if not self._pending or acknowledged == self._packet:
            self._packet = self._packet + 1 & 0xFF
            self._pending = self._said(limit)
        return bytes((SERVER_TO_CLIENT_FLOW, 1, self._packet)) + varuint(len(self._pending)) + self._pending

    def _said(self, limit: int) -> bytes:
        if self.now < self._console_ready or limit <= 0:
            return b""
        ready = self.console.output
        taken = bytes(ready[:limit])
        del ready[:limit]
        return taken

    # Motion

    @property
    def mode(self) -> int:
        """Register 000h."""
        if self._own_fault or self.firmware.state in FAULTY:
            return FAULT
        return {State.OPERATION_ENABLED: POSITION, State.QUICK_STOP_ACTIVE: TIMEOUT}.get(
            self.firmware.state, STOPPED
        )

    @property
    def fault_number(self) -> int:
        """Register 00Fh."""
        if self._own_fault:
            return self._own_fault
        if self.firmware.state in FAULTY:
            return FAULT_NUMBERS.get(self.firmware.error_code, _OTHER_FAULT)
        return _LIMITED if self.mode == POSITION and self.firmware.sample.saturated else 0

    @property
    def closed_loop(self) -> bool:
        """The position controller is at work."""
        return self.firmware.powered and self.firmware.servo.mode is ServoMode.POSITION

    @property
    def control_position(self) -> float:
        """Register 038h [rev]; nan without power."""
        return self.firmware.sample.position_demand / TURN if self.firmware.powered else math.nan

    @property
    def model(self) -> int:
        vendor = self.objects[0x1018, 1]
        return MODEL if vendor.value == vendor.default else int(float(vendor.value or 0)) & 0x7FFF

    def _stop(self) -> None:
        """Mode 0: power off; a fault whose cause is gone is forgotten."""
        self._watchdog = self._allowed = None
        self._own_fault = 0
        self.command = PositionCommand()
        if self.firmware.state in FAULTY:
            for word in (0, _RESET, 0):
                self._control(word)
        self.firmware.disable("stop commanded")

    def _obey(self, command: PositionCommand) -> None:
        if self.mode == POSITION and self.command_lost():
            command = self.command
        self.command = command
        if self.mode == STOPPED and not self._engage():
            self.begin_cycle(self.now)
            return
        if self.mode == POSITION:
            self._steer(command)
        self.begin_cycle(self.now)

    def _engage(self) -> bool:
        self._scales = (math.nan,) * 4
        self.objects[0x605A].value = _HOLD_AFTER_QUICK_STOP
        self.objects[0x6060].put(_POSITION_MODE)
        if not self.firmware.supervision.enable_input:
            self._own_fault = FAULT_NUMBERS[int(ErrorCode.ENABLE_INPUT)]
            return False
        for word in (_SHUTDOWN, _SWITCH_ON, _ENABLE):
            self._control(word)
        if self.firmware.state is not State.OPERATION_ENABLED:
            return False
        self.trajectory.hold(self.firmware.servo.position / TURN)
        return True

    def _steer(self, command: PositionCommand) -> None:
        self._guard(command.timeout)
        mode = _TORQUE_MODE if command.torque_only else _POSITION_MODE
        if int(self.objects[0x6060].value) != mode:
            self.objects[0x6060].put(mode)
            self.trajectory.hold(self.firmware.servo.position / TURN)
        self._scale(command)
        feedforward = round(command.feedforward * 1e6) if math.isfinite(command.feedforward) else 0
        torque = mode == _TORQUE_MODE
        self.objects[0x2200, 4].value = feedforward if torque else 0
        self.objects[0x2200, 3].value = 0 if torque else feedforward
        self.trajectory.take(command)

    def _guard(self, seconds: float) -> None:
        allowed = self._plain["servo.default_timeout_s"].value if seconds == 0.0 else seconds
        self._watchdog = None
        self._allowed = None if math.isnan(allowed) or allowed < 0.0 else allowed

    def _scale(self, command: PositionCommand) -> None:
        """kp and kd scales, no integral where its limit is scaled to nothing, and the torque allowed."""
        gains = (command.kp_scale, command.kd_scale, command.ilimit_scale)
        scales = (*(_NO_SCALES if command.torque_only else gains), command.max_torque)
        if scales == self._scales:
            return
        self._scales = scales
        parameters = self.firmware.servo.parameters
        record = parameters.record
        proportional, derivative, integral, most = scales
        record["controller_kp"] = parameters["controller.kp"] * proportional
        record["controller_kd"] = parameters["controller.kd"] * min(derivative, proportional)
        record["controller_ki"] = parameters["controller.ki"] * (integral != 0.0)
        allowed = parameters["limit.torque"]
        record["limit_torque"] = allowed if math.isnan(most) else min(allowed, most)

    def _unscale(self) -> None:
        """Full gains, for a stop that the controller makes by itself."""
        self._scale(PositionCommand())

    def _control(self, word: int) -> None:
        self.objects[0x6040].put(word)

    def _cycle(self) -> None:
        if self.firmware.state is State.OPERATION_ENABLED and not self.firmware.stopping:
            demand = self.trajectory.step(self.firmware.servo.period)
            counts = round(demand * TURN * self.firmware.counts_per_rad)
            target = self.objects[0x607A]
            target.put(max(-0x80000000, min(0x7FFFFFFF, counts)))
        super()._cycle()

    # Time

    def begin_cycle(self, now: float) -> None:
        self.node.syncs += 1
        super().begin_cycle(now)

    def end_cycle(self) -> None:
        if not self._real_time:
            parts = max(round(self._plain["autotune.period_s"].value / self.firmware.servo.period), 1)
            for _ in range(parts - 1):
                self._cycle()

    def poll(self, now: float) -> float:
        due = super().poll(now)
        if (
            self._allowed is not None
        ):  # counts from the answer: a drive that was held up must not blame its host
            self._watchdog, self._allowed = now + self._allowed, None
        return due if self._watchdog is None else min(due, self._watchdog)

    @property
    def heartbeat_due(self) -> float | None:
        """When the watchdog acts [s]."""
        return self._watchdog

    def check_heartbeats(self, now: float) -> None:
        """Reacts to a host that has not commanded anything in time; before it, the input must be empty."""
        if self._watchdog is None or now < self._watchdog:
            return
        self._watchdog = None
        self._unscale()
        if self._plain["servo.timeout_mode"].value == STOPPED:
            self.firmware.disable("watchdog")
        else:
            self.firmware.quick_stop("watchdog: the host was silent")

    # Power and memory

    def power_loss(self) -> None:
        self._watchdog = self._allowed = None
        self._own_fault = 0
        self.console.reset()
        self._pending = b""
        super().power_loss()

    def _start(self, area: tuple[int, int]) -> None:
        for name, value in self._fresh_plain.items():
            self._plain[name].value = value
        self._take_stored()
        super()._start(area)
        self._scales = (math.nan,) * 4

    def _take_stored(self) -> None:
        places = list(self._plain.values())
        for number, value in self._stored_plain().items():
            places[number].value = value
        self._apply_ripple()

    def _apply_ripple(self) -> None:
        """The table and its zero as they stand in the console, to the servo loop."""
        record, plain, servo = self.firmware.servo.ripple, self._plain, self.firmware.servo
        counts = servo.preset.plant.counts
        record["offset"] = self._zero + plain["motor_position.sources.0.offset"].value / counts
        record["step"] = plain[SCALE].value * TORQUE_FACTOR / plain["motor.Kv"].value
        record["table"] = [cell.value for cell in self._cells]

    def _stored_plain(self) -> dict[int, float]:
        return {
            subindex: struct.unpack("<f", data)[0]
            for (index, subindex), data in self.memory.read().items()
            if index == _PLAIN_INDEX and subindex < len(self._plain) and len(data) == 4
        }

    def _store_all(self) -> str:
        if self.firmware.powered:
            return "the motor has power"
        if self.on_store is not None:
            self.on_store()
            if self._boot_at is not None:
                return "power lost"
        values = {(e.index, e.subindex): e.encode(e.value) for e in self._kept((0, 0xFFFF))}
        for number, place in enumerate(self._plain.values()):
            if not place.fixed:
                values[_PLAIN_INDEX, number] = struct.pack("<f", place.value)
        try:
            self._write_memory(values)
        except Abort:
            return "flash"
        self._console_ready = self.now + STORE_TIME
        self._log("parameters stored")
        self.note_objects("stored")
        return ""

    def _load_all(self) -> str:
        return self._replace(self.memory.read())

    def _default_all(self) -> str:
        return self._replace({})

    def _replace(self, stored: dict[tuple[int, int], bytes]) -> str:
        """All values of the console from `stored`, or their defaults, without a restart."""
        if self.firmware.powered:
            return "the motor has power"
        for name, value in self._fresh_plain.items():
            self._plain[name].value = value
        if stored:
            self._take_stored()
        self._apply_ripple()
        self._load((0x2000, 0xFFFF), stored)
        self._settings.apply()
        self._scales = (math.nan,) * 4
        return ""
