"""Friction that is higher at rest than at speed (3.5), with the shapes of Table 2.1.

A fit never takes break-away below Coulomb friction: friction that rises from rest is a film that builds up, viscous and
curved (`nonlinear_viscous`), and a fall with the sign turned would stand for that and for much else.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from autotune.models.effect import Kind, Parameter
from autotune.models.layout import BREAK_AWAY, COULOMB, STRIBECK_VELOCITY, VISCOUS, block, flag
from autotune.models.look_alikes import AT_STARTS, IN_SPEED, IN_TIME
from autotune.models.lugre import falling_level
from autotune.models.nonlinear_viscous import curved_coefficient
from autotune.models.start_values import StartContext, StartValues, Vary, at_first

EXPONENT = block("stribeck")
TAIL = EXPONENT + 1
FALLS = flag("stribeck")
SPEEDS = (1e-3, 1.0, 200)
"""Of the top speed, and how many: where it is looked whether friction falls. What has fallen below them is dry."""


def starts(c: StartContext) -> Iterator[StartValues]:
    """Several velocities, and the two shapes of Table 2.1 that differ most."""
    slowest = -math.inf if c.constant_speeds else STRIBECK.parameter("stribeck_velocity").least(c.speed)
    for share, exponent in ((0.01, 2.0), (0.05, 2.0), (0.03, 1.0)):
        speed = share * c.speed if not c.constant_speeds else 5.0 * share * c.speed
        yield StartValues(
            {
                "break_away": float(c.p[COULOMB]) + at_first(0.1 * c.coulomb, c.left),
                "stribeck_velocity": speed,
                "stribeck_exponent": exponent,
            },
            {
                "break_away": Vary(0.1 * c.coulomb, 0.4 * c.coulomb),
                "stribeck_velocity": Vary(0.3 * speed, 0.6 * speed, lower=slowest),
            },
        )


def free_shape(c: StartContext) -> StartValues:
    """Exponent and tail free: all curves of Table 2.1, the hyperbola and what is between them (`falling_level`)."""
    return StartValues({}, {"stribeck_exponent": Vary(0.5, 0.5), "stribeck_tail": Vary(0.5, 0.5)})


def falls(c: StartContext) -> bool:
    """Whether friction falls anywhere, all that is viscous added.

    Beside a free Coulomb and viscous friction a level that falls over much of the speeds is any curve of speed: where
    the sum only rises, ever more steeply, that is windage as well.
    """
    p, speeds = c.p, np.geomspace(*SPEEDS) * c.speed
    shape = p[STRIBECK_VELOCITY], p[EXPONENT], p[TAIL]
    level = [falling_level(v, p[COULOMB], p[BREAK_AWAY], *shape) for v in speeds.tolist()]
    slope = [p[VISCOUS] + curved_coefficient(p, v) for v in speeds.tolist()]
    return bool(np.any(np.diff(np.array(level) + np.array(slope) * speeds) < 0.0))


STRIBECK = Kind(
    name="stribeck",
    parameters=(
        Parameter(
            "break_away", "N m", 0.0, 0.0, 1e6, "torque needed to start moving", BREAK_AWAY, above=COULOMB
        ),
        Parameter(
            "stribeck_velocity",
            "rad/s",
            1.0,
            1e-7,
            1e3,
            "speed at which it has fallen",
            STRIBECK_VELOCITY,
            slowest=SPEEDS[0],
        ),
        Parameter(
            "stribeck_exponent", "1", 2.0, 0.3, 4.0, "shape: 2 Gaussian, 1 exponential", EXPONENT, True
        ),
        Parameter("stribeck_tail", "1", 0.0, 0.0, 2.0, "0 as its exponential, 1 as a hyperbola", TAIL, True),
    ),
    looks_like="Friction is highest just after starting and falls with speed; slow moves may stick and slip.",
    cause="Boundary lubrication: at low speed the lubricant film does not carry and surfaces touch.",
    remedy="Use a lubricant with friction modifiers, lower the preload, renew dried grease.",
    surface_prefix=False,
    look_alikes=(IN_SPEED, AT_STARTS, IN_TIME),
    starts=starts,
    size="break_away",
    free_shape=free_shape,
    own_course=falls,
    at_constant_speed=True,
    in_lugre=True,
)
