"""What is planted: for each effect a law, its shape drawn, and a size that can be set later."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from bench.worlds import names
from bench.worlds.draw import TURN, spread
from bench.worlds.world import Alien, Planted, World

Rng = np.random.Generator
Build = Callable[[float], Planted]


@dataclass(frozen=True, slots=True)
class Seedling:
    """An effect whose size is still open: where to begin, how large it may be, and how it is made."""

    start: float
    most: float
    build: Build
    load: tuple[float, float] | None = None

    def at(self, world: World, size: float) -> World:
        """The world with this effect, so large."""
        planted = replace(world, planted=(*world.planted, self.build(size)))
        if self.load is None:
            return planted
        return replace(
            planted, plant=replace(world.plant, load_inertia=self.load[0], load_friction=self.load[1])
        )


def possible(world: World) -> tuple[str, ...]:
    """Effects that this axis can have and its programme can show."""
    turns = 2.0 * world.plant.travel / TURN if world.unit == "rad" else 0.0
    rotary = ("gravity_imbalance", "encoder_eccentricity")
    return tuple(name for name in names.EFFECTS if name not in rotary or turns >= 1.6)


def seedling(world: World, effect: str, law: int, rng: Rng) -> Seedling:
    """An effect by one of its laws, fitted to the axis's scales."""
    return _MAKERS[effect](world, law, rng)


def _simple(effect: int, law: int, start: float, most: float, *rest: float) -> Seedling:
    return Seedling(start, most, lambda size: Planted(effect, law, (size, *rest)))


def _ripple(w: World, law: int, rng: Rng) -> Seedling:
    travel = 2.0 * w.plant.travel
    first = TURN * spread(rng, 5.0, 60.0) / travel
    if w.unit == "rad" and travel > 1.5 * TURN:
        first = spread(rng, max(1.3, 4.0 * TURN / travel), min(40.0, 250.0 * TURN / travel))
    count = int(rng.integers(1, 4)) if law == 1 else 1
    near = first * (1.0 + max(rng.uniform(0.03, 0.15), 1.5 * TURN / (first * travel)))
    rows = [first, near, first * rng.uniform(1.9, 2.6)][:count]
    waves = tuple(
        (1.0 if i == 0 else rng.uniform(0.3, 0.8), k, rng.uniform(0, TURN)) for i, k in enumerate(rows)
    )
    level = w.plant.coulomb
    return Seedling(0.05 * level, 0.5 * level, lambda size: Planted(names.RIPPLE, law, (size,), waves))


def _asymmetry(w: World, law: int, rng: Rng) -> Seedling:
    top = w.plant.top_speed
    return _simple(
        names.ASYMMETRY, law, 0.05, 0.6, spread(rng, 3e-4, 2e-3) * top, rng.uniform(0.1, 0.4) * top
    )


def _stribeck(w: World, law: int, rng: Rng) -> Seedling:
    f = w.plant.coulomb
    rest = (spread(rng, 0.004, 0.05) * w.plant.top_speed, rng.uniform(0.5, 1.5))
    return _simple(names.STRIBECK, law, 0.1 * f, 1.2 * f, *rest)


def _curved(w: World, law: int, rng: Rng) -> Seedling:
    top, f = w.plant.top_speed, w.plant.coulomb
    speed = (spread(rng, 0.01, 0.1), rng.uniform(0.05, 0.3), spread(rng, 0.03, 0.2))[law - 1] * top
    return _simple(names.CURVED, law, 0.2 * f, 3.0 * f, speed, top)


def _place(w: World, law: int, rng: Rng) -> Seedling:
    x = w.plant.travel
    centre, half = rng.uniform(-0.5, 0.5) * x, rng.uniform(0.1, 0.3) * x
    if law == 1:
        return _simple(names.PLACE, law, 0.1, 2.0, centre - half, centre + half, rng.uniform(0.02, 0.06) * x)
    if law == 2:
        return _simple(names.PLACE, law, 0.1, 2.0, centre, 2.0 * half)
    return _simple(names.PLACE, law, 0.1, 2.0, 0.4 * centre, x)


def _imbalance(w: World, law: int, rng: Rng) -> Seedling:
    turns = 2.0 * w.plant.travel / TURN
    order = 1.0 if turns < 4.0 or rng.uniform() < 0.6 else spread(rng, 1.7 / turns, 1.0)
    f = w.plant.coulomb
    return _simple(
        names.IMBALANCE, law, 0.1 * f, 0.8 * f, order, rng.uniform(0, TURN), rng.uniform(0.05, 0.2)
    )


def _spring(w: World, law: int, rng: Rng) -> Seedling:
    f = w.plant.coulomb
    shape = (rng.uniform(-0.25, 0.5), rng.uniform(0.6, 1.5), rng.uniform(-0.7, -0.2))[law - 1]
    return _simple(names.SPRING, law, 0.1 * f, 0.8 * f, w.plant.travel, shape)


def _memory(w: World, law: int, rng: Rng) -> Seedling:
    f, reach = w.plant.coulomb, w.plant.reach
    way = (spread(rng, 2.0, 6.0) if law == 1 else spread(rng, 0.7, 2.0)) * reach
    return _simple(names.MEMORY, law, 0.1 * f, 0.8 * f, way, spread(rng, 4.0, 9.0), rng.uniform(0.0, 0.5))


