"""How a moteus position command moves the controller's demand: at once, at a velocity, or within limits."""

from __future__ import annotations

import math
from dataclasses import dataclass

NAN = math.nan


@dataclass
class PositionCommand:
    """Registers 020h to 02Dh of one command frame, with the values of what it leaves out.

    Positions in revolutions; `position` nan keeps the demand, limits nan or below zero are none here.
    """

    position: float = 0.0
    velocity: float = 0.0
    feedforward: float = 0.0
    kp_scale: float = 1.0
    kd_scale: float = 1.0
    max_torque: float = NAN
    stop_position: float = NAN
    timeout: float = 0.0
    velocity_limit: float = NAN
    acceleration_limit: float = NAN
    fixed_voltage: float = NAN
    ilimit_scale: float = 1.0
    fixed_current: float = NAN
    ignore_bounds: float = 0.0

    @property
    def torque_only(self) -> bool:
        """No feedback at all: the feedforward is the torque."""
        return self.kp_scale == self.kd_scale == self.ilimit_scale == 0.0

    @property
    def limited(self) -> bool:
        return self.velocity_limit > 0.0 or self.acceleration_limit > 0.0


class Trajectory:
    """The demand [rev] and its velocity [rev/s]."""

    def __init__(self) -> None:
        self.position = 0.0
        self.velocity = 0.0
        self.complete = True
        self._target = NAN
        self._fresh = False
        self._command = PositionCommand()

    def hold(self, position: float, velocity: float = 0.0) -> None:
        """Begins anew where the axis is."""
        self.position, self.velocity, self._target = position, velocity, NAN
        self._command = PositionCommand(position=NAN)
        self.complete, self._fresh = True, False

    def take(self, command: PositionCommand) -> None:
        """A new command; without limits the demand is there at once."""
        self._command = command
        self._target = command.position
        self.complete = not command.limited
        if not command.limited:
            self.velocity = _finite(command.velocity)
            if not math.isnan(command.position):
                self.position, self._fresh = command.position, True

    def step(self, h: float) -> float:
        """The demand for the control period that begins now."""
        if self._fresh:
            self._fresh = False
            return self.position
        if self._command.limited:
            self._approach(h)
        self.position += self.velocity * h
        if (self.position - self._command.stop_position) * self.velocity > 0.0:
            self.position, self.velocity = self._command.stop_position, 0.0
        return self.position

    def _approach(self, h: float) -> None:
        """Bang-bang towards the target, or to the target velocity where there is no target."""
        limit = self._command.velocity_limit if self._command.velocity_limit > 0.0 else math.inf
        steepest = self._command.acceleration_limit if self._command.acceleration_limit > 0.0 else math.inf
        wanted = _finite(self._command.velocity)
        if not math.isnan(self._target):
            left = self._target - self.position
            brake = math.sqrt(2.0 * steepest * abs(left)) if steepest < math.inf else math.inf
            wanted = math.copysign(min(limit, brake, abs(left) / h), left)
            self.complete = (
                abs(left) < 1e-9 + abs(self.velocity) * h and abs(self.velocity) <= 2.0 * steepest * h
            )
        wanted = max(-limit, min(limit, wanted))
        change = max(-steepest * h, min(steepest * h, wanted - self.velocity))
        self.velocity += change


def _finite(value: float) -> float:
    return value if math.isfinite(value) else 0.0
