"""Friction that differs between the two directions.

Coulomb and break-away levels are F ± ΔF and viscous friction σ2 ± Δσ2, the upper sign for positive
velocity.
"""

from __future__ import annotations

from collections.abc import Iterator

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kernels, Kind, Parameter
from autotune.models.layout import block
from autotune.models.look_alikes import AT_REVERSALS
from autotune.models.start_values import StartContext, StartValues, Vary

_AT = block("direction_asymmetry")


@compiled
def level_difference(p: Floats, state: Floats, velocity: float) -> float:
    """What is added to the friction level [N m]."""
    return float(p[_AT]) if velocity >= 0.0 else -float(p[_AT])


@compiled
def viscous_difference(p: Floats, velocity: float) -> float:
    """What is added to the viscous coefficient [N m s/rad]."""
    return float(p[_AT + 1]) if velocity >= 0.0 else -float(p[_AT + 1])


def starts(c: StartContext) -> Iterator[StartValues]:
    """From no difference."""
    viscous = 0.3 * c.torque / c.speed
    yield StartValues(
        {}, {"coulomb": Vary(0.1 * c.coulomb, 0.5 * c.coulomb), "viscous": Vary(0.3 * viscous, viscous)}
    )


DIRECTION_ASYMMETRY = Kind(
    name="direction_asymmetry",
    parameters=(
        Parameter(
            "coulomb",
            "N m",
            0.0,
            -1e6,
            1e6,
            "half the difference of the two directions",
            _AT,
            like_offset=True,
            refined=0.05,
        ),
        Parameter(
            "viscous", "N m s/rad", 0.0, -1e6, 1e6, "half the difference of the two directions", _AT + 1
        ),
    ),
    looks_like="One direction needs more torque than the other, at all positions.",
    cause="A worn or preloaded screw or nut, a guide or seal that is loaded on one side.",
    remedy="Check the nut's preload and wear, the alignment of guides, seals and wipers.",
    look_alikes=(AT_REVERSALS,),
    kernels=Kernels(level=level_difference, viscous=viscous_difference),
    starts=starts,
    of_place=True,
    at_constant_speed=True,
)
