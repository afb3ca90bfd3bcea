"""Friction that changes as the axis warms: the lubricant thins, or preload grows.

One thermal mass is heated by the friction it produces: w' = (|F·v| + idle − w)/time_constant, in watt, and
all friction is multiplied by exp(−softening·w) (viscosity law of Reynolds).
"""

from __future__ import annotations

import math

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kind, Parameter
from autotune.models.layout import block, state_block

_AT = block("thermal_drift")
WARMTH = state_block("thermal_drift")

THERMAL_DRIFT = Kind(
    name="thermal_drift",
    parameters=(
        Parameter("softening", "1/W", 0.0, -1e6, 1e6, "relative loss of friction per watt of heating", _AT),
        Parameter("time_constant", "s", 60.0, 0.5, 1e5, "of the warming", _AT + 1),
        Parameter("idle", "W", 0.0, 0.0, 1e6, "heat that is there at rest: motor and amplifier", _AT + 2),
    ),
    looks_like="The same motion needs less and less (or more and more) torque from repeat to repeat.",
    cause="Lubricant that thins as bearings, screw or gear warm; preload that grows with warming.",
    remedy="Warm up before precise work; check the grade of the lubricant; recheck when the axis is warm.",
)


@compiled
def warm_factor(p: Floats, state: Floats) -> float:
    """What all friction is multiplied by."""
    return math.exp(min(max(-p[_AT] * state[WARMTH], -3.0), 3.0))


@compiled
def warm(p: Floats, state: Floats, power: float, duration: float) -> None:
    """Heats the axis with `power` [W] for `duration` [s]."""
    gain = duration / p[_AT + 1]
    state[WARMTH] = (state[WARMTH] + gain * (abs(power) + p[_AT + 2])) / (1.0 + gain)
