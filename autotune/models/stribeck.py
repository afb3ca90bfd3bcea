"""Friction at rest other than at speed (3.5), with the shapes of Table 2.1: above Coulomb friction, as a rule."""

from __future__ import annotations

from autotune.models.effect import Kind, Parameter
from autotune.models.layout import BREAK_AWAY, STRIBECK_VELOCITY, block

EXPONENT = block("stribeck")

STRIBECK = Kind(
    name="stribeck",
    parameters=(
        Parameter("break_away", "N m", 0.0, 0.0, 1e6, "torque needed to start moving", BREAK_AWAY),
        Parameter(
            "stribeck_velocity", "rad/s", 1.0, 1e-7, 1e3, "speed at which it has fallen", STRIBECK_VELOCITY
        ),
        Parameter(
            "stribeck_exponent", "1", 2.0, 0.3, 4.0, "shape: 2 Gaussian, 1 exponential", EXPONENT, True
        ),
    ),
    looks_like="Friction is highest just after starting and falls with speed; slow moves may stick and slip.",
    cause="Boundary lubrication: at low speed the lubricant film does not carry and surfaces touch.",
    remedy="Use a lubricant with friction modifiers, lower the preload, renew dried grease.",
    surface_prefix=False,
)
