"""Torque over position that a simulated drive adds by itself: a table, or harmonics, over the commutation angle.

The commutation encoder counts from a zero of its own: fraction of a turn = encoder reading / 2π + offset. A
table is read as moteus's firmware reads it (`fw/bldc_servo_control.h`): the value below, the value above, a
straight line between; whole steps times a scale, added after the torque limit. Harmonics are
gain·Σ r·cos(n·φ + phi), with r ≥ 0. Both act in the current loop, not once a servo period: at 34 Hz a hold of
1 ms alone would leave a tenth of the ripple.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from autotune_sim.kernel import Record, kernel

POINTS = 1024
HARMONICS = 10
TURN = 2.0 * math.pi
OWN_RIPPLE = np.dtype(
    [
        ("offset", np.float64),
        ("step", np.float64),
        ("table", np.float64, (POINTS,)),
        ("gain", np.float64),
        ("order", np.float64, (HARMONICS,)),
        ("phase", np.float64, (HARMONICS,)),
        ("torque", np.float64, (HARMONICS,)),
    ],
    align=True,
)
"""`offset` [turns]; `step`: N m of one step of the table; `gain` of the harmonics; `phase` [rad]; `torque` [N m]."""


def fresh_ripple(offset: float) -> Any:
    """A drive that adds nothing; shape (1,)."""
    record = np.zeros(1, OWN_RIPPLE)
    record["offset"] = offset
    return record


@kernel
def acts(r: Record) -> bool:
    """Whether the drive adds anything."""
    return bool(r.step != 0.0 or r.gain != 0.0)


@kernel
def own_ripple(r: Record, reading: float) -> float:
    """Torque that the drive adds at an encoder reading [rad], in N m."""
    part = reading / TURN + r.offset
    part -= math.floor(part)
    total = 0.0
    if r.step != 0.0:
        left = min(POINTS - 1, int(POINTS * part))
        right = (left + 1) % POINTS
        share = part * POINTS - left
        total += r.step * (r.table[left] + (r.table[right] - r.table[left]) * share)
    if r.gain != 0.0:
        for i in range(HARMONICS):
            if r.torque[i] != 0.0:
                total += r.gain * r.torque[i] * math.cos(r.order[i] * TURN * part + r.phase[i])
    return total
