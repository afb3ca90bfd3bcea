"""The power state machine of CiA 402 (6.2, figure 2) as a table: pure, without time or torque."""

from __future__ import annotations

from enum import Enum


class State(Enum):
    """A state; the value is its bits in the status word (mask 6Fh, or 4Fh without quick stop)."""

    NOT_READY = 0x00
    SWITCH_ON_DISABLED = 0x40
    READY_TO_SWITCH_ON = 0x21
    SWITCHED_ON = 0x23
    OPERATION_ENABLED = 0x27
    QUICK_STOP_ACTIVE = 0x07
    FAULT_REACTION_ACTIVE = 0x0F
    FAULT = 0x08


class Word(Enum):
    """A command of the controlword."""

    SHUTDOWN = "shutdown"
    SWITCH_ON = "switch on"
    ENABLE_OPERATION = "enable operation"
    DISABLE_VOLTAGE = "disable voltage"
    QUICK_STOP = "quick stop"


POWERED = frozenset({State.OPERATION_ENABLED, State.QUICK_STOP_ACTIVE, State.FAULT_REACTION_ACTIVE})
FAULTY = frozenset({State.FAULT, State.FAULT_REACTION_ACTIVE})

HALT = 0x0100
_FAULT_RESET = 0x0080

TRANSITIONS: dict[tuple[State, Word], State] = {
    (State.SWITCH_ON_DISABLED, Word.SHUTDOWN): State.READY_TO_SWITCH_ON,
    (State.READY_TO_SWITCH_ON, Word.SWITCH_ON): State.SWITCHED_ON,
    (State.READY_TO_SWITCH_ON, Word.ENABLE_OPERATION): State.OPERATION_ENABLED,
    (State.READY_TO_SWITCH_ON, Word.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.READY_TO_SWITCH_ON, Word.QUICK_STOP): State.SWITCH_ON_DISABLED,
    (State.SWITCHED_ON, Word.ENABLE_OPERATION): State.OPERATION_ENABLED,
    (State.SWITCHED_ON, Word.SHUTDOWN): State.READY_TO_SWITCH_ON,
    (State.SWITCHED_ON, Word.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.SWITCHED_ON, Word.QUICK_STOP): State.SWITCH_ON_DISABLED,
    (State.OPERATION_ENABLED, Word.SWITCH_ON): State.SWITCHED_ON,
    (State.OPERATION_ENABLED, Word.SHUTDOWN): State.READY_TO_SWITCH_ON,
    (State.OPERATION_ENABLED, Word.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.OPERATION_ENABLED, Word.QUICK_STOP): State.QUICK_STOP_ACTIVE,
    (State.QUICK_STOP_ACTIVE, Word.DISABLE_VOLTAGE): State.SWITCH_ON_DISABLED,
    (State.QUICK_STOP_ACTIVE, Word.ENABLE_OPERATION): State.OPERATION_ENABLED,
}


def command(controlword: int) -> Word:
    """What a controlword asks for (CiA 402, table 28)."""
    if controlword & 0x02 == 0:
        return Word.DISABLE_VOLTAGE
    if controlword & 0x06 == 0x02:
        return Word.QUICK_STOP
    if controlword & 0x07 == 0x06:
        return Word.SHUTDOWN
    if controlword & 0x0F == 0x07:
        return Word.SWITCH_ON
    return Word.ENABLE_OPERATION


def fault_reset(before: int, after: int) -> bool:
    """True on the rising edge of bit 7."""
    return bool(after & ~before & _FAULT_RESET)
