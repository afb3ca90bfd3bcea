"""Friction that depends on the place: a tight spot, a worn stretch, a bearing that runs untrue.

The friction level is multiplied by 1 + height·exp(−|(q − centre)/width|^edge) + sin·sin(N·q) + cos·cos(N·q), and by
a line through `rise_1` … at places that are evenly spaced, where its course is another. With an edge of 2 the spot is a
bell, with 1 a peak, with more a stretch with two flanks, each about 1/edge of the width long.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kernels, Kind, Parameter, Proportion
from autotune.models.lanes import anywhere, where
from autotune.models.layout import COULOMB, INERTIA, block
from autotune.models.look_alikes import IN_PLACE
from autotune.models.start_values import StartContext, StartValues, Vary, at_first
from autotune.models.torque_ripple import scale_slot

_AT = block("position_dependent_friction")
_SCALE = scale_slot()
LEAST_FACTOR = 0.05
KNOTS = 21
"""Places of a course that is neither spot nor wave; where the first of them is, is free."""
_EDGE = _AT + 8 + KNOTS
BELL, STEEPEST = 2.0, 20.0


@compiled
def place_factor(p: Floats, state: Floats, position: float) -> float:
    """What the friction level is multiplied by."""
    factor = 1.0
    if anywhere(p[_AT] != 0.0):
        ratio = (position - p[_AT + 1]) / p[_AT + 2]
        power = ratio * ratio
        if anywhere(p[_EDGE] != BELL):
            power = where(p[_EDGE] != BELL, abs(ratio) ** p[_EDGE], power)
        factor += where(p[_AT] != 0.0, p[_AT] * math.exp(-power), 0.0)
    if anywhere(p[_AT + 3] > 0.0):
        angle = p[_AT + 3] * p[_SCALE] * position
        factor += where(p[_AT + 3] > 0.0, p[_AT + 4] * math.sin(angle) + p[_AT + 5] * math.cos(angle), 0.0)
    if anywhere(p[_AT + 7] > 0.0):
        place = (position - p[_AT + 6]) / p[_AT + 7]
        for i in range(KNOTS):
            factor += where(p[_AT + 7] > 0.0, p[_AT + 8 + i] * max(1.0 - abs(place - i), 0.0), 0.0)
    return float(max(factor, LEAST_FACTOR))


def starts(c: StartContext) -> Iterator[StartValues]:
    """A spot where the residual looks most like one, and a wave over a turn (or the travel)."""
    low, high = (float(edge) for edge in np.percentile(c.position(), [1, 99]))
    centre, width = _likeliest_spot(c, low, high)
    yield StartValues(
        {"height": at_first(0.02, c.left / c.coulomb), "centre": centre, "width": width},
        {
            "height": Vary(0.2, 0.5),
            "centre": Vary(0.5 * width, 0.7 * width),
            "width": Vary(0.4 * width, 0.5 * width),
        },
    )
    span = high - low
    order = 1.0 if c.angle == 1.0 else 1.0 / span
    if span * order * c.angle >= 1.2 * math.pi:
        yield StartValues({"order": order}, {"sin": Vary(0.1, 0.4), "cos": Vary(0.1, 0.4)})


def plain_shape(_: StartContext) -> StartValues:
    """Other flanks of the spot."""
    return StartValues({}, {"edge": Vary(1.0, 2.0, 1.0, STEEPEST)})


def free_shape(c: StartContext) -> StartValues:
    """Other flanks of the spot, and a line through places that are evenly spaced over the travel."""
    low, high = float(np.min(c.position())), float(np.max(c.position()))
    step = (high - low) / (KNOTS - 2)
    values = {"from": low - 0.5 * step, "step": step}
    rises = {f"rise_{i}": 0.0 for i in range(1, KNOTS + 1)}
    raster = {"from": Vary(0.1 * step, 0.3 * step, low - step, low)}
    free = dict(plain_shape(c).free) | raster | {name: Vary(0.2, 0.5) for name in rises}
    return StartValues(values | rises, free)


@compiled
def _rises(p: Floats, state: Floats, places: Floats, rises: Floats) -> None:
    """Fills in by how much the friction level rises at places of shape (n,), relative."""
    for i in range(len(places)):
        rises[i] = place_factor(p, state, places[i]) - 1.0


def parts(p: Floats, position: Floats, velocity: Floats, acceleration: Floats) -> tuple[Floats, Floats]:
    """What friction and inertia would have by such a course, g(q)·(J·a + F·sign v), and −g·J·a [N m].

    Their sum is the law: friction alone follows the place, its viscous part with it or without. A torque constant that
    does has the first without the second: the motor's torque falls short of what its current says, whatever that torque
    is for. Shape (n,) each.
    """
    course = np.empty(len(position))
    _rises(p, np.zeros(1), position, course)
    accelerating = p[INERTIA] * acceleration
    return course * (accelerating + p[COULOMB] * np.sign(velocity)), -course * accelerating


def _likeliest_spot(c: StartContext, low: float, high: float) -> tuple[float, float]:
    """Centre and width of the spot that explains most of the residual."""
    thin = c.thinned()
    place = c.position()[thin.rows]
    column = c.sensitivity("coulomb")[thin.rows] * c.coulomb
    span = high - low
    best = (-1.0, 0.5 * (low + high), span)
    for width in (0.04 * span, 0.1 * span, 0.22 * span, 0.5 * span):
        for centre in np.linspace(low, high, min(25, max(9, int(span / width)))):
            shape = np.exp(-(((place - centre) / width) ** 2))
            best = max(best, (thin.share((column * shape)[:, None]), float(centre), float(width)))
    return best[1], best[2]


POSITION_DEPENDENT_FRICTION = Kind(
    name="position_dependent_friction",
    parameters=(
        Parameter("height", "1", 0.0, -0.95, 20.0, "relative rise of friction at the spot", _AT),
        Parameter("centre", "rad", 0.0, -1e6, 1e6, "where the spot is", _AT + 1),
        Parameter("width", "rad", 1.0, 1e-6, 1e6, "how far it reaches", _AT + 2),
        Parameter("order", "cycles/rev", 0.0, 0.0, 1e6, "periods per revolution", _AT + 3, True, held=True),
        Parameter("sin", "1", 0.0, -0.95, 0.95, "sine part, relative", _AT + 4, True),
        Parameter("cos", "1", 0.0, -0.95, 0.95, "cosine part, relative", _AT + 5, True),
        Parameter("from", "rad", 0.0, -1e6, 1e6, "first place of the line", _AT + 6, True, held=True),
        Parameter("step", "rad", 0.0, 0.0, 1e6, "from place to place", _AT + 7, True, held=True),
        *(
            Parameter(f"rise_{i}", "1", 0.0, -0.95, 20.0, "relative rise there", _AT + 7 + i, True)
            for i in range(1, KNOTS + 1)
        ),
        Parameter("edge", "1", BELL, 1.0, STEEPEST, "how steep its flanks are", _EDGE, True),
    ),
    looks_like="Friction is higher (or lower) at some places, in both directions: the band between "
    "forward and backward torque widens there.",
    cause="A tight spot of guide or screw, local wear, misalignment, a bent shaft, a damaged seal.",
    remedy="Look at guide, screw and alignment at that place; clean and lubricate there first.",
    look_alikes=(IN_PLACE,),
    kernels=Kernels(level_factor=place_factor),
    starts=starts,
    size="height",
    plain_shape=plain_shape,
    free_shape=free_shape,
    proportion=Proportion(
        parts,
        "the part by which it spares the torque that accelerates the axis",
        0.0,
        "a torque constant that changes with the place, as magnets and tired windings make it",
        common=False,
    ),
    of_place=True,
    both_ways=True,
    keeps_zero=True,
)
