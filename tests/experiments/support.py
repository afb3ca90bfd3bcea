"""Drives to play experiments on without any physics worth the name, and with faults on demand."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from autotune.core.axis import Axis, Limits, read_axis
from autotune.core.drive import Command, Mode, Sample, Standing
from autotune.core.errors import LinkError

CONFIG = Path(__file__).resolve().parents[2] / "config" / "axes" / "edm-vertical.toml"


def axis(**limits: float) -> Axis:
    """The axis of the thesis with some limits replaced."""
    whole = read_axis(CONFIG)
    return whole.model_copy(update={"limits": Limits(**(whole.limits.model_dump() | limits))})


def sample(**values: float) -> Sample:
    """A sample at rest at zero with some values replaced."""
    rest = Sample(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.nan, 0)
    return rest._replace(**values)  # type: ignore[arg-type]


class FollowingDrive:
    """Follows its reference exactly; in torque mode it is a spring that slides above `friction`."""

    def __init__(
        self,
        period: float = 1e-3,
        position: float = 0.0,
        friction: float = 0.33,
        stiffness: float = 100.0,
        offset: float = 0.048,
    ) -> None:
        self.period = period
        self.identity: Mapping[str, int | str] = {"vendor": "test"}
        self.position = position
        self.friction, self.stiffness, self.offset = friction, stiffness, offset
        self.turning = 0.0  # rad/s, without power
        self.powered = False
        self.mode: Mode | None = None
        self.calls: list[str] = []
        self.commands: list[Command] = []
        self.cycles = 0
        self.faulty_at: dict[int, Exception] = {}
        self.bent: dict[int, dict[str, float]] = {}
        self.disable_fails = False
        self.parameters: dict[str, float] = {}
        self.refuse_writes: set[str] = set()
        self._anchor = position
        self._before = position

    def look(self) -> Standing:
        return Standing(self.position, self.turning)

    def enable(self, mode: Mode) -> None:
        self.calls.append(f"enable {mode.value}")
        self.powered, self.mode = True, mode
        self._anchor = self._before = self.position

    def step(self, command: Command) -> Sample:
        if not self.powered:
            raise LinkError("stepped without power")
        self.cycles += 1
        self.commands.append(command)
        if self.cycles in self.faulty_at:
            raise self.faulty_at[self.cycles]
        torque = command.torque_feedforward
        if self.mode is Mode.TORQUE:
            torque += command.torque
            self._spring(torque - self.offset)
        elif not math.isnan(command.position):
            self.position = command.position
            velocity = self.position - self._before
            torque = self.offset + math.copysign(self.friction, velocity) * (abs(velocity) > 1e-9)
        velocity, self._before = (self.position - self._before) / self.period, self.position
        answer = Sample(
            self.cycles * self.period, self.position, self.position, velocity, torque, torque,
            command.torque_feedforward, torque - command.torque_feedforward, 30.0, 0,
        )  # fmt: skip
        return answer._replace(**self.bent.get(self.cycles, {}))  # type: ignore[arg-type]

    def _spring(self, torque: float) -> None:
        if abs(torque) > self.friction:
            self._anchor += math.copysign(2e-4, torque)
        self.position = self._anchor + torque / self.stiffness

    def disable(self) -> None:
        self.calls.append("disable")
        if self.disable_fails:
            raise LinkError("nobody answers")
        self.powered = False

    def read_parameters(self, names: Sequence[str] | None = None) -> dict[str, float]:
        return {name: self.parameters[name] for name in (names or self.parameters)}

    def write_parameters(self, values: Mapping[str, float]) -> None:
        self.calls.append(f"write {', '.join(values)}")
        for name, value in values.items():
            if name in self.refuse_writes:
                raise LinkError(f"{name} is refused")
            self.parameters[name] = value

    def store(self) -> None:
        self.calls.append("store")

    def faults(self) -> list[str]:
        return []

    def close(self) -> None:
        self.disable()
