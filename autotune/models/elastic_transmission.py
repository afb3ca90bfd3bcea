"""Two masses with a spring between motor and load; the equations are in `transmission`."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

from autotune.core.arrays import Flags, Floats
from autotune.models.effect import Kind, Parameter
from autotune.models.layout import INERTIA, block, flag
from autotune.models.load_side import (
    SHARES,
    SPLITS,
    compliance_at,
    hangs,
    least_compliance,
    load_parameters,
    load_varies,
    sides,
)
from autotune.models.look_alikes import IN_QUICK_MOTION
from autotune.models.start_values import StartContext, StartValues, Vary

COMPLIANCE = block("elastic_transmission")
HARDENING, RELAXING, RELAXATION = COMPLIANCE + 5, COMPLIANCE + 6, COMPLIANCE + 7
IS_ELASTIC = flag("elastic_transmission")
RESONANCES = (0.37, 0.55, 0.83, 1.25, 1.83, 2.67, 4.0, 6.0)
"""In cut-offs: where torques are compared, and as far above as they still tell of it."""
LEAST_DAMPED = 0.01
"""Share of critical damping beside a part that relaxes, at the start."""
CRITICAL = 1.0
"""Damping from which free motion of motor against load does not oscillate."""


def hardened(compliance: float, torque: float, added: float) -> tuple[float, float]:
    """Compliance [rad/(N m)] and hardening [1/(N m)²] of a spring that gives way alike under a torque [N m].

    `added`: of the stiffness that it has without load, what its twist under that torque adds to it.
    """
    linear = torque / (1.0 + added)
    return compliance * (1.0 + added), added / linear**2


def relaxing(p: Floats, share: float, turns: float) -> dict[str, float]:
    """Values of a spring a part of which relaxes, as stiff and as damped as that of `p` where motor and load ring.

    `share`: of the stiffness that stays, what relaxes; `turns`: radians of ringing in the time in which it does.
    """
    stiffer = share * turns**2 / (1.0 + turns**2)
    stays = 1.0 / (1.0 + stiffer)
    lost = 0.5 * share * stays * turns / (1.0 + turns**2)  # as a share of critical damping
    left = max(float(p[COMPLIANCE + 3]) - lost, LEAST_DAMPED) / math.sqrt(stays)
    rate = 2.0 * math.pi * resonance(p)
    return {
        "compliance": float(p[COMPLIANCE]) / stays,
        "damping": left,
        "relaxing": share,
        "relaxation_time": turns / rate,
    }


def starts(c: StartContext) -> Iterator[StartValues]:
    """Many resonances, with small loads and large ones, with friction on both sides or on one."""
    least, told = least_compliance(c), hangs(c)
    for cutoffs, share, side, split in itertools.product(RESONANCES, SHARES, sides(told), SPLITS):
        compliance = compliance_at(c, share, cutoffs)
        free = {"compliance": Vary(compliance, 0.6 * compliance, lower=least)} | load_varies(told)
        values = {"compliance": compliance, **side, "load_inertia": share, "load_friction": split}
        yield StartValues(values, free)


def resonance(p: Floats) -> float:
    """Frequency at which motor and load ring [Hz]; infinite where they are one mass."""
    share = p[COMPLIANCE + 1]
    reduced = share * (1.0 - share) * p[INERTIA]
    if reduced <= 0.0 or p[COMPLIANCE] <= 0.0:
        return math.inf
    return float(1.0 / (2.0 * math.pi * math.sqrt(p[COMPLIANCE] * reduced)))


def creeps(p: Floats, on: Flags) -> bool:
    """Whether a load comes to rest on its spring without ringing, as that is damped critically or more."""
    return bool(on[IS_ELASTIC]) and bool(p[COMPLIANCE + 3] >= CRITICAL)


ELASTIC_TRANSMISSION = Kind(
    name="elastic_transmission",
    parameters=(
        Parameter("compliance", "rad/(N m)", 0.0, 0.0, 1e3, "twist per torque", COMPLIANCE),
        *load_parameters(COMPLIANCE + 1),
        Parameter(
            "hardening",
            "1/(N m)²",
            0.0,
            0.0,
            1e12,
            "stiffness added per square of torque",
            HARDENING,
            True,
            whole=True,
        ),
        Parameter(
            "relaxing",
            "1",
            0.0,
            0.0,
            3.0,
            "stiffness that relaxes, of that which stays",
            RELAXING,
            True,
            whole=True,
        ),
        Parameter("relaxation_time", "s", 1e-2, 1e-5, 10.0, "in which that relaxes", RELAXATION, True),
    ),
    looks_like="The torque rings or lags after every jerk, at the same frequency at every place and speed.",
    cause="A belt, coupling, gear or long screw that twists between motor and load.",
    remedy="Tension the belt, tighten coupling and clamps; limit jerk; a notch filter in the drive.",
    look_alikes=(IN_QUICK_MOTION,),
    not_fed_forward="its inverse asks for derivatives of the reference that excite the resonance",
    starts=starts,
    resonance=resonance,
    quick=True,
    loop_like=True,
    in_transmission=True,
)
