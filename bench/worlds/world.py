"""A world: one axis with its drive, sensors and surroundings, as plain numbers. SI, motor side."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from bench.worlds import names

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Plant:
    """Mechanics and friction of the base.

    Attributes:
        reach: way of the exponential bristle; `other`: share of another family (see `hysteresis`).
        offset: constant load (gravity, amplifier).
        current_tau: of the current loop [s].
        fade_law, fade_speed: of the damping in presliding (see `laws.faded`); 0: the same at all speeds.
        low_law, low_size, low_speed, low_exponent: of friction that falls with speed in the base (see `laws.falling`).
    """

    inertia: float
    viscous: float
    coulomb: float
    reach: float
    micro: float
    offset: float
    family: int
    other: float
    spread: float
    power: float
    limit: float
    resolution: float
    current_tau: float
    travel: float
    top_speed: float
    load_inertia: float = 0.5
    load_friction: float = 0.0
    fade_law: int = 0
    fade_speed: float = 1.0
    low_law: int = 0
    low_size: float = 0.0
    low_speed: float = 1.0
    low_exponent: float = 1.0

    def packed(self) -> Floats:
        p = np.zeros(names.PLANT_SIZE)
        p[:] = [
            self.inertia, self.viscous, self.coulomb, self.reach, self.micro, self.offset, self.family, self.other,
            self.spread, self.power, self.limit, self.resolution, self.current_tau, self.travel, self.top_speed,
            self.load_inertia, self.load_friction, self.fade_law, self.fade_speed, self.low_law, self.low_size,
            self.low_speed, self.low_exponent,
        ]  # fmt: skip
        return p


@dataclass(frozen=True, slots=True)
class Loop:
    """The controller and its clock.

    Attributes:
        kind: index into `names.LOOPS`; tick: period of the drive's loop [s]; cycle: ticks for each row.
        filter: of the host's PID a share for each row, else a rate [1/s].
        dead: rows by which what the controller sees is old.
        jitter: spread of the moment at which a row is written [ticks].
        stated: what the recording says of the controller: `right`, `unknown` or `wrong`.
    """

    kind: int
    tick: float
    cycle: int
    kp: float
    kd: float
    ki: float
    filter: float
    speed_feed: float
    accel_feed: float
    dead: int
    subsample: int
    cubic: bool
    jitter: float
    stated: str
    bandwidth: float

    @property
    def period(self) -> float:
        return self.tick * self.cycle

    def packed(self) -> Floats:
        return np.array([
            self.kind, self.kp, self.kd, self.ki, self.filter, self.speed_feed, self.accel_feed, self.dead,
            self.subsample, float(self.cubic),
        ])  # fmt: skip


@dataclass(frozen=True, slots=True)
class Surroundings:
    """What differs from repeat to repeat, and what the sensors do to the torque.

    Attributes:
        colour: `white`, `coloured`, `mains`, `intermittent` or `wandering`; memory: AR(1) a millisecond.
        level: rms of the process's torque; sensor: of the torque sensor's noise; step: of the torque's quantiser.
        unit_error: relative; columns: `both`, `measured` or `command`; instant: torque as at the row's moment.
    """

    colour: str
    memory: float
    level: float
    sensor: float
    step: float
    unit_error: float
    columns: str
    instant: bool
    mains: float = 50.0


@dataclass(frozen=True, slots=True)
class Planted:
    """An effect by one of its laws; `e`: its parameters, the first the size; `waves` only of a ripple, (WAVES, 3)."""

    effect: int
    law: int
    e: tuple[float, ...]
    waves: tuple[tuple[float, float, float], ...] = ()

    @property
    def name(self) -> str:
        return names.EFFECTS[self.effect]


@dataclass(frozen=True, slots=True)
class Alien:
    """Something the library does not know: index into `names.ALIENS` plus 1, and parameters (see `plant.stranger`)."""

    kind: int
    e: tuple[float, ...]

    @property
    def name(self) -> str:
        return names.ALIENS[self.kind - 1]


@dataclass(frozen=True, slots=True)
class World:
    """Everything. `unit`: rad or m; `hard`: the hardest acceleration of the programme."""

    seed: int
    unit: str
    plant: Plant
    loop: Loop
    around: Surroundings
    hard: float
    planted: tuple[Planted, ...] = ()
    alien: Alien | None = None
    notes: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    @property
    def substeps(self) -> int:
        """So that a step is 12 to 20 µs."""
        return max(round(self.loop.tick / 15.6e-6), 1)

    def laws(self) -> tuple[NDArray[np.int64], Floats, Floats]:
        """Law and parameters by effect, and the ripple's waves."""
        law = np.zeros(len(names.EFFECTS), dtype=np.int64)
        e = np.zeros((len(names.EFFECTS), names.EFFECT_PARAMETERS))
        waves = np.zeros((names.WAVES, 3))
        for one in self.planted:
            law[one.effect] = one.law
            e[one.effect, : len(one.e)] = one.e
            for i, wave in enumerate(one.waves):
                waves[i] = wave
        return law, e, waves
