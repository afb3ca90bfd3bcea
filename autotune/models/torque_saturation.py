"""Large torques with less effect: iron that carries no more flux, or a current limit.

T = u·(1 + c·|u/torque|ⁿ)^(−1/n), with c = (1 − loss)^(−n) − 1, so that `loss` is what is lost at the level `torque`.
Small losses are u·(1 − loss·|u/torque|ⁿ). The exponent is 2 where iron saturates slowly, large where a limit cuts in.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kind, Parameter
from autotune.models.layout import block, flag
from autotune.models.look_alikes import AT_REVERSALS, IN_TORQUE
from autotune.models.start_values import StartContext, StartValues, Vary, at_first

_AT = block("torque_saturation")
SATURATES = flag("torque_saturation")


@compiled
def saturated(p: Floats, on: Flags, demand: float) -> float:
    """Torque that a demand gives in the long run [N m]."""
    if not on[SATURATES]:
        return demand
    n = p[_AT + 2]
    c = (1.0 - p[_AT]) ** -n - 1.0
    return float(demand * (1.0 + c * (abs(demand) / p[_AT + 1]) ** n) ** (-1.0 / n))


def torque_slope(p: Floats, on: Flags, demand: Floats) -> Floats | float:
    """How much of a change of the demand arrives at the shaft.

    The residual is told in the demand's own scale; else saturation would seem to explain by shrinking.
    """
    if not on[SATURATES]:
        return 1.0
    n = p[_AT + 2]
    ratio = np.minimum(np.abs(demand) / p[_AT + 1], 1.0)
    c = (1.0 - p[_AT]) ** -n - 1.0
    return np.asarray(np.maximum((1.0 + c * ratio**n) ** (-1.0 / n - 1.0), 0.05))


def starts(c: StartContext) -> Iterator[StartValues]:
    """A small and a large loss at the largest torque that was recorded, with and without a knee."""
    for loss, exponent in ((0.05, 2.0), (0.05, 5.0), (0.35, 5.0)):
        yield StartValues(
            {
                "loss": loss if loss > 0.1 else at_first(loss, c.left / c.torque),
                "torque": c.largest_torque,
                "exponent": exponent,
            },
            {"loss": Vary(0.2, 0.3), "exponent": Vary(2.0, 2.0)},
        )


TORQUE_SATURATION = Kind(
    name="torque_saturation",
    parameters=(
        Parameter("loss", "1", 0.0, 0.0, 0.9, "relative loss of torque at that level", _AT),
        Parameter("torque", "N m", 1.0, 1e-9, 1e9, "level at which the loss is given", _AT + 1, held=True),
        Parameter("exponent", "1", 2.0, 1.0, 10.0, "how suddenly it sets in", _AT + 2, optional=True),
    ),
    looks_like="Large torques have less effect than small ones; fast accelerations fall short.",
    cause="Iron of the motor that saturates, a weak magnet, a current limit, a low supply voltage.",
    remedy="Check supply and current limits; a motor that was too hot may have lost magnetism; "
    "plan gentler accelerations.",
    look_alikes=(IN_TORQUE, AT_REVERSALS),
    not_fed_forward="it acts where there is no torque in reserve",
    starts=starts,
    quick=True,
)
