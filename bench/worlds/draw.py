"""Worlds drawn from a seed: travel from 2 mrad to 200 turns, two decades of inertia, friction and stiffness."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from bench.worlds import names
from bench.worlds.names import CASCADE, HOST_PID
from bench.worlds.world import Loop, Plant, Surroundings, World

TICKS = (125e-6, 100e-6, 62.5e-6)
CYCLES = {0.25e-3: 0.05, 0.5e-3: 0.1, 1e-3: 0.6, 2e-3: 0.17, 4e-3: 0.08}
TURN = 2.0 * math.pi


def spread(rng: np.random.Generator, low: float, high: float) -> float:
    """Uniform in the logarithm."""
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def draw_world(seed: int, cycle: float | None = None) -> World:
    """The base of a world, with nothing planted; the same for the same seed."""
    rng = np.random.default_rng([seed, 1401])
    unit = "rad" if rng.uniform() < 0.72 else "m"
    half, top = _motion(rng, unit)
    ramp = min(spread(rng, 0.03, 0.2), 0.4 * half / top)
    hard = top / ramp
    coulomb = spread(rng, 0.02, 5.0) if unit == "rad" else spread(rng, 1.0, 200.0)
    inertia = spread(rng, 0.7, 7.0) * coulomb / hard
    period = cycle or float(rng.choice(list(CYCLES), p=list(CYCLES.values())))
    resolution = _resolution(rng, unit, half, top)
    loop, current = _loop(rng, period, inertia, coulomb, resolution)
    reach = _reach(rng, loop, inertia, coulomb, top, half, resolution)
    viscous = spread(rng, 0.05, 1.0) * coulomb / top
    offset = float(rng.choice([0.0, rng.uniform(-0.1, 0.1), rng.uniform(-0.8, 0.8)])) * coulomb
    limit = spread(rng, 1.5, 2.5) * (inertia * hard + 1.3 * coulomb + viscous * top + abs(offset))
    micro = rng.uniform(0.05, 0.6) * 2.0 * math.sqrt(inertia * coulomb / reach)
    plant = Plant(
        inertia, viscous, coulomb, reach, float(micro), offset, int(rng.integers(3)), 1.0, rng.uniform(0.2, 1.2),
        rng.uniform(0.6, 1.6), limit, resolution, current, half, top,
    )  # fmt: skip
    return World(seed, unit, plant, loop, _surroundings(rng, coulomb, limit), hard)


def with_base(world: World, base: str) -> World:
    """The world with another base (`names.BASES`), drawn from a stream of its own; the same where `base` is empty.

    Where damping fades and where friction falls is of the order of a Stribeck velocity, as textbooks have it; damping
    that fades is near the critical one at rest.
    """
    if not base:
        return world
    rng, plant = np.random.default_rng([world.seed, names.BASES.index(base), 1405]), world.plant
    law, speed = int(rng.integers(2)) + 1, spread(rng, 0.004, 0.05) * plant.top_speed
    if base == "fading":
        micro = rng.uniform(0.3, 1.0) * 2.0 * math.sqrt(plant.inertia * plant.coulomb / plant.reach)
        return replace(world, plant=replace(plant, micro=float(micro), fade_law=law, fade_speed=speed))
    size = spread(rng, 0.08, 0.5) * plant.coulomb
    return replace(world, plant=replace(plant, low_law=law, low_size=size, low_speed=speed, low_exponent=1.0))


def _motion(rng: np.random.Generator, unit: str) -> tuple[float, float]:
    """Half of the travel and the top speed."""
    usual = rng.uniform() < 0.7
    if unit == "rad":
        half = 0.5 * (spread(rng, 1.5, 120.0) if usual else spread(rng, 2e-3, 200.0 * TURN))
        return half, min(half / spread(rng, 0.25, 0.8), spread(rng, 150.0, 500.0))
    half = 0.5 * (spread(rng, 0.05, 1.5) if usual else spread(rng, 2e-3, 3.0))
    return half, min(half / spread(rng, 0.25, 0.8), spread(rng, 1.0, 4.0))


def _resolution(rng: np.random.Generator, unit: str, half: float, top: float) -> float:
    """2 000 to 8 million counts a turn, 1 nm to 10 µm; a coarse encoder never on an axis that hardly moves."""
    low, high = (TURN / 8e6, TURN / 2e3) if unit == "rad" else (1e-9, 1e-5)
    return spread(rng, max(low, 2e-7 * half), max(min(high, 1e-3 * half), 1.1 * low))


def _loop(
    rng: np.random.Generator, period: float, inertia: float, coulomb: float, resolution: float
) -> tuple[Loop, float]:
    """A loop that is stable with its delays and does not shake at the encoder's counts."""
    fits = [tick for tick in TICKS if abs(period / tick - round(period / tick)) < 1e-9]
    tick = float(rng.choice(fits))
    current = 1.0 / (TURN * spread(rng, 900.0, 3000.0))
    kind = int(rng.choice(3, p=[0.5, 0.3, 0.2]))
    dead = int(rng.choice(4, p=[0.45, 0.3, 0.15, 0.1]))
    if kind == HOST_PID and period > 1.5e-3:
        dead = min(dead, 1)
    wait = period * (0.7 + dead) if kind == HOST_PID else 4.0 * tick + current
    quiet = math.sqrt(0.02 * coulomb / (inertia * resolution))
    rate = min(0.2 / wait, quiet, TURN * 40.0) * rng.uniform(0.6, 1.0)
    subsample = int(rng.choice([1, 2, 4]))
    smooth = min(5.0 * rate, 0.7 / period) if kind == HOST_PID else 10.0 * rate
    share = 1.0 - math.exp(-smooth * period) if kind == HOST_PID else smooth
    if kind == CASCADE:
        kp, kd, ki = rate, 2.5 * rate * inertia, 0.8 * rate * rate * inertia
    else:
        kp, kd = 3.0 * rate * rate * inertia, 3.0 * rate * inertia
        ki = rng.uniform(0.4, 1.0) * rate**3 * inertia
    feed = 1.0 if kind == HOST_PID else float(rng.choice([0.0, 0.9, 1.0]))
    accel = 0.0 if kind == HOST_PID or rng.uniform() < 0.6 else rng.uniform(0.7, 1.1)
    jitter = 0.0 if rng.uniform() < 0.7 else spread(rng, 0.005, 0.05) * period / tick
    stated = str(rng.choice(["right", "unknown", "wrong"], p=[0.55, 0.35, 0.1]))
    if kind == CASCADE and stated == "right":
        stated = "unknown"
    loop = Loop(
        kind, tick, round(period / tick), kp, kd, ki, share, feed, accel, dead, subsample, bool(rng.integers(2)),
        jitter, stated, rate,
    )  # fmt: skip
    return loop, current


