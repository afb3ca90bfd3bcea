"""Where a piece begins: its motion, and the bristle that explains its first torques.

For a motion that was measured, the bristle of (5.8) is affine in its start, z(t) = a(t) + b(t)·z0. So the
mean torque of the first moments gives z0 by one division, also where the piece begins with a reversal
and the bristle unwinds all the while.
"""

from __future__ import annotations

import math

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.models import layout
from autotune.models.compiled import compiled
from autotune.models.contact import additive, friction_limit, viscous_coefficient
from autotune.models.drive_model import Packed
from autotune.models.layout import MICRO_DAMPING, STIFFNESS

START_SECONDS = 0.02
LEAST_SHARE = 0.05
"""Of the stiffness: below, the start is forgotten so soon that its torque says nothing about it."""


@compiled
def first_friction(
    p: Floats, on: Flags, state: Floats, position: Floats, velocity: Floats, period: float
) -> tuple[float, float]:
    """Mean friction over the rows given as A + B·z0; arrays of shape (n,), steps as in `required`."""
    a, b, level, slope = 0.0, 1.0, 0.0, 0.0
    before = velocity[0]
    for k in range(len(velocity)):
        q, v = position[k], velocity[k]
        mean = 0.5 * (before + v)
        before = v
        limit = friction_limit(p, on, state, q, mean)
        left = math.exp(-abs(mean) * period / limit)
        a = math.copysign(limit, mean) * (1.0 - left) + left * a
        b *= left
        drag = p[MICRO_DAMPING] * abs(v) / friction_limit(p, on, state, q, v)
        level += (p[STIFFNESS] - drag) * a + (p[MICRO_DAMPING] + viscous_coefficient(p, on, state, v)) * v
        slope += (p[STIFFNESS] - drag) * b
    return level / len(velocity), slope / len(velocity)


def starting_state(
    packed: Packed, torque: Floats, position: Floats, velocity: Floats, acceleration: Floats, period: float
) -> Floats:
    """State at the first row: the bristle carries what balances the first torques, at most friction.

    Arrays of shape (n,), of the whole piece or of its beginning.
    """
    p, on = packed.p, packed.on
    state = np.zeros(layout.STATES)
    first = slice(0, max(2, round(START_SECONDS / period)))
    outside = additive(p, on, float(np.mean(position[first])))
    spare = float(np.mean(torque[first])) - p[layout.INERTIA] * float(np.mean(acceleration[first])) - outside
    level, slope = first_friction(p, on, state, position[first], velocity[first], period)
    limit = friction_limit(p, on, state, float(position[0]), float(np.mean(velocity[first])))
    told = slope > LEAST_SHARE * p[STIFFNESS]
    bristle = (spare - level) / slope if told else math.copysign(limit, float(velocity[0]))
    state[layout.POSITION], state[layout.VELOCITY] = position[0], velocity[0]
    state[layout.BRISTLE] = min(max(bristle, -limit), limit)
    return state
