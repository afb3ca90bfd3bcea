"""Large torques with less effect: iron that carries no more flux, or a current limit.

T = u·(1 + c·|u/torque|ⁿ)^(−1/n), with c = (1 − loss)^(−n) − 1, so that `loss` is what is lost at the level `torque`.
Small losses are u·(1 − loss·|u/torque|ⁿ). The exponent is 2 where iron saturates slowly, large where a limit cuts in.
By another law more is lost from each of a few demands on: loss_i·(|u| − knee_i).
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kind, Parameter
from autotune.models.lanes import anywhere, where
from autotune.models.layout import BLOCK, block, flag
from autotune.models.look_alikes import AT_REVERSALS, IN_TORQUE
from autotune.models.start_values import StartContext, StartValues, Vary, at_first

_AT = block("torque_saturation")
OF_SATURATION = slice(_AT, _AT + BLOCK)
SATURATES = flag("torque_saturation")


KNEES = 4
"""Demands from which on more of the torque is lost, by another law."""
MOST = 0.6
"""Of the largest torque that was recorded: the most that a fit lets be lost there. With more, and a sudden limit,
nearly all demands would give the same torque, which is the sign of the velocity: that fits any axis."""
RARE = 0.6
"""Of the largest torque: where no more than a twentieth of the rows ask for more than that, those rows are bursts."""
BEGUN, MOST_USUAL = 0.2, 0.4
"""Of the torque that a twentieth of the rows exceed: the loss there, as it begins where more is asked for in bursts,
and at most. A small loss at the bursts raises the error; a limit among usual demands fits any axis."""
PLACES = (0.15, 0.3, 0.5, 0.75)
"""Of the largest demand that was recorded: where they begin; each moves as far as half-way to the next."""


@compiled
def bent(p: Floats, on: Flags) -> float:
    """c, which is the same for every demand; 0 where nothing saturates."""
    if not on[SATURATES]:
        return float(0.0 * p[_AT])
    return float((1.0 - p[_AT]) ** -p[_AT + 2] - 1.0)


@compiled
def saturated(p: Floats, on: Flags, demand: float, c: float) -> float:
    """Torque that a demand gives in the long run [N m]; `c` is what `bent` gives."""
    if not on[SATURATES]:
        return demand
    n, size = p[_AT + 2], abs(demand)
    torque = size * (1.0 + c * (size / p[_AT + 1]) ** n) ** (-1.0 / n)
    for i in range(KNEES):
        if not anywhere(p[_AT + 4 + 2 * i] > 0.0):
            break
        torque -= p[_AT + 3 + 2 * i] * max(size - p[_AT + 4 + 2 * i], 0.0)
    return float(where(demand < 0.0, -torque, torque))


def torque_slope(p: Floats, on: Flags, demand: Floats) -> Floats | float:
    """How much of a change of the demand arrives at the shaft.

    The residual is told in the demand's own scale; else saturation would seem to explain by shrinking.
    """
    if not on[SATURATES]:
        return 1.0
    n = p[_AT + 2]
    ratio = np.minimum(np.abs(demand) / p[_AT + 1], 1.0)
    c = (1.0 - p[_AT]) ** -n - 1.0
    slope = (1.0 + c * ratio**n) ** (-1.0 / n - 1.0)
    for i in range(KNEES):
        if p[_AT + 4 + 2 * i] > 0.0:
            slope = slope - p[_AT + 3 + 2 * i] * (np.abs(demand) > p[_AT + 4 + 2 * i])
    return np.asarray(np.maximum(slope, 0.05))


def starts(c: StartContext) -> Iterator[StartValues]:
    """A small and a large loss at the largest torque that was recorded, with and without a knee.

    Where that was asked for in bursts only, a loss at what other rows ask for, too.
    """
    largest, high, small = c.largest_torque, c.high_torque, at_first(0.05, c.left / c.torque)
    for loss, exponent in ((small, 2.0), (small, 5.0), (0.35, 5.0)):
        yield _start(loss, largest, exponent, MOST)
    if high < RARE * largest:
        yield _start(BEGUN, high, 2.0, MOST_USUAL)


def _start(loss: float, torque: float, exponent: float, most: float) -> StartValues:
    """So much of a torque lost, and at most."""
    return StartValues(
        {"loss": loss, "torque": torque, "exponent": exponent},
        {"loss": Vary(0.2, 0.3, upper=most), "exponent": Vary(2.0, 2.0)},
    )


def free_shape(c: StartContext) -> StartValues:
    """Any course that bends one way: more is lost from each of several demands on."""
    between = [0.5 * (one + two) for one, two in itertools.pairwise((0.0, *PLACES, 1.0))]
    values: dict[str, float] = {}
    free: dict[str, Vary] = {}
    for i, share in enumerate(PLACES, 1):
        lower, upper = (c.largest_torque * edge for edge in between[i - 1 : i + 1])
        values |= {f"loss_{i}": 0.0, f"knee_{i}": share * c.largest_torque}
        free[f"loss_{i}"] = Vary(0.05, 0.1)
        free[f"knee_{i}"] = Vary(0.2 * (upper - lower), 0.4 * (upper - lower), lower, upper)
    return StartValues(values, free)


def _knee(number: int) -> tuple[Parameter, Parameter]:
    at = _AT + 1 + 2 * number
    return (
        Parameter(f"loss_{number}", "1", 0.0, 0.0, 0.6, "more of the torque lost beyond it", at, True),
        Parameter(
            f"knee_{number}", "N m", 0.0, 0.0, 1e9, "demand where that begins", at + 1, True, held=True
        ),
    )


TORQUE_SATURATION = Kind(
    name="torque_saturation",
    parameters=(
        Parameter("loss", "1", 0.0, 0.0, 0.9, "relative loss of torque at that level", _AT),
        Parameter("torque", "N m", 1.0, 1e-9, 1e9, "level at which the loss is given", _AT + 1, held=True),
        Parameter("exponent", "1", 2.0, 1.0, 10.0, "how suddenly it sets in", _AT + 2, optional=True),
        *(one for number in range(1, KNEES + 1) for one in _knee(number)),
    ),
    looks_like="Large torques have less effect than small ones; fast accelerations fall short.",
    cause="Iron of the motor that saturates, a weak magnet, a current limit, a low supply voltage.",
    remedy="Check supply and current limits; a motor that was too hot may have lost magnetism; "
    "plan gentler accelerations.",
    look_alikes=(IN_TORQUE, AT_REVERSALS),
    not_fed_forward="it acts where there is no torque in reserve",
    starts=starts,
    free_shape=free_shape,
    own_size="loss",
    quick=True,
)
