"""The drive loop: current loop, velocity filter, PID or P-PI at the drive's rate, set points between cycles.

A tick is one period of the drive's loop (62.5 to 125 µs); a cycle holds some ticks and gives one row.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from bench.worlds.laws import misread, weakened
from bench.worlds.names import (
    ACCEL_FEED,
    CASCADE,
    CUBIC,
    CURRENT_TAU,
    DEAD,
    ECCENTRIC,
    ELASTIC,
    FILTER,
    GAP,
    HOST_PID,
    INERTIA,
    KD,
    KI,
    KIND,
    KP,
    LAG,
    LIMIT,
    MISSING_CODES,
    RESOLUTION,
    SATURATION,
    SPEED_FEED,
    SUBSAMPLE,
)  # fmt: skip
from bench.worlds.plant import STATES, coupled, rigid

LAG_TICKS = 512


@njit(cache=True)
def read(p: np.ndarray, law: np.ndarray, e: np.ndarray, place: float, alien: int, odd: np.ndarray) -> float:
    """What the encoder tells."""
    told = place
    if law[ECCENTRIC]:
        told += misread(law[ECCENTRIC], e[ECCENTRIC], place)
    if alien == MISSING_CODES:
        cell = math.floor(told / odd[7])
        told = max(told, cell * odd[7] + odd[0] * odd[8])
    if p[RESOLUTION] > 0.0:
        told = math.floor(told / p[RESOLUTION] + 0.5) * p[RESOLUTION]
    return told


@njit(cache=True)
def late(law: int, e: np.ndarray, ring: np.ndarray, at: int, tick: float, torque: float) -> float:
    """The torque path's lag. 1: a pure delay; 2: two poles; 3: a moving mean. `ring`: past torques, 2 states last."""
    size = e[0]
    ring[at % LAG_TICKS] = torque
    if law == 1:
        back = size / tick
        whole = int(back)
        part = back - whole
        return ring[(at - whole) % LAG_TICKS] * (1.0 - part) + ring[(at - whole - 1) % LAG_TICKS] * part
    if law == 2:
        rate = tick / (0.5 * size)
        ring[LAG_TICKS] += (1.0 - math.exp(-rate)) * (torque - ring[LAG_TICKS])
        ring[LAG_TICKS + 1] += (1.0 - math.exp(-rate)) * (ring[LAG_TICKS] - ring[LAG_TICKS + 1])
        return ring[LAG_TICKS + 1]
    width = 2.0 * size / tick
    whole = int(width)
    total = 0.0
    for i in range(whole):
        total += ring[(at - i) % LAG_TICKS]
    total += (width - whole) * ring[(at - whole) % LAG_TICKS]
    return total / width


@njit(cache=True)
def host(c: np.ndarray, mem: np.ndarray, ref: float, told: float, period: float, limit: float) -> float:
    """The recorded PID form, at the cycle. mem: 0 sum, 1 rate, 2 last reference, 3 last reading."""
    error = ref - told
    change = (ref - mem[2] - told + mem[3]) / period
    mem[1] += c[FILTER] * (change - mem[1])
    demand = c[KP] * error + c[KD] * mem[1] + c[KI] * (mem[0] + error * period)
    if abs(demand) <= limit:
        mem[0] += error * period
    mem[2], mem[3] = ref, told
    return min(max(demand, -limit), limit)


@njit(cache=True)
def inside(
    c: np.ndarray, mem: np.ndarray, ref: float, push: float, told: float, tick: float, limit: float
) -> float:
    """The drive's own loop, every tick. mem: 0 sum, 1 filtered speed, 2, 3 as above, 4 speed asked, 5 tick number."""
    rate = (told - mem[3]) / tick
    asked = (ref - mem[2]) / tick
    mem[3], mem[2] = told, ref
    blend = 1.0 - math.exp(-tick * c[FILTER])
    error = ref - told
    if c[KIND] == CASCADE:
        mem[1] += blend * (rate - mem[1])
        mem[6] += blend * (asked - mem[6])
        if mem[5] % c[SUBSAMPLE] == 0.0:
            mem[4] = c[KP] * error + c[SPEED_FEED] * mem[6]
        lack = mem[4] - mem[1]
        demand = c[KD] * lack + c[KI] * (mem[0] + lack * tick) + push
        gain = lack
    else:
        mem[1] += blend * (c[SPEED_FEED] * asked - rate - mem[1])
        demand = c[KP] * error + c[KD] * mem[1] + c[KI] * (mem[0] + error * tick) + push
        gain = error
    mem[5] += 1.0
    if abs(demand) <= limit:
        mem[0] += gain * tick
    return min(max(demand, -limit), limit)


