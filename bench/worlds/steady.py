"""Whether a world's friction at constant speed is its own, or made by an axis that chatters by itself.

Friction that the transmitted torque presses feeds back on itself: torque falls with friction, and friction grows with
torque. Where presliding damping leads the level enough, the axis chatters at a kilohertz, and a damping that never
drives makes steady friction of it. No axis slides so: such a world is drawn again, as one whose loop runs away.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.ndimage import minimum_filter1d

from bench.worlds.names import LOAD
from bench.worlds.play import run
from bench.worlds.programme import Programme, scale_of
from bench.worlds.world import Floats, World

SETTLED = 0.05
"""s from a change of speed on, until friction is a sliding contact's."""
SPEEDS = (0.3, 0.7, 1.0)
"""Of the top speed, each one way and back."""


def chatters(world: World, noise: float) -> bool:
    """Whether presliding damping turns the torque of constant speed by more than the noise (rms).

    Raises:
        RanAway: the loop is not stable.
    """
    if not any(one.effect == LOAD for one in world.planted):
        return False
    what, rows = _strokes(world)
    if not rows.any():
        return False
    damped, bare = (
        _torque(replace(world, plant=replace(world.plant, micro=micro)), what)
        for micro in (world.plant.micro, 0.0)
    )
    return float(np.sqrt(np.mean((damped - bare)[rows] ** 2))) > noise


def _torque(world: World, what: Programme) -> Floats:
    return run(world, what, 0, noisy=False).mean


def _strokes(world: World) -> tuple[Programme, np.ndarray]:
    """Strokes at constant speeds, and the rows at which one is held."""
    scale = scale_of(world)
    far, parts = 0.95 * scale.half, [scale.move(0.0, -0.95 * scale.half, 0.5, 0.5)]
    for speed in SPEEDS:
        parts += [scale.move(-far, far, speed, 0.5), scale.move(far, -far, speed, 0.5)]
    path = np.concatenate([*parts, scale.move(-far, 0.0, 0.5, 0.5)])
    speed = np.gradient(path, scale.period)
    held = np.abs(np.gradient(speed, scale.period)) < 1e-3 * scale.hard
    width = 2 * max(round(SETTLED / scale.period), 1) + 1
    rows = minimum_filter1d(held & (np.abs(speed) > 0.1 * scale.top), width)
    return Programme(path, np.full(len(path), "scans"), np.zeros(len(path), dtype=np.int64)), np.asarray(rows)
