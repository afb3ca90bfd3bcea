"""Recordings as others make them: one trajectory, nothing twice; and a second file, taken when things had changed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from autotune.recordings.recording import Recording
from bench.worlds.names import NEIGHBOUR
from bench.worlds.play import recording
from bench.worlds.programme import Programme, Scale, scale_of
from bench.worlds.world import Alien, Floats, World

SECONDS = 40.0
CHANGES = ("nothing", "load", "neighbour", "temperature", "homing")
DISTURBED = ("load", "joint", "temperature", "all")
"""Of a second file that is always taken under other circumstances: another load, a joint that moves beside it and sends
a coloured torque through this one, warmer or colder friction; or all three."""
Rng = np.random.Generator


def _points(s: Scale, rng: Rng) -> Floats:
    """From place to place at many speeds, with short rests."""
    parts, place = [s.rest(0.0, 0.3)], 0.0
    while sum(map(len, parts)) * s.period < SECONDS:
        target, speed = rng.uniform(-0.95, 0.95) * s.half, float(np.exp(rng.uniform(math.log(0.1), 0.0)))
        parts += [s.move(place, target, speed, rng.uniform(0.2, 1.0)), s.rest(target, rng.uniform(0.02, 0.4))]
        place = target
    return np.concatenate(parts)


def _waves(s: Scale, rng: Rng) -> Floats:
    """A slow, a quick and two middle waves, never twice the same."""
    time = np.arange(round(SECONDS / s.period)) * s.period
    path = np.zeros(len(time))
    for low, high, speed in ((0.05, 0.15, 0.12), (0.2, 0.6, 0.15), (0.8, 2.0, 0.1), (3.0, 7.0, 0.04)):
        hertz = rng.uniform(low, high)
        omega = 2.0 * math.pi * hertz
        size = min(speed * s.top / omega, 0.2 * s.half, 0.15 * s.hard / omega**2)
        path += size * np.sin(omega * time + rng.uniform(0.0, 6.28))
    edge = np.clip(time / 1.0, 0.0, 1.0)
    return np.asarray((path - path[0]) * edge * edge * (3.0 - 2.0 * edge))


def _periodic(s: Scale, rng: Rng) -> Floats:
    """One period again and again."""
    hertz = rng.uniform(0.25, 0.6)
    omega = 2.0 * math.pi * hertz
    size = min(0.35 * s.top / omega, 0.5 * s.half, 0.3 * s.hard / omega**2)
    time = np.arange(round(SECONDS / s.period)) * s.period
    turn, phase = omega * time, rng.uniform(0.0, 6.28)
    path = np.sin(turn) + 0.3 * (np.sin(3.0 * turn + phase) - math.sin(phase))
    edge = np.clip(time / 1.0, 0.0, 1.0)
    return np.asarray(size * path * edge * edge * (3.0 - 2.0 * edge))


def _triangles(s: Scale, rng: Rng) -> Floats:
    """Constant speeds back and forth."""
    parts = [s.rest(0.0, 0.3)]
    while sum(map(len, parts)) * s.period < SECONDS:
        speed = float(np.exp(rng.uniform(math.log(0.03), math.log(0.8))))
        far = min(rng.uniform(0.3, 0.9) * s.half, 2.0 * speed * s.top)
        place = 0.0
        for target in (far, -far, 0.0):
            parts.append(s.move(place, target, speed, 0.5))
            place = target
    return np.concatenate(parts)


TRAJECTORIES: Mapping[str, Callable[[Scale, Rng], Floats]] = MappingProxyType(
    {"points": _points, "waves": _waves, "periodic": _periodic, "triangles": _triangles}
)


def alone(world: World, kind: str, rng: Rng, seed: int) -> Recording:
    """One trajectory, recorded once; sometimes without the reference."""
    path = TRAJECTORIES[kind](scale_of(world), rng)
    what = Programme(path, np.full(len(path), "move"), np.zeros(len(path), dtype=np.int64))
    taken = recording(world, what, seed)
    if rng.uniform() < 0.6:
        return taken
    kept = {name: values for name, values in taken.floats.items() if name != "reference"}
    return replace(taken, floats=MappingProxyType(kept)).with_metadata(controller=None)


def changed(world: World, change: str, rng: Rng) -> World:
    """The axis when the second file was taken."""
    plant = world.plant
    if change == "load":
        offset = plant.offset + rng.uniform(-0.3, 0.3) * plant.coulomb
        return replace(
            world, plant=replace(plant, inertia=plant.inertia * rng.uniform(0.8, 1.6), offset=offset)
        )
    if change == "temperature":
        warm = rng.uniform(0.75, 1.2)
        return replace(
            world, plant=replace(plant, coulomb=plant.coulomb * warm, viscous=plant.viscous * warm**2)
        )
    if change == "joint":
        slow = math.exp(-1e-3 / float(np.exp(rng.uniform(math.log(0.05), math.log(0.5)))))
        around = replace(world.around, colour="coloured", memory=slow)
        return replace(world, around=replace(around, level=rng.uniform(0.1, 0.4) * plant.coulomb))
    if change == "all":
        for one in DISTURBED[:-1]:
            world = changed(world, one, rng)
        return world
    if change == "neighbour":
        return replace(world, alien=Alien(NEIGHBOUR, (rng.uniform(0.1, 0.3) * plant.coulomb, *[0.0] * 9)))
    if change not in CHANGES:
        raise ValueError(f"there is no change '{change}': {', '.join((*CHANGES, *DISTURBED))}")
    return world


def second_file(world: World, change: str, kind: str, rng: Rng, seed: int) -> Recording:
    """Another trajectory after something has changed."""
    taken = alone(changed(world, change, rng), kind, rng, seed)
    if change != "homing":
        return taken
    shift = rng.uniform(-0.5, 0.5) * world.plant.travel
    moved = {name: taken[name] + shift for name in ("position", "reference") if name in taken}
    return replace(taken, floats=MappingProxyType({**taken.floats, **moved}))
