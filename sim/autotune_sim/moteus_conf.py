"""The diagnostic console of the simulated moteus controller: `conf` commands on channel 1.

The names are moteus's own where it has the parameter, in its units (revolutions, N m/rev). What moteus
does not have is below `autotune.`: the torque limit, the derivative's filter, the LuGre feedforward, and
how the simulation's time passes. Numbers are printed with six digits, as the controller prints them.

`motor.cogging_dq_comp.N` (int8) times `motor.cogging_dq_scale` [A] times the torque constant (8.27/Kv, the
manual's formula) is added over the turn of the commutation encoder, whose zero
`motor_position.sources.0.offset` [counts] moves.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from autotune_sim.aborts import Abort
from autotune_sim.firmware import Firmware
from autotune_sim.object_dictionary import REAL32, Entry, ObjectDictionary
from autotune_sim.own_ripple import POINTS

TURN = 2.0 * math.pi
KV = 82.7  # rpm/V: 0.1 N m/A
TORQUE_FACTOR = 8.27  # N m/A times rpm/V
SCALE, TABLE = "motor.cogging_dq_scale", "motor.cogging_dq_comp"
_LONGEST_LINE = 100
_FEEDFORWARD = ("enabled", "inertia", "viscous", "coulomb", "break_away", "stribeck_velocity", "stiffness",
                "micro_damping", "offset", "reference_filter")  # fmt: skip


@dataclass
class Plain:
    """A value of the console alone; `fixed` ones cannot be set, `whole` ones hold whole numbers."""

    value: float
    fixed: bool = False
    low: float = -math.inf
    high: float = math.inf
    whole: bool = False


def plain_values(node_id: int, lock_step: bool) -> dict[str, Plain]:
    """What has no object behind it."""
    return {
        "id.id": Plain(node_id, fixed=True),
        "servo.pid_position.sign": Plain(-1, fixed=True),
        "servo.pid_position.iratelimit": Plain(-1, fixed=True),
        "servo.pid_position.ilimit": Plain(1e6, fixed=True),
        "servo.pid_position.max_desired_rate": Plain(0, fixed=True),
        "servo.inertia_feedforward": Plain(0, fixed=True),
        "servo.default_velocity_limit": Plain(math.nan, fixed=True),
        "servo.default_timeout_s": Plain(0.1, low=0.0, high=10.0),
        "servo.timeout_mode": Plain(12, low=0.0, high=15.0),
        "autotune.lock_step": Plain(lock_step, fixed=True),
        "autotune.period_s": Plain(1e-3, low=1e-3, high=0.1),
        "motor.poles": Plain(14, fixed=True),
        "motor.phase_invert": Plain(0, fixed=True),
        "motor.Kv": Plain(KV, low=1.0, high=1e5),
        "motor_position.commutation_source": Plain(0, fixed=True),
        "motor_position.rotor_to_output_ratio": Plain(1, fixed=True),
        "motor_position.output.sign": Plain(1, fixed=True),
        "motor_position.sources.0.sign": Plain(1, fixed=True),
        "motor_position.sources.0.offset": Plain(0, low=-1e6, high=1e6, whole=True),
        SCALE: Plain(0.0),
    } | {f"{TABLE}.{k}": Plain(0, low=-128.0, high=127.0, whole=True) for k in range(POINTS)}


def object_values(firmware: Firmware) -> dict[str, tuple[int, int, float]]:
    """Name → (index, sub-index, raw units a unit of the console)."""
    counts = firmware.counts_per_rad * TURN
    table = {
        "servopos.position_min": (0x607D, 1, counts),
        "servopos.position_max": (0x607D, 2, counts),
        "servo.pid_position.kp": (0x2000, 1, 1.0 / TURN),
        "servo.pid_position.ki": (0x2000, 3, 1.0 / TURN),
        "servo.pid_position.kd": (0x2000, 2, 1.0 / TURN),
        "servo.max_velocity": (0x607F, 0, counts),
        "servo.default_accel_limit": (0x6085, 0, counts),
        "servo.fault_position_error": (0x6065, 0, counts),
        "servo.motor_fault_temperature": (0x2220, 2, 10.0),
        "autotune.max_torque_Nm": (0x6072, 0, 1e3 / firmware.rated_torque),
        "autotune.derivative_filter": (0x2000, 4, 1.0),
    }
    return table | {
        f"autotune.feedforward.{name}": (0x2100, k, 1.0) for k, name in enumerate(_FEEDFORWARD, 1)
    }


class Console:
    """Lines in, lines out.

    Args:
        actions: what `conf write`, `load` and `default` do; each returns the error's text or nothing.
        refuse: SDO-like abort code for an entry that is to be read or written, or 0 (for rehearsals).
        changed: told that a value without an object has changed.
    """

    def __init__(
        self,
        objects: ObjectDictionary,
        firmware: Firmware,
        plain: dict[str, Plain],
        actions: dict[str, Callable[[], str]],
        refuse: Callable[[Entry, bool], int],
        changed: Callable[[], None],
    ) -> None:
        self.output = bytearray()
        self._objects = objects
        self._places = object_values(firmware)
        self._plain = plain
        self._actions = actions
        self._refuse = refuse
        self._changed = changed
        self._input = b""
        self._skipping = False

    def reset(self) -> None:
        self.output.clear()
        self._input = b""
        self._skipping = False

    def feed(self, data: bytes) -> None:
        """Takes what has come on the channel."""
        *lines, rest = (self._input + data).replace(b"\r", b"\n").split(b"\n")
        if self._skipping and lines:
            del lines[0]
            self._skipping = False
        if len(rest) >= _LONGEST_LINE:
            rest, self._skipping = b"", True
        self._input = rest
        for line in lines:
            if line.strip():
                self.output += self._answer(line.decode("latin-1")).encode() + b"\r\n"

    def _answer(self, line: str) -> str:
        words = line.split()
        if words[:2] == ["tel", "stop"]:
            return "OK"
        if words[:1] != ["conf"] or len(words) < 2:
            return "ERR unknown command"
        verb, arguments = words[1], words[2:]
        if verb == "get" and len(arguments) == 1:
            return self._get(arguments[0])
        if verb == "set" and len(arguments) == 2:
            return self._set(*arguments)
        if verb == "enumerate" and not arguments:
            return "".join(f"{name} {self._get(name)}\r\n" for name in (*self._plain, *self._places)) + "OK"
        if verb in self._actions and not arguments:
            trouble = self._actions[verb]()
            return f"ERR {trouble}" if trouble else "OK"
        return "ERR unknown command"

    def _get(self, name: str) -> str:
        if name in self._plain:
            return f"{self._plain[name].value:g}"
        if name not in self._places:
            return self._unknown(name, "reading")
        index, subindex, scale = self._places[name]
        entry = self._objects[index, subindex]
        if self._refuse(entry, False):
            return "ERR error reading"
        value = entry.get()
        return f"{float(value) / scale:g}" if not isinstance(value, bytes) else "ERR error reading"

    def _set(self, name: str, text: str) -> str:
        try:
            value = float(text)
        except ValueError:
            return "ERR error setting"
        if name in self._plain:
            return self._set_plain(self._plain[name], value)
        if name not in self._places:
            return self._unknown(name, "setting")
        index, subindex, scale = self._places[name]
        entry = self._objects[index, subindex]
        if not math.isfinite(value) or self._refuse(entry, True):
            return "ERR error setting"
        try:
            entry.put(value * scale if entry.data_type == REAL32 else round(value * scale))
        except Abort:
            return "ERR error setting"
        return "OK"

    def _set_plain(self, place: Plain, value: float) -> str:
        if place.fixed and not (value == place.value or (math.isnan(value) and math.isnan(place.value))):
            return "ERR error setting"
        if not place.fixed:
            if not place.low <= value <= place.high:
                return "ERR error setting"
            place.value = float(math.trunc(value)) if place.whole else value
            self._changed()
        return "OK"

    def _unknown(self, name: str, doing: str) -> str:
        groups = {known.partition(".")[0] for known in (*self._plain, *self._places)}
        return f"ERR error {doing}" if name.partition(".")[0] in groups else "ERR unknown group"
