"""Friction between reference and slip: a fraction of exponential bristle, the rest of another family.

The stretch of every element is relative to Coulomb friction, so that one at its limit carries `level`/Coulomb.
Families of the rest: 0 slip elements with spread break-away, 1 a power of the way left (Dahl's exponent),
2 elastic, then plastic (Dupont). How large the rest may be is calibrated: see `sizes.other_family`.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from bench.worlds.names import FAMILY, OTHER, POWER, REACH, SPREAD

ELEMENTS = 8


@njit(cache=True)
def _slip(stretch: float, step: float, reach: float, level: float) -> float:
    """An element that follows, then slips at once; where its limit has fallen it follows that along the way."""
    moved = stretch + step / reach
    if abs(moved) <= level:
        return moved
    over = abs(stretch) - level
    left = over * math.exp(-2.0 * abs(step) / reach) if over > 0.0 and moved * stretch > 0.0 else 0.0
    return math.copysign(level + left, moved)


@njit(cache=True)
def _power(stretch: float, step: float, reach: float, level: float, power: float) -> float:
    sign = 1.0 if step >= 0.0 else -1.0
    way = 1.0 - sign * stretch / level
    if way <= 0.0:
        return sign * level * (1.0 - way * math.exp(-abs(step) / reach))
    moved = stretch + step / reach * way**power
    return math.copysign(level, step) if sign * moved > level else moved


@njit(cache=True)
def _plastic(stretch: float, step: float, reach: float, level: float) -> float:
    sign = 1.0 if step >= 0.0 else -1.0
    ratio = sign * stretch / level
    part = 0.0
    if ratio >= 1.0:
        part = 1.0
    elif ratio > 0.5:
        part = 0.5 + 0.5 * math.sin(math.pi * (ratio - 0.75) / 0.5)
    return stretch + step / reach * (1.0 - part * ratio)


@njit(cache=True)
def rub(p: np.ndarray, state: np.ndarray, step: float, level: float) -> float:
    """Moves all elements by `step`; the stretch of all together. `level` is relative to Coulomb friction."""
    reach, other = p[REACH], p[OTHER]
    sign = 1.0 if step >= 0.0 else -1.0
    steady = sign * level
    state[0] = steady + (state[0] - steady) * math.exp(-abs(step) / (reach * level))
    if other == 0.0:
        return state[0]
    if p[FAMILY] == 0.0:
        total = 0.0
        for i in range(ELEMENTS):
            own = reach * (1.0 + p[SPREAD] * (i / (ELEMENTS - 1.0) - 0.5)) * 1.4
            state[1 + i] = _slip(state[1 + i], step, own, level)
            total += state[1 + i]
        total /= ELEMENTS
    elif p[FAMILY] == 1.0:
        total = state[1] = _power(state[1], step, reach, level, p[POWER])
    else:
        total = state[1] = _plastic(state[1], step, 1.2 * reach, level)
    return (1.0 - other) * state[0] + other * total
