"""What becomes of the torque demand before it turns the shaft: lag and saturation.

Saturation: `torque_saturation`. Lag: τ·T' = u − T, the current
loop. The mean over a sample of a lagged, held demand is exact and smooth down to τ = 0.
"""

from __future__ import annotations

import math

from autotune.core.arrays import Flags, Floats
from autotune.models.compiled import compiled
from autotune.models.torque_lag import IS_LATE, MOTOR_TORQUE, TIME_CONSTANT
from autotune.models.torque_saturation import saturated


@compiled
def delivered(p: Floats, on: Flags, state: Floats, demand: float, duration: float) -> float:
    """Mean torque at the shaft while a demand is held for `duration` [N m]."""
    target = saturated(p, on, demand)
    if not on[IS_LATE] or p[TIME_CONSTANT] <= 0.0:
        return target
    missing = target - state[MOTOR_TORQUE]
    ratio = duration / p[TIME_CONSTANT]
    left = math.exp(-ratio)
    state[MOTOR_TORQUE] = target - missing * left
    return float(target - missing * (1.0 - left) / ratio)
