"""One cycle on the line: a position command with its queries out, the controller's state in.

The command carries position, velocity, feedforward torque, the torque allowed and the watchdog time; it
asks for no trajectory limits, as the references are trajectories already. A position's velocity carries the
demand on between the commands, but no further than to where it is `AHEAD` cycles later: where this host is
late, the axis waits there, and is not thrown back by the next command. In real time a cycle waits for
its turn on an absolute grid; turns that were missed are skipped and counted. In lock-step the
controller's time advances with the command, so nothing waits.

A reply holds mode, position, velocity, torque, control position, temperature, fault, P, I, D and
feedforward torque, and their total: all of one control period. It also echoes the watchdog time, whose
last digits count the commands: a reply that is late or was asked for twice is known by them. Firmware
that refuses a subframe once 41 bytes of a reply are used gets the longest one last.
"""

from __future__ import annotations

import math
import struct
import time
from operator import itemgetter
from typing import NamedTuple

from autotune.core.errors import LinkError
from autotune.core.stopping import Ways
from autotune_drivers.moteus.multiplex import FAULT, MODE, Form, parse, read, reply_head
from autotune_drivers.moteus.node import Heard, MoteusNode
from autotune_drivers.moteus.profile import MoteusCycle
from autotune_drivers.punctuality import Punctuality, host_late

TEMPERATURE_AGE = 0.1  # s; it comes with every reply, so single ones without it may be passed over
LOCK_STEP_TIMEOUT = 0.12  # s; shorter than the watchdog, so that a lost command can be sent again
CONTROL_POSITION = 0x038
TEMPERATURES = {"motor": 0x00A, "board": 0x00E}
_TORQUES = 0x030
_WATCHDOG = 0x027
AHEAD = 2.0
_COMMAND = struct.Struct("<5s3f3s5f")
_HEAD, _REST = b"\x01\x00\x0a\x0f\x20", b"\x0c\x05\x25"
_NO_FEEDBACK = b"\x02\x23\x00\x00\x01\x2b\x00"  # kp and kd scale, and the integral's limit, are 0
_NO_LIMIT = -1.0
_TEMPERATURE_STEP = 0.1
_COUNTED = 64
_COUNT_STEP = 2.0**-17  # s, 8 µs: exact in single precision below a second
_LOWEST = -32768


class State(NamedTuple):
    """What the controller told, in its own units."""

    mode: int
    position: float
    velocity: float
    torque: float
    control_position: float
    temperature: float
    fault: int
    proportional: float
    integral: float
    derivative: float
    feedforward: float
    total: float


class Target(NamedTuple):
    """What the controller is told, in its own units; nan as `position` keeps the demand."""

    position: float
    velocity: float = 0.0
    feedforward: float = 0.0
    feedback: bool = True


