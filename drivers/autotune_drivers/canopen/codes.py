"""Error codes of object 603Fh and of EMCY messages in words (CiA 301, table 26; CiA 402-2, 6.1)."""

from __future__ import annotations

from collections.abc import Mapping

_CODES = {
    0x2110: "short circuit or earth leakage at the input",
    0x2211: "over-current inside the drive",
    0x2220: "continuous over-current",
    0x2230: "short circuit or earth leakage in the drive",
    0x2310: "continuous over-current at the output: the motor is overloaded or blocked",
    0x2311: "over-current at the output",
    0x2320: "short circuit at the output: check motor cable and winding",
    0x2330: "earth leakage at the output",
    0x3110: "mains over-voltage",
    0x3120: "mains under-voltage",
    0x3130: "a mains phase is missing",
    0x3210: "DC link over-voltage: braking returns more energy than the supply takes",
    0x3220: "DC link under-voltage: the power supply is off or weak",
    0x3310: "output over-voltage",
    0x4110: "ambient temperature too high",
    0x4210: "drive temperature too high: let it cool",
    0x4310: "motor temperature too high: let it cool",
    0x4410: "supply temperature too high",
    0x5090: "safe torque off is active",
    0x5112: "control voltage too low",
    0x5210: "measurement circuit of the drive is defect",
    0x5441: "a contactor is open",
    0x5530: "the parameter memory (EEPROM) is defect",
    0x6010: "the drive's watchdog has reset it",
    0x6310: "parameters are lost: restore and store them",
    0x6320: "parameters contradict each other",
    0x7110: "brake chopper",
    0x7121: "the motor is blocked: check brake and mechanics",
    0x7122: "motor error or wrong commutation",
    0x7180: "motor brake",
    0x7300: "position sensor",
    0x7303: "resolver 1",
    0x7305: "incremental encoder 1: check its cable",
    0x7306: "incremental encoder 2: check its cable",
    0x7310: "speed too high",
    0x7320: "position sensor: check its cable",
    0x7500: "communication",
    0x8110: "CAN overrun: frames were lost",
    0x8120: "CAN error passive: check cable and termination",
    0x8130: "life guard or heartbeat lost: the master was silent",
    0x8140: "recovered from CAN bus off",
    0x8150: "CAN identifier collision: two nodes have the same number",
    0x8180: "synchronisation lost: SYNC messages were missing",
    0x8210: "a PDO was too short",
    0x8220: "a PDO was too long",
    0x8250: "an RPDO did not arrive in time",
    0x8311: "torque limit exceeded",
    0x8400: "speed control error",
    0x8480: "speed error too large",
    0x8500: "position control error",
    0x8611: "following error too large: the axis did not follow its reference",
    0x8612: "position limit reached",
    0x8613: "homing error",
    0x8A80: "negative limit switch",
    0x8A81: "positive limit switch",
}
_FAMILIES = {
    0x10: "generic error",
    0x20: "current",
    0x21: "current at the input",
    0x22: "current inside the drive",
    0x23: "current at the output",
    0x30: "voltage",
    0x31: "mains voltage",
    0x32: "DC link voltage",
    0x33: "output voltage",
    0x40: "temperature",
    0x41: "ambient temperature",
    0x42: "drive temperature",
    0x43: "motor temperature",
    0x50: "hardware of the drive",
    0x60: "software of the drive",
    0x61: "internal software",
    0x62: "user software",
    0x63: "data set",
    0x70: "additional module",
    0x71: "power module: brake or motor",
    0x73: "sensor",
    0x80: "monitoring",
    0x81: "communication",
    0x82: "protocol error",
    0x83: "torque control",
    0x84: "velocity control",
    0x86: "positioning",
    0x90: "external error",
    0xF0: "additional function",
    0xFF: "specific to this drive: see its manual",
}
HEARTBEAT_LOST = 0x8130
_COMMUNICATION = 0x81
_NOT_OURS = 0b1110
"""Bits of the error register (1001h; CiA 301, table 45): current, voltage, temperature."""


def error_text(code: int, own: Mapping[int, str]) -> str:
    """Words for an error code; `own` are the profile's texts for the vendor's codes."""
    if code == 0:
        return "no error code"
    words = own.get(code) or _CODES.get(code) or _FAMILIES.get(code >> 8) or _FAMILIES.get(code >> 8 & 0xF0)
    return f"{words or 'unknown to this program, see the manual of the drive'} (error code {code:04X}h)"


def is_communication(code: int) -> bool:
    """True where a silent or stuttering master is the cause: safe to acknowledge by a live one."""
    return code >> 8 == _COMMUNICATION


def is_motion(code: int) -> bool:
    """True where the motion commanded is the cause (speed, following error, position)."""
    return code >> 8 in (0x84, 0x85, 0x86) or code == 0x7310


def not_ours(register: int) -> bool:
    """True where the error register shows current, voltage or temperature: no master may reset that."""
    return bool(register & _NOT_OURS)
