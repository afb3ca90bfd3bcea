"""Which object is which quantity: process values to read, and parameters of the servo loop.

Integer objects are SI quantities times a scale: counts per rad, per mille of rated torque, 0.1 °C.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from autotune_sim.aborts import Abort, AbortCode
from autotune_sim.firmware import Firmware
from autotune_sim.object_dictionary import REAL32, Entry, ObjectDictionary, Value
from autotune_sim.supervision import Supervision

_FEEDFORWARD = ("enabled", "inertia", "viscous", "coulomb", "break_away", "stribeck_velocity", "stiffness",
                "micro_damping", "offset", "reference_filter")  # fmt: skip
_CONTROLLER = ("kp", "kd", "ki", "derivative_filter")
_DIGITAL_ENABLE, _DIGITAL_BRAKE = 1 << 16, 1 << 17


class Settings:
    """Objects that are parameters of the servo loop (`Servo.parameters`)."""

    def __init__(self, objects: ObjectDictionary, firmware: Firmware) -> None:
        self._parameters = firmware.servo.parameters
        self._bound = [(objects[key], name, scale) for key, (name, scale) in _table(firmware).items()]
        for entry, name, scale in self._bound:
            entry.write = self._writer(name, scale)
            entry.default = _to_object(entry, self._parameters[name] * scale)

    def apply(self) -> None:
        """Hands all values, as they stand in the dictionary, to the servo loop.

        Raises:
            Abort: a value that the servo loop does not take.
        """
        for entry, name, scale in self._bound:
            self._writer(name, scale)(entry.value)

    def _writer(self, name: str, scale: float) -> Callable[[Value], None]:
        def write(value: Value) -> None:
            try:
                self._parameters.set(name, float(value) / scale)
            except ValueError:
                raise Abort(AbortCode.RANGE) from None

        return write


def _table(firmware: Firmware) -> dict[tuple[int, int], tuple[str, float]]:
    counts = firmware.counts_per_rad
    table = {(0x2000, k): (f"controller.{name}", 1.0) for k, name in enumerate(_CONTROLLER, 1)}
    table |= {(0x2100, k): (f"feedforward.{name}", 1.0) for k, name in enumerate(_FEEDFORWARD, 1)}
    return table | {
        (0x2220, 2): ("limit.temperature", 10.0),
        (0x6065, 0): ("limit.following_error", counts),
        (0x6072, 0): ("limit.torque", 1e3 / firmware.rated_torque),
        (0x607D, 1): ("limit.position_min", counts),
        (0x607D, 2): ("limit.position_max", counts),
        (0x607F, 0): ("limit.speed", counts),
        (0x6085, 0): ("limit.deceleration", counts),
    }


def _to_object(entry: Entry, value: float) -> Value:
    return value if entry.data_type == REAL32 else round(value)


def bind_process_values(objects: ObjectDictionary, firmware: Firmware) -> None:
    """Hooks what the master may read of the present cycle."""
    counts = firmware.counts_per_rad
    per_mille = 1e3 / firmware.rated_torque
    for key, value in {
        (0x6041, 0): firmware.statusword,
        (0x6061, 0): lambda: firmware.mode,
        (0x6062, 0): lambda: round(firmware.sample.position_demand * counts),
        (0x6063, 0): lambda: round(firmware.sample.position * counts),
        (0x6064, 0): lambda: round(firmware.sample.position * counts),
        (0x606B, 0): lambda: round(firmware.demand_velocity * counts),
        (0x606C, 0): lambda: round(firmware.sample.velocity * counts),
        (0x6074, 0): lambda: _short(firmware.sample.torque_demand * per_mille),
        (0x6077, 0): lambda: _short(firmware.sample.torque_actual * per_mille),
        (0x6078, 0): lambda: _short(firmware.sample.torque_actual * per_mille),
        (0x60F4, 0): lambda: round(firmware.sample.following_error * counts),
        (0x60FD, 0): lambda: _digital_inputs(firmware.supervision),
        (0x603F, 0): lambda: firmware.error_code,
        (0x2200, 1): lambda: round(firmware.sample.torque_demand * 1e6),
        (0x2200, 2): lambda: round(firmware.sample.torque_actual * 1e6),
        (0x2200, 5): lambda: round(firmware.sample.torque_offset * 1e6),
        (0x2200, 6): lambda: round((firmware.sample.torque_offset - firmware.host_offset) * 1e6),
        (0x2200, 7): lambda: round((firmware.sample.torque_demand - firmware.sample.torque_offset) * 1e6),
        (0x2210, 1): lambda: firmware.cycles & 0xFFFFFFFF,
        (0x2210, 2): lambda: firmware.cycles & 0xFFFF,
        (0x2220, 1): lambda: _short(firmware.temperature * 10.0),
    }.items():
        objects[key].read = value
    objects[0x2210, 6].value = round(firmware.servo.period * 1e9)
    objects[0x608F, 1].value = round(counts * 2.0 * math.pi)


def _digital_inputs(inputs: Supervision) -> int:
    return _DIGITAL_ENABLE * inputs.enable_input + _DIGITAL_BRAKE * inputs.brake_input


def _short(value: float) -> int:
    return max(-32768, min(32767, round(value)))
