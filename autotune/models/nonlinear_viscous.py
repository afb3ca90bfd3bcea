"""Viscous friction that is not proportional to speed: grease and oil that thin with shear, windage.

T = torque·v·(v² + knee²)^((exponent − 1)/2), that is torque·|v|^exponent·sign v above the knee. Palmgren's
law for lubricated bearings has exponent 2/3, windage 2; the sum with σ2·v covers both.

Of a law that is no power: films that shear off, film·(1 − exp(−|v|/film_speed)), and windage that sets in at a speed,
fan·((|v| − fan_speed)/fan_speed)². None of them is negative: the torque rises with speed, in whatever shape.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from autotune.core.arrays import Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kernels, Kind, Parameter
from autotune.models.lanes import anywhere, where
from autotune.models.layout import block
from autotune.models.look_alikes import IN_SPEED
from autotune.models.start_values import StartContext, StartValues, Vary, at_first

_AT = block("nonlinear_viscous")
FILMS, FANS = 3, 2
_FILM, _FAN = _AT + 3, _AT + 3 + 2 * FILMS


@compiled
def curved_coefficient(p: Floats, velocity: float) -> float:
    """Torque over velocity [N m s/rad]."""
    knee = p[_AT + 2]
    total = p[_AT] * (velocity * velocity + knee * knee) ** (0.5 * (p[_AT + 1] - 1.0))
    for i in range(FILMS):
        film = p[_FILM + 2 * i + 1]
        if not anywhere(film != 0.0):
            break
        size = max(abs(velocity), 1e-6 * film)
        total += where(film != 0.0, p[_FILM + 2 * i] * (1.0 - math.exp(-size / film)) / size, 0.0)
    for i in range(FANS):
        onset = p[_FAN + 2 * i + 1]
        if not anywhere(onset != 0.0):
            break
        over = max(abs(velocity) - onset, 0.0) / onset
        total += where(onset != 0.0, p[_FAN + 2 * i] * over * over / max(abs(velocity), onset), 0.0)
    return float(total)


def starts(c: StartContext) -> Iterator[StartValues]:
    """One below proportional (grease that thins), one above (windage)."""
    for exponent, share in ((0.5, 0.1), (2.0, 0.05)):
        torque = share * c.coulomb / c.speed**exponent
        yield StartValues(
            {
                "torque": at_first(torque, c.left / c.speed**exponent),
                "exponent": exponent,
                "knee": 2e-3 * c.speed,
            },
            {"torque": Vary(torque, 5.0 * torque), "exponent": Vary(0.3, 0.4)},
        )


SHEARS_OFF, SETS_IN = (0.01, 0.05, 0.25), (0.1, 0.3)
"""Of the top speed: where films shear off and fans set in."""


def free_shape(c: StartContext) -> StartValues:
    """Films and fans beside the power, over the speeds that were driven."""
    values: dict[str, float] = {}
    free: dict[str, Vary] = {}
    for name, places in (("film", SHEARS_OFF), ("fan", SETS_IN)):
        for i, share in enumerate(places, 1):
            values |= {f"{name}_{i}": 0.0, f"{name}_speed_{i}": share * c.speed}
            free[f"{name}_{i}"] = Vary(0.1 * c.coulomb, 0.5 * c.coulomb)
    return StartValues(values, free)


def _term(name: str, number: int, at: int, meaning: str) -> tuple[Parameter, ...]:
    return (
        Parameter(f"{name}_{number}", "N m", 0.0, 0.0, 1e9, meaning, at, True),
        Parameter(
            f"{name}_speed_{number}",
            "rad/s",
            0.0,
            0.0,
            1e6,
            "speed that belongs to it",
            at + 1,
            True,
            held=True,
        ),
    )


NONLINEAR_VISCOUS = Kind(
    name="nonlinear_viscous",
    parameters=(
        Parameter("torque", "N m", 0.0, 0.0, 1e9, "torque at a speed of one unit", _AT),
        Parameter("exponent", "1", 1.0, 0.1, 3.0, "power of the speed", _AT + 1),
        Parameter(
            "knee", "rad/s", 1e-3, 1e-9, 1e3, "below it the torque is linear in speed", _AT + 2, held=True
        ),
        *(one for i in range(FILMS) for one in _term("film", i + 1, _FILM + 2 * i, "a film that shears off")),
        *(
            one
            for i in range(FANS)
            for one in _term("fan", i + 1, _FAN + 2 * i, "windage, at twice its speed")
        ),
    ),
    looks_like="The torque over speed is a curve instead of a straight line, the same in both directions.",
    cause="A lubricant that thins with shear, too much or too thick grease, churning, windage of a fan.",
    remedy="Check amount and grade of the lubricant; a curve that steepens points to churning.",
    look_alikes=(IN_SPEED,),
    kernels=Kernels(viscous=curved_coefficient),
    starts=starts,
    size="torque",
    free_shape=free_shape,
    own_size="torque",
    at_constant_speed=True,
)
