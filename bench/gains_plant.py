"""Axes drawn at random and their loop on the simulator's plant: the judge of `bench.gains`, with nothing of the twin.

The plant is `autotune_sim.plant`; controller, dead time, and what counts as hunting, standing and settled are written
here again, so that judge and judged share no code.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from autotune_sim.plant import (
    Bristle,
    Element,
    PlantParameters,
    Wave,
    advance,
    fresh_state,
    pack,
    reading,
    substeps,
)

Floats = NDArray[np.float64]
PERIOD = 1e-3


@dataclass(frozen=True)
class DrawnAxis:
    """One axis: plant, dead time of its drive [s], large step [rad], fastest slow motion [rad/s], reference filter."""

    plant: PlantParameters
    dead_time: float
    step: float
    speed: float
    filter: float = 0.8


def draw(random: np.random.Generator) -> DrawnAxis:
    """Inertia over two decades, friction with or without a fall and memory, 0 to 3 cycles late, resonance or none."""
    inertia = 10.0 ** random.uniform(-4.0, -2.0)
    rate = 10.0 ** random.uniform(1.9, 2.7)  # rad/s, eigenfrequency in presliding
    stiffness = inertia * rate**2
    travel = 10.0 ** random.uniform(-3.0, -2.0)  # x_s [rad]
    friction = stiffness * travel
    damping = 2.0 * random.uniform(0.1, 0.6) * inertia * rate
    plant: dict[str, Any] = {
        "inertia": inertia,
        "viscous": random.uniform(0.5, 3.0) * inertia,
        "offset": random.uniform(-0.2, 0.2) * friction,
    }
    if random.random() < 0.5:
        rise = random.uniform(0.9, 1.4)
        plant["bristle"] = Bristle(
            friction, friction * rise, 10.0 ** random.uniform(-1.5, 0.0), stiffness, damping
        )
    else:
        plant["elements"], plant["micro_damping"] = _elements(random, friction, stiffness), damping
    if random.random() < 0.5:
        share = random.uniform(0.15, 0.5)
        resonance = 2.0 * math.pi * 10.0 ** random.uniform(1.95, 2.5)
        plant |= {
            "transmission_stiffness": resonance**2 * inertia * share * (1.0 - share),
            "load_inertia": share,
            "load_friction": random.uniform(0.1, 0.5),
        }
    limit = friction * random.uniform(3.0, 8.0)
    ripple = (Wave(24.0, 0.02 * friction, random.uniform(0.0, 6.0)),)
    noise = {
        "process_noise": 0.01 * friction,
        "torque_noise": 0.005 * friction,
        "ripple": ripple,
        "torque_limit": limit,
    }
    counts = round(2.0 * math.pi / (travel / 40.0))
    dead = PERIOD * random.integers(0, 4)
    return DrawnAxis(PlantParameters(**plant, **noise, counts=counts), dead, 20.0 * travel, 200.0 * travel)


def _elements(random: np.random.Generator, friction: float, stiffness: float) -> tuple[Element, ...]:
    """Four elements whose stiffness adds up, travels spread over a decade and a half."""
    shares = random.dirichlet(np.full(4, 3.0)) * friction
    travels = np.geomspace(1.0, 30.0, 4) * random.uniform(0.7, 1.4, 4)
    travels *= float(np.sum(shares / travels)) / stiffness
    return tuple(Element(float(d), float(w)) for d, w in zip(travels, shares, strict=True))


@njit(cache=True)
def _loop(
    p: Any,
    s: Any,
    gains: Floats,
    limit: float,
    delay: int,
    parts: int,
    h: float,
    r: Floats,
    noise: Floats,
    q: Floats,
) -> int:
    total = derivative = last_r = last_y = 0.0
    queue = np.zeros(delay + 1)
    for k in range(len(r)):
        y = reading(p, s)
        error = r[k] - y
        derivative += gains[3] * ((r[k] - last_r - y + last_y) / h - derivative)
        wanted = gains[0] * error + gains[1] * derivative + gains[2] * (total + error * h)
        if abs(wanted) <= limit:
            total += error * h
        wanted = min(max(wanted, -limit), limit)
        for i in range(delay):
            queue[i] = queue[i + 1]
        queue[delay] = wanted
        last_r, last_y, q[k] = r[k], y, s.position
        advance(p, s, queue[0], noise[k], False, parts, h / parts)
        if not abs(s.velocity) < 1e5:
            return k
    return len(r)


def positions(axis: DrawnAxis, gains: Floats, reference: Floats, seed: int, noisy: bool = True) -> Floats:
    """True motor positions along a reference, shape (n,); infinite from where the loop ran away."""
    plant = axis.plant
    random = np.random.default_rng([seed, 77])
    noise = random.normal(0.0, plant.process_noise, len(reference)) * float(noisy)
    packed, state, result = pack(plant), fresh_state(), np.full(len(reference), math.inf)
    delay = round(axis.dead_time / PERIOD)
    _loop(
        packed[0],
        state[0],
        gains,
        plant.torque_limit,
        delay,
        substeps(plant, PERIOD),
        PERIOD,
        reference,
        noise,
        result,
    )
    return result


REST = 600
"""Samples before a step, in which the offset is taken over."""


def stepped(axis: DrawnAxis, gains: Floats, size: float, seconds: float, seed: int) -> Floats:
    """Positions after a step, where the loop was at rest before it."""
    count = round(seconds / PERIOD)
    raw = np.concatenate([np.zeros(REST), np.full(count, size)])
    reference = np.concatenate([np.zeros(REST), size * (1.0 - axis.filter ** np.arange(1, count + 1))])
    return positions(axis, gains, reference if axis.filter > 0.0 else raw, seed)[REST:]


def settled(axis: DrawnAxis, gains: Floats, size: float, seed: int = 1, horizon: float = 2.0) -> float:
    """Time to the last sample outside ±10 % [s]; the horizon where it does not settle."""
    q = stepped(axis, gains, size, horizon, seed)
    late = np.flatnonzero(~(np.abs(q - size) <= 0.1 * size))
    return float(late[-1] + 1) * PERIOD if len(late) else 0.0


LONG = 32.0
"""s: what is too slow for the usual time is looked at for so long."""


@dataclass(frozen=True)
class Swing:
    """Half of peak to peak [rad] and frequency [Hz]."""

    amplitude: float
    frequency: float


def swinging(
    axis: DrawnAxis, gains: Floats, size: float, seconds: float = 8.0, seed: int = 2
) -> Swing | None:
    """The oscillation in the last quarter after a step: lasting, and beyond six counts and the noise at rest."""
    q = stepped(axis, gains, size, seconds, seed)
    if not np.all(np.isfinite(q)):
        return Swing(math.inf, math.nan)
    quarter = len(q) // 4
    last, before = q[-quarter:], q[-2 * quarter : -quarter]
    reach = float(np.ptp(last))
    floor = max(
        6.0 * axis.plant.resolution, 12.0 * axis.plant.process_noise / max(axis.plant.stiffness, 1e-12)
    )
    parts = [float(np.ptp(part)) for part in np.array_split(q[quarter:], 9)]
    bursts = any(
        parts[j] > max(3.0 * parts[i], 2.0 * floor) for i in range(9) for j in range(max(i + 1, 4), 9)
    )
    if bursts:  # they grow for some 10 s: how far they come is seen in a longer look
        grown = swinging(axis, gains, size, LONG, seed) if seconds < LONG else None
        return grown or Swing(0.5 * float(np.ptp(q[quarter:])), math.nan)
    if reach <= floor or reach < 0.7 * float(np.ptp(before)):
        return None
    spectrum = np.abs(np.fft.rfft((last - last.mean()) * np.hanning(quarter), 8 * quarter))
    peak = int(np.argmax(spectrum))
    if peak < 16 and seconds < LONG:  # less than two whole swings: it creeps, or swings slowly
        return swinging(axis, gains, size, LONG, seed)
    if peak < 16:
        return None
    return Swing(0.5 * reach, peak / (8 * quarter * PERIOD))


def stands(axis: DrawnAxis, gains: Floats, speed: float, seed: int = 3) -> bool:
    """Whether it comes to rest, by its true position, more than twice in the second half of a slow way."""
    way = 60.0 * axis.plant.friction / axis.plant.stiffness
    count = round(min(max(way / speed, 1.0), 20.0) / PERIOD)
    q = positions(axis, gains, np.arange(count) * speed * PERIOD, seed)
    if not np.all(np.isfinite(q)):
        return True
    span = max(round(8.0 * axis.plant.resolution / (speed * PERIOD)), 4)
    late = q[count // 2 :]
    rate = (late[span:] - late[:-span]) / (span * PERIOD)
    still = rate < 0.08 * speed
    return int(np.count_nonzero(np.diff(still.astype(int)) == 1)) > 2
