"""The laws of the effects in these worlds, each at least two and none the library's.

Every function takes the effect's law (0: not there) and its parameters `e`, whose first is the size. Torques in N m or
N, motor side; speeds and places in the motion unit.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from bench.worlds.names import WAVES


@njit(cache=True)
def ripple(law: int, size: float, waves: np.ndarray, place: float) -> float:
    """1: a sum of sines; 2: narrow humps (von Mises) a pitch apart; 3: flat-topped waves."""
    total = 0.0
    for i in range(WAVES):
        if waves[i, 0] == 0.0:
            break
        angle = waves[i, 1] * place + waves[i, 2]
        if law == 1:
            total += waves[i, 0] * math.sin(angle)
        elif law == 2:
            total += waves[i, 0] * (math.exp(2.0 * (math.cos(angle) - 1.0)) - 0.3085)
        else:
            total += waves[i, 0] * math.tanh(1.5 * math.sin(angle))
    return size * total


@njit(cache=True)
def asymmetry(law: int, e: np.ndarray, speed: float) -> float:
    """Relative to the friction level. 1: a sigmoid of speed; 2: grows on with speed."""
    if law == 1:
        return e[0] * math.tanh(speed / e[1])
    return e[0] * (0.6 * math.tanh(speed / e[1]) + 0.4 * speed / (abs(speed) + e[2]))


@njit(cache=True)
def falling(law: int, e: np.ndarray, speed: float) -> float:
    """What break-away is above Coulomb friction. 1: Lorentz; 2: Tustin with an exponent; 3: hyperbola."""
    ratio = abs(speed) / e[1]
    if law == 1:
        return e[0] / (1.0 + ratio * ratio)
    if law == 2:
        return e[0] * math.exp(-(ratio ** e[2]))
    return e[0] / (1.0 + 2.0 * ratio)


@njit(cache=True)
def faded(law: int, damping: float, at: float, speed: float) -> float:
    """Damping of presliding at a speed. 1: Canudas de Wit and Åström's exponential; 2: a rational one."""
    ratio = speed / at
    if law == 1:
        return damping * math.exp(-ratio * ratio)
    if law == 2:
        return damping / (1.0 + ratio * ratio)
    return damping


@njit(cache=True)
def curved(law: int, e: np.ndarray, speed: float) -> float:
    """1: Eyring's film (asinh); 2: windage above a speed; 3: a film that shears off (hyperbola)."""
    size = abs(speed)
    if law == 1:
        torque = e[0] * math.asinh(size / e[1]) / math.asinh(e[2] / e[1])
    elif law == 2:
        over = max(size - e[1], 0.0) / (e[2] - e[1])
        torque = e[0] * over * over
    else:
        torque = e[0] * size / (size + e[1])
    return math.copysign(torque, speed)


@njit(cache=True)
def tight(law: int, e: np.ndarray, place: float) -> float:
    """Factor of friction. 1: a stretch with two flanks; 2: a roof; 3: wear towards both ends."""
    if law == 1:
        rise = 0.5 * (math.tanh((place - e[1]) / e[3]) - math.tanh((place - e[2]) / e[3]))
    elif law == 2:
        rise = max(1.0 - abs(place - e[1]) / e[2], 0.0)
    else:
        rise = ((place - e[1]) / e[2]) ** 2
    return max(1.0 + e[0] * rise, 0.1)


@njit(cache=True)
def unbalanced(law: int, e: np.ndarray, place: float) -> float:
    """1: a mass whose lever changes over the turn; 2: a mass at a crank's rod."""
    angle = e[1] * place + e[2]
    if law == 1:
        return e[0] * math.sin(angle) * (1.0 + e[3] * math.cos(angle))
    sine = math.sin(angle)
    return e[0] * sine * (1.0 + e[3] * math.cos(angle) / math.sqrt(1.0 - (e[3] * sine) ** 2))


@njit(cache=True)
def pulled(law: int, e: np.ndarray, place: float) -> float:
    """1: a spring that hardens; 2: a hose that gives way; 3: a buffer that is met on the way."""
    ratio = place / e[1]
    if law == 1:
        return e[0] * ratio * (1.0 + e[2] * ratio * ratio)
    if law == 2:
        return e[0] * math.tanh(e[2] * ratio) / math.tanh(e[2])
    return e[0] * max(ratio - e[2], 0.0)


