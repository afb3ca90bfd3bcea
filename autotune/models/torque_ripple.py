"""Torque that depends on position alone and repeats: cogging, commutation, rolling elements.

Σ sin_k·sin(N_k·q) + cos_k·cos(N_k·q), with q in revolutions × 2π on a rotary axis; on a linear axis N is
in cycles per metre. It adds to the torque that the motion needs.
"""

from __future__ import annotations

import math

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kind, Parameter
from autotune.models.layout import block

LINES = 10
"""How many orders one model can hold; three slots each, the last two slots of the block are spare."""
_AT = block("torque_ripple")
_SCALE = _AT + 30


def _line(number: int) -> tuple[Parameter, ...]:
    at = _AT + 3 * (number - 1)
    later = number > 1
    return (
        Parameter(f"order_{number}", "cycles/rev", 0.0, 0.0, 1e6, "periods per revolution", at, later),
        Parameter(f"sin_{number}", "N m", 0.0, -1e6, 1e6, "sine part", at + 1, later),
        Parameter(f"cos_{number}", "N m", 0.0, -1e6, 1e6, "cosine part", at + 2, later),
    )


TORQUE_RIPPLE = Kind(
    name="torque_ripple",
    parameters=tuple(parameter for number in range(1, LINES + 1) for parameter in _line(number)),
    looks_like="The torque waves with position, at the same places in both directions and at every speed.",
    cause="Cogging of the motor, commutation, rolling elements of bearings or screw, teeth of a belt.",
    remedy="Compensate it by a map; look at bearings, screw and belt if it has grown.",
)


@compiled
def ripple(p: Floats, position: float) -> float:
    """Torque that the ripple needs at a position [N m]."""
    total = 0.0
    scale = p[_SCALE]
    for line in range(LINES):
        order = p[_AT + 3 * line]
        if order == 0.0:
            break
        angle = order * scale * position
        total += p[_AT + 3 * line + 1] * math.sin(angle) + p[_AT + 3 * line + 2] * math.cos(angle)
    return total


def scale_slot() -> int:
    """Where the plant finds the angle per motion unit: 1 on a rotary axis, 2π on a linear one."""
    return _SCALE
