"""The control laws of the catalogue in the loop of one axis, as the thesis's Appendix B plays them.

    feedforward   u = PID + J·r̈ + σ2·ṙ + F_g + friction(ṙ)                        (5.1), (5.2)
    linearisation u = PID + J·r̈ + friction(q̇, ẑ) + F_g                            (5.34), (5.39)
    ẑ from        ẑ' = q̇ − |q̇|/g·ẑ + k·(r − q)                                   (5.17), k = 0 for an open observer
                  ξ' = f(ξ + L·q) + u/J − L·q̇̂                                     (5.23), (5.29) with v_l of (5.30),
                                                                                  (5.32)–(5.33)

Velocities are backward differences of the measured position, those of the reference central ones; σ2 acts on the
reference's velocity in the feedback laws too, and sign has the dead zone of (3.7).
"""

from __future__ import annotations

import math

from autotune.control.adaptation import _adapt as adapt_step
from autotune.control.feedforward import advance as feedforward_step
from autotune.control.feedforward import stribeck_level
from autotune.control.gains.twin import RUNAWAY, pass_time
from autotune.core.arrays import Flags, Floats
from autotune.models.compiled import compiled
from autotune.models.layout import POSITION, VELOCITY

PID, KINETIC_FEEDFORWARD, LUGRE_FEEDFORWARD, ADAPTIVE_FEEDFORWARD, PLAYED_FEEDFORWARD = range(5)
LUND_GRENOBLE, LUENBERGER, LUENBERGER_SLOWED, LUENBERGER_EXACT, KINETIC_LINEARISED, LUGRE_LINEARISED = range(
    5, 11
)
FEEDBACK_LAWS = range(LUND_GRENOBLE, LUGRE_LINEARISED + 1)
CORRECTION, L1, DAMPING, SLOW_SPEED, DEAD_ZONE = range(5)
"""Places in the vector of a law's own numbers: k of (5.17), l1, velocity gain on q̇̂, v_l of (5.30), zone of (3.7)."""


@compiled
def direction(velocity: float, zone: float) -> float:
    """Sign with Karnopp's zone (3.7)."""
    if abs(velocity) <= zone:
        return 0.0
    return math.copysign(1.0, velocity)


@compiled
def kinetic(f: Floats, velocity: float, push: float, zone: float) -> float:
    """σ0·g(v)·sign v, and F_s in the direction of `push` at rest: (5.1), (5.34) [N m]."""
    sign = direction(velocity, zone)
    if sign == 0.0:
        return float(f[6] * direction(push, 0.0))
    return float(stribeck_level(f, velocity) * sign)


@compiled
def bristle_after(f: Floats, z: float, velocity: float, push: float, period: float) -> float:
    """ẑ a sample later for a constant velocity (5.8); `push` is what is integrated beside the decay."""
    if velocity == 0.0:
        return float(z + period * push)
    limit = stribeck_level(f, velocity) / f[3]
    decay = math.exp(-abs(velocity) / limit * period)
    return float(decay * z + (1.0 - decay) * limit / abs(velocity) * (velocity + push))


@compiled
def observer_step(
    kind: int, f: Floats, x: Floats, seen: Floats, q: float, torque: float, period: float
) -> None:
    """Luenberger-like observers; `seen` is [ξ1, ξ2 = ẑ (l2 = 0)] and is updated."""
    velocity, z = seen[0] + x[L1] * q, seen[1]
    limit = stribeck_level(f, velocity) / f[3]
    rate = velocity - abs(velocity) / limit * z
    force = f[3] * z + f[4] * rate + f[1] * velocity + f[5]
    seen[0] += period * ((torque - force) / f[0] - x[L1] * velocity)
    if kind == LUENBERGER_EXACT:
        seen[1] = bristle_after(f, z, velocity, 0.0, period)
    elif kind == LUENBERGER_SLOWED:
        seen[1] += period * rate / (1.0 + abs(velocity) / x[SLOW_SPEED])
    else:
        seen[1] += period * rate


