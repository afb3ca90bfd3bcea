"""An axis as its owner describes it: link, mechanics, limits, benchmark. One TOML file an axis.

Everything is SI and on the motor side. The limits are what a person answers for: there is no default
for any of them, and no experiment ever widens one.
"""

from __future__ import annotations

import hashlib
import json
import math
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from autotune.core.configuration import Strict, read_toml, validate

Positive = Annotated[float, Field(gt=0)]


class Mechanics(Strict):
    """What turns counts into motion.

    `counts_per_revolution` is used for rotary axes, `counts_per_metre` for linear ones; `direction`
    is −1 where the drive counts against the axis's positive sense.
    """

    counts_per_revolution: Positive | None = None
    counts_per_metre: Positive | None = None
    direction: Literal[1, -1] = 1


class Limits(Strict):
    """What the guard and the drive hold the axis to.

    Position in the motion unit, from the drive's zero; `deceleration` is what the axis can brake
    with at any time (the guard predicts stopping distances with it).
    """

    position_min: float
    position_max: float
    speed: Positive
    torque: Positive
    following_error: Positive
    deceleration: Positive
    temperature: Annotated[float, Field(gt=0, le=200)]
    machine_seconds: Annotated[float, Field(gt=0, le=3600)]

    @model_validator(mode="after")
    def _ordered(self) -> Limits:
        if self.position_min >= self.position_max:
            raise ValueError(
                f"position_min {self.position_min} must be below position_max {self.position_max}"
            )
        return self


class Reference(Strict):
    """How references are smoothed before the drive gets them: H(z) = (1 − α)z/(z − α) (6.14)."""

    filter: Annotated[float, Field(ge=0, lt=1)] = 0.0


class Benchmark(Strict):
    """The sine on which improvement is proved (section 6.3.6: 0.2 rad, 1 Hz)."""

    amplitude: Positive
    frequency: Annotated[float, Field(gt=0, le=20)]
    repeats: Annotated[int, Field(ge=5, le=50)] = 6
    periods: Annotated[int, Field(ge=2, le=50)] = 3


class Acceptance(Strict):
    """What "better" must mean before anything is kept."""

    improvement: Annotated[float, Field(ge=0, lt=1)] = 0.1
    confidence: Annotated[float, Field(ge=0.9, lt=1)] = 0.99


class Simulation(Strict):
    """Which simulated axis `autotune sim` puts behind the link: a preset, or the file of a composed machine."""

    preset: str = "edm-vertical"


class Axis(Strict):
    """One axis. `link` says where it is, `profile` what kind of drive it is."""

    schema_version: Annotated[Literal[1], Field(alias="schema")] = 1
    name: Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9-]{0,40}$")]
    link: str
    profile: str
    motion_unit: Literal["rad", "m"] = "rad"
    cycle: Annotated[float, Field(ge=2.5e-4, le=1e-2)] = 1e-3
    mechanics: Mechanics
    limits: Limits
    reference: Reference = Reference()
    benchmark: Benchmark
    acceptance: Acceptance = Acceptance()
    simulation: Simulation = Simulation()

    @model_validator(mode="after")
    def _scaled(self) -> Axis:
        need = "counts_per_revolution" if self.motion_unit == "rad" else "counts_per_metre"
        if getattr(self.mechanics, need) is None:
            raise ValueError(f"mechanics.{need} must be set where motion_unit is {self.motion_unit!r}")
        return self

    @property
    def position_resolution(self) -> float:
        """One count of the position sensor [rad or m]."""
        if self.motion_unit == "rad":
            return 2.0 * math.pi / float(self.mechanics.counts_per_revolution or 1.0)
        return 1.0 / float(self.mechanics.counts_per_metre or 1.0)

    @property
    def fingerprint(self) -> str:
        """Short hash of what gives the numbers their meaning: name, unit, profile, mechanics."""
        meaning = [self.name, self.motion_unit, self.profile, self.mechanics.model_dump()]
        return hashlib.sha256(json.dumps(meaning, sort_keys=True).encode()).hexdigest()[:12]


def read_axis(path: str | Path) -> Axis:
    """Reads an axis file.

    Raises:
        ConfigurationError: no such file, not TOML, an unknown key or a value out of range.
    """
    return validate(Axis, read_toml(path, "axis file"), f"axis file {path}")
