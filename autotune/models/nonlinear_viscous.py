"""Viscous friction that is not proportional to speed: grease and oil that thin with shear, windage.

T = torque·v·(v² + knee²)^((exponent − 1)/2), that is torque·|v|^exponent·sign v above the knee. Palmgren's
law for lubricated bearings has exponent 2/3, windage 2; the sum with σ2·v covers both.
"""

from __future__ import annotations

from collections.abc import Iterator

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kernels, Kind, Parameter
from autotune.models.layout import block
from autotune.models.look_alikes import IN_SPEED
from autotune.models.start_values import StartContext, StartValues, Vary

_AT = block("nonlinear_viscous")


@compiled
def curved_coefficient(p: Floats, velocity: float) -> float:
    """Torque over velocity [N m s/rad]."""
    knee = p[_AT + 2]
    return float(p[_AT] * (velocity * velocity + knee * knee) ** (0.5 * (p[_AT + 1] - 1.0)))


def starts(c: StartContext) -> Iterator[StartValues]:
    """One below proportional (grease that thins), one above (windage)."""
    for exponent, share in ((0.5, 0.1), (2.0, 0.05)):
        torque = share * c.coulomb / c.speed**exponent
        yield StartValues(
            {"torque": torque, "exponent": exponent, "knee": 2e-3 * c.speed},
            {"torque": Vary(torque, 5.0 * torque), "exponent": Vary(0.3, 0.4)},
        )


NONLINEAR_VISCOUS = Kind(
    name="nonlinear_viscous",
    parameters=(
        Parameter("torque", "N m", 0.0, 0.0, 1e9, "torque at a speed of one unit", _AT),
        Parameter("exponent", "1", 1.0, 0.1, 3.0, "power of the speed", _AT + 1),
        Parameter(
            "knee", "rad/s", 1e-3, 1e-9, 1e3, "below it the torque is linear in speed", _AT + 2, held=True
        ),
    ),
    looks_like="The torque over speed is a curve instead of a straight line, the same in both directions.",
    cause="A lubricant that thins with shear, too much or too thick grease, churning, windage of a fan.",
    remedy="Check amount and grade of the lubricant; a curve that steepens points to churning.",
    look_alikes=(IN_SPEED,),
    kernels=Kernels(viscous=curved_coefficient),
    starts=starts,
    at_constant_speed=True,
)