@compiled
def compensation(
    kind: int,
    f: Floats,
    x: Floats,
    seen: Floats,
    q: float,
    slope: float,
    feedback: float,
    ref: Floats,
    period: float,
) -> float:
    """What a law adds to the PID's torque; `ref` is [r, ṙ, r̈], `slope` the measured velocity."""
    rate, change = ref[1], ref[2]
    if kind == KINETIC_FEEDFORWARD:
        return float(f[0] * change + f[1] * rate + f[5] + stribeck_level(f, rate) * direction(rate, 1e-9))
    if kind in (LUGRE_FEEDFORWARD, ADAPTIVE_FEEDFORWARD):
        return feedforward_step(f, seen, rate, change, period)
    base = f[0] * change + f[1] * rate + f[5]
    if kind == KINETIC_LINEARISED:
        return float(base + kinetic(f, slope, feedback + f[0] * change, x[DEAD_ZONE]))
    if kind in (LUND_GRENOBLE, LUGRE_LINEARISED):
        z = seen[0]
        force = f[3] * z - f[4] * z * abs(slope) * f[3] / stribeck_level(f, slope) + f[4] * rate
        correction = x[CORRECTION] * (ref[0] - q) if kind == LUND_GRENOBLE else 0.0
        seen[0] = bristle_after(f, z, slope, correction, period)
        return float(base + force)
    velocity, z = seen[0] + x[L1] * q, seen[1]
    bend = velocity - abs(velocity) * f[3] / stribeck_level(f, velocity) * z
    return float(base + f[3] * z + f[4] * bend + x[DAMPING] * (rate - velocity))


@compiled
def run_structure(
    p: Floats,
    on: Flags,
    state: Floats,
    c: Floats,
    loop: Floats,
    held: Floats,
    parts: int,
    kind: int,
    f: Floats,
    x: Floats,
    seen: Floats,
    law: Floats,
    reference: Floats,
    played: Floats,
    position: Floats,
    torque: Floats,
) -> int:
    """The loop sample by sample, as `gains.twin.run_loop`, with a law of the catalogue.

    Args:
        c: kp, kd, ki, α, and both weights of the reference, as `Gains.array` has them; no notch.
        f: LuGre's parameters in the order of `LugreParameters`, adapted in place by the adaptive law.
        x: the law's own numbers; seen: its states, shape (2,).
        law: gains and bounds of adaptation: three gains, three lower, three upper bounds; shape (9,).
        reference: r, ṙ, r̈; shape (n, 3). played: torque beside the law [N m], shape (n,).
    """
    period, limit, resolution, dead = loop[0], loop[1], loop[2], loop[3]
    whole = int(dead / period + 1e-9)
    late = max(dead - whole * period, 0.0)
    depth = len(held)
    total, smooth, last_r, last_y = loop[4], loop[5], loop[6], loop[7]
    for k in range(len(reference)):
        y = state[POSITION]
        if resolution > 0.0:
            y = math.floor(y / resolution + 0.5) * resolution
        error, slope = reference[k, 0] - y, (y - last_y) / period
        smooth += c[3] * (c[5] * (reference[k, 0] - last_r) / period - slope - smooth)
        feedback = c[0] * (c[4] * reference[k, 0] - y) + c[1] * smooth + c[2] * (total + error * period)
        demand = feedback + played[k]
        if kind not in (PID, PLAYED_FEEDFORWARD):
            demand += compensation(kind, f, x, seen, y, slope, feedback, reference[k], period)
        if abs(demand) <= limit:
            total += error * period
        demand = min(max(demand, -limit), limit)
        if kind == ADAPTIVE_FEEDFORWARD:
            adapt_step(f, seen, law[:3], law[3:6], law[6:], feedback, period)
        if LUENBERGER <= kind <= LUENBERGER_EXACT:
            observer_step(kind, f, x, seen, y, demand, period)
        last_r, last_y = reference[k, 0], y
        position[k], torque[k] = y, demand
        for i in range(depth - 1):
            held[i] = held[i + 1]
        held[depth - 1] = demand
        pass_time(p, on, state, held[depth - 2 - whole], held[depth - 1 - whole], late, period, parts)
        if not (abs(state[VELOCITY]) < RUNAWAY and abs(seen[0]) < 1e12):
            return k
    return len(reference)
