"""Friction that differs between the two directions.

Coulomb and break-away levels are F ± ΔF and viscous friction σ2 ± Δσ2, the upper sign for positive
velocity.
"""

from __future__ import annotations

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kind, Parameter
from autotune.models.layout import block

_AT = block("direction_asymmetry")

DIRECTION_ASYMMETRY = Kind(
    name="direction_asymmetry",
    parameters=(
        Parameter("coulomb", "N m", 0.0, -1e6, 1e6, "half the difference of the two directions", _AT),
        Parameter(
            "viscous", "N m s/rad", 0.0, -1e6, 1e6, "half the difference of the two directions", _AT + 1
        ),
    ),
    looks_like="One direction needs more torque than the other, at all positions.",
    cause="A worn or preloaded screw or nut, a guide or seal that is loaded on one side.",
    remedy="Check the nut's preload and wear, the alignment of guides, seals and wipers.",
)


@compiled
def level_difference(p: Floats, velocity: float) -> float:
    """What is added to the friction level [N m]."""
    return float(p[_AT]) if velocity >= 0.0 else -float(p[_AT])


@compiled
def viscous_difference(p: Floats, velocity: float) -> float:
    """What is added to the viscous coefficient [N m s/rad]."""
    return float(p[_AT + 1]) if velocity >= 0.0 else -float(p[_AT + 1])