class MoteusExchange:
    """The cyclic traffic with one controller.

    Attributes:
        count: cycles since the start, missed ones included.
        healthy: the last cycle was answered.
        state: what the controller told last.
        temperature_overdue: it told a temperature before, but no number for `TEMPERATURE_AGE`.
        ways: in the last cycles [rev].
        punctuality: how late this host was.
    """

    def __init__(
        self,
        node: MoteusNode,
        cycle: MoteusCycle,
        period: float,
        lock_step: bool,
        *,
        temperature: str,
        torque: float,
        watchdog: float,
    ) -> None:
        self.count = 0
        self.healthy = False
        self.state: State | None = None
        self._node = node
        self._period = period
        self._lock_step = lock_step
        self._timeout = LOCK_STEP_TIMEOUT if lock_step else cycle.reply_timeout
        self._tries = cycle.lost_cycles + 1
        self._torque = torque
        self._watchdog = math.floor(watchdog / _COUNT_STEP) * _COUNT_STEP
        self._number = 0
        self._expected: float | None = None
        self._due = 0.0
        self.punctuality = Punctuality()
        self._left = math.inf
        self._ahead = math.nan
        self.ways = Ways(period)
        self._last_temperature = math.nan
        self._cold_cycles = 0
        self._temperature = TEMPERATURES.get(temperature)
        self.has_control_position = True
        self._has_echo = True

    def survey(self) -> None:
        """Asks once for what not every firmware has. Raises LinkError."""
        wanted = [(Form.FLOAT, CONTROL_POSITION, 1), (Form.FLOAT, _WATCHDOG, 1)]
        if self._temperature is not None:
            wanted.append((Form.INT16, self._temperature, 1))
        there = {entry[1]: self._node.registers(entry).get(entry[1]) for entry in wanted}
        self.has_control_position = there[CONTROL_POSITION] is not None
        self._has_echo = there[_WATCHDOG] is not None
        if self._temperature is not None and there[self._temperature] is None:
            self._temperature = None
        self._ask()

    @property
    def waits_at(self) -> float:
        """Where the demand waits for a host that is late, and the axis with it [rev]; nan where it does not."""
        late = not self._lock_step and time.monotonic() - self._left > AHEAD * self._period
        return self._ahead if late else math.nan

    def _ask(self) -> None:
        """The query of every cycle, and what its answer looks like."""
        parts: list[tuple[Form, int, int]] = [(Form.INT8, MODE, 1), (Form.FLOAT, 0x001, 3)]
        if self.has_control_position:
            parts.append((Form.FLOAT, CONTROL_POSITION, 1))
        if self._has_echo:
            parts.append((Form.FLOAT, _WATCHDOG, 1))
        if self._temperature is not None:
            parts.append((Form.INT16, self._temperature, 1))
        parts += [(Form.INT8, FAULT, 1), (Form.FLOAT, _TORQUES, 5)]
        self._query = b"".join(read(*part) for part in parts)
        heads = [reply_head(*part) for part in parts]
        forms = ["bhif"[form] * count for form, _, count in parts]
        pairs = zip(heads, forms, strict=True)
        self._layout = struct.Struct("<" + "".join(f"{len(head)}s{form}" for head, form in pairs))
        self._heads = tuple(heads)
        self._registers = [number for _, first, count in parts for number in range(first, first + count)]
        places, at = [], 0
        for _, _, count in parts:
            places.append(at)
            at += 1 + count
        self._heads_of = itemgetter(*places)
        self._values_of = itemgetter(*(place for place in range(at) if place not in places))

    # One cycle

    def restart(self) -> None:
        """The next cycle is due now; to be called after a pause."""
        self._due = time.monotonic()
        self._left = math.inf
        self.ways.begin()
        self._node.port.drain()

    def cycle(self, target: Target) -> int:
        """Plays one cycle; the number of cycles missed before.

        Raises:
            LinkTimeout: no answer several times in a row. LinkError: the line is gone or refuses.
            OverflowError: a value beyond single precision.
        """
        self.healthy = False
        missed = 0
        heard = Heard(None, False, "", False)
        self.punctuality.spell = 0.0
        self.punctuality.note(time.monotonic() - self._left - self._period)
        for _ in range(self._tries):
            missed += self._wait_turn()
            self._node.send(self._command(target))
            heard = self._listen()
            if heard.reply is not None:
                self.count += missed + 1
                self.healthy = True
                self._left = time.monotonic()
                if self.state is not None:
                    now = math.nan if self._lock_step else self._left
                    self.ways.see(self.state.position, missed, now)
                return missed
            self._node.note_refusal(heard.refusal)
            if not heard.refusal:
                missed += 1
        if self.punctuality.spell >= self._timeout:
            then = f"{self._tries} answers in a row did not come"
            raise host_late(f"controller {self._node.number}", self.punctuality.spell, self._timeout, then)
        raise self._node.silence(heard)

    def _listen(self) -> Heard:
        """The answer; what came while this host was held up is looked at before it counts as lost."""
        began = time.monotonic()
        heard = self._node.listen(self._timeout, self._take)
        late = time.monotonic() - began - self._timeout
        self.punctuality.note(late)
        if heard.reply is None and late > 0.0:
            return self._node.listen(0.0, self._take)
        return heard

    def stop(self, timeout: float) -> State | None:
        """Power off; the state after it, None where nobody answers. Raises LinkError: the line is gone."""
        data = b"\x01\x00\x00" + self._query
        self._expected = None
        for _ in range(self._tries):
            self._node.port.drain()
            self._node.send(data)
            heard = self._node.listen(timeout, self._take)
            if heard.reply is not None:
                return self.state
            self._node.note_refusal(heard.refusal)
        return None

    def look(self) -> State:
        """The state, without a command. Raises LinkError."""
        self._expected = None
        self._node.request(self._query, self._take)
        if self.state is None:
            raise LinkError(f"controller {self._node.number} tells nothing; this is a defect")
        return self.state

    def _command(self, target: Target) -> bytes:
        position, velocity, feedforward, feedback = target
        self._number = (self._number + 1) % _COUNTED
        watchdog = self._watchdog - self._number * _COUNT_STEP
        self._expected = watchdog if self._has_echo else None
        self._ahead = position + AHEAD * velocity * self._period
        data = _COMMAND.pack(
            _HEAD, position, velocity, feedforward,
            _REST, self._torque, self._ahead, watchdog, _NO_LIMIT, _NO_LIMIT,
        )  # fmt: skip
        return data + (b"" if feedback else _NO_FEEDBACK) + self._query

    def _wait_turn(self) -> int:
        """Waits for the next turn; the number of turns that have passed unused."""
        if self._lock_step:
            return 0
        now = time.monotonic()
        late = 0
        if now < self._due:
            time.sleep(self._due - now)
            self.punctuality.note(time.monotonic() - self._due)
        else:
            late = int((now - self._due) / self._period)
        self._due += (late + 1) * self._period
        self._node.port.drain()
        return late

    def _age(self, temperature: float) -> None:
        if math.isnan(temperature):
            self._cold_cycles += 1
        else:
            self._last_temperature, self._cold_cycles = temperature, 0

    @property
    def last_temperature(self) -> float:
        """The last one that was a number [°C]; nan where none was."""
        return self._last_temperature

    @property
    def temperature_overdue(self) -> bool:
        cold = self._cold_cycles * self._period
        return cold > TEMPERATURE_AGE and not math.isnan(self._last_temperature)

    def _take(self, data: bytes) -> bool:
        """Unpacks a reply; False where it is the answer to something else."""
        if len(data) >= self._layout.size:
            values = self._layout.unpack_from(data)
            if self._heads_of(values) == self._heads:
                return self._keep([*self._values_of(values)], True)
        found = parse(data).values
        if any(register not in found for register in self._registers):
            return False
        return self._keep([found[register] for register in self._registers], False)

    def _keep(self, values: list[float], raw: bool) -> bool:
        """Takes the values as the state; False where they are the answer to another command."""
        mode, position, velocity, torque, *rest = values
        control = rest.pop(0) if self.has_control_position else math.nan
        if self._has_echo and rest.pop(0) != self._expected and self._expected is not None:
            return False
        temperature = math.nan
        if self._temperature is not None:
            temperature = rest.pop(0)
            if raw:
                temperature = math.nan if temperature == _LOWEST else temperature * _TEMPERATURE_STEP
        self._age(temperature)
        fault, proportional, integral, derivative, feedforward, total = rest
        self.state = State(
            int(mode), position, velocity, torque, control, temperature, int(fault),
            proportional, integral, derivative, feedforward, total,
        )  # fmt: skip
        return True
