"""Between the raw values of a cycle and SI: the factors of a profile, worked out once."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from autotune.core.drive import Command, Mode, Sample, Standing
from autotune_drivers.canopen.objects import ObjectRef, Raw
from autotune_drivers.profile import Profile
from autotune_drivers.units import Units


class Told(NamedTuple):
    """What a drive tells in a cycle, raw: `values` as in `Exchange.values`, and the slow signal."""

    values: tuple[Raw, ...]
    slow: Raw | None


class Scaling:
    """Commands into raw values and what the drive tells into SI.

    `demand_has_feedforward`: whether the torque demand that the drive tells includes the host's feedforward.
    """

    def __init__(self, profile: Profile, units: Units) -> None:
        signals, commands = profile.signals, profile.commands
        self._to_position = units.signed(signals.position.unit)
        self._to_velocity = units.signed(signals.velocity.unit)
        self._to_torque = units.signed(signals.torque.unit)
        self._to_demand = units.signed(signals.torque_demand.unit)
        feedback = signals.torque_feedback
        self._to_feedback = units.signed(feedback.unit) if feedback else None
        self._to_temperature = units.factor(signals.temperature.unit) if signals.temperature else 0.0
        self._command_position = units.signed(commands.position.unit)
        self._command_velocity = units.signed(commands.velocity.unit)
        self._command_torque = units.signed(commands.torque.unit)
        self._command_feedforward = units.signed(commands.torque_feedforward.unit)
        self._raw_position = _rounder(commands.position.ref)
        self._raw_velocity = _rounder(commands.velocity.ref)
        self._raw_torque = _rounder(commands.torque.ref)
        self._raw_feedforward = _rounder(commands.torque_feedforward.ref)
        self.demand_has_feedforward = profile.torque.demand_includes_feedforward

    def target(self, mode: Mode, command: Command, held: Raw) -> Raw:
        """The target of a mode; `held` where the command names no position. Raises ValueError, OverflowError."""
        if mode is Mode.POSITION:
            if math.isnan(command.position):
                return held
            return self._raw_position(command.position / self._command_position)
        if mode is Mode.VELOCITY:
            return self._raw_velocity(command.velocity / self._command_velocity)
        return self._raw_torque(command.torque / self._command_torque)

    def feedforward(self, command: Command) -> Raw:
        """The torque beside the drive's own. Raises ValueError, OverflowError."""
        return self._raw_feedforward(command.torque_feedforward / self._command_feedforward)

    def standing(self, position: Raw, velocity: Raw) -> Standing:
        return Standing(position * self._to_position, velocity * self._to_velocity)

    def temperature(self, slow: Raw | None) -> float:
        """Of the drive [°C]; nan where it told none."""
        return float("nan") if slow is None else slow * self._to_temperature

    def sample(
        self, mode: Mode, time: float, target: Raw, feedforward: Raw, told: Told, missed: int
    ) -> Sample:
        """A cycle in SI: what was sent, raw, and what was told."""
        values = told.values
        position = values[1] * self._to_position
        demand = values[2] * self._to_demand
        host = feedforward * self._command_feedforward
        if self._to_feedback is not None:
            feedback = values[5] * self._to_feedback
            host = demand - feedback
        elif self.demand_has_feedforward:
            feedback = demand - host
        else:
            feedback, demand = demand, demand + host
        return Sample(
            time,
            target * self._command_position if mode is Mode.POSITION else position,
            position,
            values[4] * self._to_velocity,
            demand,
            values[3] * self._to_torque,
            host,
            feedback,
            self.temperature(told.slow),
            missed,
        )


def _rounder(ref: ObjectRef) -> Callable[[float], Raw]:
    """How a number becomes a raw value of this object: whole, or finite as it is."""
    return _finite if ref.is_float else round


def _finite(value: float) -> Raw:
    if not math.isfinite(value):
        raise ValueError(f"{value} is no number")
    return value
