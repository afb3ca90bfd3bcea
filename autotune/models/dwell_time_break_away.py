"""Break-away torque that grows while the axis rests.

The contact ages: a' = (1 − a)/time_constant − a·|slip'|/slip, and the friction level is higher by rise·a
(after Rabinowicz 1958; Dieterich and Kilgore 1994).
"""

from __future__ import annotations

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kind, Parameter
from autotune.models.layout import block, state_block

_AT = block("dwell_time_break_away")
AGE = state_block("dwell_time_break_away")

DWELL_TIME_BREAK_AWAY = Kind(
    name="dwell_time_break_away",
    parameters=(
        Parameter("rise", "N m", 0.0, 0.0, 1e6, "more friction after a long rest", _AT),
        Parameter("time_constant", "s", 1.0, 1e-2, 1e4, "of the rise while resting", _AT + 1),
        Parameter("slip", "rad", 1e-3, 1e-9, 1e3, "travel in which it is lost", _AT + 2),
    ),
    looks_like="The longer the axis has rested, the higher the peak of torque at the next start.",
    cause="Lubricant squeezed out of the contact at rest, seals that stick, slideways without a film.",
    remedy="Make a short move before precise work; slideway oil with adhesion additives, other seals.",
)


@compiled
def age_level(p: Floats, state: Floats) -> float:
    """What is added to the friction level [N m]."""
    return float(p[_AT] * state[AGE])


@compiled
def grow_older(p: Floats, state: Floats, slip: float, duration: float) -> None:
    """Lets the contact rest for `duration` [s] and slip by `slip` [rad]."""
    gain = duration / p[_AT + 1]
    state[AGE] = (state[AGE] + gain) / (1.0 + gain + slip / p[_AT + 2])
