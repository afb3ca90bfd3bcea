"""What can go wrong with a drive, on demand: for rehearsals and tests.

An order is a text `NAME[=VALUE][@WHEN]`; WHEN is `2.5` (seconds with operation enabled), `2.5w` (seconds
of the wall clock since the start), `500c` (SYNC messages), `write` or `write3` (that parameter write, by
SDO into 2000h to 5FFFh), `store` (in the middle of storing). Without it, the fault is there at once.

| name | value | what happens |
|---|---|---|
| silent | seconds, or for good | the node neither hears nor speaks |
| unplugged | seconds, or for good | the adapter is pulled out of the host |
| power-loss | | power goes and comes back; volatile values are lost |
| drive-fault | error code in hex (2310) | a fault that can be reset |
| enable-missing | | enable input open: torque off, no way to be enabled |
| brake-missing | | no feedback of the released brake |
| blocked | | the axis cannot move: following error |
| hot | °C (200) | the motor is warmer by so much |
| frames-lost | percent (1) | frames get lost at random, both ways |
| emcy | error code in hex (5000) | an EMCY message and nothing else |
| sdo-abort | INDEX[:SUB[:CODE]] in hex | transfers of the object are refused |
| other-identity | vendor in hex (0000009A) | another drive answers |
| nvm | | storing is confirmed, but nothing is kept |
| stop-fault | error code in hex (2310) | a fault in the middle of the next controlled stop: power goes at once |
| rpdo-lost | percent (100) | receive PDOs (moteus: commands) get lost, everything else works |
| second-master | rad (0.1) | another master puts its own target, so far away, in place of ours |
| status-word | value in hex (0000) | the status word tells this, whatever is true |
| fault-reset | | somebody resets the drive's fault |
| snapshot | | nothing; the objects are logged, where what is true is logged |
| clear | | all of the above is over |

Besides these, everything that can break inside the axis: `hurts`.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from autotune.core.errors import ConfigurationError
from autotune_sim.aborts import AbortCode
from autotune_sim.device import Device
from autotune_sim.hurts import HURTS, apply_hurt
from autotune_sim.object_dictionary import Entry

_ORDER = re.compile(r"^(?P<name>[a-z-]+)(?:=(?P<value>[^@]*))?(?:@(?P<when>.+))?$")
_WHEN = re.compile(
    r"^(?:(?P<seconds>\d+(?:\.\d*)?)(?P<wall>w)?|(?P<syncs>\d+)c|write(?P<write>\d*)|(?P<store>store))$"
)


class Plug(Protocol):
    """The adapter's cable."""

    def plug(self) -> None: ...

    def unplug(self) -> None: ...


@dataclass(frozen=True, slots=True)
class Order:
    """One fault to come. `trigger` is `now`, `motion`, `wall`, `sync`, `write` or `store`."""

    name: str
    value: str = ""
    trigger: str = "now"
    amount: float = 0.0


def parse_order(text: str) -> Order:
    """Reads an order.

    Raises:
        ConfigurationError: an unknown name, with the nearest right one, or a value or time that cannot be.
    """
    match = _ORDER.match(text.strip())
    if match is None or match["name"] not in FAULTS:
        name = match["name"] if match else text
        near = difflib.get_close_matches(name, FAULTS, 1)
        hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(FAULTS)}"
        raise ConfigurationError(f"fault {text!r} is not known; {hint}")
    name, value = match["name"], match["value"] or ""
    if not re.fullmatch(FAULTS[name].pattern, value):
        raise ConfigurationError(f"fault {text!r}: value {value!r} must be {FAULTS[name].words}")
    trigger, amount = _when(text, match["when"])
    return Order(name, value, trigger, amount)


def _when(text: str, when: str | None) -> tuple[str, float]:
    if when is None:
        return "now", 0.0
    match = _WHEN.match(when)
    if match is None:
        raise ConfigurationError(
            f"fault {text!r}: {when!r} is no time; give 2.5 (seconds enabled), 2.5w (wall clock), "
            "500c (SYNC messages), write, write3 or store"
        )
    if match["seconds"]:
        return ("wall" if match["wall"] else "motion"), float(match["seconds"])
    if match["syncs"]:
        return "sync", float(match["syncs"])
    return ("store", 0.0) if match["store"] else ("write", float(match["write"] or 1))


