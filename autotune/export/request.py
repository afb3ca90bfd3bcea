"""What is asked of an export, what came of it, and what a target cannot do."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from autotune.control.model_feedforward import fed_forward, left_out
from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.models.drive_model import DriveModel
from autotune.models.effect import Effect

SHORTEST, LONGEST = 2e-5, 2e-2
"""Of a sample period [s]: the fastest current loops, the slowest PLC tasks."""
NAME = "autotune_ff"
"""Of functions and files; another for each axis where several are built into one program."""
FADE = 0.5
"""Seconds in which an exported feedforward comes and goes: slow for any position loop, short for a person."""


@dataclass(frozen=True, slots=True)
class Motion:
    """A sine on which the cost of what is left out is told: amplitude [rad or m], frequency [Hz]."""

    amplitude: float
    frequency: float

    def sampled(self, period: float) -> tuple[Floats, Floats, Floats]:
        """Position, velocity, acceleration over three periods of the sine; shape (n,) each."""
        samples = round(3.0 / (self.frequency * period))
        rate = 2.0 * math.pi * self.frequency
        angle = rate * period * np.arange(samples)
        q, v = self.amplitude * np.sin(angle), self.amplitude * rate * np.cos(angle)
        return q, v, -rate * rate * q


@dataclass(frozen=True, slots=True)
class Request:
    """One export.

    Attributes:
        model: the law to be played.
        source: the file or run that the model is from, for headers.
        period: sample period of the target [s].
        torque_limit: largest torque that is put out [N m or N]; None: the target's own limit acts.
        motion: for what costs are told on.
        rated_torque: what a drive's per mille are of [N m or N], where known (CiA 402 6076h).
        lead: travel of a linear axis per turn of its motor [mm], where there is one.
        speed: up to which tables over velocity reach [rad/s or m/s].
        travel: of a linear axis, for tables over position [m].
        name: of functions and files.
        warnings: sentences that belong into every file of it.

    Raises:
        ConfigurationError: a number that no controller has.
    """

    model: DriveModel
    source: str
    period: float
    torque_limit: float | None = None
    motion: Motion = Motion(1.0, 0.5)
    rated_torque: float | None = None
    lead: float | None = None
    speed: float | None = None
    travel: tuple[float, float] | None = None
    name: str = NAME
    warnings: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not re.fullmatch(r"[a-z][a-z0-9_]{0,30}", self.name):
            raise ConfigurationError(
                f"--name is {self.name!r}; it must be a small letter, then small letters, digits and _, at most 31"
            )
        if not SHORTEST <= self.period <= LONGEST:
            raise ConfigurationError(
                f"the cycle is {self.period:g} s; it must be between {SHORTEST:g} and {LONGEST:g} s"
            )
        if abs(self.period_ns * 1e-9 - self.period) > 1e-6 * self.period:
            raise ConfigurationError(f"the cycle {self.period!r} s is not a whole number of nanoseconds")
        for name in ("torque_limit", "rated_torque", "lead", "speed"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0.0):
                raise ConfigurationError(f"--{name.replace('_', '-')} is {value:g}; it must be above 0")

    @property
    def period_ns(self) -> int:
        """Sample period [ns]."""
        return round(self.period * 1e9)


@dataclass(frozen=True, slots=True)
class Lost:
    """An effect that the target does not play: why, and what it costs on a motion [N m or N rms].

    `cost` is None where it is not a torque of the reference's motion.
    """

    effect: str
    why: str
    cost: float | None


@dataclass(frozen=True, slots=True)
class Exported:
    """Files that were made, by name in the folder; what was left out; what a person should know."""

    files: Mapping[str, bytes]
    lost: tuple[Lost, ...] = ()
    notes: tuple[str, ...] = field(default=())

    def as_json(self, target: str, folder: Path, request: Request) -> dict[str, Any]:
        """The object of `autotune export --json`."""
        lost = [{"effect": one.effect, "why": one.why, "cost_rms": one.cost} for one in self.lost]
        return {
            "target": target,
            "files": [str(folder / name) for name in self.files],
            "cycle": request.period,
            "torque_limit": request.torque_limit,
            "left_out": lost,
            "notes": list(self.notes),
        }


def lost_everywhere(request: Request) -> tuple[Lost, ...]:
    """Effects of the model that no feedforward plays."""
    told = left_out(request.model)
    by_name = {effect.name: effect for effect in request.model.effects}
    return tuple(Lost(name, why, cost(request, by_name[name])) for name, why in told.items())


def cost(request: Request, effect: Effect) -> float | None:
    """Rms of the torque that an effect makes along the request's motion; None where it makes none."""
    q, v, a = request.motion.sampled(request.period)
    whole = request.model.torque(q, v, a, request.period)
    less = request.model.without_effect(effect.name).torque(q, v, a, request.period)
    third = len(q) // 3
    size = float(np.sqrt(np.mean((whole - less)[third:] ** 2)))
    return size if math.isfinite(size) and size > 0.0 else None


def lost_in_words(request: Request, lost: tuple[Lost, ...]) -> list[str]:
    """A sentence for each effect that is left out."""
    torque, unit = request.model.torque_symbol, request.model.motion_unit
    motion = f"a sine of {request.motion.amplitude:g} {unit} at {request.motion.frequency:g} Hz"
    told = []
    for one in lost:
        price = "" if one.cost is None else f"; it costs {one.cost:.2g} {torque} rms on {motion}"
        told.append(f"left out: {one.effect}, because {one.why}{price}")
    return told


def played(request: Request) -> list[str]:
    """Names of the effects that are played beside inertia and base friction."""
    return [effect.name for effect in fed_forward(request.model).effects]
