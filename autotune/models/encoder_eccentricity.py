"""A position sensor that is not centred: it tells y = q + sin·sin(N·q) + cos·cos(N·q), N = 1."""

from __future__ import annotations

import math
from collections.abc import Iterator

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kind, Parameter
from autotune.models.layout import block, flag
from autotune.models.look_alikes import IN_QUICK_MOTION
from autotune.models.start_values import StartContext, StartValues, Vary
from autotune.models.torque_ripple import scale_slot

_AT = block("encoder_eccentricity")
_SCALE = scale_slot()
IS_ECCENTRIC = flag("encoder_eccentricity")


@compiled
def reading_error(p: Floats, position: float) -> float:
    """What the sensor tells too much [rad]."""
    angle = p[_AT + 2] * p[_SCALE] * position
    return float(p[_AT] * math.sin(angle) + p[_AT + 1] * math.cos(angle))


@compiled
def true_motion(p: Floats, y: float, rate: float, change: float) -> tuple[float, float, float]:
    """Position, velocity and acceleration of the shaft from those of the reading, to first order."""
    order = p[_AT + 2] * p[_SCALE]
    angle = order * y
    sine, cosine = math.sin(angle), math.cos(angle)
    slope = 1.0 - order * (p[_AT] * cosine - p[_AT + 1] * sine)
    bend = order * order * (p[_AT] * sine + p[_AT + 1] * cosine)
    position = y - p[_AT] * sine - p[_AT + 1] * cosine
    return position, rate * slope, change * slope + bend * rate * rate


def starts(c: StartContext) -> Iterator[StartValues]:
    """One is enough: the reading is linear in both parts."""
    scale = max(c.resolution, 1e-4)
    if c.angle == 1.0:
        yield StartValues({}, {"sin": Vary(scale, 0.02), "cos": Vary(scale, 0.02)})


def size(p: Floats) -> float:
    """How much the sensor tells too much at most [rad]."""
    return math.hypot(p[_AT], p[_AT + 1])


ENCODER_ECCENTRICITY = Kind(
    name="encoder_eccentricity",
    parameters=(
        Parameter("sin", "rad", 0.0, -0.5, 0.5, "sine part of the reading's error", _AT),
        Parameter("cos", "rad", 0.0, -0.5, 0.5, "cosine part of the reading's error", _AT + 1),
        Parameter("order", "cycles/rev", 1.0, 1e-6, 1e6, "periods per revolution", _AT + 2, True, held=True),
    ),
    looks_like="At speed the torque waves once a turn, and the wave grows with the square of the speed.",
    cause="An encoder disc or magnet off centre, a bent shaft, a coupling of the encoder out of line.",
    remedy="Centre the encoder, renew its coupling, or correct the reading by a table in the drive.",
    look_alikes=(IN_QUICK_MOTION,),
    not_fed_forward="it is an error of the measurement, not a torque",
    starts=starts,
    extent=size,
    quick=True,
    rotary_only=True,
)
