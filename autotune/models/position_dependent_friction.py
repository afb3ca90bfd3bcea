"""Friction that depends on the place: a tight spot, a worn stretch, a bearing that runs untrue.

The friction level is multiplied by 1 + height·exp(−((q − centre)/width)²) + sin·sin(N·q) + cos·cos(N·q).
"""

from __future__ import annotations

import math

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kind, Parameter
from autotune.models.layout import block
from autotune.models.torque_ripple import scale_slot

_AT = block("position_dependent_friction")
_SCALE = scale_slot()
LEAST_FACTOR = 0.05

POSITION_DEPENDENT_FRICTION = Kind(
    name="position_dependent_friction",
    parameters=(
        Parameter("height", "1", 0.0, -0.95, 20.0, "relative rise of friction at the spot", _AT),
        Parameter("centre", "rad", 0.0, -1e6, 1e6, "where the spot is", _AT + 1),
        Parameter("width", "rad", 1.0, 1e-6, 1e6, "how far it reaches", _AT + 2),
        Parameter("order", "cycles/rev", 0.0, 0.0, 1e6, "periods per revolution", _AT + 3, True),
        Parameter("sin", "1", 0.0, -0.95, 0.95, "sine part, relative", _AT + 4, True),
        Parameter("cos", "1", 0.0, -0.95, 0.95, "cosine part, relative", _AT + 5, True),
    ),
    looks_like="Friction is higher (or lower) at some places, in both directions: the band between "
    "forward and backward torque widens there.",
    cause="A tight spot of guide or screw, local wear, misalignment, a bent shaft, a damaged seal.",
    remedy="Look at guide, screw and alignment at that place; clean and lubricate there first.",
)


@compiled
def place_factor(p: Floats, position: float) -> float:
    """What the friction level is multiplied by."""
    factor = 1.0
    if p[_AT] != 0.0:
        ratio = (position - p[_AT + 1]) / p[_AT + 2]
        factor += p[_AT] * math.exp(-ratio * ratio)
    if p[_AT + 3] > 0.0:
        angle = p[_AT + 3] * p[_SCALE] * position
        factor += p[_AT + 4] * math.sin(angle) + p[_AT + 5] * math.cos(angle)
    return float(max(factor, LEAST_FACTOR))
