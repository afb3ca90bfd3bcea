"""What is between motor and load: two masses with a spring, a damper and a gap.

T = K·(φ ∓ gap/2)·(1 ± χ·φ') + D·φ' beyond the gap and 0 inside it, φ the twist; a contact cannot pull. D is a share
`damping` of critical, χ what a contact is damped by per torque: surfaces that meet touch in a point first, so that the
damping grows with the torque [hunt-1975]. Without a gap T = K·φ·(1 + η·(K·φ)²) + D·φ': a gear, a strain wave gear most
of all, is stiffer the more teeth carry [tuttle-1996]; and a part ρ·K·ψ of it relaxes, ψ' = φ' - ψ/τ, in belts and in
couplings of rubber (Zener's solid [zener-1948]). Without effect, motor and load are one mass.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from autotune.core.arrays import Flags, Floats
from autotune.models.backlash import BACKLASH, GAP, HAS_GAP, IMPACT
from autotune.models.compiled import compiled
from autotune.models.elastic_transmission import (
    COMPLIANCE,
    ELASTIC_TRANSMISSION,
    HARDENING,
    IS_ELASTIC,
    RELAXATION,
    RELAXING,
)
from autotune.models.lanes import anywhere, where
from autotune.models.layout import INERTIA, OFFSET, state_block

_STATE = state_block(ELASTIC_TRANSMISSION.name)
LOAD_POSITION, LOAD_VELOCITY, LOAD_BRISTLE, STARTED = _STATE, _STATE + 1, _STATE + 2, _STATE + 3
RELAXED = _STATE + 4
LOAD_ELEMENTS = _STATE + 5
"""Where the states of a contact's elements at the load begin (`reversal_memory`)."""
BETWEEN = frozenset(
    parameter.slot for kind in (ELASTIC_TRANSMISSION, BACKLASH) for parameter in kind.parameters
)
"""Places of all parameters between motor and load."""
Coupling: TypeAlias = tuple[float, float, float, float, float, float, float]
"""What `coupling` gives."""
Between: TypeAlias = tuple[float, float, float, float, float, float, float, float, float, float]
"""What `between_masses` gives."""
STIFFEST_RATE = 8e3  # rad/s, what the integration still resolves
COUPLED_STEP = 2.0 / 3.0
"""Radians of their ringing in a step of two masses: a spring's is 0.04 % off then. One that hardens fourfold and rings
3.2 times as fast is as far off as a step of a third of that without foresight would have it. No parameter moves it: a
sensitivity would be that of the step."""
HARDEST = 3.0
"""Of its stiffness without load, what a twist adds to a spring at most: so much more rate the integration bears."""


@compiled
def has_load(on: Flags) -> bool:
    """Whether motor and load are two masses."""
    return bool(on[IS_ELASTIC] or on[HAS_GAP])


def of_one_mass(on: Flags) -> Flags:
    """The flags of the same axis with motor and load in one piece."""
    rigid = on.copy()
    rigid[[IS_ELASTIC, HAS_GAP]] = False
    return rigid


@compiled
def load_shares(p: Floats, on: Flags) -> tuple[float, float]:
    """Shares of inertia and friction beyond the transmission."""
    at = COMPLIANCE + 1 if on[IS_ELASTIC] else GAP + 2
    return float(p[at]), float(p[at + 1])


@compiled
def contact_damping(p: Floats, on: Flags) -> float:
    """Share of critical damping between motor and load."""
    return float(p[COMPLIANCE + 3 if on[IS_ELASTIC] else GAP + 4])


@compiled
def hung(p: Floats, on: Flags) -> float:
    """Constant torque that acts at the load and not at the motor, as a weight does [N m]."""
    return float(p[OFFSET] * p[COMPLIANCE + 4 if on[IS_ELASTIC] else GAP + 5])


