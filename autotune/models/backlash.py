"""Two masses with play between motor and load, and a spring where they touch; the equations are in `transmission`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

from autotune.core.arrays import Floats
from autotune.models.effect import Kind, Parameter
from autotune.models.layout import COULOMB, INERTIA, block, flag
from autotune.models.load_side import (
    AT_START,
    SHARES,
    SPLITS,
    compliance_at,
    hangs,
    least_compliance,
    load_parameters,
    load_varies,
    settles,
    sides,
)
from autotune.models.look_alikes import IN_QUICK_MOTION, IN_SPEED
from autotune.models.start_values import StartContext, StartValues, Vary

GAP = block("backlash")
IMPACT = GAP + 6
HAS_GAP = flag("backlash")
CONTACT = 3.0
"""Resonance of motor and load in contact, in cut-offs: softer than most; what is compared tells little of a harder one.
"""
CROSSINGS = (0.06, 0.1, 0.16, 0.26, 0.42, 0.7, 1.1, 1.8)
"""Times in which a motor that its friction stops crosses gaps, in periods of the cut-off: shorter, nobody sees them;
longer, anybody does."""
DAMPED = (AT_START["damping"], 0.3)
"""Shares of critical damping that are looked at. A loop that holds the axis on its own contact may hunt on one that is
damped less, and no steps lead from there: what hunts costs many times what no gap costs. A contact that is damped too
much loses only a part of its ringing, and comes down from there; but far down it ends short of it."""
SLOWEST = 1e-6
"""rad/s or m/s, at which surfaces meet at least, where friction or gap come to nothing."""


def starts(c: StartContext) -> Iterator[StartValues]:
    """Gaps of many sizes, with friction on both sides or on one, in contacts that ring and that hardly do.

    After a reversal, or at a stop, motor and load part by ½·(F/J)·t² in a time t.
    """
    least, hung = least_compliance(c), hangs(c)
    for periods, share, split in itertools.product(CROSSINGS, SHARES, SPLITS):
        compliance = compliance_at(c, share, CONTACT)
        gap = 0.5 * c.coulomb / float(c.p[INERTIA]) * (periods / c.cutoff) ** 2
        free = {
            "gap": Vary(0.5 * gap, 0.6 * gap),
            "contact_compliance": Vary(compliance, compliance, lower=least),
        }
        told = hung or (split == 0.0 and settles(c, gap, share))
        for side, damping in itertools.product(sides(told), DAMPED):
            values = {"gap": gap, "contact_compliance": compliance, **side, "damping": damping}
            yield StartValues(
                values | {"load_inertia": share, "load_friction": split}, free | load_varies(told)
            )


def damped_by_impact(p: Floats, damping: float) -> float:
    """What damps a contact per torque as much as a share of critical [s/rad]: as much speed is left after an impact.

    A contact that is damped by a share d of critical leaves e = exp(-π·d/√(1 - d²)) of it, one by χ about 1 - 2/3·χ·v
    [hunt-1975]; v is the speed at which a motor that its friction stops has crossed the gap.
    """
    left = math.exp(-math.pi * damping / math.sqrt(1.0 - damping**2))
    speed = math.sqrt(2.0 * float(p[GAP] * p[COULOMB] / p[INERTIA]))
    return 1.5 * (1.0 - left) / max(speed, SLOWEST)


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
        Parameter(
            "impact_damping",
            "s/rad",
            0.0,
            0.0,
            1e6,
            "damping per torque of its contact",
            IMPACT,
            True,
            whole=True,
        ),
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
