"""An axis with a drive whose encoder can be hurt from inside: the controller is deceived as the guard is.

Independent of simulator and models: one mass on a LuGre bristle with gravity and viscous friction, a PID
controller, an encoder of whole counts. `truth` logs what the mass really did while it had power.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from autotune.core.axis import Axis
from autotune.core.drive import Command, Mode, Sample, Standing

SUBSTEPS = 10
Encoder = Callable[[float, float], float]
"""What an encoder tells of a position at a time."""


def sound(position: float, time: float) -> float:
    return position


@dataclass(frozen=True)
class Hurt:
    """What happens to an encoder from `at` on [s].

    Attributes:
        kind: frozen, dithering (±1 count), reversed, scaled or jumped.
        size: factor of `scaled` and distance of `jumped`; amplitude of `dithering`.
    """

    kind: str
    at: float
    size: float = 0.0

    def __call__(self) -> Encoder:
        seen: list[float] = []

        def read(position: float, time: float) -> float:
            if time < self.at:
                return position
            if not seen:
                seen.append(position)
            moved = {"frozen": 0.0, "dithering": 0.0, "reversed": -1.0, "scaled": self.size, "jumped": 1.0}
            told = seen[0] + moved[self.kind] * (position - seen[0])
            if self.kind == "dithering":
                told += self.size * (round(time * 1e3) % 2)
            return told + (self.size if self.kind == "jumped" else 0.0)

        return read


@dataclass
class Mass:
    """Mechanics [kg m², N m, rad/s]; friction breaks loose at `sticks` times `friction`."""

    inertia: float = 6.66e-4
    friction: float = 0.33
    sticks: float = 1.1
    viscous: float = 4e-3
    gravity: float = 0.05
    bends: float = 3.3e-3
    vs: float = 0.1
    load: Callable[[float], float] = lambda time: 0.0

    def __post_init__(self) -> None:
        self.position = self.velocity = self._bristle = 0.0

    def advance(self, torque: float, time: float, seconds: float) -> None:
        h = seconds / SUBSTEPS
        stiffness = self.friction / self.bends if self.friction else 0.0
        damping = 0.3 * math.sqrt(stiffness * self.inertia)
        outside = torque - self.gravity - self.load(time)
        for _ in range(SUBSTEPS):
            v = self.velocity
            level = self.friction * (1.0 + (self.sticks - 1.0) * math.exp(-((v / self.vs) ** 2)))
            rate = 0.0
            if stiffness:
                rate = v - abs(v) * stiffness * self._bristle / level
                limit = level / stiffness
                self._bristle = min(max(self._bristle + rate * h, -limit), limit)
            held = stiffness * self._bristle + damping * rate + self.viscous * v
            self.velocity = (v * self.inertia + (outside - held) * h) / self.inertia
            self.position += self.velocity * h


@dataclass
class HurtDrive:
    """`autotune.core.drive.Drive` over a mass; units and cycle of `axis`."""

    axis: Axis
    mass: Mass = field(default_factory=Mass)
    hurt: Hurt | None = None
    gains: tuple[float, float, float] = (60.0, 0.15, 6000.0)
    velocity_factor: float = 1.0
    identity: Mapping[str, int | str] = field(default_factory=lambda: {"vendor": "test"})

    def __post_init__(self) -> None:
        self.period = self.axis.cycle
        self.resolution = self.axis.position_resolution
        self.encoder = self.hurt() if self.hurt else sound
        self.powered, self.mode, self.time = False, Mode.POSITION, 0.0
        self.truth: list[tuple[float, float, float]] = []
        self._demand = self._seen = self._rate = self._sum = 0.0

    def read(self) -> float:
        told = self.encoder(self.mass.position, self.time)
        return round(told / self.resolution) * self.resolution

    def look(self) -> Standing:
        return Standing(self.read(), 0.0)

    def enable(self, mode: Mode) -> None:
        self.powered, self.mode = True, mode
        self._demand = self._seen = self.read()
        self._rate = self._sum = 0.0

    def step(self, command: Command) -> Sample:
        h, seen = self.period, self.read()
        self._rate += 0.2 * ((seen - self._seen) / h - self._rate)
        demand = seen
        if self.mode is Mode.POSITION:
            demand = self._demand if math.isnan(command.position) else command.position
        torque = self._torque(command, demand, seen)
        self._demand, self._seen = demand, seen
        told = Sample(
            self.time, demand, seen, self._rate * self.velocity_factor, torque, torque,
            command.torque_feedforward, torque - command.torque_feedforward, 30.0, 0,
        )  # fmt: skip
        self.truth.append((self.mass.position, self.mass.velocity, torque))
        self.mass.advance(torque, self.time, h)
        self.time += h
        return told

    def _torque(self, command: Command, demand: float, seen: float) -> float:
        limit, h = self.axis.limits.torque, self.period
        kp, kd, ki = self.gains
        if self.mode is Mode.TORQUE:
            return min(max(command.torque + command.torque_feedforward, -limit), limit)
        error, rate = demand - seen, ((demand - self._demand) - (seen - self._seen)) / h
        if self.mode is Mode.VELOCITY:
            error, rate = 0.0, command.velocity - (seen - self._seen) / h
            self._sum += rate * h
            wanted = kd * rate + kp * self._sum
        else:
            wanted = kp * error + kd * rate + ki * (self._sum + error * h)
        wanted += command.torque_feedforward
        if abs(wanted) > limit:
            return math.copysign(limit, wanted)
        self._sum += error * h if self.mode is Mode.POSITION else 0.0
        return wanted

    def disable(self) -> None:
        """Power off: the brake holds."""
        self.powered = False
        self.mass.velocity = 0.0

    def read_parameters(self, names: Sequence[str] | None = None) -> dict[str, float]:
        return {}

    def write_parameters(self, values: Mapping[str, float]) -> None:
        return

    def store(self) -> None:
        return

    def faults(self) -> list[str]:
        return []

    def close(self) -> None:
        self.disable()

    @property
    def fastest(self) -> float:
        """Peak of the true speed under power."""
        return max((abs(v) for _, v, _ in self.truth), default=0.0)

    @property
    def farthest(self) -> float:
        """Largest true distance from zero under power."""
        return max((abs(q) for q, _, _ in self.truth), default=0.0)
