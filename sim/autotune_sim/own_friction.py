"""Torque over velocity that a simulated drive adds to its feedforward: a table as servo drives have it.

As in Baumüller's b maXX BM5800 (parameter manual 5.16029.03, "friction torque compensation"): six supporting points
of torque over the speed set value, straight lines between them, the origin fixed, the negative half turned round, and
constant beyond the last point. It acts with the feedforward block, and on the unfiltered rate of the demand.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from autotune_sim.kernel import Record, kernel

POINTS = 6
OWN_FRICTION = np.dtype([("velocity", np.float64, (POINTS,)), ("torque", np.float64, (POINTS,))], align=True)
"""`velocity` [rad/s], ascending, all 0 where there is no table; `torque` [N m]."""


def fresh_friction() -> Any:
    """A drive with an empty table; shape (1,)."""
    return np.zeros(1, OWN_FRICTION)


@kernel
def own_friction(r: Record, velocity: float) -> float:
    """Torque of the table at a velocity [rad/s], in N m."""
    if r.velocity[POINTS - 1] == 0.0:
        return 0.0
    speed, left, below = abs(velocity), 0.0, 0.0
    sign = 1.0 if velocity >= 0.0 else -1.0
    for i in range(POINTS):
        right, above = r.velocity[i], r.torque[i]
        if speed < right:
            return float(sign * (below + (above - below) * (speed - left) / (right - left)))
        left, below = right, above
    return float(sign * below)
