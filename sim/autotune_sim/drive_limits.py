"""Limits that the simulated drive in this process holds itself to, and by which its stop is watched."""

from __future__ import annotations

import math
from dataclasses import dataclass

from autotune.core.stopping import StopLimits, gain_allowed
from autotune_sim.emergency import ErrorCode
from autotune_sim.parameters import Parameters
from autotune_sim.servo import Servo, ServoState

BEYOND = 0.03  # rad outside of a position limit, on the way out, that is a fault
LEAST_SPEED = 0.1  # rad/s on the way out
OVERSPEED = 1.2  # times the speed limit that is a fault


@dataclass(frozen=True, slots=True)
class DriveLimits:
    """What the parameters allow.

    Attributes:
        lowest, highest: of the position [rad]; `window`: of the following error [rad].
        speed: of targets [rad/s]; `fastest`: of the axis before it is a fault.
        deceleration: of the drive's own stop [rad/s²].
        hottest: reading of the motor's sensor above which it is too warm [°C].
    """

    lowest: float
    highest: float
    window: float
    speed: float
    fastest: float
    deceleration: float
    hottest: float

    @classmethod
    def of(cls, p: Parameters, heating: float) -> DriveLimits:
        """`heating`: by how much the motor is warmer than its sensor reads [K]."""
        speed = p["limit.speed"]
        return cls(
            p["limit.position_min"],
            p["limit.position_max"],
            p["limit.following_error"],
            speed,
            OVERSPEED * speed,
            p["limit.deceleration"],
            p["limit.temperature"] - heating,
        )

    def broken(self, state: ServoState) -> int:
        """The fault that a state is; 0 for none."""
        if abs(state.following_error) > self.window:
            return ErrorCode.FOLLOWING_ERROR
        if abs(state.velocity) > self.fastest:
            return ErrorCode.SPEED
        if not self.lowest - BEYOND < state.position < self.highest + BEYOND and self._leaves(state):
            return ErrorCode.POSITION_LIMIT
        return ErrorCode.MOTOR_TEMPERATURE if state.temperature > self.hottest else 0

    def _leaves(self, state: ServoState) -> bool:
        """Whether it moves further away from where it may be."""
        outwards = state.velocity if state.position > self.highest else -state.velocity
        return outwards > LEAST_SPEED

    def stop(self, servo: Servo) -> StopLimits:
        """What a driver in front of this drive would watch its stop by."""
        count = 2.0 * math.pi / servo.preset.plant.counts
        allowance = gain_allowed(self.speed, self.deceleration, servo.period, count)
        return StopLimits(
            servo.period, allowance, self.lowest, self.highest, self.window, "rad", self.deceleration, count
        )
