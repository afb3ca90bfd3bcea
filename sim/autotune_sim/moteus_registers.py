"""Registers of the simulated moteus controller: what may be read, as which kind of quantity.

Source: the moteus reference manual, "Registers". P, I and D torques (030h to 032h) are, as in the
firmware (`fw/pid.h`), those of measured − desired: with `servo.pid_position.sign` −1 they count against
the torque. 033h is the host's feedforward alone, 034h the total after the limit.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from autotune_sim.moteus_conf import TURN

if TYPE_CHECKING:
    from autotune_sim.moteus_device import MoteusDevice

MODEL, MAP_VERSION, FIRMWARE_VERSION = 0x7A01, 5, 0x010A
VOLTAGE, BOARD_TEMPERATURE = 24.0, 35.0
MODE = 0x000
COMMANDS = {
    0x020: ("position", "position"),
    0x021: ("velocity", "velocity"),
    0x022: ("feedforward", "torque"),
    0x023: ("kp_scale", "scale"),
    0x024: ("kd_scale", "scale"),
    0x025: ("max_torque", "torque"),
    0x026: ("stop_position", "position"),
    0x027: ("timeout", "time"),
    0x028: ("velocity_limit", "velocity"),
    0x029: ("acceleration_limit", "acceleration"),
    0x02A: ("fixed_voltage", "voltage"),
    0x02B: ("ilimit_scale", "scale"),
    0x02C: ("fixed_current", "current"),
    0x02D: ("ignore_bounds", "int"),
}
"""Register → (field of `PositionCommand`, kind)."""

Place = tuple[str, Callable[[], float]]


def readable(device: MoteusDevice) -> dict[int, Place]:
    """Register → (kind, what it reads)."""
    firmware = device.firmware
    table: dict[int, Place] = {
        0x000: ("int", lambda: device.mode),
        0x001: ("position", lambda: firmware.sample.position / TURN),
        0x002: ("velocity", lambda: firmware.sample.velocity / TURN),
        0x003: ("torque", lambda: firmware.sample.torque_actual),
        0x00A: ("temperature", lambda: firmware.temperature),
        0x00B: ("int", lambda: device.trajectory.complete),
        0x00C: ("int", lambda: 1),
        0x00D: ("voltage", lambda: VOLTAGE),
        0x00E: ("temperature", lambda: BOARD_TEMPERATURE),
        0x00F: ("int", lambda: device.fault_number),
        0x033: ("torque", lambda: device.command.feedforward),
        0x034: ("torque", lambda: firmware.sample.torque_demand),
        0x038: ("position", lambda: device.control_position),
        0x039: ("velocity", lambda: device.trajectory.velocity),
        0x03A: ("torque", lambda: firmware.sample.torque_demand),
        0x03B: ("position", lambda: -firmware.sample.following_error / TURN),
        0x070: ("int", lambda: int(device.now * 1e3) & 0x7FFFFFFF),
        0x100: ("int", lambda: device.model),
        0x101: ("int", lambda: FIRMWARE_VERSION),
        0x102: ("int", lambda: MAP_VERSION),
        0x120: ("int", lambda: device.objects.number(0x1018, 4)),
        0x121: ("int", lambda: 0),
        0x122: ("int", lambda: 0),
    }
    for part in range(3):
        table[0x030 + part] = ("torque", _part(device, part))
    for register, (field, kind) in COMMANDS.items():
        table[register] = (kind, _field(device, field))
    return table


def _part(device: MoteusDevice, part: int) -> Callable[[], float]:
    return lambda: -device.firmware.servo.feedback_parts[part] if device.closed_loop else 0.0


def _field(device: MoteusDevice, field: str) -> Callable[[], float]:
    return lambda: float(getattr(device.command, field))
