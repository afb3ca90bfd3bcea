"""The project's programme of the diagnosis, scaled to an axis: seven experiments twice, veto twice, test.

Speeds are shares of the top speed, small ways multiples of the presliding way; 140 s or less.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.worlds.world import Floats, World

EXPERIMENTS = ("presliding", "sine", "triangles", "scans", "dwells", "multisine", "points")


@dataclass(frozen=True, slots=True)
class Programme:
    """References with name and repeat of every row; arrays of shape (n,)."""

    reference: Floats
    names: NDArray[np.str_]
    repeats: NDArray[np.int64]

    def only(self, *wanted: str, repeat: int = 0) -> Programme:
        """One repeat of some experiments, with conditioning between them kept short."""
        rows = np.isin(self.names, wanted) & (self.repeats == repeat)
        return Programme(self.reference[rows], self.names[rows], self.repeats[rows])


@dataclass(frozen=True, slots=True)
class Scale:
    """What the axis can do: period [s], half travel, top speed, hardest acceleration, presliding way, counts."""

    period: float
    half: float
    top: float
    hard: float
    reach: float
    count: float

    def move(self, start: float, target: float, speed: float, ease: float = 1.0) -> Floats:
        """A move with sin² flanks at a share of top speed and of the hardest acceleration."""
        distance = abs(target - start)
        if distance == 0.0:
            return np.zeros(0)
        fast, hard = speed * self.top, ease * self.hard
        flank = fast / hard * math.pi / 2.0
        if fast * flank > distance:
            fast = math.sqrt(distance * hard * 2.0 / math.pi)
            flank = fast / hard * math.pi / 2.0
        seconds = distance / fast
        time = np.arange(0.0, seconds + flank + self.period, self.period)

        def way(t: Floats) -> Floats:
            inner = np.clip(t, 0.0, flank)
            return (
                inner / 2 - flank / (2 * math.pi) * np.sin(math.pi * inner / flank) + np.maximum(t - flank, 0)
            )

        shape = way(time) - way(time - seconds)
        return np.asarray(start + (target - start) * shape / shape[-1])

    def rest(self, place: float, seconds: float) -> Floats:
        return np.full(max(round(seconds / self.period), 1), place)

    def sine(self, size: float, hertz: float, cycles: float) -> Floats:
        """No faster and harder than the axis may."""
        size = min(size, 0.8 * self.half)
        hertz = min(
            hertz, 0.6 * self.top / (2 * math.pi * size), math.sqrt(0.6 * self.hard / size) / (2 * math.pi)
        )
        time = np.arange(round(cycles / hertz / self.period)) * self.period
        return np.asarray(size * np.sin(2 * math.pi * hertz * time))

    def triangle(self, speed: float, seconds: float, cycles: float) -> Floats:
        """Back and forth at a share of top speed, rounded by the axis's acceleration."""
        size = min(speed * self.top * seconds / 4.0, 0.8 * self.half)
        speed = min(speed, 1.0)
        parts, place = [], 0.0
        for target in [size, -size] * max(round(cycles), 1) + [0.0]:
            parts.append(self.move(place, target, speed, 0.4))
            place = target
        return np.concatenate(parts)

    def ways(self, *factors: float) -> list[float]:
        """Small ways: multiples of the presliding way, no fewer than three counts, each larger than the last."""
        out: list[float] = []
        for factor in factors:
            least = 1.5 * out[-1] if out else 3.0 * self.count
            out.append(min(max(factor * self.reach, least), 0.3 * self.half))
        return out


def _presliding(s: Scale) -> Floats:
    hertz = (2.5, 1.6, 1.6, 1.3, 1.1, 1.1)
    ways = s.ways(0.15, 0.3, 0.6, 1.2, 3.0, 7.0)
    return np.concatenate([s.sine(a, f, 2.0) for a, f in zip(ways, hertz, strict=True)])


def _triangles(s: Scale) -> Floats:
    rows = ((0.002, 3.5, 1), (0.007, 2.0, 1), (0.02, 1.4, 1), (0.07, 1.2, 1), (0.2, 0.8, 1))
    return np.concatenate([s.triangle(*row) for row in rows])


def _scans(s: Scale) -> Floats:
    slow = min(max(0.2, s.half / (1.3 * s.top)), 0.6)
    far = 0.95 * s.half
    return np.concatenate([
        s.move(0, far, slow, 0.4), s.move(far, -far, slow, 0.4), s.move(-far, far, 0.7, 0.5),
        s.move(far, -far, 0.7, 0.5), s.move(-far, 0, 0.4, 0.5),
    ])  # fmt: skip


def _dwells(s: Scale) -> Floats:
    step = min(0.012 * s.top, 0.3 * s.half)
    parts, place = [], 0.0
    for i, rest in enumerate((0.05, 0.1, 0.2, 0.4, 0.8, 1.5, 2.5, 1.2, 0.6, 0.3, 0.15)):
        target = step if i % 2 == 0 else 0.0
        parts += [s.move(place, target, 0.05, 0.07), s.rest(target, rest)]
        place = target
    return np.concatenate([*parts, s.move(place, 0.0, 0.05, 0.07)])


