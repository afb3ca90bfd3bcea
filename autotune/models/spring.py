"""Torque in proportion to position: a counterbalance spring, a cable, a hose, a bellows.

One that is not straight is a sum of ramps beside it, `ramp_1` … over equal parts of the travel, all of one sign.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kernels, Kind, Parameter
from autotune.models.lanes import anywhere, where
from autotune.models.layout import block
from autotune.models.look_alikes import IN_A_PART_OF_A_TURN, IN_PLACE
from autotune.models.reversal_memory import REVERSAL_MEMORY
from autotune.models.start_values import StartContext, StartValues, Vary

_AT = block("spring")
RAMPS = 16
"""Of equal length; where the first of them begins is free, so that a ramp begins where the course bends."""


@compiled
def spring_torque(p: Floats, position: float) -> float:
    """Torque that the spring needs [N m]."""
    torque = p[_AT] * position
    if anywhere(p[_AT + 2] > 0.0):
        place = (position - p[_AT + 1]) / p[_AT + 2]
        for i in range(RAMPS):
            torque += where(p[_AT + 2] > 0.0, p[_AT + 3 + i] * min(max(place - i, 0.0), 1.0), 0.0)
    return float(torque)


def starts(c: StartContext) -> Iterator[StartValues]:
    """One is enough: the torque is linear in the stiffness."""
    yield StartValues({}, {"stiffness": Vary(c.coulomb / c.travel)})


def free_shape(c: StartContext) -> StartValues:
    """Ramps over the whole travel, in the direction of the spring."""
    low, high = float(np.min(c.position())), float(np.max(c.position()))
    step = (high - low) / (RAMPS - 1)
    values = {"from": low - 0.5 * step, "step": step}
    ramps = {f"ramp_{i}": 0.0 for i in range(1, RAMPS + 1)}
    pulls = c.p[_AT] >= 0.0
    one_way = (0.0, math.inf) if pulls else (-math.inf, 0.0)
    vary, straight = (Vary(one, math.inf, *one_way) for one in (0.1 * c.coulomb, c.coulomb / c.travel))
    raster = {"from": Vary(0.1 * step, 0.3 * step, low - step, low)}
    return StartValues(values | ramps, {"stiffness": straight} | raster | dict.fromkeys(ramps, vary))


SPRING = Kind(
    name="spring",
    parameters=(
        Parameter("stiffness", "N m/rad", 0.0, -1e9, 1e9, "torque per travel", _AT),
        Parameter("from", "rad", 0.0, -1e6, 1e6, "where the first ramp begins", _AT + 1, True, held=True),
        Parameter("step", "rad", 0.0, 0.0, 1e6, "length of a ramp", _AT + 2, True, held=True),
        *(
            Parameter(f"ramp_{i}", "N m", 0.0, -1e6, 1e6, "more torque after it", _AT + 2 + i, True)
            for i in range(1, RAMPS + 1)
        ),
    ),
    looks_like="The torque rises in a straight line over the whole travel, in both directions alike.",
    cause="A counterbalance spring, a cable chain, a hose, a bellows, a magnet.",
    remedy="If no spring belongs there, look for cables and hoses that pull; else compensate it.",
    look_alikes=(IN_PLACE, IN_A_PART_OF_A_TURN),
    kernels=Kernels(torque=spring_torque),
    starts=starts,
    free_shape=free_shape,
    of_place=True,
    loop_like=True,
    end_of=(REVERSAL_MEMORY.name,),  # an element that never lets go within the travel
)
