"""How large an effect must be: its repeatable residual over the noise, from noise-free and noisy simulations.

The residual is what a rigid axis with one exponential bristle, refitted, leaves of the torque below 60 Hz. A pair of
simulations without noise, with and without the effect, gives the effect's part of it; the noise is half the difference
between repeats of the recording as it is written. Nothing of the library is used.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numba import njit
from scipy.ndimage import maximum_filter1d, minimum_filter1d
from scipy.signal import butter, sosfiltfilt

from autotune.recordings.recording import Recording
from bench.worlds.play import recording, run
from bench.worlds.programme import EXPERIMENTS, Programme, programme
from bench.worlds.world import Floats, World

CUTOFF = 60.0
MOTION = 150.0
"""Hz, of the motion that the bristle follows."""
NEAR = 0.15
"""A ratio is near enough to the one asked."""


@njit(cache=True)
def _bristle(place: np.ndarray, reach: float) -> np.ndarray:
    out = np.zeros(len(place))
    for k in range(1, len(place)):
        step = place[k] - place[k - 1]
        sign = 1.0 if step >= 0.0 else -1.0
        out[k] = sign + (out[k - 1] - sign) * math.exp(-abs(step) / reach)
    return out


def smooth(values: Floats, period: float, cutoff: float = CUTOFF) -> Floats:
    """Zero-phase low-pass, along the first axis."""
    sos = butter(4, min(cutoff, 0.35 / period), fs=1.0 / period, output="sos")
    return np.asarray(sosfiltfilt(sos, values, axis=0))


def _columns(place: Floats, period: float, reach: float) -> Floats:
    """Acceleration, speed, 1, bristle and its rate; shape (n, 5)."""
    speed, bend = np.gradient(place, period), np.gradient(np.gradient(place, period), period)
    z = _bristle(place, reach)
    return np.column_stack([bend, speed, np.ones(len(place)), z, np.gradient(z, period)])


def moving(what: Programme, world: World, reading: Floats | None = None) -> np.ndarray:
    """Rows of training where the reading (else the reference) moves by more than two counts in 20 ms."""
    width = 2 * max(round(0.01 / world.loop.period), 1) + 1
    place = what.reference if reading is None else reading
    swing = maximum_filter1d(place, width) - minimum_filter1d(place, width)
    return np.asarray(np.isin(what.names, EXPERIMENTS) & (swing > 2.1 * world.plant.resolution))


def left(world: World, what: Programme) -> float:
    """Rms of the torque that a refitted base leaves in a simulation without noise."""
    played, period = run(world, what, 0, noisy=False, steps=0.5), world.loop.period
    place = 0.5 * (played.reading + np.append(played.reading[1:], played.reading[-1]))
    rows = np.flatnonzero(moving(what, world)[:-5])[:: max(round(2e-3 / period), 1)]
    torque = smooth(played.mean, period)[rows]
    plain = smooth(_columns(place, period, world.plant.reach)[:, :3], period)[rows]
    best = math.inf
    for factor in (0.4, 0.63, 1.0, 1.6, 2.5):
        z = _bristle(place, factor * world.plant.reach)
        columns = np.column_stack([plain, smooth(np.column_stack([z, np.gradient(z, period)]), period)[rows]])
        columns = columns / np.maximum(np.sqrt((columns**2).mean(axis=0)), 1e-300)
        found = np.linalg.lstsq(columns, torque, rcond=None)[0]
        best = min(best, float(np.sqrt(np.mean((torque - columns @ found) ** 2))))
    return best


def unexplained(world: World, taken: Recording) -> Floats:
    """Recorded torque less that of the true base, row by row."""
    plant, period = world.plant, world.loop.period
    torque = taken["torque_command" if "torque_command" in taken else "torque"] / (
        1.0 + world.around.unit_error
    )
    columns = _columns(smooth(taken["position"], period, MOTION), period, plant.reach)
    return np.asarray(torque - columns @ np.array([plant.inertia, plant.viscous, 0.0, plant.coulomb, 0.0]))


def noise(world: World, what: Programme) -> float:
    """Rms of what repeats do not share, on the recording's own columns."""
    taken = recording(world, what, seed=991)
    error = smooth(unexplained(world, taken), world.loop.period)
    rows = moving(what, world, taken["position"])
    squares, count = 0.0, 0
    for name in EXPERIMENTS:
        one, two = (np.flatnonzero((what.names == name) & (what.repeats == r)) for r in (0, 1))
        shared = rows[one] & rows[two]
        squares += 0.5 * float(np.sum((error[one] - error[two])[shared] ** 2))
        count += int(shared.sum())
    return math.sqrt(squares / max(count, 1))


def training(world: World, repeats: int = 1) -> Programme:
    """The programme up to the veto."""
    what = programme(world, repeats)
    stop = int(np.argmax(what.names == "veto"))
    return Programme(what.reference[:stop], what.names[:stop], what.repeats[:stop])


def other_family(world: World, share: float) -> tuple[World, float]:
    """The world whose friction differs from a bristle by `share` of the noise at most, and the noise."""
    plain = replace(world, plant=replace(world.plant, other=0.0))
    floor = noise(plain, training(plain, 2))
    what = training(world)
    whole = math.sqrt(max(left(world, what) ** 2 - left(plain, what) ** 2, 0.0))
    part = min(share * floor / max(whole, 1e-300), 1.0)
    return replace(world, plant=replace(world.plant, other=part)), floor


def share_of(plain: World, other: World) -> float:
    """Rms of the torque by which one world is unlike a base that is fitted to it, beyond another."""
    what = training(plain)
    return math.sqrt(max(left(other, what) ** 2 - left(plain, what) ** 2, 0.0))


def sized(
    base: World,
    floor: float,
    ratio: float,
    start: float,
    most: float,
    make: Callable[[float], World],
    repeats: int = 1,
) -> tuple[World, float]:
    """The world with an effect of this ratio, and the ratio that was reached."""
    what, size = training(base, repeats), start
    without, best = left(base, what), (base, 0.0)
    for _ in range(4):
        world = make(size)
        with_it = left(world, what)
        found = math.sqrt(max(with_it**2 - without**2, 0.0)) / floor
        if abs(math.log(max(found, 1e-9) / ratio)) < abs(math.log(max(best[1], 1e-9) / ratio)):
            best = (world, found)
        if abs(found / ratio - 1.0) < NEAR or (size >= most and found < ratio):
            break
        size = min(size * min(max(ratio / max(found, 1e-9), 0.02), 20.0), most)
    return best
