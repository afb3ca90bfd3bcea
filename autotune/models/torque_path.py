"""What becomes of the torque demand before it turns the shaft: lag and saturation.

Saturation: `torque_saturation`. Lag: τ·T' = u − T, the current
loop. The mean over a sample of a lagged, held demand is exact and smooth down to τ = 0.
"""

from __future__ import annotations

import math

from autotune.core.arrays import Flags, Floats
from autotune.models.compiled import compiled
from autotune.models.lanes import anywhere, where
from autotune.models.torque_lag import IS_LATE, MOTOR_TORQUE, STAGES, STEEPNESS, TIME_CONSTANT
from autotune.models.torque_saturation import saturated


@compiled
def delivered(p: Floats, on: Flags, state: Floats, demand: float, duration: float, c: float) -> float:
    """Mean torque at the shaft while a demand is held for `duration` [N m]; `c`: see `saturated`."""
    target = saturated(p, on, demand, c)
    if not on[IS_LATE]:
        return target
    share = p[STEEPNESS]
    torque = _through(state, MOTOR_TORQUE, target, (1.0 - share) * p[TIME_CONSTANT], duration)
    for i in range(STAGES):
        torque = _through(state, MOTOR_TORQUE + 1 + i, torque, share * p[TIME_CONSTANT] / STAGES, duration)
    return float(torque)


@compiled
def _through(state: Floats, at: int, given: float, time_constant: float, duration: float) -> float:
    """Mean of what a first-order stage gives while `given` is held for `duration` [N m]; it itself without delay."""
    late = time_constant > 0.0
    if not anywhere(late):
        return given
    missing = given - state[at]
    ratio = duration / time_constant
    left = math.exp(-ratio)
    state[at] = where(late, given - missing * left, state[at])
    return float(where(late, given - missing * (1.0 - left) / ratio, given))
