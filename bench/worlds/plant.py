"""The mechanics, one step: rigid, or motor and load behind a coupling. Velocity implicit in its damping.

State: 0 place, 1 speed, 2 load's place, 3 load's speed, 4 acceleration, 5 torque that presses, 6 time, 7 friction
torque, 8 the coupling's slow arm; from 10 elements of the motor's side, from 20 of the load's, from 30 of the memory,
40 warmth, 44 contact age, 46 aliens.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from bench.worlds.hysteresis import rub
from bench.worlds.laws import (
    aged,
    asymmetry,
    curved,
    faded,
    falling,
    pressed,
    pulled,
    remembered,
    ripple,
    tight,
    unbalanced,
    warmth,
)
from bench.worlds.names import (
    ASYMMETRY,
    BOUC_WEN,
    BREATHING,
    COULOMB,
    CRANK,
    CREEP,
    CURVED,
    DRAG,
    DWELL,
    ELASTIC,
    FADE_LAW,
    FADE_SPEED,
    GAP,
    HUMP,
    IMBALANCE,
    INERTIA,
    LIMIT,
    LOAD,
    LOAD_FRICTION,
    LOAD_INERTIA,
    LOW_LAW,
    LOW_SIZE,
    MEMORY,
    MICRO,
    OFFSET,
    PLACE,
    RIPPLE,
    SPRING,
    STRIBECK,
    SWIRL,
    THERMAL,
    TOP_SPEED,
    UNEVEN_OIL,
    VISCOUS,
)  # fmt: skip

STATES = 50
MOTOR, BEYOND, MEMORIES, WARM, AGE, ODD = 10, 20, 30, 40, 44, 46


@njit(cache=True)
def stranger(kind: int, e: np.ndarray, s: np.ndarray, v: float, step: float) -> float:
    """Torque of an alien that belongs to place, speed and acceleration."""
    x = s[0]
    if kind == CRANK:
        return e[0] * (s[4] * math.cos(e[1] * x) - 0.5 * e[1] * v * v * math.sin(e[1] * x)) / e[2]
    if kind == UNEVEN_OIL:
        return e[0] * v * math.sin(e[1] * x) / e[3]
    if kind == CREEP:
        s[ODD] += step / e[4] * (v - s[ODD])
        return e[0] * s[ODD] / e[3]
    if kind == HUMP:
        ratio = (abs(v) - 0.3 * e[3]) / (0.08 * e[3])
        return math.copysign(e[0] * math.exp(-ratio * ratio), v)
    if kind == DRAG:
        return e[0] * s[4] * abs(s[4]) / (e[2] * e[2])
    if kind == SWIRL:
        return e[0] * v * v * math.sin(e[1] * x) / (e[3] * e[3])
    if kind == BOUC_WEN:
        z = s[ODD]
        s[ODD] += step * v / e[5] * (1.0 - (0.8 * math.copysign(1.0, v * z) + 0.2) * abs(z) ** 1.5)
        return e[0] * s[ODD]
    return 0.0


@njit(cache=True)
def friction_level(
    p: np.ndarray, law: np.ndarray, e: np.ndarray, s: np.ndarray, x: float, v: float, step: float, alien: int,
    odd: np.ndarray,
) -> float:  # fmt: skip
    """Friction while sliding, over Coulomb friction."""
    level = p[COULOMB]
    if law[ASYMMETRY]:
        level *= 1.0 + asymmetry(law[ASYMMETRY], e[ASYMMETRY], v)
    if p[LOW_LAW] > 0.0:
        level += falling(int(p[LOW_LAW]), p[LOW_SIZE:], v)
    if law[STRIBECK]:
        level += falling(law[STRIBECK], e[STRIBECK], v)
    if law[DWELL]:
        level += aged(law[DWELL], e[DWELL], s[AGE:], v, abs(v) * step, step)
    if law[LOAD]:
        level += pressed(law[LOAD], e[LOAD], s[5], s[7], p[COULOMB])
    if law[PLACE]:
        level *= tight(law[PLACE], e[PLACE], x)
    if alien == BREATHING:
        level *= 1.0 + odd[0] / p[COULOMB] * math.sin(odd[6] * s[6])
    return max(level / p[COULOMB], 0.05)


@njit(cache=True)
def micro(p: np.ndarray, v: float, rest: float) -> float:
    """Damping of presliding at a speed; `rest`: part of the way to its level that the contact has yet to be bent.

    It drives only where friction falls with speed in the base, as in the textbook's equation.
    """
    if rest < 0.0 and p[LOW_LAW] == 0.0:
        return 0.0
    return rest * faded(int(p[FADE_LAW]), p[MICRO], p[FADE_SPEED], v)


@njit(cache=True)
def warm_factor(
    p: np.ndarray, law: np.ndarray, e: np.ndarray, s: np.ndarray, drive: float, step: float
) -> float:
    if law[THERMAL] == 0:
        return 1.0
    heat = abs(s[7] * s[1]) / (0.15 * p[COULOMB] * p[TOP_SPEED])
    copper = (drive / (0.3 * p[LIMIT])) ** 2
    return warmth(law[THERMAL], e[THERMAL], s[WARM:], s[6], heat, copper, step)


@njit(cache=True)
def placed(
    p: np.ndarray, law: np.ndarray, e: np.ndarray, waves: np.ndarray, s: np.ndarray, step: float, alien: int,
    odd: np.ndarray,
) -> float:  # fmt: skip
    """Torque needed beside inertia and the base's friction."""
    x, v = s[0], s[1]
    total = p[OFFSET]
    if law[RIPPLE]:
        total += ripple(law[RIPPLE], e[RIPPLE, 0], waves, x)
    if law[IMBALANCE]:
        total += unbalanced(law[IMBALANCE], e[IMBALANCE], x)
    if law[SPRING]:
        total += pulled(law[SPRING], e[SPRING], x)
    if law[CURVED]:
        total += curved(law[CURVED], e[CURVED], v)
    if law[MEMORY]:
        total += remembered(law[MEMORY], e[MEMORY], s[MEMORIES:], step * v)
    if alien:
        total += stranger(alien, odd, s, v, step)
    return total


