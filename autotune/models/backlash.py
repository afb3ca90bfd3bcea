"""Two masses with play between motor and load, and a spring where they touch; the equations are in `transmission`."""

from __future__ import annotations

import itertools
from collections.abc import Iterator

from autotune.core.arrays import Floats
from autotune.models.effect import Kind, Parameter
from autotune.models.layout import block, flag
from autotune.models.load_side import (
    AT_START,
    SPLITS,
    compliance_at,
    least_compliance,
    load_parameters,
    load_varies,
)
from autotune.models.look_alikes import IN_QUICK_MOTION, IN_SPEED
from autotune.models.start_values import StartContext, StartValues, Vary

GAP = block("backlash")
HAS_GAP = flag("backlash")
CONTACT = 200.0
"""Resonance of motor and load in contact [Hz]: softer than most: samples can tell no more of a harder one."""
REACHES = (0.15, 0.4, 0.8, 1.5, 3.0, 7.0)
"""Gaps, measured by the travel over which the bristle bends."""


def starts(c: StartContext) -> Iterator[StartValues]:
    """Gaps of many sizes, with friction on both sides or on one."""
    least, compliance = least_compliance(c), compliance_at(c, CONTACT)
    for reaches, split in itertools.product(REACHES, SPLITS):
        gap = max(reaches * c.reach, 4.0 * c.resolution)
        free = {
            "gap": Vary(0.5 * gap, 0.6 * gap),
            "contact_compliance": Vary(compliance, compliance, lower=least),
        }
        values = {"gap": gap, "contact_compliance": compliance, **AT_START, "load_friction": split}
        yield StartValues(values, free | load_varies())


def width(p: Floats) -> float:
    """Of the gap [rad]."""
    return float(p[GAP])


BACKLASH = Kind(
    name="backlash",
    parameters=(
        Parameter("gap", "rad", 0.0, 0.0, 1e3, "free play", GAP),
        Parameter(
            "contact_compliance", "rad/(N m)", 1e-3, 1e-9, 1e3, "twist per torque of its contact", GAP + 1
        ),
        *load_parameters(GAP + 2),
    ),
    looks_like="After a reversal the motor runs free for a moment, then meets the load with an impact.",
    cause="Play in gear, coupling, key or nut.",
    remedy="Adjust or preload the nut or gear, tighten the coupling; worn parts must be replaced.",
    look_alikes=(IN_SPEED, IN_QUICK_MOTION),
    not_fed_forward="a torque that crosses the play at the wrong moment is an impact",
    starts=starts,
    extent=width,
    quick=True,
    in_transmission=True,
)
