"""Modes and fault numbers of a moteus in words (moteus manual, registers 000h and 00Fh)."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum


class Mode(IntEnum):
    """Values of register 000h that matter to a master."""

    STOPPED = 0
    FAULT = 1
    POSITION = 10
    TIMEOUT = 11
    ZERO_VELOCITY = 12
    BRAKE = 15


STARTING = frozenset({2, 3, 4})
"""Modes on the way to power: the controller calibrates its current sensors."""
UNCOMMANDED = frozenset({Mode.STOPPED, Mode.FAULT, Mode.TIMEOUT, Mode.ZERO_VELOCITY, Mode.BRAKE})
"""Modes in which nobody moves the axis."""
LIMITED = range(96, 112)
"""Numbers that are no faults: they say what limits the torque."""

_MODES = {
    0: "stopped",
    1: "fault",
    5: "PWM",
    6: "voltage",
    7: "voltage FOC",
    8: "voltage DQ",
    9: "current",
    10: "position",
    11: "timeout",
    12: "zero velocity",
    13: "stay within",
    14: "measure inductance",
    15: "brake",
}
_FAULTS = {
    1: "DMA transfer error inside the controller",
    2: "DMA FIFO error inside the controller",
    3: "overrun on the serial line",
    4: "framing error on the serial line: check its speed",
    5: "noise on the serial line",
    6: "the serial line's buffer has overflowed",
    7: "parity error on the serial line",
    32: "calibration: the encoder does not sense its magnet",
    33: "motor driver: most often the supply gives less current than was drawn",
    34: "over-voltage: braking returns more energy than the supply takes",
    35: "encoder: its readings fit no magnet; check its cable and distance",
    36: "the motor is not calibrated: run 'moteus_tool --calibrate'",
    37: "the control cycle took too long",
    38: "over-temperature: let it cool",
    39: "control was started outside of servopos.position_min and position_max: bring the axis back between them",
    40: "under-voltage: the supply is off or weak",
    41: "a parameter was changed that needs a stop",
    42: "no commutation encoder is valid",
    43: "no output encoder is valid",
    44: "the motor driver could not be enabled: check safe torque off, enable input and supply",
    45: "the deprecated stop position was used",
    46: "the control cycle was late",
    47: "servo.bemf_feedforward needs an acceleration limit",
    48: "servopos.position_min or position_max is outside of what the position can be",
    49: "position error too large: the axis did not follow its reference (servo.fault_position_error)",
    50: "velocity error too large (servo.fault_velocity_error)",
    96: "limited by servo.max_velocity",
    97: "limited by servo.max_power_W",
    98: "limited by the supply voltage",
    99: "limited by servo.max_current_A",
    100: "limited by the temperature of the controller",
    101: "limited by the temperature of the motor",
    102: "limited by the commanded maximum torque",
    103: "limited by servopos.position_min or position_max",
}
_MOTION = frozenset({39, 49, 50, 121, 122})


def mode_text(mode: int) -> str:
    """A mode as errors name it."""
    return f"{_MODES.get(mode, 'unknown')!r} (mode {mode})"


def fault_text(number: int, own: Mapping[int, str]) -> str:
    """Words for a fault number; `own` are the profile's texts."""
    if number == 0:
        return "no fault number"
    words = (
        own.get(number) or _FAULTS.get(number) or "unknown to this program, see the manual of the controller"
    )
    return f"{words} (fault {number})"


def is_motion(number: int) -> bool:
    """True where the motion commanded is the cause."""
    return number in _MOTION