@njit(cache=True)
def rigid(
    p: np.ndarray, law: np.ndarray, e: np.ndarray, waves: np.ndarray, s: np.ndarray, drive: float, outer: float,
    step: float, alien: int, odd: np.ndarray,
) -> None:  # fmt: skip
    """One step of one mass, in place; `outer` acts beside the drive."""
    x, v = s[0], s[1]
    warm = warm_factor(p, law, e, s, drive, step)
    level = warm * friction_level(p, law, e, s, x, v, step, alien, odd)
    z = rub(p, s[MOTOR:], step * v, level)
    sign = 1.0 if v >= 0.0 else -1.0
    damping = warm * p[VISCOUS] + micro(p, v, 1.0 - sign * z / level)
    beside = placed(p, law, e, waves, s, step, alien, odd)
    later = (p[INERTIA] * v + step * (drive + outer - p[COULOMB] * z - beside)) / (
        p[INERTIA] + step * damping
    )
    s[4] = (later - v) / step
    s[0], s[1] = x + step * later, later
    s[7] = p[COULOMB] * z + damping * later
    s[5] += (p[INERTIA] * s[4] + beside - s[5]) * step / (step + 5e-4)
    s[6] += step


@njit(cache=True)
def passed(law: np.ndarray, e: np.ndarray, s: np.ndarray, step: float) -> float:
    """Torque from motor to load.

    Elastic, e: 0 compliance, 1 damping, 2 twist at which it is twice as stiff or the arm's share, 3 the arm's time.
    Gap, e: 0 gap, 1 stiffness, 2 damping. Laws: hardening; a Zener arm; Hunt and Crossley; a gap full of grease.
    """
    twist, rate = s[0] - s[2], s[1] - s[3]
    if law[ELASTIC]:
        c = e[ELASTIC]
        if law[ELASTIC] == 1:
            return twist / c[0] * (1.0 + (twist / c[2]) ** 2) + c[1] * rate
        s[8] = (s[8] + step * rate) / (1.0 + step / c[3])
        return twist / c[0] + c[2] / c[0] * s[8]
    c = e[GAP]
    depth = abs(twist) - 0.5 * c[0]
    sign = 1.0 if twist >= 0.0 else -1.0
    if law[GAP] == 1:
        return sign * c[1] * depth * max(1.0 + c[2] * sign * rate, 0.0) if depth > 0.0 else 0.0
    if depth > 0.0:
        return sign * max(c[1] * depth + c[3] * sign * rate, 0.0)
    return 0.02 * c[3] * rate


@njit(cache=True)
def coupled(
    p: np.ndarray, law: np.ndarray, e: np.ndarray, waves: np.ndarray, s: np.ndarray, drive: float, outer: float,
    step: float, alien: int, odd: np.ndarray,
) -> None:  # fmt: skip
    """One step of motor and load, in place. Friction is split; the constant load hangs at the load."""
    warm = warm_factor(p, law, e, s, drive, step)
    part = p[LOAD_FRICTION]
    through = passed(law, e, s, step)
    level = warm * friction_level(p, law, e, s, s[0], s[1], step, alien, odd)
    z = rub(p, s[MOTOR:], step * s[1], level)
    sign = 1.0 if s[1] >= 0.0 else -1.0
    damping = (1.0 - part) * (warm * p[VISCOUS] + micro(p, s[1], 1.0 - sign * z / level))
    beside = placed(p, law, e, waves, s, step, alien, odd) - p[OFFSET]
    inertia = p[INERTIA] * (1.0 - p[LOAD_INERTIA])
    pull = drive + outer - through - (1.0 - part) * p[COULOMB] * z - beside
    later = (inertia * s[1] + step * pull) / (inertia + step * damping)
    s[7] = (1.0 - part) * p[COULOMB] * z + damping * later
    z = rub(p, s[BEYOND:], step * s[3], level)
    sign = 1.0 if s[3] >= 0.0 else -1.0
    damping = part * (warm * p[VISCOUS] + micro(p, s[3], 1.0 - sign * z / level))
    inertia = p[INERTIA] * p[LOAD_INERTIA]
    beyond = (inertia * s[3] + step * (through - part * p[COULOMB] * z - p[OFFSET])) / (
        inertia + step * damping
    )
    s[4] = (later - s[1]) / step
    s[5] += (through - s[5]) * step / (step + 5e-4)
    s[0], s[1] = s[0] + step * later, later
    s[2], s[3] = s[2] + step * beyond, beyond
    s[6] += step
