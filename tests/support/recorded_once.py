"""Recordings as others make them: one trajectory, no repeats, sampled, scaled and labelled in many ways."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.arrays import Floats
from autotune.recordings.recording import Recording
from autotune_sim.presets import Preset
from tests.support.diagnosis_programme import Programme, move, play

AMPERE = 0.12  # N m/A
LEAD = 5e-3 / (2 * math.pi)  # m/rad


def points(random: np.random.Generator, seconds: float, period: float) -> Floats:
    """Moves from place to place at many speeds, with short rests."""
    parts, place, rows = [np.zeros(1)], 0.0, round(seconds / period)
    while sum(map(len, parts)) < rows:
        target = random.uniform(-4.5, 4.5)
        speed, acceleration = 10 ** random.uniform(-0.5, 1.1), 10 ** random.uniform(1.2, 2.4)
        step = move(place, target, speed, acceleration)
        if period != 1e-3:
            step = np.interp(np.arange(0, len(step) * 1e-3, period), np.arange(len(step)) * 1e-3, step)
        parts += [step, np.full(round(random.uniform(0.02, 0.4) / period), target)]
        place = target
    return np.concatenate(parts)[:rows]


def waves(random: np.random.Generator, seconds: float, period: float) -> Floats:
    """A slow and a quick wave and some between, never twice the same."""
    t = np.arange(round(seconds / period)) * period
    q = np.zeros(len(t))
    for low, high, speed in ((0.05, 0.15, 2.0), (0.2, 0.6, 2.5), (0.8, 2.0, 1.5), (3.0, 7.0, 0.8)):
        f = random.uniform(low, high)
        q += speed / (2 * np.pi * f) * np.sin(2 * np.pi * f * t + random.uniform(0, 6.28))
    return np.asarray((q - q[0]) * np.minimum(1.0, t / 0.5))


def sweep(random: np.random.Generator, seconds: float, period: float) -> Floats:
    """A sine that grows quicker and smaller."""
    t = np.arange(round(seconds / period)) * period
    low, high = random.uniform(0.1, 0.3), random.uniform(3.0, 8.0)
    rate = math.log(high / low) / seconds
    f = low * np.exp(rate * t)
    phase = 2 * np.pi * (f - low) / rate
    speed = random.uniform(2.0, 6.0)
    return np.asarray(speed / (2 * np.pi * f) * np.sin(phase))


def periodic(random: np.random.Generator, seconds: float, period: float) -> Floats:
    """One period again and again: two harmonics."""
    t = np.arange(round(seconds / period)) * period
    f = random.uniform(0.25, 0.6)
    a = random.uniform(2.0, 6.0) / (2 * np.pi * f)
    p = random.uniform(0.0, 6.28)
    return np.asarray(a * (np.sin(2 * np.pi * f * t) + 0.35 * (np.sin(6 * np.pi * f * t + p) - np.sin(p))))


def triangles(random: np.random.Generator, seconds: float, period: float) -> Floats:
    """Constant speeds back and forth, each twice, with rounded corners."""
    parts, rows = [np.zeros(1)], round(seconds / period)
    while sum(map(len, parts)) < rows:
        speed, reach = 10 ** random.uniform(-0.7, 1.0), random.uniform(0.5, 4.0)
        for target in (reach, -reach, 0.0):
            step = move(parts[-1][-1], target, speed, 80.0)
            parts.append(np.interp(np.arange(0, len(step) * 1e-3, period), np.arange(len(step)) * 1e-3, step))
    return np.concatenate(parts)[:rows]


TRAJECTORIES: Mapping[str, Callable[[np.random.Generator, float, float], Floats]] = {
    "points": points, "waves": waves, "sweep": sweep, "periodic": periodic, "triangles": triangles,
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Dress:
    """How a recording looks: every `every`-th sample, what is known, in which units."""

    name: str
    every: int = 1
    period: float = 1e-3
    counts: int = 50_000
    reference: bool = True
    controller: bool = True
    metres: bool = False
    amperes: bool = False
    command: bool = True


DRESSES = (
    Dress("plain"),
    Dress("no controller", controller=False),
    Dress("no reference", controller=False, reference=False),
    Dress("500 Hz", every=2, controller=False),
    Dress("250 Hz", every=4, controller=False, reference=False),
    Dress("100 Hz", every=10, controller=False, reference=False),
    Dress("loop of 2 ms", period=2e-3),
    Dress("metres", controller=False, metres=True),
    Dress("amperes", controller=False, reference=False, amperes=True),
    Dress("coarse", counts=4000, controller=False),
    Dress("measured torque", controller=False, reference=False, command=False),
)


def dressed(recording: Recording, dress: Dress) -> Recording:
    """The recording as its maker would hand it over."""
    motion = LEAD if dress.metres else 1.0
    torque = (1.0 / LEAD if dress.metres else 1.0) * (1.0 / AMPERE if dress.amperes else 1.0)
    held = recording["torque_command"] if dress.command else recording["torque"]
    columns = {
        "time": recording["time"],
        "position": motion * recording["position"],
        "torque": torque * held,
    }
    if dress.reference:
        columns["reference"] = motion * recording["reference"]
    columns = {name: values[:: dress.every] for name, values in columns.items()}
    old = recording.metadata
    limit = None if old.torque_limit is None else torque * old.torque_limit
    metadata = replace(
        old,
        sample_period=old.sample_period * dress.every,
        motion_unit="m" if dress.metres else "rad",
        position_resolution=None,
        torque_limit=limit if dress.controller else None,
        controller=old.controller if dress.controller else None,
        extra={"torque_unit": "A"} if dress.amperes else {},
    )
    return Recording.from_columns(columns, metadata, "move")


def played(axis: Preset, dress: Dress, kind: str, seed: int, seconds: float) -> Recording:
    axis = replace(axis, period=dress.period, plant=replace(axis.plant, counts=dress.counts))
    path = TRAJECTORIES[kind](np.random.default_rng([seed, 3]), seconds, dress.period)
    what = Programme(path, ["move"] * len(path), [0] * len(path))
    return dressed(play(axis, seed, what), dress)
