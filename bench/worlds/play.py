"""Plays a programme in a world and writes it down as this project's recording."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from autotune.recordings.recording import Controller, Metadata, Recording
from bench.worlds.disturbance import disturbance
from bench.worlds.loop import play as play_compiled
from bench.worlds.names import CASCADE, DRIVE_PID, MAINS, NEIGHBOUR
from bench.worlds.programme import Programme, programme
from bench.worlds.world import Floats, World


class RanAway(RuntimeError):
    """The loop of a world is not stable: such a world is drawn again."""


@dataclass(frozen=True, slots=True)
class Played:
    """What happened, shape (n,): reading, demand at the row, motor torque there and over the coming row, place, speed."""

    reading: Floats
    demand: Floats
    instant: Floats
    mean: Floats
    place: Floats
    speed: Floats


def run(world: World, what: Programme, seed: int, noisy: bool = True) -> Played:
    """Simulates; without noise there is no disturbance, no quantiser and no jitter.

    Raises:
        RanAway: the loop is not stable.
    """
    rng = np.random.default_rng([world.seed, seed, 77])
    plant = world.plant if noisy else replace(world.plant, resolution=0.0)
    n, loop = len(what.reference), world.loop
    ticks = np.full(n, loop.cycle, dtype=np.int64)
    if noisy and loop.jitter > 0.0:
        late = np.rint(loop.jitter * rng.standard_normal(n + 1)).astype(np.int64)
        ticks = np.maximum(ticks + np.diff(late), 1)
    seconds = (ticks.sum() + 2) * loop.tick
    outer = disturbance(world.around, seconds, rng) if noisy else np.zeros(int(seconds * 1000) + 4)
    outer = outer + _strange(world, what, len(outer), rng if noisy else np.random.default_rng(1))
    law, e, waves = world.laws()
    alien, odd = (world.alien.kind, np.asarray(world.alien.e)) if world.alien else (0, np.zeros(10))
    out = np.zeros((6, n + 1))
    rows = play_compiled(
        plant.packed(), loop.packed(), law, e, waves, alien, odd, what.reference, ticks, loop.tick, world.substeps,
        loop.cycle, outer, out,
    )  # fmt: skip
    if rows < n or float(np.abs(out[4, :n]).max()) > 3.0 * world.plant.travel + 100.0 * world.plant.reach:
        raise RanAway(f"the loop of world {world.seed} ran away after {rows} rows")
    return Played(out[0, :n], out[1, :n], out[2, :n], out[3, 1:], out[4, :n], out[5, :n])


def _strange(world: World, what: Programme, n: int, rng: np.random.Generator) -> Floats:
    """Torque of an alien that belongs to time: mains that runs through, or a neighbour that moves with each experiment."""
    alien = world.alien
    if alien is None or alien.kind not in (MAINS, NEIGHBOUR):
        return np.zeros(n)
    time = np.arange(n) / 1000.0
    if alien.kind == MAINS:
        return np.asarray(alien.e[0] * np.sin(2.0 * np.pi * alien.e[9] * time + rng.uniform(0, 6.28)))
    starts = np.flatnonzero(what.names[1:] != what.names[:-1]) * world.loop.period
    since = time - starts[np.clip(np.searchsorted(starts, time) - 1, 0, None)]
    return np.asarray(alien.e[0] * np.tanh(3.0 * np.sin(2.0 * np.pi * since / 2.7)))


def recording(world: World, what: Programme, seed: int = 0) -> Recording:
    """The recording that this world's owner would hand over."""
    played, around, loop = run(world, what, seed), world.around, world.loop
    rng = np.random.default_rng([world.seed, seed, 78])
    n = len(what.reference)
    scale = 1.0 + around.unit_error
    columns = {
        "time": np.arange(n) * loop.period,
        "reference": what.reference,
        "position": played.reading,
        "torque": scale * (played.instant if around.instant else played.mean)
        + around.sensor * rng.standard_normal(n),
    }
    if around.columns != "measured":
        columns["torque_command"] = scale * played.demand
    if around.columns == "command":
        columns["torque"] = columns["torque_command"].copy()
    if around.step > 0.0:
        for name in ("torque", "torque_command"):
            if name in columns:
                columns[name] = np.rint(columns[name] / around.step) * around.step
    metadata = Metadata(
        motion_unit=world.unit,
        sample_period=loop.period,
        position_resolution=world.plant.resolution,
        torque_limit=scale * world.plant.limit,
        controller=_stated(world, rng),
        axis="world",
    )
    return Recording.from_columns(columns, metadata, what.names, what.repeats)


def _stated(world: World, rng: np.random.Generator) -> Controller | None:
    """What the file says of the controller: nothing, the truth in its words, or something else."""
    loop = world.loop
    if loop.stated == "unknown":
        return None
    scale = 1.0 + world.around.unit_error
    share = loop.filter if loop.kind not in (CASCADE, DRIVE_PID) else 1.0 - np.exp(-loop.filter * loop.period)
    gains = np.array([loop.kp, loop.kd, loop.ki]) * scale
    if loop.kind == CASCADE:
        gains = np.array([loop.kd * loop.kp + loop.ki, loop.kd, loop.ki * loop.kp]) * scale
    if loop.stated == "wrong":
        gains = gains * np.exp(rng.uniform(-0.7, 0.7, 3))
    return Controller(float(gains[0]), float(gains[1]), float(gains[2]), float(share))


def whole(world: World, seed: int = 0) -> Recording:
    """The whole programme, recorded."""
    return recording(world, programme(world), seed)