class Faults:
    """Puts faults into a drive, at once (`inject`) or when their time has come.

    Args:
        plug: the adapter's cable.
        clock: monotonic time [s].
    """

    def __init__(
        self, device: Device, plug: Plug, clock: Callable[[], float], log: Callable[[str], None]
    ) -> None:
        self.device = device
        self.plug = plug
        self._clock = clock
        self._log = log
        self._start = clock()
        self._writes = 0
        self._orders: list[Order] = []
        self._later: list[tuple[float, Callable[[], None]]] = []

    def add(self, order: Order) -> None:
        """Takes an order."""
        if order.trigger == "now":
            self.inject(order)
            return
        self._orders.append(order)
        triggers = {waiting.trigger for waiting in self._orders}
        self.device.on_cycle = self._on_cycle if triggers & {"motion", "sync"} else None
        self.device.on_write = self._on_write if "write" in triggers else None
        self.device.on_store = self._on_store if "store" in triggers else None

    def inject(self, order: Order) -> None:
        """Makes a fault happen now."""
        self._log(f"fault put in: {order.name}{'=' + order.value if order.value else ''}")
        servo = self.device.firmware.servo
        if servo.truth is not None and order.name not in _NO_FAULTS:
            servo.truth.note("fault put in", servo.time, name=order.name, value=order.value)
        FAULTS[order.name].act(self, order.value)

    def poll(self, now: float) -> float | None:
        """Does what the wall clock asks for; when to call again [s]."""
        elapsed = now - self._start
        self._fire(lambda order: order.trigger == "wall" and elapsed >= order.amount)
        ripe = [act for time, act in self._later if time <= now]
        self._later = [(time, act) for time, act in self._later if time > now]
        for act in ripe:
            act()
        times = [self._start + order.amount for order in self._orders if order.trigger == "wall"]
        return min(times + [time for time, _ in self._later], default=None)

    def after(self, seconds: str, act: Callable[[], None]) -> None:
        """Calls `act` later; never where no time is given."""
        if seconds:
            self._later.append((self._clock() + float(seconds), act))

    def _fire(self, ripe: Callable[[Order], bool]) -> None:
        for order in [order for order in self._orders if ripe(order)]:
            self._orders.remove(order)
            self.inject(order)

    def _on_cycle(self, device: Device) -> None:
        reached = {"motion": device.firmware.enabled_time, "sync": float(device.node.syncs)}
        self._fire(lambda order: order.trigger in reached and reached[order.trigger] >= order.amount)

    def _on_write(self, entry: Entry) -> None:
        if 0x2000 <= entry.index < 0x6000:
            self._writes += 1
            self._fire(lambda order: order.trigger == "write" and self._writes >= order.amount)

    def _on_store(self) -> None:
        self._fire(lambda order: order.trigger == "store")


def _silent(faults: Faults, value: str) -> None:
    def speak() -> None:
        faults.device.silent = False

    faults.device.silent = True
    faults.after(value, speak)


def _unplugged(faults: Faults, value: str) -> None:
    faults.plug.unplug()
    faults.after(value, faults.plug.plug)


def _sdo_abort(faults: Faults, value: str) -> None:
    index, subindex, code = [*value.split(":"), "", ""][:3]
    key = int(index, 16), int(subindex, 16) if subindex else -1
    faults.device.refusals[key] = int(code, 16) if code else AbortCode.GENERAL


def _other_identity(faults: Faults, value: str) -> None:
    faults.device.objects[0x1018, 1].value = int(value or "9A", 16)


def _nvm(faults: Faults, _: str) -> None:
    faults.device.memory.lossy = True


def _enable_missing(faults: Faults, _: str) -> None:
    faults.device.firmware.supervision.enable_input = False


def _brake_missing(faults: Faults, _: str) -> None:
    faults.device.firmware.supervision.brake_input = False


def _blocked(faults: Faults, _: str) -> None:
    faults.device.firmware.servo.brake_stuck = True


def _hot(faults: Faults, value: str) -> None:
    faults.device.firmware.supervision.heating = float(value or "200")


