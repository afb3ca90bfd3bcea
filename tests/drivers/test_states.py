"""State machine table and error codes."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from autotune_drivers.canopen.cia402 import (
    ENABLE_OPERATION,
    FAULT_RESET,
    STATUS,
    TOWARDS_ENABLED,
    State,
    describe,
    state_of,
    what_is_missing,
)
from autotune_drivers.canopen.codes import error_text, is_communication, is_motion


def test_masks_and_values_are_those_of_the_standard() -> None:
    table = {state: (mask, value) for mask, value, state in STATUS}
    assert table == {
        State.NOT_READY: (0x4F, 0x00),
        State.SWITCH_ON_DISABLED: (0x4F, 0x40),
        State.READY: (0x6F, 0x21),
        State.SWITCHED_ON: (0x6F, 0x23),
        State.ENABLED: (0x6F, 0x27),
        State.QUICK_STOP: (0x6F, 0x07),
        State.FAULT_REACTION: (0x4F, 0x0F),
        State.FAULT: (0x4F, 0x08),
    }


@given(st.integers(0, 0xFFFF))
def test_no_status_word_means_two_states(status: int) -> None:
    matching = [state for mask, value, state in STATUS if status & mask == value]
    assert len(matching) <= 1
    assert state_of(status) is (matching[0] if matching else State.UNKNOWN)
    assert f"{status:04X}h" in describe(status)
    assert what_is_missing(status)


def test_the_way_to_power_has_no_shortcut_through_a_fault() -> None:
    """Only a deliberate acknowledgement leaves a fault; nothing enables from there."""
    assert State.FAULT not in TOWARDS_ENABLED
    enabling = [state for state, control in TOWARDS_ENABLED.items() if control == ENABLE_OPERATION]
    assert set(enabling) == {State.SWITCHED_ON, State.ENABLED}
    assert not any(control & FAULT_RESET for control in TOWARDS_ENABLED.values())


@given(st.integers(0, 0xFFFF))
def test_every_error_code_has_words(code: int) -> None:
    text = error_text(code, {0xFF10: "enable input"})
    assert text == "no error code" if code == 0 else f"{code:04X}h" in text
    assert not (is_communication(code) and is_motion(code))


def test_a_profile_knows_its_own_codes_better() -> None:
    assert "enable input" in error_text(0xFF10, {0xFF10: "enable input"})
    assert "following error" in error_text(0x8611, {})
    assert "heartbeat" in error_text(0x8130, {})
    assert is_communication(0x8130)
    assert is_motion(0x8611)
    assert not is_motion(0x2310)
