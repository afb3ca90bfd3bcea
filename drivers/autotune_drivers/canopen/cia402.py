"""The power state machine of CiA 402 (part 2, figure 2) as a table, and the control words through it."""

from __future__ import annotations

from enum import Enum

from autotune.core.drive import Mode


class State(Enum):
    """States by name; the values are what errors say."""

    NOT_READY = "not ready to switch on"
    SWITCH_ON_DISABLED = "switch on disabled"
    READY = "ready to switch on"
    SWITCHED_ON = "switched on"
    ENABLED = "operation enabled"
    QUICK_STOP = "quick stop active"
    FAULT_REACTION = "fault reaction active"
    FAULT = "fault"
    UNKNOWN = "unknown"


# status word & mask == value
STATUS: tuple[tuple[int, int, State], ...] = (
    (0x4F, 0x00, State.NOT_READY),
    (0x4F, 0x40, State.SWITCH_ON_DISABLED),
    (0x6F, 0x21, State.READY),
    (0x6F, 0x23, State.SWITCHED_ON),
    (0x6F, 0x27, State.ENABLED),
    (0x6F, 0x07, State.QUICK_STOP),
    (0x4F, 0x0F, State.FAULT_REACTION),
    (0x4F, 0x08, State.FAULT),
)
ENABLED_MASK = 0x6F
ENABLED_VALUE = 0x27

DISABLE_VOLTAGE = 0x00
QUICK_STOP = 0x02
SHUTDOWN = 0x06
SWITCH_ON = 0x07
ENABLE_OPERATION = 0x0F
FAULT_RESET = 0x80

TOWARDS_ENABLED = {
    State.NOT_READY: DISABLE_VOLTAGE,
    State.SWITCH_ON_DISABLED: SHUTDOWN,
    State.READY: SWITCH_ON,
    State.SWITCHED_ON: ENABLE_OPERATION,
    State.ENABLED: ENABLE_OPERATION,
    State.QUICK_STOP: DISABLE_VOLTAGE,
    State.FAULT_REACTION: DISABLE_VOLTAGE,
    State.UNKNOWN: DISABLE_VOLTAGE,
}
POWERED = frozenset({State.ENABLED, State.QUICK_STOP, State.FAULT_REACTION})
FAULTY = frozenset({State.FAULT, State.FAULT_REACTION})

MODE_CODES = {Mode.POSITION: 8, Mode.VELOCITY: 9, Mode.TORQUE: 10}


def state_of(status: int) -> State:
    """The state that a status word tells."""
    for mask, value, state in STATUS:
        if status & mask == value:
            return state
    return State.UNKNOWN


def describe(status: int) -> str:
    """State and status word as errors name them."""
    return f"{state_of(status).value!r} (status word {status:04X}h)"


def what_is_missing(status: int) -> str:
    """What a status word says about a drive that does not go on, with what to check."""
    state = state_of(status)
    if not status & 0x10 and state in (State.READY, State.SWITCHED_ON, State.SWITCH_ON_DISABLED):
        return (
            "power is not allowed (bit 4 of the status word is 0): check the enable input, safe torque off, "
            "emergency stop and the main supply"
        )
    if state is State.SWITCH_ON_DISABLED:
        return "something forbids power: check enable input, safe torque off and emergency stop"
    if state in (State.READY, State.SWITCHED_ON):
        return "check enable input, safe torque off, and whether the brake is released"
    return "see the manual of the drive"
