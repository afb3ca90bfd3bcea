"""Cases drawn from a seed: what is planted where, how large; a batch's hash shows that it was drawn before it ran."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from bench.worlds import names, planting, sizes
from bench.worlds.draw import draw_world, with_base
from bench.worlds.play import RanAway
from bench.worlds.steady import chatters
from bench.worlds.world import World

KINDS = ("single", "half", "null", "alien", "pair", "removed", "lone", "second", "disturbed")
LONELY = ("lone", "second", "disturbed")
"""Of these files there is one trajectory, without repeats; three in ten have nothing planted. The second file of
`disturbed` ones is always taken under other circumstances."""
STRIDE = 6  # worlds of the first six kinds alternate
NULL_SHARE = 0.3
TRIES, MOST_WORLDS = 12, 100
"""Worlds of a case that are tried, and that are drawn where only some loops or cycles are wanted."""


@dataclass(frozen=True, slots=True)
class Case:
    """What one run is. `effects`: (name, law) pairs, or the alien's name with law 0; `ratio`: asked of each."""

    kind: str
    seed: int
    effects: tuple[tuple[str, int], ...]
    ratio: float

    @property
    def key(self) -> str:
        return f"{self.kind}:{self.seed}"

    @property
    def truth(self) -> tuple[str, ...]:
        return tuple(name for name, _ in self.effects)


@dataclass(frozen=True, slots=True)
class Ready:
    """A case with its world: ratios reached, noise [N m or N], and how many worlds were passed over."""

    case: Case
    world: World
    ratios: tuple[float, ...]
    noise: float
    passed: int


@dataclass(frozen=True, slots=True)
class Wanted:
    """Which worlds are wanted: loops by number, cycles of `least` to `most` seconds, and which base they are given.

    Sizes are those of the plain base, and so are all draws but the base's own; worlds in which noise hides the other
    base are passed over.
    """

    loops: tuple[int, ...] = (0, 1, 2)
    least: float = 0.0
    most: float = 1.0
    base: str = ""

    def has(self, world: World) -> bool:
        loop = world.loop
        return loop.kind in self.loops and self.least - 1e-9 < loop.period < self.most + 1e-9


ANY = Wanted()


def draw_case(kind: str, seed: int) -> Case:
    """Effects go round by seed, so that a batch holds each about as often."""
    rng = np.random.default_rng([seed, KINDS.index(kind), 1402])
    low, high = {"half": (0.5, 0.9), "pair": (1.5, 4.0), "alien": (1.5, 4.0)}.get(kind, (1.1, 4.0))
    ratio = float(np.exp(rng.uniform(np.log(low), np.log(high))))
    if kind == "null" or (kind in LONELY and rng.uniform() < NULL_SHARE):
        return Case(kind, seed, (), 0.0)
    if kind == "alien":
        return Case(kind, seed, ((names.ALIENS[seed % len(names.ALIENS)], 0),), ratio)
    first = seed % len(names.EFFECTS)
    numbers = [first]
    if kind == "pair":
        numbers.append(int(rng.choice([i for i in range(16) if i != first and {i, first} != {9, 10}])))
    effects = tuple((names.EFFECTS[i], int(rng.integers(names.LAWS[i])) + 1) for i in numbers)
    return Case(kind, seed, effects, ratio)


def draw_batch(seed: int, counts: Mapping[str, int]) -> list[Case]:
    """All cases of a batch; kinds in turn, so that a batch cut short holds some of each."""
    most = max(counts.values(), default=0)
    return [draw_case(kind, seed + i) for i in range(most) for kind in KINDS if i < counts.get(kind, 0)]


def batch_hash(cases: list[Case]) -> str:
    """sha256 over the list of cases, to be written down before they are run."""
    text = json.dumps([dataclasses.asdict(case) for case in cases], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def ready(case: Case, wanted: Wanted = ANY) -> Ready:
    """The case's world: drawn again where the axis cannot show the effect, chatters, or the loop does not hold it.

    Raises:
        RanAway: no world in a dozen.
    """
    suiting = (
        i for i in range(MOST_WORLDS) if wanted is ANY or wanted.has(draw_world(_world_seed(case) + i))
    )
    for attempt in itertools.islice(suiting, TRIES):
        try:
            made = _attempt(case, attempt, wanted.base)
        except RanAway:
            continue
        if made is not None:
            return made
    raise RanAway(f"case {case.key}: no world in {TRIES} can show {', '.join(case.truth)}")


def _world_seed(case: Case) -> int:
    kind = KINDS.index(case.kind)
    if kind < STRIDE:
        return (case.seed * STRIDE + kind) * 100
    return 1_000_000_000 * (kind - STRIDE + 1) + case.seed * 100


def _attempt(case: Case, attempt: int, base: str) -> Ready | None:
    world = draw_world(_world_seed(case) + attempt)
    rng = np.random.default_rng([world.seed, 1403])
    if case.kind != "alien" and not set(case.truth) <= set(planting.possible(world)):
        return None
    world, noise = sizes.other_family(world, float(rng.uniform(0.0, 0.2)))
    if base and sizes.share_of(world, with_base(world, base)) < noise:
        return None
    ratios = []
    for name, law in case.effects:
        world, ratio = _planted(world, name, law, case.ratio, noise, rng)
        if abs(ratio / case.ratio - 1.0) > 2.0 * sizes.NEAR:
            return None
        ratios.append(ratio)
    if chatters(world, noise):
        return None
    return Ready(case, with_base(world, base), tuple(ratios), noise, attempt)


def _planted(
    world: World, name: str, law: int, ratio: float, noise: float, rng: np.random.Generator
) -> tuple[World, float]:
    if name in names.ALIENS:
        start, most, make = planting.stranger(world, name, rng)
        if name == "mains":
            return make(ratio * noise * 2.0**0.5), ratio
        return sizes.sized(world, noise, ratio, start, most, make)
    seed = planting.seedling(world, name, law, rng)
    repeats = 2 if name == "thermal_drift" else 1
    return sizes.sized(world, noise, ratio, seed.start, seed.most, lambda size: seed.at(world, size), repeats)
