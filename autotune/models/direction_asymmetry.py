"""Friction that differs between the two directions.

Coulomb and break-away levels are F ± ΔF and viscous friction σ2 ± Δσ2, the upper sign for positive
velocity. Where the difference needs some speed to be there, ΔF·(1 − exp(−|v|/width)), and a second such term.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kernels, Kind, Parameter
from autotune.models.lanes import anywhere, where
from autotune.models.layout import block
from autotune.models.look_alikes import AT_REVERSALS
from autotune.models.start_values import StartContext, StartValues, Vary

_AT = block("direction_asymmetry")


@compiled
def level_difference(p: Floats, state: Floats, velocity: float) -> float:
    """What is added to the friction level [N m]."""
    difference = p[_AT]
    if anywhere(p[_AT + 2] > 0.0):
        risen = difference * (1.0 - math.exp(-abs(velocity) / p[_AT + 2]))
        difference = where(p[_AT + 2] > 0.0, risen, difference)
    if anywhere(p[_AT + 4] > 0.0):
        more = difference + p[_AT + 3] * (1.0 - math.exp(-abs(velocity) / p[_AT + 4]))
        difference = where(p[_AT + 4] > 0.0, more, difference)
    return float(where(velocity >= 0.0, difference, -difference))


@compiled
def viscous_difference(p: Floats, velocity: float) -> float:
    """What is added to the viscous coefficient [N m s/rad]."""
    return float(where(velocity >= 0.0, p[_AT + 1], -p[_AT + 1]))


def starts(c: StartContext) -> Iterator[StartValues]:
    """From no difference."""
    viscous = 0.3 * c.torque / c.speed
    yield StartValues(
        {}, {"coulomb": Vary(0.1 * c.coulomb, 0.5 * c.coulomb), "viscous": Vary(0.3 * viscous, viscous)}
    )


def free_shape(c: StartContext) -> StartValues:
    """A difference that needs some speed to be there, in two steps."""
    width, far = 1e-3 * c.speed, 0.1 * c.speed
    return StartValues(
        {"width": width, "fast": 0.0, "fast_width": far},
        {
            "width": Vary(width, width, 1e-5 * c.speed, 0.05 * c.speed),
            "fast": Vary(0.1 * c.coulomb, 0.5 * c.coulomb),
        },
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
        Parameter("width", "rad/s", 0.0, 0.0, 1e6, "speed at which the difference is there", _AT + 2, True),
        Parameter("fast", "N m", 0.0, -1e6, 1e6, "half the difference at speed, beside it", _AT + 3, True),
        Parameter(
            "fast_width", "rad/s", 0.0, 0.0, 1e6, "speed at which that is there", _AT + 4, True, held=True
        ),
    ),
    looks_like="One direction needs more torque than the other, at all positions.",
    cause="A worn or preloaded screw or nut, a guide or seal that is loaded on one side.",
    remedy="Check the nut's preload and wear, the alignment of guides, seals and wipers.",
    look_alikes=(AT_REVERSALS,),
    kernels=Kernels(level=level_difference, viscous=viscous_difference),
    starts=starts,
    free_shape=free_shape,
    of_place=True,
    at_constant_speed=True,
)