@compiled
def coupling(p: Floats, on: Flags) -> Coupling:
    """Stiffness [N m/rad], damping [N m s/rad], half the gap [rad], damping per torque of its contact [s/rad], share of
    the stiffness that a twist adds per square of it [1/rad²], stiffness that relaxes [N m/rad] and its rate [1/s].
    """
    share, _ = load_shares(p, on)
    reduced = p[INERTIA] * share * (1.0 - share)
    compliance = p[COMPLIANCE] if on[IS_ELASTIC] else p[GAP + 1]
    damping = p[COMPLIANCE + 3] if on[IS_ELASTIC] else p[GAP + 4]
    stiffness = min(1.0 / max(compliance, 1e-12), reduced * STIFFEST_RATE * STIFFEST_RATE)
    half = 0.5 * p[GAP] if on[HAS_GAP] else 0.0
    impact = p[IMPACT] if on[HAS_GAP] else 0.0
    damped = 2.0 * damping * math.sqrt(stiffness * reduced)
    if not on[IS_ELASTIC]:
        return stiffness, damped, half, impact, 0.0, 0.0, 0.0
    harder = p[HARDENING] * stiffness * stiffness
    return stiffness, damped, half, impact, harder, p[RELAXING] * stiffness, 1.0 / p[RELAXATION]


@compiled
def between_masses(p: Floats, on: Flags) -> Between:
    """What is between motor and load, asked once for all steps: `load_shares`, `hung` and `coupling`; 0 for one mass.

    A step writes its state, and the compiler cannot tell that no parameter is written with it: it would ask anew for a
    root and a quotient in every step.
    """
    if not has_load(on):
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    mass, rub = load_shares(p, on)
    stiffness, damping, half, impact, harder, relaxing, fading = coupling(p, on)
    return mass, rub, hung(p, on), stiffness, damping, half, impact, harder, relaxing, fading


@compiled
def passed_torque(
    stiffness: float, damping: float, half: float, impact: float, harder: float, twist: float, rate: float
) -> float:
    """Torque from motor to load [N m], but for what relaxes; the first of what `coupling` returns come first."""
    direct = stiffness * twist * (1.0 + min(harder * twist * twist, HARDEST)) + damping * rate
    if not anywhere(half != 0.0):
        return direct
    ahead = max(stiffness * (twist - half) * (1.0 + impact * rate) + damping * rate, 0.0)
    behind = min(stiffness * (twist + half) * (1.0 - impact * rate) + damping * rate, 0.0)
    touching = where(twist > half, ahead, where(twist < -half, behind, 0.0))
    return float(where(half == 0.0, direct, touching))


@compiled
def foreseen(
    stiffness: float,
    damping: float,
    half: float,
    impact: float,
    harder: float,
    relaxing: float,
    twist: float,
    passed: float,
    step: float,
) -> float:
    """What a relative acceleration of motor against load adds to the torque `passed` within a step [N m s²/rad].

    Asked before the acceleration is known, so that the step is implicit in it: a spring rings at its own frequency to
    the fourth power of a step (Newmark's method with beta = 1/12 [newmark-1959]), and damping brakes as its mean does.
    A contact that does not touch adds nothing.
    """
    grows = harder * twist * twist
    stiff = stiffness * where(grows < HARDEST, 1.0 + 3.0 * grows, 1.0 + HARDEST) + relaxing
    damped = damping
    if anywhere(half != 0.0):
        touches = where(passed == 0.0, where(half == 0.0, 1.0, 0.0), 1.0)
        damped = touches * (damping + stiffness * impact * max(abs(twist) - half, 0.0))
        stiff = touches * stiff
    return float(step * (step * stiff / 12.0 + 0.5 * damped))


@compiled
def relaxed(state: Floats, stiffness: float, fading: float, rate: float, step: float) -> float:
    """Torque that relaxes [N m], after a step in which the twist changes at `rate`; its state is changed in place.

    `stiffness` and `fading` are the last two of `coupling`.
    """
    state[RELAXED] = (state[RELAXED] + step * rate) / (1.0 + step * fading)
    return float(stiffness * state[RELAXED])


@compiled
def coupling_rate(p: Floats, on: Flags) -> float:
    """Angular frequency of motor against load [rad/s]; 0 where they are one mass."""
    if not has_load(on):
        return 0.0
    share, _ = load_shares(p, on)
    return math.sqrt(coupling(p, on)[0] / (p[INERTIA] * share * (1.0 - share)))
