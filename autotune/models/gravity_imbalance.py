"""A mass that does not hang in the axis of rotation: torque sin·sin(N·q) + cos·cos(N·q), N = 1.

On an axis behind a gear, `order` is the gear's ratio: revolutions of the load per revolution of the motor.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kernels, Kind, Parameter
from autotune.models.lanes import anywhere
from autotune.models.layout import block
from autotune.models.look_alikes import IN_A_PART_OF_A_TURN, IN_PLACE
from autotune.models.start_values import StartContext, StartValues, Vary
from autotune.models.torque_ripple import TORQUE_RIPPLE, scale_slot

_AT = block("gravity_imbalance")
_SCALE = scale_slot()


@compiled
def imbalance_torque(p: Floats, position: float) -> float:
    """Torque that the imbalance needs [N m]."""
    angle = p[_AT + 2] * p[_SCALE] * position
    torque = p[_AT] * math.sin(angle) + p[_AT + 1] * math.cos(angle)
    if anywhere(abs(p[_AT + 3]) + abs(p[_AT + 4]) > 0.0):
        torque += p[_AT + 3] * math.sin(2.0 * angle) + p[_AT + 4] * math.cos(2.0 * angle)
    return float(torque)


def starts(c: StartContext) -> Iterator[StartValues]:
    """A turn of the load for one of the motor, and the gear that the residual shows, if any."""
    if c.angle != 1.0:
        return
    parts = {"sin": Vary(0.1 * c.coulomb), "cos": Vary(0.1 * c.coulomb)}
    yield StartValues({}, parts)
    order = _of_a_gear(c)
    if order is not None:
        step = 0.3 / (c.travel / (2.0 * math.pi))
        yield StartValues({"order": order}, {**parts, "order": Vary(0.5 * step, step)})


LEAST_PERIODS, SPACING, MOST_ORDERS = 1.5, 0.35, 400
"""Of the load over the travel: fewer are a spring's course as well; and of an order, what the travel tells apart."""
STANDS_OUT, FAR_MORE = 0.1, 1.5
"""Share of the residual that a load behind a gear explains, and times what one without a gear does."""


def _of_a_gear(c: StartContext) -> float | None:
    """The order below 1 that explains most of the residual, where it explains far more than 1 does."""
    turns = c.travel / (2.0 * math.pi)
    if turns <= LEAST_PERIODS:
        return None
    orders = np.arange(LEAST_PERIODS / turns, 1.0 - SPACING / turns, SPACING / turns)[-MOST_ORDERS:]
    thin = c.thinned()
    place = c.position()[thin.rows]

    def share(order: float) -> float:
        return thin.share(np.column_stack([np.sin(order * place), np.cos(order * place)]))

    best = max(orders.tolist(), key=share, default=1.0)
    return best if share(best) > max(STANDS_OUT, FAR_MORE * share(1.0)) else None


def shows_course(p: Floats, travel: float) -> bool:
    """Whether the load turns far enough: over less, a sine comes near to any smooth course (a spring, a hose)."""
    return bool(travel * p[_AT + 2] >= LEAST_PERIODS * 2.0 * math.pi)


TURNS_THAT_TELL = 3.0
"""Of the load: over fewer, two waves are any function of the place."""


def free_shape(c: StartContext) -> StartValues | None:
    """A lever that changes over the turn: two waves in place of one, the same in every turn."""
    if c.travel * c.p[_AT + 2] < TURNS_THAT_TELL * 2.0 * math.pi:
        return None
    return StartValues({}, {"sin_2": Vary(0.1 * c.coulomb), "cos_2": Vary(0.1 * c.coulomb)})


def waves(p: Floats) -> tuple[float, ...]:
    """One a turn of the load, and two where its lever changes over the turn or it hangs at a rod."""
    return float(p[_AT + 2]), 2.0 * float(p[_AT + 2])


GRAVITY_IMBALANCE = Kind(
    name="gravity_imbalance",
    parameters=(
        Parameter("sin", "N m", 0.0, -1e6, 1e6, "sine part of the torque", _AT),
        Parameter("cos", "N m", 0.0, -1e6, 1e6, "cosine part of the torque", _AT + 1),
        Parameter(
            "order",
            "cycles/rev",
            1.0,
            1e-6,
            1e6,
            "turns of the load per turn of the motor",
            _AT + 2,
            True,
            True,
        ),
        Parameter("sin_2", "N m", 0.0, -1e6, 1e6, "sine part of two waves a turn", _AT + 3, True),
        Parameter("cos_2", "N m", 0.0, -1e6, 1e6, "cosine part of two waves a turn", _AT + 4, True),
    ),
    looks_like="The holding torque follows one sine over a turn of the load, in both directions alike.",
    cause="An unbalanced arm, table, chuck or workpiece, a missing counterweight.",
    remedy="Balance the load, or compensate it by a sine of position; check that the workpiece is centred.",
    look_alikes=(IN_PLACE, IN_A_PART_OF_A_TURN),
    kernels=Kernels(torque=imbalance_torque),
    starts=starts,
    free_shape=free_shape,
    shows_course=shows_course,
    waves=waves,
    of_place=True,
    keeps_zero=True,
    rotary_only=True,
    end_of=(TORQUE_RIPPLE.name,),  # of one period a turn
)