@njit(cache=True)
def remembered(law: int, e: np.ndarray, state: np.ndarray, step: float) -> float:
    """1: three endochronic elements; 2: a Prandtl–Ishlinskii sum of ten with a curved output."""
    total = 0.0
    if law == 1:
        for i in range(3):
            reach = e[1] * e[2] ** i
            sign = 1.0 if step >= 0.0 else -1.0
            state[i] = sign + (state[i] - sign) * math.exp(-abs(step) / reach)
            total += state[i] / 3.0
        return e[0] * total
    weight = 0.0
    for i in range(10):
        reach = e[1] * e[2] ** (2.0 * i / 9.0)
        state[i] = min(max(state[i] + step / reach, -1.0), 1.0)
        share = reach ** (-e[3])
        weight += share
        total += share * state[i]
    total /= weight
    return e[0] * total * (1.0 + 0.35 * abs(total)) / 1.35


@njit(cache=True)
def warmth(
    law: int, e: np.ndarray, state: np.ndarray, time: float, rub: float, copper: float, step: float
) -> float:
    """Factor of friction. 1: two thermal masses, thins; 2: the room warms; 3: preload grows with copper loss.

    `rub` and `copper` are relative powers (1 in hard use).
    """
    if law == 1:
        state[0] += step / e[1] * (rub + 0.3 * copper - state[0])
        state[1] += step / e[2] * (state[0] - state[1])
        return 1.0 / (1.0 + e[0] * (0.5 * state[0] + 0.5 * state[1]))
    if law == 2:
        return 1.0 - e[0] * (1.0 - math.exp(-time / e[1]))
    state[0] += step / e[1] * (copper + 0.3 * rub - state[0])
    return 1.0 + e[0] * state[0]


@njit(cache=True)
def aged(law: int, e: np.ndarray, state: np.ndarray, speed: float, slip: float, step: float) -> float:
    """Torque. 1: logarithm of the time at rest; 2: Dieterich–Ruina's contact age; 3: cube root of the rest."""
    if law == 2:
        rate = abs(speed) / e[2]
        state[0] = (state[0] + step) / (1.0 + step * rate)
        return e[0] * math.log1p(state[0] / e[1]) / math.log1p(2.5 / e[1])
    if abs(speed) < e[3]:
        state[0] += step
    else:
        state[0] *= math.exp(-slip / e[2])
    if law == 1:
        return e[0] * math.log1p(state[0] / e[1]) / math.log1p(2.5 / e[1])
    return e[0] * min((state[0] / 2.5) ** (1.0 / 3.0), 1.2)


@njit(cache=True)
def pressed(law: int, e: np.ndarray, torque: float, friction: float, coulomb: float) -> float:
    """Torque. 1: flanks with preload; 2: root of squares; 3: less a part of friction; 4: Hertz's power."""
    if law == 1:
        return e[0] * max(abs(torque) - e[1], 0.0)
    if law == 2:
        return math.sqrt(coulomb * coulomb + (e[0] * torque) ** 2) - coulomb
    if law == 3:
        return e[0] * abs(torque - 0.7 * friction)
    return e[0] * abs(torque) ** (2.0 / 3.0) * e[1] ** (1.0 / 3.0)


@njit(cache=True)
def misread(law: int, e: np.ndarray, place: float) -> float:
    """Error of the reading. 1: a disc off centre, exactly; 2: off centre and tilted."""
    angle = e[1] * place + e[2]
    if law == 1:
        return math.atan2(e[0] * e[1] * math.sin(angle), 1.0 + e[0] * e[1] * math.cos(angle)) / e[1]
    return e[0] * (math.sin(angle) + e[3] * math.sin(2.0 * angle + 1.0))


@njit(cache=True)
def weakened(law: int, e: np.ndarray, torque: float) -> float:
    """What a torque demand gives. 1: tanh; 2: a knee; 3: Fröhlich's iron with a cube."""
    size = abs(torque)
    if law == 1:
        size = e[1] * math.tanh(size / e[1])
    elif law == 2:
        size = min(size, e[1]) + e[2] * max(size - e[1], 0.0)
    else:
        size = size / (1.0 + (size / e[1]) ** 3) ** (1.0 / 3.0)
    return math.copysign(size, torque)
