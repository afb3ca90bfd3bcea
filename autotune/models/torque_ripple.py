"""Torque that depends on position alone and repeats: cogging, commutation, rolling elements.

Σ sin_k·sin(N_k·q) + cos_k·cos(N_k·q), with q in revolutions × 2π on a rotary axis; on a linear axis N is
in cycles per metre. It adds to the torque that the motion needs.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kernels, Kind, Parameter, Terms
from autotune.models.lanes import anywhere, where
from autotune.models.layout import block
from autotune.models.look_alikes import IN_PLACE
from autotune.models.start_values import StartContext, StartValues, Vary

LINES = 10
"""How many orders one model can hold; three slots each, the last two slots of the block are spare."""
_AT = block("torque_ripple")
_SCALE = _AT + 30


def _line(number: int) -> tuple[Parameter, ...]:
    at = _AT + 3 * (number - 1)
    later = number > 1
    return (
        Parameter(
            f"order_{number}", "cycles/rev", 0.0, 0.0, 1e6, "periods per revolution", at, later, held=True
        ),
        Parameter(f"sin_{number}", "N m", 0.0, -1e6, 1e6, "sine part", at + 1, later, refined=0.02),
        Parameter(f"cos_{number}", "N m", 0.0, -1e6, 1e6, "cosine part", at + 2, later, refined=0.02),
    )


@compiled
def ripple(p: Floats, position: float) -> float:
    """Torque that the ripple needs at a position [N m]."""
    total = 0.0
    scale = p[_SCALE]
    for line in range(LINES):
        order = p[_AT + 3 * line]
        if not anywhere(order != 0.0):
            break
        angle = order * scale * position
        wave = p[_AT + 3 * line + 1] * math.sin(angle) + p[_AT + 3 * line + 2] * math.cos(angle)
        total += where(order != 0.0, wave, 0.0)
    return total


def scale_slot() -> int:
    """Where the plant finds the angle per motion unit: 1 on a rotary axis, 2π on a linear one."""
    return _SCALE


def starts(c: StartContext) -> Iterator[StartValues]:
    """New lines beside those that the model has already."""
    present = [i for i in range(1, LINES + 1) if c.p[_AT + 3 * (i - 1)] > 0.0]
    orders = c.orders_in_residual(LINES - len(present))
    if not orders:
        return
    values = {f"order_{i}": float(c.p[_AT + 3 * (i - 1)]) for i in present}
    values |= {f"sin_{i}": float(c.p[_AT + 3 * (i - 1) + 1]) for i in present}
    values |= {f"cos_{i}": float(c.p[_AT + 3 * (i - 1) + 2]) for i in present}
    reach = 1.0 / (c.angle * c.travel)
    free: dict[str, Vary] = {}
    for i, order in enumerate(orders, len(present) + 1):
        values |= {f"order_{i}": order, f"sin_{i}": 0.0, f"cos_{i}": 0.0}
        free |= {f"sin_{i}": Vary(0.1 * c.coulomb), f"cos_{i}": Vary(0.1 * c.coulomb)}
        free[f"order_{i}"] = Vary(0.2 * reach, 0.5 * reach)
    yield StartValues(values, free)


TORQUE_RIPPLE = Kind(
    name="torque_ripple",
    parameters=tuple(parameter for number in range(1, LINES + 1) for parameter in _line(number)),
    looks_like="The torque waves with position, at the same places in both directions and at every speed.",
    cause="Cogging of the motor, commutation, rolling elements of bearings or screw, teeth of a belt.",
    remedy="Compensate it by a map; look at bearings, screw and belt if it has grown.",
    look_alikes=(IN_PLACE,),
    kernels=Kernels(torque=ripple),
    starts=starts,
    why_no_start="no torque that repeats with position stands out, or the travel is below one and a half periods",
    terms=Terms("order", ("sin", "cos")),
    may_grow=True,
    of_place=True,
    keeps_zero=True,
)
