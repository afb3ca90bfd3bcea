"""What becomes of the torque demand before it turns the shaft: lag and saturation.

Saturation: T = u·(1 − loss·(u/torque)²), iron that carries no more flux. Lag: τ·T' = u − T, the current
loop. The mean over a sample of a lagged, held demand is exact and smooth down to τ = 0.
"""

from __future__ import annotations

import math

from autotune.core.arrays import Flags, Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kind, Parameter
from autotune.models.layout import block, flag, state_block

_LAG = block("torque_lag")
_SATURATION = block("torque_saturation")
_IS_LATE = flag("torque_lag")
_SATURATES = flag("torque_saturation")
MOTOR_TORQUE = state_block("torque_lag")

TORQUE_LAG = Kind(
    name="torque_lag",
    parameters=(Parameter("time_constant", "s", 0.0, 0.0, 0.1, "of the torque loop", _LAG),),
    looks_like="The torque comes late: the error grows with how fast the torque changes, not with its size.",
    cause="A slow current loop, a filter on the torque demand, a delay on the bus.",
    remedy="Tune the current loop, remove torque filters, use a shorter bus cycle.",
)

TORQUE_SATURATION = Kind(
    name="torque_saturation",
    parameters=(
        Parameter("loss", "1", 0.0, 0.0, 0.33, "relative loss of torque at that level", _SATURATION),
        Parameter("torque", "N m", 1.0, 1e-9, 1e9, "level at which the loss is given", _SATURATION + 1),
    ),
    looks_like="Large torques have less effect than small ones; fast accelerations fall short.",
    cause="Iron of the motor that saturates, a weak magnet, a current limit, a low supply voltage.",
    remedy="Check supply and current limits; a motor that was too hot may have lost magnetism; "
    "plan gentler accelerations.",
)


@compiled
def saturated(p: Floats, on: Flags, demand: float) -> float:
    """Torque that a demand gives in the long run [N m]."""
    if not on[_SATURATES]:
        return demand
    ratio = min(abs(demand) / p[_SATURATION + 1], 1.0 / math.sqrt(3.0 * max(p[_SATURATION], 1e-9)))
    return math.copysign(p[_SATURATION + 1] * ratio * (1.0 - p[_SATURATION] * ratio * ratio), demand)


@compiled
def delivered(p: Floats, on: Flags, state: Floats, demand: float, duration: float) -> float:
    """Mean torque at the shaft while a demand is held for `duration` [N m]."""
    target = saturated(p, on, demand)
    if not on[_IS_LATE] or p[_LAG] <= 0.0:
        return target
    missing = target - state[MOTOR_TORQUE]
    ratio = duration / p[_LAG]
    left = math.exp(-ratio)
    state[MOTOR_TORQUE] = target - missing * left
    return float(target - missing * (1.0 - left) / ratio)