@njit(cache=True)
def between(reference: np.ndarray, k: int, part: float, cubic: bool) -> float:
    """The set point on the way to row k, from the row before it; cubic (Catmull and Rom), row k + 1 must be known."""
    one, two = reference[max(k - 1, 0)], reference[max(k, 0)]
    if not cubic:
        return one + part * (two - one)
    zero, three = reference[max(k - 2, 0)], reference[min(max(k + 1, 0), len(reference) - 1)]
    a = 2.0 * one
    b = two - zero
    d = 2.0 * zero - 5.0 * one + 4.0 * two - three
    f = 3.0 * (one - two) + three - zero
    return 0.5 * (a + part * (b + part * (d + part * f)))


@njit(cache=True)
def play(
    p: np.ndarray, c: np.ndarray, law: np.ndarray, e: np.ndarray, waves: np.ndarray, alien: int, odd: np.ndarray,
    reference: np.ndarray, late_by: np.ndarray, tick: float, substeps: int, nominal: int, disturbance: np.ndarray,
    out: np.ndarray,
) -> int:  # fmt: skip
    """Plays the reference.

    Args:
        late_by: ticks after a cycle's begin at which its row is written, shape (n,); `nominal` ticks a cycle.
        disturbance: torque at 1 kHz, beside the drive's.
        out: (6, n): reading, demand at the row, motor torque at the row, its mean over the cycle before, place, speed.

    Returns:
        rows played; fewer than n where the loop ran away.
    """
    s = np.zeros(STATES)
    s[0] = s[2] = reference[0]
    mem, ring = np.zeros(8), np.zeros(LAG_TICKS + 2)
    mem[2] = mem[3] = reference[0]
    old = np.full(4, reference[0])
    kind, dead, limit = int(c[KIND]), int(c[DEAD]), p[LIMIT]
    two = law[ELASTIC] > 0 or law[GAP] > 0
    step, keep, cycle = tick / substeps, math.exp(-tick / p[CURRENT_TAU]), nominal * tick
    demand, motor, mean, count = 0.0, 0.0, 0.0, 0
    for k in range(len(reference)):
        told = read(p, law, e, s[0], alien, odd)
        old[k % 4] = told
        out[3, k] = mean
        mean, push = 0.0, 0.0
        at = max(k - dead - (1 if kind != HOST_PID and c[CUBIC] > 0.0 else 0), 0)
        if kind == HOST_PID:
            demand = host(c, mem, reference[at], old[at % 4], cycle, limit)
        elif c[ACCEL_FEED] != 0.0 and at >= 2:
            bend = (reference[at] - 2.0 * reference[at - 1] + reference[at - 2]) / (cycle * cycle)
            push = c[ACCEL_FEED] * p[INERTIA] * bend
        for t in range(nominal):
            if kind != HOST_PID:
                ref = between(reference, at, (t + 1.0) / nominal, c[CUBIC] > 0.0)
                told = read(p, law, e, s[0], alien, odd)
                demand = inside(c, mem, ref, push, told, tick, limit)
            if t == late_by[k]:
                out[0, k], out[1, k], out[2, k] = read(p, law, e, s[0], alien, odd), demand, motor
                out[4, k], out[5, k] = s[0], s[1]
            motor = demand + (motor - demand) * keep
            mean += motor / nominal
            drive = weakened(law[SATURATION], e[SATURATION], motor) if law[SATURATION] else motor
            if law[LAG]:
                drive = late(law[LAG], e[LAG], ring, count, tick, drive)
            count += 1
            moment = count * tick * 1000.0
            index = min(int(moment), len(disturbance) - 2)
            outer = disturbance[index] + (moment - index) * (disturbance[index + 1] - disturbance[index])
            for _ in range(substeps):
                if two:
                    coupled(p, law, e, waves, s, drive, outer, step, alien, odd)
                else:
                    rigid(p, law, e, waves, s, drive, outer, step, alien, odd)
        if not abs(s[1]) < 1e7:
            return k
    return len(reference)