def _frames_lost(faults: Faults, value: str) -> None:
    faults.device.loss = min(float(value or "1"), 100.0) / 100.0


def _stop_fault(faults: Faults, value: str) -> None:
    faults.device.firmware.stop_fault = int(value or "2310", 16)


def _commands_lost(faults: Faults, value: str) -> None:
    faults.device.command_loss = min(float(value or "100"), 100.0) / 100.0


def _second_master(faults: Faults, value: str) -> None:
    faults.device.firmware.foreign_target = faults.device.firmware.sample.position + float(value or "0.1")


def _status_word(faults: Faults, value: str) -> None:
    faults.device.firmware.false_word = int(value or "0000", 16)


def _clear(faults: Faults, _: str) -> None:
    device, firmware = faults.device, faults.device.firmware
    firmware.servo.heal()
    firmware.stop_fault, firmware.foreign_target, firmware.false_word = 0, None, None
    device.command_loss = 0.0
    device.silent = device.memory.lossy = firmware.servo.brake_stuck = False
    watched = firmware.supervision
    watched.enable_input = watched.brake_input = True
    watched.heating = 0.0
    device.loss = 0.0
    device.refusals.clear()
    vendor = device.objects[0x1018, 1]
    vendor.value = vendor.default
    faults.plug.plug()


@dataclass(frozen=True, slots=True)
class _Fault:
    act: Callable[[Faults, str], None]
    pattern: str = ""
    words: str = "left out"


def _broken(name: str) -> _Fault:
    """A fault inside the axis, as an order behind the wire."""

    def act(faults: Faults, value: str) -> None:
        apply_hurt(faults.device.firmware.servo, name, value)

    pattern = HURTS[name].pattern
    return _Fault(act, f"({pattern})?" if pattern else "", HURTS[name].words)


_SECONDS = (r"(\d+(\.\d*)?)?", "seconds, for example 0.5")
_CODE = (r"([0-9A-Fa-f]{4})?", "four hexadecimal digits")
_NO_FAULTS = frozenset({"fault-reset", "snapshot", "clear"})
FAULTS: dict[str, _Fault] = {
    "silent": _Fault(_silent, *_SECONDS),
    "unplugged": _Fault(_unplugged, *_SECONDS),
    "power-loss": _Fault(lambda faults, _: faults.device.power_loss()),
    "drive-fault": _Fault(lambda faults, v: faults.device.firmware.fault(int(v or "2310", 16)), *_CODE),
    "enable-missing": _Fault(_enable_missing),
    "brake-missing": _Fault(_brake_missing),
    "blocked": _Fault(_blocked),
    "hot": _Fault(_hot, r"(\d+(\.\d*)?)?", "a temperature difference in °C"),
    "frames-lost": _Fault(_frames_lost, r"(\d+(\.\d*)?)?", "a percentage"),
    "emcy": _Fault(
        lambda faults, v: faults.device.node.emergency.report(int(v or "5000", 16), lasting=False), *_CODE
    ),
    "sdo-abort": _Fault(
        _sdo_abort,
        r"[0-9A-Fa-f]{4}(:[0-9A-Fa-f]{1,2}(:[0-9A-Fa-f]{8})?)?",
        "INDEX[:SUB[:CODE]] in hexadecimal, for example 2100:07:06090030",
    ),
    "other-identity": _Fault(_other_identity, r"([0-9A-Fa-f]{1,8})?", "a vendor-ID in hexadecimal"),
    "nvm": _Fault(_nvm),
    "stop-fault": _Fault(_stop_fault, *_CODE),
    "rpdo-lost": _Fault(_commands_lost, r"(\d+(\.\d*)?)?", "a percentage"),
    "second-master": _Fault(_second_master, r"([+-]?\d+(\.\d*)?)?", "an angle in rad"),
    "status-word": _Fault(_status_word, *_CODE),
    **{name: _broken(name) for name in HURTS},
    "fault-reset": _Fault(lambda faults, _: faults.device.firmware.reset_fault()),
    "snapshot": _Fault(lambda faults, _: faults.device.note_objects("objects")),
    "clear": _Fault(_clear),
}
