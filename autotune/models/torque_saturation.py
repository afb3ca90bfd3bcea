"""Large torques with less effect: T = u·(1 − loss·(u/torque)²), iron that carries no more flux."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kind, Parameter
from autotune.models.layout import block, flag
from autotune.models.look_alikes import AT_REVERSALS, IN_TORQUE
from autotune.models.start_values import StartContext, StartValues, Vary

_AT = block("torque_saturation")
SATURATES = flag("torque_saturation")


@compiled
def saturated(p: Floats, on: Flags, demand: float) -> float:
    """Torque that a demand gives in the long run [N m]."""
    if not on[SATURATES]:
        return demand
    ratio = min(abs(demand) / p[_AT + 1], 1.0 / math.sqrt(3.0 * max(p[_AT], 1e-9)))
    return math.copysign(p[_AT + 1] * ratio * (1.0 - p[_AT] * ratio * ratio), demand)


def torque_slope(p: Floats, on: Flags, demand: Floats) -> Floats | float:
    """How much of a change of the demand arrives at the shaft.

    The residual is told in the demand's own scale; else saturation would seem to explain by shrinking.
    """
    if not on[SATURATES]:
        return 1.0
    ratio = np.minimum(np.abs(demand) / p[_AT + 1], 1.0)
    return np.asarray(np.maximum(1.0 - 3.0 * p[_AT] * ratio**2, 0.05))


def starts(c: StartContext) -> Iterator[StartValues]:
    """A small loss at the largest torque that was recorded."""
    yield StartValues({"loss": 0.05, "torque": c.largest_torque}, {"loss": Vary(0.2, 0.3)})


TORQUE_SATURATION = Kind(
    name="torque_saturation",
    parameters=(
        Parameter("loss", "1", 0.0, 0.0, 0.33, "relative loss of torque at that level", _AT),
        Parameter("torque", "N m", 1.0, 1e-9, 1e9, "level at which the loss is given", _AT + 1, held=True),
    ),
    looks_like="Large torques have less effect than small ones; fast accelerations fall short.",
    cause="Iron of the motor that saturates, a weak magnet, a current limit, a low supply voltage.",
    remedy="Check supply and current limits; a motor that was too hot may have lost magnetism; "
    "plan gentler accelerations.",
    look_alikes=(IN_TORQUE, AT_REVERSALS),
    not_fed_forward="it acts where there is no torque in reserve",
    starts=starts,
    quick=True,
)
