"""What the simulated drive in this process says of its faults and refusals."""

from __future__ import annotations

from autotune.core.errors import DriveFault, TransferAborted
from autotune_sim.aborts import AbortCode
from autotune_sim.emergency import ErrorCode
from autotune_sim.servo import ServoState

OVER_CURRENT = 0x2310
_WORDS = {
    OVER_CURRENT: "continuous over-current at the output: the motor is overloaded or blocked",
    ErrorCode.MOTOR_TEMPERATURE: "motor temperature too high: let it cool",
    ErrorCode.SPEED: "speed too high",
    ErrorCode.FOLLOWING_ERROR: "following error too large: the axis did not follow its reference",
    ErrorCode.POSITION_LIMIT: "position limit reached",
    ErrorCode.ENABLE_INPUT: "the enable input is missing: switch it on, or check safe torque off",
    ErrorCode.BRAKE: "the brake is not released: check its supply and wiring",
}
REHEARSED = {
    "drive-fault": OVER_CURRENT,
    "following-error": ErrorCode.FOLLOWING_ERROR,
    "enable-missing": ErrorCode.ENABLE_INPUT,
    "brake-missing": ErrorCode.BRAKE,
}
"""Codes of the failures (`rehearsal`) that are faults."""


def in_words(code: int) -> str:
    """What a fault's code means."""
    return _WORDS.get(code, "fault")


def fault_error(code: int, when: str, state: ServoState) -> DriveFault:
    """The error for a fault that is reported in a state, and `when` that was."""
    return DriveFault(
        f"the simulated drive reports a fault {when}: {in_words(code)} ({code:04X}h) at "
        f"{state.time:.3f} s, position {state.position:.4g} rad, following error "
        f"{state.following_error:.3g} rad. Remove its cause, reset the fault at the drive (or switch it "
        "off and on), and start again",
        code,
    )


def refused(what: str) -> TransferAborted:
    """The error for a transfer that the drive does not take."""
    return TransferAborted(
        f"the simulated drive refuses: {what} (abort code {AbortCode.STATE:08X}h, because of the present "
        "device state; a rehearsed failure)",
        AbortCode.STATE,
    )
