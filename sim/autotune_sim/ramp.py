"""Controlled stop: a position demand that brakes at a constant deceleration, then rests."""

from __future__ import annotations

import math

SETTLE = 0.02  # s at rest before power may go
SLOWEST = 2.0  # s after which power goes anyway


class Ramp:
    """Position demands of a stop from `position` [rad] at `velocity` [rad/s].

    Attributes:
        position: the present demand [rad].
        elapsed: time of the stop until now [s].
        done: the demand has come to rest and has stayed there for `SETTLE`, or time is up.
    """

    def __init__(self, position: float, velocity: float, deceleration: float) -> None:
        self.position = position
        self._velocity = velocity
        self._deceleration = deceleration
        self.elapsed = 0.0
        self._resting = 0.0

    @property
    def done(self) -> bool:
        return self._resting >= SETTLE or self.elapsed >= SLOWEST

    def step(self, h: float) -> float:
        """The demand one period of h seconds later [rad]."""
        self.elapsed += h
        speed = abs(self._velocity)
        if speed == 0.0:
            self._resting += h
            return self.position
        slower = max(speed - self._deceleration * h, 0.0)
        self.position += math.copysign(0.5 * (speed + slower) * h, self._velocity)
        self._velocity = math.copysign(slower, self._velocity)
        return self.position
