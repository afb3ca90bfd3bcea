"""Friction that grows with the torque transmitted: level + factor·|J·q'' + load + share·friction|.

The transmitted torque presses the contacts; it is smoothed over a millisecond. Between two masses it is what passes to
the load, beside the motor's friction. A constant torque is part of it where it is a weight's, and no part where it is
an amplifier's or a sensor's own (`offset_apart`). `friction_share` says on which side of the friction the pressed
contact sits: 0 at the load, 1 at the motor, which drives friction too; below 0 friction is higher while braking than
while driving.

By another law it grows with a power of that torque, and from a preload on: factor·typical·((T − preload)/typical)ⁿ.
And what is pressed may be stiffer too (`stiffens`): the area of real contact carries friction and stiffness alike, and
grows with what presses it (Baumberger and Caroli 2006), so that its reach stays. A bristle of LuGre has one stiffness,
and its reach grows with its level. Both slide alike; they differ after reversals under load.
"""

from __future__ import annotations

from collections.abc import Iterator

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kernels, Kind, Parameter, part_that_stiffens
from autotune.models.lanes import anywhere, where
from autotune.models.layout import OFFSET, block, flag, state_block
from autotune.models.load_side import hangs
from autotune.models.look_alikes import IN_TORQUE
from autotune.models.start_values import StartContext, StartValues, Vary, at_first, stiffer

_AT = block("load_dependent_friction")
PRESSED = state_block("load_dependent_friction")
IS_PRESSED = flag("load_dependent_friction")
_STIFFENS = _AT + 5
_OFFSET_APART = _AT + 6
SMOOTHING = 1e-3  # s
_BYPASSES = "share of the offset that does not pass"


@compiled
def load_level(p: Floats, state: Floats, velocity: float) -> float:
    """What is added to the friction level [N m]."""
    over = max(state[PRESSED] - p[_AT + 4], 0.0)
    if anywhere(p[_AT + 2] != 1.0):
        over = where(p[_AT + 2] != 1.0, p[_AT + 3] * (over / p[_AT + 3]) ** p[_AT + 2], over)
    return float(p[_AT] * over)


@compiled
def stiffening(p: Floats, state: Floats, velocity: float) -> float:
    """The part of that by which the contact is stiffer too [N m]."""
    if not anywhere(p[_STIFFENS] > 0.0):
        return 0.0 * velocity
    return float(p[_STIFFENS] * load_level(p, state, velocity))


@compiled
def transmitted(p: Floats, torque: float) -> float:
    """Of the torque beyond a rigid axis's friction what passes through the contacts [N m]."""
    return float(torque - p[_OFFSET_APART] * p[OFFSET])


@compiled
def press(p: Floats, state: Floats, torque: float, friction: float, duration: float) -> None:
    """Presses the contacts with the torque transmitted, `friction` beside what the load takes."""
    passed = abs(torque + p[_AT + 1] * friction)
    state[PRESSED] += (passed - state[PRESSED]) * duration / (SMOOTHING + duration)


def starts(c: StartContext) -> Iterator[StartValues]:
    """The contact at the load, at the motor, one that is pressed more while braking, and one that no offset presses."""
    free = {"factor": Vary(0.1, 0.2), "friction_share": Vary(0.3, 0.4)}
    factor = at_first(0.03, c.left / c.torque)
    for share in (0.0, 1.0, -0.5):
        yield StartValues({"factor": factor, "friction_share": share}, free)
    if hangs(c):
        yield StartValues({"factor": factor, "friction_share": 0.0, "offset_apart": 1.0}, free)


def free_shape(c: StartContext) -> StartValues:
    """Any power of the torque, from any preload on, a part of a constant torque in it."""
    free = {
        "exponent": Vary(0.3, 0.3),
        "preload": Vary(0.05 * c.largest_torque, 0.1 * c.largest_torque, upper=0.7 * c.largest_torque),
    }
    apart = {"offset_apart": Vary(0.3, 0.5)} if hangs(c) else {}
    return StartValues({"typical": 0.5 * c.largest_torque, "exponent": 1.001}, free | apart)


LOAD_DEPENDENT_FRICTION = Kind(
    name="load_dependent_friction",
    parameters=(
        Parameter("factor", "1", 0.0, 0.0, 5.0, "friction torque per torque transmitted", _AT),
        Parameter("friction_share", "1", 0.0, -1.0, 1.0, "of the friction that is transmitted too", _AT + 1),
        Parameter("exponent", "1", 1.0, 0.3, 4.0, "power of the torque transmitted", _AT + 2, True),
        Parameter(
            "typical", "N m", 1.0, 1e-9, 1e9, "torque at which the factor holds", _AT + 3, True, held=True
        ),
        Parameter("preload", "N m", 0.0, 0.0, 1e9, "torque from which on it grows", _AT + 4, True),
        part_that_stiffens(_STIFFENS),
        Parameter("offset_apart", "1", 0.0, 0.0, 1.0, _BYPASSES, _OFFSET_APART, True, whole=True),
    ),
    looks_like="Friction is higher while the axis accelerates, brakes or carries a load.",
    cause="Worm and screw drives, gears and nuts whose flanks are pressed by what they transmit.",
    remedy="Lubricate the flanks; an efficiency that has fallen points to wear or dry teeth.",
    look_alikes=(IN_TORQUE,),
    not_fed_forward="it depends on the load of the moment",
    kernels=Kernels(level=load_level, stiffening=stiffening),
    starts=starts,
    size="factor",
    plain_shape=stiffer,
    free_shape=free_shape,
    quick=True,
)
