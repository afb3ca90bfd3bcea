"""Friction that changes as the axis warms: the lubricant thins, or preload grows.

One thermal mass is heated by the friction it produces: w' = (|F·v| + idle − w)/time_constant, in watt, and
all friction is multiplied by exp(−softening·w) (viscosity law of Reynolds).
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kernels, Kind, Parameter
from autotune.models.layout import block, flag, state_block
from autotune.models.look_alikes import IN_TIME
from autotune.models.start_values import StartContext, StartValues, Vary

_AT = block("thermal_drift")
WARMTH = state_block("thermal_drift")
WARMS = flag("thermal_drift")
BY_ITSELF = 5.0
"""Times the heat of friction: what comes from elsewhere, where an axis warms whether it moves or not."""


@compiled
def warm_factor(p: Floats, state: Floats) -> float:
    """What all friction is multiplied by."""
    return math.exp(min(max(-p[_AT] * state[WARMTH], -3.0), 3.0))


@compiled
def level_when_warm(p: Floats, state: Floats, position: float) -> float:
    """What the level of dry friction is multiplied by, at any position."""
    return warm_factor(p, state)


@compiled
def warm(p: Floats, state: Floats, power: float, duration: float) -> None:
    """Heats the axis with `power` [W] for `duration` [s]."""
    gain = duration / p[_AT + 1]
    state[WARMTH] = (state[WARMTH] + gain * (abs(power) + p[_AT + 2])) / (1.0 + gain)


def starts(c: StartContext) -> Iterator[StartValues]:
    """A fast and a slow warming by friction, and one by what is there at rest: motor, amplifier, the room."""
    power = c.coulomb * c.mean_speed
    for seconds, idle in ((20.0, 0.5), (90.0, 0.5), (40.0, BY_ITSELF)):
        heat = power * max(idle, 1.0)
        yield StartValues(
            {"softening": 0.0, "time_constant": seconds, "idle": idle * power},
            {
                "softening": Vary(0.1 / heat, 0.5 / heat),
                "time_constant": Vary(0.3 * seconds, 0.6 * seconds),
                "idle": Vary(heat, 2.0 * heat),
            },
        )


def time_constant(p: Floats) -> float:
    """Of the warming [s]."""
    return float(p[_AT + 1])


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
    look_alikes=(IN_TIME,),
    not_fed_forward="it depends on how warm the axis is, which the reference does not know",
    kernels=Kernels(level_factor=level_when_warm, viscous_factor=warm_factor),
    starts=starts,
    slow_change=time_constant,
    drifts=True,
)