def _thermal(w: World, law: int, rng: Rng) -> Seedling:
    return _simple(names.THERMAL, law, 0.1, 0.5, spread(rng, 15.0, 60.0), spread(rng, 40.0, 150.0))


def _elastic(w: World, law: int, rng: Rng) -> Seedling:
    share = rng.uniform(0.2, 0.75)
    rubs = 0.0 if rng.uniform() < 0.3 else rng.uniform(0.2, 0.8)
    reduced = w.plant.inertia * share * (1.0 - share)
    slack, arm, over = rng.uniform(0.02, 0.1), rng.uniform(0.3, 1.0), rng.uniform(1.0, 3.0)

    def build(compliance: float) -> Planted:
        rate = math.sqrt(1.0 / (compliance * reduced))
        twist = over * w.hard * w.plant.inertia * share * compliance
        third, fourth = (twist, 0.0) if law == 1 else (arm, 1.5 / rate)
        return Planted(names.ELASTIC, law, (compliance, 2.0 * slack * rate * reduced, third, fourth))

    most = 1.0 / (w.plant.inertia * share * (3.0 * w.loop.bandwidth) ** 2)
    return Seedling(min(1.0 / (reduced * (TURN * 40.0) ** 2), most), most, build, (share, rubs))


def _gap(w: World, law: int, rng: Rng) -> Seedling:
    share = rng.uniform(0.3, 0.7)
    reduced = w.plant.inertia * share * (1.0 - share)
    rate = TURN * spread(rng, 80.0, 250.0)
    stiffness, blow = reduced * rate**2, rng.uniform(0.3, 1.5) / (0.1 * w.plant.top_speed)
    damping = 2.0 * rng.uniform(0.05, 0.3) * reduced * rate
    start = 0.5 * w.plant.reach
    return Seedling(
        start,
        0.05 * w.plant.travel,
        lambda gap: Planted(names.GAP, law, (gap, stiffness, blow, damping)),
        (share, float(rng.choice([0.0, rng.uniform(0.1, 0.6)]))),
    )


def _lag(w: World, law: int, rng: Rng) -> Seedling:
    return _simple(names.LAG, law, 4e-4, min(6e-3, 0.2 / w.loop.bandwidth))


def _saturation(w: World, law: int, rng: Rng) -> Seedling:
    level = w.plant.inertia * w.hard + w.plant.coulomb + abs(w.plant.offset)

    def build(loss: float) -> Planted:
        if law == 1:
            low, high = 1e-3, 20.0
            for _ in range(60):
                ratio = math.sqrt(low * high)
                low, high = (ratio, high) if math.tanh(ratio) / ratio > 1.0 - loss else (low, ratio)
            return Planted(names.SATURATION, law, (loss, level / ratio))
        if law == 2:
            return Planted(names.SATURATION, law, (loss, 0.4 * level, max(1.0 - loss / 0.6, 0.1)))
        return Planted(names.SATURATION, law, (loss, level / ((1.0 - loss) ** -3.0 - 1.0) ** (1.0 / 3.0)))

    return Seedling(0.1, 0.4, build)


def _dwell(w: World, law: int, rng: Rng) -> Seedling:
    f, slip = w.plant.coulomb, spread(rng, 3.0, 15.0) * w.plant.reach
    return _simple(names.DWELL, law, 0.1 * f, 1.5 * f, spread(rng, 0.02, 0.2), slip, 5e-4 * w.plant.top_speed)


def _load(w: World, law: int, rng: Rng) -> Seedling:
    level = w.plant.inertia * w.hard
    first = rng.uniform(0.1, 0.3) * level if law == 1 else level
    return _simple(names.LOAD, law, 0.08, 0.6, first)


def _eccentric(w: World, law: int, rng: Rng) -> Seedling:
    return _simple(names.ECCENTRIC, law, 2e-3, 0.08, 1.0, rng.uniform(0, TURN), rng.uniform(0.15, 0.3))


_MAKERS: Mapping[str, Callable[[World, int, Rng], Seedling]] = dict(
    zip(
        names.EFFECTS,
        (
            _ripple, _asymmetry, _stribeck, _curved, _place, _imbalance, _spring, _memory, _thermal, _elastic, _gap,
            _lag, _saturation, _dwell, _load, _eccentric,
        ),
        strict=True,
    )
)  # fmt: skip


def stranger(world: World, name: str, rng: Rng) -> tuple[float, float, Callable[[float], World]]:
    """An alien: where its size begins, how large it may be, and the world with it."""
    plant, kind = world.plant, names.ALIENS.index(name) + 1
    wave = TURN * rng.uniform(1.2, 4.0) / (2.0 * plant.travel)
    pitch = plant.travel / rng.uniform(4.0, 9.0)
    rest = (
        wave, world.hard, plant.top_speed, spread(rng, 0.15, 0.6), rng.uniform(4.0, 15.0) * plant.reach,
        TURN * rng.uniform(0.15, 0.9), pitch, plant.reach / plant.coulomb, rng.uniform(6.0, 35.0),
    )  # fmt: skip
    most = 1.5 if name == "breathing" else 3.0
    return (
        0.1 * plant.coulomb,
        most * plant.coulomb,
        lambda size: replace(world, alien=Alien(kind, (size, *rest))),
    )