def _reach(
    rng: np.random.Generator,
    loop: Loop,
    inertia: float,
    coulomb: float,
    top: float,
    half: float,
    resolution: float,
) -> float:
    """Way of presliding: short against the moves, long against counts where that is possible, no stiffer than the
    loop can hold and the steps can follow."""
    stiffness = inertia * min(1500.0, 6.0 * loop.bandwidth) ** 2
    low = max(coulomb / stiffness, 5e-5 * top)
    return max(spread(rng, low, max(8.0 * low, min(30.0 * resolution, 2e-3 * half))), low)


def _surroundings(rng: np.random.Generator, coulomb: float, limit: float) -> Surroundings:
    colour = str(
        rng.choice(
            ["white", "coloured", "mains", "intermittent", "wandering"], p=[0.2, 0.45, 0.12, 0.13, 0.1]
        )
    )
    memory = float(rng.uniform(0.3, 0.95)) if colour in ("coloured", "intermittent") else 0.0
    columns = str(rng.choice(["both", "measured", "command"], p=[0.45, 0.25, 0.3]))
    return Surroundings(
        colour,
        memory,
        spread(rng, 0.002, 0.02) * coulomb,
        0.0 if rng.uniform() < 0.2 else spread(rng, 0.002, 0.03) * coulomb,
        0.0 if rng.uniform() < 0.4 else limit / float(rng.choice([1000, 4096, 32768])),
        0.0 if rng.uniform() < 0.5 else float(rng.uniform(-0.1, 0.1)),
        columns,
        bool(rng.uniform() < 0.5),
        float(rng.choice([50.0, 60.0, 16.7, 24.3])),
    )