def _multisine(s: Scale) -> Floats:
    hertz = np.array([2, 3, 5, 7, 9.5, 12.5, 16.5, 19.5, 23.0])
    hertz = hertz[hertz < 0.06 / s.period]
    time = np.arange(round(4.0 / s.period)) * s.period
    phases = np.random.default_rng(5).uniform(0, 2 * math.pi, len(hertz))
    waves = (np.sin(2 * math.pi * np.outer(time, hertz) + phases) / hertz**1.3).sum(axis=1)
    speed, hard = np.abs(np.gradient(waves, s.period)).max(), np.abs(np.diff(waves, 2)).max() / s.period**2
    size = min(0.12 * s.top / speed, 0.7 * s.hard / hard, 0.3 * s.half / np.abs(waves).max())
    return np.asarray(size * waves * np.minimum(1.0, np.minimum(time, time[::-1]) / 0.3))


def _points(s: Scale) -> Floats:
    places = np.array([0.0, 0.4, -0.3, 0.85, -0.85, 0.2, 0.0]) * s.half
    parts = []
    for a, b, speed in zip(places[:-1], places[1:], (0.4, 0.7, 1.0, 1.0, 0.55, 0.4), strict=True):
        parts += [s.move(a, b, speed, 1.0), s.rest(b, 0.12)]
    return np.concatenate(parts)


def _moves(s: Scale, seed: int, rows: tuple[tuple[float, float, float], ...]) -> list[Floats]:
    rng, parts, place = np.random.default_rng(seed), [], 0.0
    for speed, ease, rest in rows:
        far = (
            min(s.half, 0.8 * speed * s.top) * rng.uniform(0.4, 0.9)
            if speed > 0.1
            else min(0.02 * s.top, 0.3 * s.half)
        )
        target = -far if place > 0 else far
        if speed <= 0.1:
            target = place - math.copysign(far, place)
        parts += [s.move(place, target, speed, ease), s.rest(target, rest)]
        place = target
    return [*parts, s.move(place, 0.0, 0.5, 0.5)]


def _veto(s: Scale) -> Floats:
    rows = ((0.08, 0.1, 0.5), (0.27, 0.3, 0.1), (0.8, 0.7, 0.05), (0.03, 0.05, 0.9), (0.5, 0.9, 0.2),
            (0.15, 0.2, 0.05), (0.95, 0.95, 0.4))  # fmt: skip
    small, large = s.ways(1.3, 5.0)
    waves = [s.sine(0.01 * s.top, 0.7, 2), s.sine(small, 1.3, 2), s.sine(0.06 * s.top, 0.8, 1)]
    return np.concatenate([*_moves(s, 17, rows), *waves, s.sine(large, min(6.0, 0.04 / s.period), 9)])


def _test(s: Scale) -> Floats:
    small, large = s.ways(2.0, 6.0)
    far = 0.65 * s.half
    return np.concatenate([
        s.sine(0.01 * s.top, 1.2, 2), s.sine(small, 0.9, 1), s.triangle(0.05, 1.8, 1), s.sine(0.1 * s.top, 0.6, 1),
        s.move(0, far, 0.6, 0.5), s.rest(far, 0.3), s.move(far, -0.7 * far, 0.35, 0.7), s.rest(-0.7 * far, 0.08),
        s.move(-0.7 * far, 0, 0.15, 0.2), s.sine(large, min(4.5, 0.04 / s.period), 5),
    ])  # fmt: skip


_PLAYS = {
    "presliding": _presliding, "sine": lambda s: s.sine(0.0133 * s.top, 1.0, 3), "triangles": _triangles,
    "scans": _scans, "dwells": _dwells, "multisine": _multisine, "points": _points, "veto": _veto, "test": _test,
}  # fmt: skip


def scale_of(world: World) -> Scale:
    plant = world.plant
    return Scale(world.loop.period, plant.travel, plant.top_speed, world.hard, plant.reach, plant.resolution)


def programme(world: World, repeats: int = 2) -> Programme:
    """The whole programme; everything begins and ends at 0."""
    s = scale_of(world)
    far = 0.3 * s.half
    warm = np.concatenate([s.move(0, far, 0.4, 0.4), s.move(far, -far, 0.4, 0.4), s.move(-far, 0, 0.4, 0.4)])
    pieces = [("conditioning", 0, warm), ("conditioning", 0, s.rest(0.0, 0.15))]
    order = [(name, r) for r in range(repeats) for name in EXPERIMENTS]
    order += [("veto", r) for r in range(repeats)] + [("test", 0)]
    for name, repeat in order:
        pieces += [(name, repeat, _PLAYS[name](s)), ("conditioning", 0, s.rest(0.0, 0.15))]
    return Programme(
        np.concatenate([part for _, _, part in pieces]),
        np.concatenate([np.full(len(part), name) for name, _, part in pieces]),
        np.concatenate([np.full(len(part), repeat) for _, repeat, part in pieces]),
    )
