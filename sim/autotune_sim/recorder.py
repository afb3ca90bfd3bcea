"""The drive's own data recorder (objects 2400h to 2402h): every servo cycle, without the bus in the way."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable
from enum import IntEnum

from autotune_sim.aborts import Abort, AbortCode
from autotune_sim.object_dictionary import FORMATS, ObjectDictionary, Value, packed

CHANNELS = 8
_RISING = 1


class Status(IntEnum):
    """Object 2400:02."""

    IDLE = 0
    ARMED = 1
    RECORDING = 2
    COMPLETE = 3


class Recorder:
    """Records mapped objects; `tick` belongs at the end of each servo cycle while `active`.

    Args:
        cycle: number of the present servo cycle.
    """

    def __init__(self, objects: ObjectDictionary, cycle: Callable[[], int]) -> None:
        self._objects = objects
        self._cycle = cycle
        self._control = objects[0x2400, 1]
        self._control.write = self._command
        objects[0x2400, 2].read = lambda: int(self.status)
        objects[0x2400, 9].read = lambda: len(self._rows)
        objects[0x2400, 10].read = lambda: self._first & 0xFFFFFFFF
        objects[0x2400, 11].read = lambda: self._packer.size
        objects[0x2402].read = lambda: b"".join(self._rows)
        for key in [(0x2400, sub) for sub in range(3, 9)] + [(0x2401, sub) for sub in range(1, CHANNELS + 1)]:
            objects[key].write = self._refuse_while_active
        self.reset()

    def reset(self) -> None:
        """As at power-up: nothing recorded."""
        self.status = Status.IDLE
        self.active = False
        self._rows: deque[bytes] = deque()
        self._packer = struct.Struct("<")
        self._reads: list[Callable[[], Value]] = []
        self._first = 0
        self._phase = 0

    def _refuse_while_active(self, _: Value) -> None:
        if self.active:
            raise Abort(AbortCode.STATE)

    def _command(self, value: Value) -> None:
        if value == 0:
            self.active = False
            self.status = Status.COMPLETE if self.status is Status.COMPLETE else Status.IDLE
            return
        mapped = [
            self._objects.mapped(number)
            for channel in range(1, CHANNELS + 1)
            if (number := self._objects.number(0x2401, channel))
        ]
        if not mapped:
            raise Abort(AbortCode.PARAMETERS)
        self._packer = struct.Struct("<" + "".join(FORMATS[entry.data_type] for entry in mapped))
        self._reads = [entry.read or entry.get for entry in mapped]
        self._arm(value == 2)

    def _arm(self, at_once: bool) -> None:
        number = self._objects.number
        self._divider, self._wanted = number(0x2400, 3), number(0x2400, 4)
        self._level, self._rising = number(0x2400, 7), number(0x2400, 8) == _RISING
        trigger = number(0x2400, 6)
        self._trigger = self._objects.mapped(trigger).get if trigger and not at_once else None
        before = min(number(0x2400, 5), self._wanted) if self._trigger else 0
        self._rows = deque(maxlen=before)
        self._previous: int | None = None
        self._phase = 0
        self.active = True
        self.status = Status.ARMED
        if self._trigger is None:
            self._begin()

    def _begin(self) -> None:
        self._rows = deque(self._rows, maxlen=self._wanted)
        self._first = self._cycle() + 1 - len(self._rows) * self._divider
        self.status = Status.RECORDING

    def tick(self) -> None:
        """Takes one servo cycle."""
        self._phase = (self._phase + 1) % self._divider
        if self._phase != 1 % self._divider:
            return
        if self.status is Status.ARMED and self._triggered():
            self._begin()
            self._first -= 1
        self._rows.append(packed(self._packer, [read() for read in self._reads]))
        if self.status is Status.RECORDING and len(self._rows) >= self._wanted:
            self.status = Status.COMPLETE
            self.active = False

    def _triggered(self) -> bool:
        if self._trigger is None:
            return True
        value, previous = self._trigger(), self._previous
        now = int(value) if not isinstance(value, bytes) else 0
        self._previous = now
        if previous is None:
            return False
        if self._rising:
            return previous < self._level <= now
        return previous > self._level >= now
