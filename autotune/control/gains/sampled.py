"""Margins of the sampled loop: exact for a held torque, whole and broken cycles of dead time, filter and notch.

L(z) = C(z)·N(z)·G(z) with G the step-invariant (zero-order hold) form of a regime, its input delayed by d·h. The
decision about stability is that of the closed loop's eigenvalues; the margins are read off L on the unit circle
(Åström and Wittenmark, Computer-Controlled Systems, 3rd ed., ch. 3).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
import scipy
from numpy.typing import NDArray

from autotune.control.gains.loop import Gains, LoopTiming
from autotune.control.gains.regimes import LinearAxis
from autotune.core.arrays import Floats

Complexes = NDArray[np.complex128]
POINTS = 600
LOWEST = 0.02  # Hz


@dataclass(frozen=True, slots=True)
class Margins:
    """Of one loop.

    Attributes:
        stable: all eigenvalues inside the unit circle; `radius` the largest of them.
        crossover: highest frequency at which |L| = 1 [Hz], nan for none.
        phase: least phase margin of all crossings [deg], inf for none; below 0 where unstable.
        gain: by how much the gain may grow [dB], inf for none; below 0 where unstable (what it is away from stable).
        gain_down: by how much it may fall [dB].
        modulus: least distance of L from −1.
    """

    stable: bool
    radius: float
    crossover: float
    phase: float
    gain: float
    gain_down: float
    modulus: float


@dataclass(frozen=True, slots=True)
class SampledAxis:
    """G(z): x⁺ = A·x + b·u held for a sample, y = c·x, u late by `delay` whole cycles."""

    a: Floats
    b: Floats
    c: Floats
    delay: int


def sampled_axis(axis: LinearAxis, timing: LoopTiming, dead_time: float | None = None) -> SampledAxis:
    """Exact discretisation; a broken part of the dead time is one state more (last cycle's torque)."""
    a, b, c = axis.state_space()
    h = timing.period
    dead = timing.dead_time if dead_time is None else dead_time
    whole = int(dead / h + 1e-9)
    late = max(dead - whole * h, 0.0)
    if late < 1e-6 * h:
        step, drive = _held(a, b, h)
        return SampledAxis(step, drive, c, whole)
    n = len(b)
    rest, new = _held(a, b, h - late)
    _, old = _held(a, b, late)
    whole_step, _ = _held(a, b, h)
    wide = np.zeros((n + 1, n + 1))
    wide[:n, :n], wide[:n, n] = whole_step, rest @ old
    return SampledAxis(wide, np.append(new, 1.0), np.append(c, 0.0), whole)


def _held(a: Floats, b: Floats, duration: float) -> tuple[Floats, Floats]:
    n = len(b)
    block = np.zeros((n + 1, n + 1))
    block[:n, :n], block[:n, n] = a, b
    exponential = scipy.linalg.expm(block * duration)
    return exponential[:n, :n], exponential[:n, n]


@cache
def frequencies(period: float) -> Floats:
    """From `LOWEST` to nearly half the sample rate [Hz], shape (POINTS,)."""
    return np.geomspace(LOWEST, 0.499 / period, POINTS)


def axis_response(axis: SampledAxis, period: float) -> Complexes:
    """G(z) at `frequencies`, shape (POINTS,)."""
    z = np.exp(2j * np.pi * frequencies(period) * period)
    n = len(axis.b)
    solved = np.linalg.solve(
        z[:, None, None] * np.eye(n) - axis.a, np.broadcast_to(axis.b, (len(z), n))[..., None]
    )
    return np.asarray((solved[..., 0] @ axis.c) * z ** (-axis.delay))


@lru_cache(maxsize=8)
def controller_response(gains: Gains, period: float) -> Complexes:
    """C(z)·N(z) from −y to u at `frequencies`, shape (POINTS,)."""
    back = np.exp(-2j * np.pi * frequencies(period) * period)
    values = gains.array(period)
    rate = values[3] / (1.0 - (1.0 - values[3]) * back) * (1.0 - back) / period
    law = values[0] + values[1] * rate + values[2] * period / (1.0 - back)
    notch = (values[6] + values[7] * back + values[8] * back**2) / (
        1.0 + values[9] * back + values[10] * back**2
    )
    return np.asarray(law * notch)


def closed_loop_radius(axis: SampledAxis, gains: Gains, period: float) -> float:
    """Largest magnitude of the closed loop's eigenvalues but the integral's own where there is none."""
    return float(np.max(np.abs(np.linalg.eigvals(_closed_loop(axis, gains, period)))))


def _closed_loop(axis: SampledAxis, gains: Gains, period: float) -> Floats:
    """States: axis (n), torques under way (d), derivative, last y, sum, notch (4). Reference 0."""
    n, d = len(axis.b), axis.delay
    kp, kd, ki, smooth, *_ = gains.array(period)[:4]
    notch = gains.array(period)[6:]
    size = n + d + 7
    at = n + d
    y = np.zeros(size)
    y[:n] = axis.c
    rate = np.zeros(size)  # d⁺ = (1 − α)·d + α·(last − y)/h
    rate[at], rate[at + 1] = 1.0 - smooth, smooth / period
    rate -= smooth / period * y
    total = -period * y
    total[at + 2] += 1.0
    raw = -kp * y + kd * rate + ki * total
    torque = notch[0] * raw
    torque[at + 3 : at + 7] += np.array([notch[1], notch[2], -notch[3], -notch[4]])
    m = np.zeros((size, size))
    m[:n, :n] = axis.a
    first = torque if d == 0 else np.eye(size)[n]
    m[:n] += np.outer(axis.b, first)
    for i in range(d):
        m[n + i] = np.eye(size)[n + i + 1] if i < d - 1 else torque
    m[at], m[at + 1] = rate, y
    if ki > 0.0:
        m[at + 2] = total
    m[at + 3], m[at + 4] = raw, np.eye(size)[at + 3]
    m[at + 5], m[at + 6] = torque, np.eye(size)[at + 5]
    return m


def margins(axis: SampledAxis, gains: Gains, period: float, response: Complexes | None = None) -> Margins:
    """Margins of one loop; `response` of the axis where it is known already."""
    plant = axis_response(axis, period) if response is None else response
    loop = plant * controller_response(gains, period)
    radius = closed_loop_radius(axis, gains, period)
    stable = radius < 1.0 - 1e-9
    size, angle = np.abs(loop), np.unwrap(np.angle(loop))
    crossings = _crossings(np.log(np.maximum(size, 1e-300)))
    phases = [_between(angle, k, part) for k, part in crossings]
    away = [math.degrees((phase + 2.0 * math.pi) % (2.0 * math.pi) - math.pi) for phase in phases]
    least = min((abs(one) for one in away), default=math.inf)
    up, down = _gain_margins(loop)
    highest = _between(np.log(frequencies(period)), *crossings[-1]) if crossings else math.nan
    return Margins(
        stable,
        radius,
        math.exp(highest) if crossings else math.nan,
        least if stable else -least,
        up if stable else -min(up, down),
        down,
        float(np.min(np.abs(1.0 + loop))),
    )


def _crossings(values: Floats) -> list[tuple[int, float]]:
    """Where a curve crosses 0: index before and part of the way to the next."""
    found = np.flatnonzero(np.diff(np.signbit(values)))
    return [(int(k), float(values[k] / (values[k] - values[k + 1]))) for k in found]


def _between(values: Floats, k: int, part: float) -> float:
    return float(values[k] + part * (values[k + 1] - values[k]))


def _gain_margins(loop: Complexes) -> tuple[float, float]:
    """By how many dB the gain may grow and fall until L meets −1."""
    up = down = math.inf
    for k, part in _crossings(loop.imag):
        real = _between(loop.real, k, part)
        if real < 0.0:
            room = -20.0 * math.log10(-real)
            if room >= 0.0:
                up = min(up, room)
            else:
                down = min(down, -room)
    return up, down


def torque_noise(gains: Gains, timing: LoopTiming) -> float:
    """Largest step of the torque demand that one count of the encoder makes: (kp + kd·α/h + ki·h)·Δ [N m]."""
    rate = gains.kd * gains.derivative_filter / timing.period
    return timing.resolution * (gains.kp + rate + gains.ki * timing.period)
