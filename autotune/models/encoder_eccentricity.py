"""A position sensor that is not centred: it tells y = q + sin·sin(N·q) + cos·cos(N·q), N = 1.

By another law two waves a turn are beside it, `sin_2` and `cos_2`: a disc that is tilted or far off centre.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kind, Parameter, Proportion
from autotune.models.lanes import anywhere
from autotune.models.layout import INERTIA, block, flag
from autotune.models.look_alikes import IN_QUICK_MOTION
from autotune.models.start_values import StartContext, StartValues, Vary
from autotune.models.torque_ripple import scale_slot

_AT = block("encoder_eccentricity")
_SCALE = scale_slot()
IS_ECCENTRIC = flag("encoder_eccentricity")


TURNS_OF_INVERSE = 3
"""By which the shaft's place is found from the reading: each leaves less than the error's slope of what was left."""


@compiled
def reading_error(p: Floats, position: float) -> float:
    """What the sensor tells too much [rad]."""
    angle = p[_AT + 2] * p[_SCALE] * position
    error = p[_AT] * math.sin(angle) + p[_AT + 1] * math.cos(angle)
    if anywhere(abs(p[_AT + 3]) + abs(p[_AT + 4]) > 0.0):
        error += p[_AT + 3] * math.sin(2.0 * angle) + p[_AT + 4] * math.cos(2.0 * angle)
    return float(error)


@compiled
def true_motion(p: Floats, y: float, rate: float, change: float) -> tuple[float, float, float]:
    """Position, velocity and acceleration of the shaft from those of the reading."""
    order = p[_AT + 2] * p[_SCALE]
    position = y
    for _ in range(TURNS_OF_INVERSE):
        position = y - reading_error(p, position)
    angle = order * position
    slope = order * (p[_AT] * math.cos(angle) - p[_AT + 1] * math.sin(angle))
    bend = -order * order * (p[_AT] * math.sin(angle) + p[_AT + 1] * math.cos(angle))
    if anywhere(abs(p[_AT + 3]) + abs(p[_AT + 4]) > 0.0):
        angle, twice = 2.0 * angle, 2.0 * order
        slope += twice * (p[_AT + 3] * math.cos(angle) - p[_AT + 4] * math.sin(angle))
        bend -= twice * twice * (p[_AT + 3] * math.sin(angle) + p[_AT + 4] * math.cos(angle))
    velocity = rate / (1.0 + slope)
    return position, velocity, (change - bend * velocity * velocity) / (1.0 + slope)


def starts(c: StartContext) -> Iterator[StartValues]:
    """One is enough: the reading is linear in both parts."""
    scale = max(c.resolution, 1e-4)
    if c.angle == 1.0:
        yield StartValues({}, {"sin": Vary(scale, 0.02), "cos": Vary(scale, 0.02)})


def free_shape(c: StartContext) -> StartValues:
    """Two waves a turn beside the one: a disc that is tilted too."""
    scale = max(c.resolution, 1e-4)
    return StartValues({}, {"sin_2": Vary(scale, 0.02), "cos_2": Vary(scale, 0.02)})


def parts(p: Floats, position: Floats, velocity: Floats, acceleration: Floats) -> tuple[Floats, Floats]:
    """Torque that goes with the acceleration and with the square of the speed, −J·e'·a and −J·e''·v² [N m].

    From the reading's motion, to first order in its error e(q); arrays of shape (n,). An inertia J(q) that changes with
    the place has the torque J·a + ½·J'·v² (Lagrange): with J' = −J·e'' half of the second beside the same first.
    """
    own, turn = p[_AT : _AT + 5], p[_AT + 2] * p[_SCALE]
    one, two = np.exp(1j * turn * position), np.exp(2j * turn * position)
    error = own[0] * one.imag + own[1] * one.real + 4.0 * (own[3] * two.imag + own[4] * two.real)
    slope = own[0] * one.real - own[1] * one.imag + 2.0 * (own[3] * two.real - own[4] * two.imag)
    inertia = p[INERTIA]
    return -inertia * turn * slope * acceleration, inertia * turn**2 * error * velocity**2


def size(p: Floats) -> float:
    """How much the sensor tells too much at most [rad]."""
    return math.hypot(p[_AT], p[_AT + 1]) + math.hypot(p[_AT + 3], p[_AT + 4])


ENCODER_ECCENTRICITY = Kind(
    name="encoder_eccentricity",
    parameters=(
        Parameter("sin", "rad", 0.0, -0.5, 0.5, "sine part of the reading's error", _AT),
        Parameter("cos", "rad", 0.0, -0.5, 0.5, "cosine part of the reading's error", _AT + 1),
        Parameter("order", "cycles/rev", 1.0, 1e-6, 1e6, "periods per revolution", _AT + 2, True, held=True),
        Parameter("sin_2", "rad", 0.0, -0.5, 0.5, "sine part of two waves a turn", _AT + 3, True),
        Parameter("cos_2", "rad", 0.0, -0.5, 0.5, "cosine part of two waves a turn", _AT + 4, True),
    ),
    looks_like="At speed the torque waves once a turn, and the wave grows with the square of the speed.",
    cause="An encoder disc or magnet off centre, a bent shaft, a coupling of the encoder out of line.",
    remedy="Centre the encoder, renew its coupling, or correct the reading by a table in the drive.",
    look_alikes=(IN_QUICK_MOTION,),
    not_fed_forward="it is an error of the measurement, not a torque",
    starts=starts,
    free_shape=free_shape,
    least_own=0.5,  # the torque of two waves a turn has four times its part of the reading's error
    extent=size,
    proportion=Proportion(
        parts,
        "the part of its torque that goes with the square of the speed",
        0.5,
        "an inertia that changes with the place, as a crank's or a linkage's",
    ),
    quick=True,
    keeps_zero=True,
    rotary_only=True,
)
