"""Break-away torque that grows while the axis rests.

The contact ages: a' = (1 − a)/time_constant − a·|slip'|/slip, and the friction level is higher by rise·a
(after Rabinowicz 1958; Dieterich and Kilgore 1994). By another law it ages at rest only, the first term times
e^(−(slip'/rest)²): a slow motion finds it as young as a fast one. Where any motion rubs, as in laws that know a
velocity and no bristle, the way that bends the bristle counts as slip too (`bending`). Contacts that age slower and
faster beside it, `rise_2` and `rise_3` with time constants of their own, make a rise that never ends: a logarithm or a
root of the rest. The area of real contact, which grows with the rest, carries stiffness as well as friction (Baumberger
and Caroli 2006): with `stiffens` 1 its reach stays, where a bristle of LuGre goes further.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kernels, Kind, Parameter, part_that_stiffens
from autotune.models.lanes import anywhere, where
from autotune.models.layout import block, flag, state_block
from autotune.models.look_alikes import AT_STARTS, IN_TIME
from autotune.models.start_values import StartContext, StartValues, Vary, at_first, stiffer

_AT = block("dwell_time_break_away")
AGE = state_block("dwell_time_break_away")
AGES = flag("dwell_time_break_away")
_STIFFENS = _AT + 9
AGES_MOST = 3
"""Contacts of different age in one axis."""


@compiled
def age_level(p: Floats, state: Floats, velocity: float) -> float:
    """What is added to the friction level [N m]."""
    return float(p[_AT] * state[AGE] + p[_AT + 3] * state[AGE + 1] + p[_AT + 5] * state[AGE + 2])


@compiled
def stiffening(p: Floats, state: Floats, velocity: float) -> float:
    """The part of that by which the contact is stiffer too [N m]."""
    if not anywhere(p[_STIFFENS] > 0.0):
        return 0.0 * velocity
    return float(p[_STIFFENS] * age_level(p, state, velocity))


@compiled
def grow_older(p: Floats, state: Floats, slip: float, way: float, duration: float, part: float = 1.0) -> None:
    """Lets the contact rest for `duration` [s] and slip by `slip` of its `way` [rad], which bends the bristle too.

    So does a `part` of the contact.
    """
    slip += p[_AT + 8] * (way - slip)
    lost = part * slip / p[_AT + 2]
    rest = duration + 0.0 * lost
    if anywhere(p[_AT + 7] > 0.0):
        faster = slip / (p[_AT + 7] * duration)
        rest = where(p[_AT + 7] > 0.0, duration * math.exp(-faster * faster), rest)
    rest *= part
    gain = rest / p[_AT + 1]
    state[AGE] = (state[AGE] + gain) / (1.0 + gain + lost)
    for i in range(1, AGES_MOST):
        if anywhere(p[_AT + 2 + 2 * i] > 0.0):
            gain = rest / p[_AT + 2 + 2 * i]
            older = (state[AGE + i] + gain) / (1.0 + gain + lost)
            state[AGE + i] = where(p[_AT + 2 + 2 * i] > 0.0, older, state[AGE + i])


LEAST_AGE, LEAST_AT_REST = 0.1, 0.01
"""Seconds in which a contact ages: one that is faster falls with speed, as Stribeck's does, at every speed; unless it
ages at rest only."""


AT_REST = 2.0
"""1/s: what slips no faster than so many times the bristle's reach is at rest, at first."""


def starts(c: StartContext) -> Iterator[StartValues]:
    """A contact that is young again within the bristle's reach, one that takes longer, one that ages at rest only."""
    for slip, rest in ((0.3, 0.0), (2.0, 0.0), (10.0, AT_REST)):
        slip, rest = slip * c.reach, rest * c.reach
        values = {"rise": at_first(0.1 * c.coulomb, c.left), "time_constant": 1.0, "slip": slip}
        free = {
            "rise": Vary(0.2 * c.coulomb, 0.4 * c.coulomb),
            "time_constant": Vary(0.5, 0.8, lower=LEAST_AT_REST if rest > 0.0 else LEAST_AGE),
            "slip": Vary(0.5 * slip, 0.7 * slip),
        }
        if rest > 0.0:
            values |= {"rest": rest, "bending": 1.0}
            free["rest"] = Vary(0.5 * rest, 0.7 * rest, lower=0.05 * rest)
            free["bending"] = Vary(0.3, 0.5)
        yield StartValues(values, free)


FASTER, SLOWER = 0.1, 10.0
"""Time constants of further contacts, over that of the first; none shorter than the least."""


def free_shape(c: StartContext) -> StartValues:
    """A contact that ages ten times as fast, and one that takes ten times as long."""
    seconds = float(c.p[_AT + 1])
    least = LEAST_AT_REST if c.p[_AT + 7] > 0.0 else LEAST_AGE
    values = {
        "rise_2": 0.0,
        "time_constant_2": max(FASTER * seconds, least),
        "rise_3": 0.0,
        "time_constant_3": SLOWER * seconds,
    }
    rises = Vary(0.2 * c.coulomb, 0.4 * c.coulomb)
    return StartValues(values, {"rise_2": rises, "rise_3": rises})


DWELL_TIME_BREAK_AWAY = Kind(
    name="dwell_time_break_away",
    parameters=(
        Parameter("rise", "N m", 0.0, 0.0, 1e6, "more friction after a long rest", _AT),
        Parameter("time_constant", "s", 1.0, 1e-2, 1e4, "of the rise while resting", _AT + 1),
        Parameter("slip", "rad", 1e-3, 1e-9, 1e3, "travel in which it is lost", _AT + 2),
        Parameter("rise_2", "N m", 0.0, 0.0, 1e6, "of a contact that ages faster", _AT + 3, True),
        Parameter("time_constant_2", "s", 0.0, 0.0, 1e4, "of that one", _AT + 4, True, held=True),
        Parameter("rise_3", "N m", 0.0, 0.0, 1e6, "of a contact that ages slower", _AT + 5, True),
        Parameter("time_constant_3", "s", 0.0, 0.0, 1e5, "of that one", _AT + 6, True, held=True),
        Parameter(
            "rest",
            "rad/s",
            0.0,
            0.0,
            1e6,
            "speed of slip above which it ages no more; 0: it always does",
            _AT + 7,
            True,
        ),
        Parameter(
            "bending",
            "1",
            0.0,
            0.0,
            1.0,
            "of the way that bends the bristle, that counts as slip",
            _AT + 8,
            True,
        ),
        part_that_stiffens(_STIFFENS),
    ),
    looks_like="The longer the axis has rested, the higher the peak of torque at the next start.",
    cause="Lubricant squeezed out of the contact at rest, seals that stick, slideways without a film.",
    remedy="Make a short move before precise work; slideway oil with adhesion additives, other seals.",
    look_alikes=(AT_STARTS, IN_TIME),
    not_fed_forward="it depends on how long the axis has rested, and on every small motion then",
    kernels=Kernels(level=age_level, stiffening=stiffening),
    starts=starts,
    size="rise",
    plain_shape=stiffer,
    free_shape=free_shape,
    needs_rests=True,
    quick=True,
)
