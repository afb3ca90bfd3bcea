"""Friction that grows with the torque transmitted: level + factor·|J·q'' + load|.

The transmitted torque presses the contacts; it is smoothed over a millisecond.
"""

from __future__ import annotations

from autotune.models.compiled import compiled
from autotune.models.effect import Kind, Parameter
from autotune.models.layout import block, state_block
from autotune.models.lugre import Floats

_AT = block("load_dependent_friction")
PRESSED = state_block("load_dependent_friction")
SMOOTHING = 1e-3  # s

LOAD_DEPENDENT_FRICTION = Kind(
    name="load_dependent_friction",
    parameters=(Parameter("factor", "1", 0.0, 0.0, 5.0, "friction torque per torque transmitted", _AT),),
    looks_like="Friction is higher while the axis accelerates, brakes or carries a load.",
    cause="Worm and screw drives, gears and nuts whose flanks are pressed by what they transmit.",
    remedy="Lubricate the flanks; an efficiency that has fallen points to wear or dry teeth.",
)


@compiled
def load_level(p: Floats, state: Floats) -> float:
    """What is added to the friction level [N m]."""
    return float(p[_AT] * state[PRESSED])


@compiled
def press(state: Floats, torque: float, duration: float) -> None:
    """Presses the contacts with the torque transmitted."""
    state[PRESSED] += (abs(torque) - state[PRESSED]) * duration / (SMOOTHING + duration)
