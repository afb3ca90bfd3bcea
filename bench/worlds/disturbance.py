"""Torque that acts on the axis beside the drive's, at 1 kHz, of the rms that the surroundings have."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter

from bench.worlds.world import Floats, Surroundings

RATE = 1000.0


def disturbance(around: Surroundings, seconds: float, rng: np.random.Generator) -> Floats:
    """The process's torque over the whole recording, shape (n,)."""
    n = int(seconds * RATE) + 4
    made = {"mains": _mains, "intermittent": _bursts, "wandering": _wandering}.get(around.colour, _coloured)
    raw = made(n, around, rng)
    return np.asarray(around.level * raw / max(float(np.sqrt(np.mean(raw**2))), 1e-300))


def _coloured(n: int, around: Surroundings, rng: np.random.Generator) -> Floats:
    """AR(1) with `memory` a millisecond."""
    white = rng.standard_normal(n + 200)
    return np.asarray(lfilter([1.0], [1.0, -around.memory], white)[200:])


def _mains(n: int, around: Surroundings, rng: np.random.Generator) -> Floats:
    """Half noise, half a line whose phase and height wander."""
    time = np.arange(n) / RATE
    phase = np.cumsum(rng.standard_normal(n)) * 0.06
    height = 1.0 + 0.3 * np.sin(2.0 * math.pi * 0.07 * time + rng.uniform(0, 6.28))
    line = height * np.sin(2.0 * math.pi * around.mains * time + phase)
    return np.asarray(rng.standard_normal(n) + line)


def _bursts(n: int, around: Surroundings, rng: np.random.Generator) -> Floats:
    """Coloured noise, five times as strong in bursts of half a second every eight or so."""
    gate = np.ones(n)
    at = 0.0
    while at < n:
        at += rng.exponential(8.0 * RATE)
        gate[int(min(at, n)) : int(min(at + rng.uniform(200, 900), n))] = 5.0
    return np.asarray(gate * _coloured(n, around, rng))


def _wandering(n: int, around: Surroundings, rng: np.random.Generator) -> Floats:
    """Noise on a level that wanders over seconds."""
    slow = np.asarray(lfilter([1.0], [1.0, -math.exp(-1.0 / (3.0 * RATE))], rng.standard_normal(n)))
    return np.asarray(rng.standard_normal(n) + 0.5 * slow / np.sqrt(np.mean(slow**2)))
