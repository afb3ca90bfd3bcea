"""Friction that grows with the torque transmitted: level + factor·|J·q'' + load + share·friction|.

The transmitted torque presses the contacts; it is smoothed over a millisecond. `friction_share` says on
which side of the friction the pressed contact sits: 0 at the load, 1 at the motor, which drives friction too.
"""

from __future__ import annotations

from collections.abc import Iterator

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kernels, Kind, Parameter
from autotune.models.layout import block, flag, state_block
from autotune.models.look_alikes import IN_TORQUE
from autotune.models.start_values import StartContext, StartValues, Vary

_AT = block("load_dependent_friction")
PRESSED = state_block("load_dependent_friction")
IS_PRESSED = flag("load_dependent_friction")
SMOOTHING = 1e-3  # s


@compiled
def load_level(p: Floats, state: Floats, velocity: float) -> float:
    """What is added to the friction level [N m]."""
    return float(p[_AT] * state[PRESSED])


@compiled
def press(p: Floats, state: Floats, torque: float, friction: float, duration: float) -> None:
    """Presses the contacts with the torque transmitted, `friction` beside what the load takes."""
    passed = abs(torque + p[_AT + 1] * friction)
    state[PRESSED] += (passed - state[PRESSED]) * duration / (SMOOTHING + duration)


def starts(c: StartContext) -> Iterator[StartValues]:
    """The contact at the load, and at the motor."""
    for share in (0.0, 1.0):
        yield StartValues(
            {"factor": 0.03, "friction_share": share},
            {"factor": Vary(0.1, 0.2), "friction_share": Vary(0.3, 0.4)},
        )


LOAD_DEPENDENT_FRICTION = Kind(
    name="load_dependent_friction",
    parameters=(
        Parameter("factor", "1", 0.0, 0.0, 5.0, "friction torque per torque transmitted", _AT),
        Parameter("friction_share", "1", 0.0, 0.0, 1.0, "of the friction that is transmitted too", _AT + 1),
    ),
    looks_like="Friction is higher while the axis accelerates, brakes or carries a load.",
    cause="Worm and screw drives, gears and nuts whose flanks are pressed by what they transmit.",
    remedy="Lubricate the flanks; an efficiency that has fallen points to wear or dry teeth.",
    look_alikes=(IN_TORQUE,),
    not_fed_forward="it depends on the load of the moment",
    kernels=Kernels(level=load_level),
    starts=starts,
    quick=True,
)
