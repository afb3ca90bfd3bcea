"""Blocks of the simulated CiA 402 drive. Two have the AX8000's object numbers: friction, and torque over position.

3144h: spring rate, static and dynamic friction, of the drive's own reference; it acts where the LuGre block
(2100h:01) is off. 32CBh: ten harmonics of torque over the commutation angle, which the drive adds itself. What
is written to them acts at once; 32CFh:01 saves them, and at start they are loaded where 32CBh:01 says so.
1010h keeps control and gain, not the harmonics.

And a third, with numbers of this simulation: 3160h, torque over velocity (`own_friction.py`). It acts while 2100h:01
is on, which is refused as long as its velocities do not increase; 1010h keeps it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from itertools import pairwise

from autotune_sim.aborts import Abort, AbortCode
from autotune_sim.firmware import Firmware
from autotune_sim.object_dictionary import Entry, ObjectDictionary, Value
from autotune_sim.own_friction import POINTS
from autotune_sim.own_ripple import HARMONICS

FRICTION, VELOCITY_TABLE, RIPPLE, SAVE, COMMUTATION = 0x3144, 0x3160, 0x32CB, 0x32CF, 0x32E7
FIRST = 7  # sub-index of the first coefficient
_MEMORY, _WRITTEN = 2, 3
_SAVED = 0xFD00  # where the memory keeps what 32CFh has saved
_FRICTION = (("feedforward.stiffness",), ("feedforward.coulomb", "feedforward.break_away"),
             ("feedforward.viscous",))  # fmt: skip
_FIELDS = ("order", "phase", "torque")

Stored = dict[tuple[int, int], bytes]


class FrictionBlock:
    """3144h."""

    def __init__(self, objects: ObjectDictionary, firmware: Firmware) -> None:
        self._parameters = firmware.servo.parameters
        self._switch = objects[0x2100, 1]
        self._entries = [objects[FRICTION, sub] for sub in (1, 2, 3)]
        for number, entry in enumerate(self._entries):
            entry.write = self._writer(number)

    def start(self) -> None:
        """Hands over what is stored; nothing where all is 0, as 2100h then has its own way."""
        values = [_number(entry.value) for entry in self._entries]
        if any(values):
            self._apply(values)

    def _writer(self, number: int) -> Callable[[Value], None]:
        def write(value: Value) -> None:
            values = [_number(entry.value) for entry in self._entries]
            values[number] = _number(value)
            self._apply(values)

        return write

    def _apply(self, values: list[float]) -> None:
        if self._switch.value:
            return
        for names, value in zip(_FRICTION, values, strict=True):
            for name in names:
                self._parameters.set(name, value)
        self._parameters.set("feedforward.enabled", float(any(values)))


class VelocityTable:
    """3160h: :01 to :06 velocities [0.0001 rpm], :07 to :0C torques [‰ of 6076h]."""

    def __init__(self, objects: ObjectDictionary, firmware: Firmware) -> None:
        self._record = firmware.servo.friction
        self._scales = (1e-4 * 2.0 * math.pi / 60.0, 1e-3 * firmware.rated_torque)
        self._entries = [objects[VELOCITY_TABLE, 1 + k] for k in range(2 * POINTS)]
        for number, entry in enumerate(self._entries):
            entry.write = self._writer(number)
        switch = objects[0x2100, 1]
        self._switched, switch.write = switch.write, self._switch

    def start(self) -> None:
        """Hands over what is stored."""
        for number, entry in enumerate(self._entries):
            self._writer(number)(entry.value)

    def _writer(self, number: int) -> Callable[[Value], None]:
        place, point = divmod(number, POINTS)

        def write(value: Value) -> None:
            self._record[("velocity", "torque")[place]][0, point] = _number(value) * self._scales[place]

        return write

    def _switch(self, value: Value) -> None:
        velocity = [_number(entry.value) for entry in self._entries[:POINTS]]
        if value and any(velocity) and not all(a < b for a, b in pairwise([0.0, *velocity])):
            raise Abort(AbortCode.STATE)
        if self._switched is not None:
            self._switched(value)


class RippleBlock:
    """32CBh, 32CFh and 32E7h.

    Args:
        read, keep: the non-volatile memory; `keep` raises Abort where it cannot be written.
        delay: seconds that saving takes; raises Abort where it is not allowed now.
    """

    def __init__(
        self,
        objects: ObjectDictionary,
        firmware: Firmware,
        read: Callable[[], Mapping[tuple[int, int], bytes]],
        keep: Callable[[Stored], None],
        delay: Callable[[], float],
    ) -> None:
        self._record = firmware.servo.ripple
        self._read, self._keep = read, keep
        self._control, self._gain = objects[RIPPLE, 1], objects[RIPPLE, 2]
        self._entries = [objects[RIPPLE, FIRST + k] for k in range(3 * HARMONICS)]
        self._control.write = self._select
        self._gain.write = lambda value: self._act(int(_number(self._control.value)), _number(value))
        for number, entry in enumerate(self._entries):
            entry.write = self._writer(number)
        objects[RIPPLE, 3].read = self._status
        objects[RIPPLE, 5].read = lambda: int(bool(self._saved()))
        objects[SAVE, 1].delay = lambda _: delay()
        objects[SAVE, 1].write = self._save
        objects[COMMUTATION, 2].read = self._offset

    def start(self) -> None:
        """After power-on: what was saved where it is asked for, else nothing."""
        self._take(self._saved() if self._control.value == _MEMORY else {})
        self._act(int(_number(self._control.value)), _number(self._gain.value))

    @staticmethod
    def keeps(entry: Entry) -> bool:
        """True where 1010h does not: the harmonics, and the command that saves them."""
        return (entry.index == RIPPLE and entry.subindex >= FIRST) or entry.index == SAVE

    def _select(self, value: Value) -> None:
        if value == _MEMORY:
            self._take(self._saved())
        self._act(int(_number(value)), _number(self._gain.value))

    def _act(self, control: int, gain: float) -> None:
        self._record["gain"] = gain if control in (_MEMORY, _WRITTEN) else 0.0

    def _writer(self, number: int) -> Callable[[Value], None]:
        harmonic, place = divmod(number, 3)
        factor = math.radians(1.0) if _FIELDS[place] == "phase" else 1.0

        def write(value: Value) -> None:
            self._record[_FIELDS[place]][0, harmonic] = _number(value) * factor

        return write

    def _take(self, saved: Mapping[int, bytes]) -> None:
        for number, entry in enumerate(self._entries):
            value = entry.decode(saved[number]) if number in saved else entry.default
            self._writer(number)(value)
            entry.value = value

    def _saved(self) -> dict[int, bytes]:
        return {sub: data for (index, sub), data in self._read().items() if index == _SAVED}

    def _save(self, value: Value) -> None:
        if not value:
            raise Abort(AbortCode.RANGE)
        saved = {(_SAVED, k): entry.encode(entry.value) for k, entry in enumerate(self._entries)}
        self._keep(dict(self._read()) | saved)

    def _status(self) -> int:
        control = int(_number(self._control.value))
        return control if control in (_MEMORY, _WRITTEN) else 0

    def _offset(self) -> int:
        return round(36000.0 * (float(self._record["offset"][0]) % 1.0)) % 36000


def _number(value: Value) -> float:
    return float(value) if not isinstance(value, bytes) else 0.0
