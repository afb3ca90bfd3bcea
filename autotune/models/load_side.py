"""What effects between motor and load have in common: parameters of the load, and where a fit of it begins."""

from __future__ import annotations

import math

from autotune.models.effect import Parameter
from autotune.models.layout import INERTIA, OFFSET
from autotune.models.start_values import StartContext, Vary

LEAST_LOAD = 0.1
"""Share of the inertia beyond a transmission: less, behind a soft spring, is a hysteresis element."""
STIFFEST = 2.0 * math.pi * 500.0
"""Angular frequency [rad/s] above which a resonance of two equal masses is not looked for, or half the
sampling rate where that is higher."""
AT_START = {"load_inertia": 0.4, "load_friction": 0.4, "damping": 0.1}
SHARES = (0.2, 0.4, 0.65)
"""Of the inertia on the load that are looked at: with a wrong one the loop hardly holds the axis."""
SPLITS = (0.0, 0.2, 0.6)
"""Shares of the friction on the load that are looked at: none of it, so that it floats in a gap; both sides; most."""


def load_parameters(at: int) -> tuple[Parameter, ...]:
    """Share of the inertia, share of the friction, damping and share of the constant torque, from place `at` on."""
    return (
        Parameter("load_inertia", "1", 0.4, 0.02, 0.98, "share of the inertia beyond it", at),
        Parameter("load_friction", "1", 0.4, 0.0, 1.0, "share of the friction beyond it", at + 1, whole=True),
        Parameter("damping", "1", 0.05, 0.0, 2.0, "share of critical damping", at + 2),
        Parameter(
            "load_offset", "1", 0.0, 0.0, 1.0, "share of the offset beyond it", at + 3, True, whole=True
        ),
    )


def load_varies(told: bool) -> dict[str, Vary]:
    """Shares of a load that deserves the name, and the damping; where it is `told`, that of a constant torque."""
    free = {
        "load_inertia": Vary(0.2, 0.2, lower=LEAST_LOAD),
        "load_friction": Vary(0.2, 0.3),
        "damping": Vary(0.1, 0.1),
    }
    return free | ({"load_offset": Vary(0.3, 0.5)} if told else {})


def sides(told: bool) -> tuple[dict[str, float], ...]:
    """Where fits of the load begin, but for its shares: a constant torque is a weight at the load, or an amplifier's.

    What friction and a gap make of the one is far from what they make of the other; where nothing is `told`, it acts at
    the motor.
    """
    return tuple(AT_START | {"load_offset": share} for share in (1.0, 0.0)) if told else (AT_START,)


def hangs(c: StartContext) -> bool:
    """Whether there is a constant torque of which these data can tell on which side it acts.

    One that is less than what is left makes nothing of that.
    """
    return abs(float(c.p[OFFSET])) > c.left


def settles(c: StartContext, gap: float, share: float) -> bool:
    """Whether a constant torque lays a load that nothing holds against one wall of a gap, before the axis turns.

    It crosses the gap in √(2·gap·J/w), the axis its travel in travel over speed. However little it is of what is left,
    the gap is closed then, and opens where the axis brakes.
    """
    seconds = c.travel / max(c.mean_speed, 1e-300)
    return abs(float(c.p[OFFSET])) * seconds**2 > 2.0 * gap * share * float(c.p[INERTIA])


def compliance_at(c: StartContext, share: float, cutoffs: float) -> float:
    """Compliance with which a load of this share rings at so many cut-offs [rad/(N m)]."""
    return ringing_compliance(float(c.p[INERTIA]), share, cutoffs * c.cutoff)


def ringing_compliance(inertia: float, share: float, hertz: float) -> float:
    """Compliance on which a load that is this share of the inertia rings against the motor at `hertz` [rad/(N m)]."""
    return 1.0 / (share * (1.0 - share) * inertia * (2 * math.pi * hertz) ** 2)


def least_compliance(c: StartContext) -> float:
    """Below it motor and load are one mass to these samples [rad/(N m)].

    Without this bound a fit that needs no compliance ends where an integration takes ten times as long.
    """
    return compliance_of_one_mass(float(c.p[INERTIA]), c.period)


def compliance_of_one_mass(inertia: float, period: float) -> float:
    """Compliance below which motor and load are one mass to samples that are a period [s] apart [rad/(N m)]."""
    rate = max(math.pi / period, STIFFEST)
    return 4.0 / (inertia * rate**2)
