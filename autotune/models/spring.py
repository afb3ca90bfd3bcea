"""Torque in proportion to position: a counterbalance spring, a cable, a hose, a bellows."""

from __future__ import annotations

from collections.abc import Iterator

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kernels, Kind, Parameter
from autotune.models.layout import block
from autotune.models.look_alikes import IN_PLACE
from autotune.models.start_values import StartContext, StartValues, Vary

_AT = block("spring")


@compiled
def spring_torque(p: Floats, position: float) -> float:
    """Torque that the spring needs [N m]."""
    return float(p[_AT] * position)


def starts(c: StartContext) -> Iterator[StartValues]:
    """One is enough: the torque is linear in the stiffness."""
    yield StartValues({}, {"stiffness": Vary(c.coulomb / c.travel)})


SPRING = Kind(
    name="spring",
    parameters=(Parameter("stiffness", "N m/rad", 0.0, -1e9, 1e9, "torque per travel", _AT),),
    looks_like="The torque rises in a straight line over the whole travel, in both directions alike.",
    cause="A counterbalance spring, a cable chain, a hose, a bellows, a magnet.",
    remedy="If no spring belongs there, look for cables and hoses that pull; else compensate it.",
    look_alikes=(IN_PLACE,),
    kernels=Kernels(torque=spring_torque),
    starts=starts,
    of_place=True,
    loop_like=True,
)
