"""What is between motor and load: two masses with a spring, a damper and a gap.

T = K·(φ ∓ gap/2) + D·φ' beyond the gap and 0 inside it, φ the twist; a contact cannot pull. D is a share
`damping` of critical. Without effect, motor and load are one mass.
"""

from __future__ import annotations

import math

from autotune.core.arrays import Flags, Floats
from autotune.models.compiled import compiled
from autotune.models.effect import Kind, Parameter
from autotune.models.layout import INERTIA, block, flag, state_block

_ELASTIC = block("elastic_transmission")
_BACKLASH = block("backlash")
_IS_ELASTIC = flag("elastic_transmission")
_HAS_GAP = flag("backlash")
_STATE = state_block("elastic_transmission")
LOAD_POSITION, LOAD_VELOCITY, LOAD_BRISTLE, STARTED = _STATE, _STATE + 1, _STATE + 2, _STATE + 3
STIFFEST_RATE = 8e3  # rad/s, what the integration still resolves


def _load(at: int) -> tuple[Parameter, ...]:
    return (
        Parameter("load_inertia", "1", 0.4, 0.02, 0.98, "share of the inertia beyond it", at),
        Parameter("load_friction", "1", 0.4, 0.0, 1.0, "share of the friction beyond it", at + 1),
        Parameter("damping", "1", 0.05, 0.0, 2.0, "share of critical damping", at + 2),
    )


ELASTIC_TRANSMISSION = Kind(
    name="elastic_transmission",
    parameters=(
        Parameter("compliance", "rad/(N m)", 0.0, 0.0, 1e3, "twist per torque", _ELASTIC),
        *_load(_ELASTIC + 1),
    ),
    looks_like="The torque rings or lags after every jerk, at the same frequency at every place and speed.",
    cause="A belt, coupling, gear or long screw that twists between motor and load.",
    remedy="Tension the belt, tighten coupling and clamps; limit jerk; a notch filter in the drive.",
)

BACKLASH = Kind(
    name="backlash",
    parameters=(
        Parameter("gap", "rad", 0.0, 0.0, 1e3, "free play", _BACKLASH),
        Parameter(
            "contact_compliance",
            "rad/(N m)",
            1e-3,
            1e-9,
            1e3,
            "twist per torque of the flanks",
            _BACKLASH + 1,
        ),
        *_load(_BACKLASH + 2),
    ),
    looks_like="After a reversal the motor runs free for a moment, then catches the load with a blow.",
    cause="Play in gear, coupling, key or nut.",
    remedy="Adjust or preload the nut or gear, tighten the coupling; worn parts must be replaced.",
)


@compiled
def has_load(on: Flags) -> bool:
    """Whether motor and load are two masses."""
    return bool(on[_IS_ELASTIC] or on[_HAS_GAP])


@compiled
def load_shares(p: Floats, on: Flags) -> tuple[float, float]:
    """Shares of inertia and friction beyond the transmission."""
    at = _ELASTIC + 1 if on[_IS_ELASTIC] else _BACKLASH + 2
    return float(p[at]), float(p[at + 1])


@compiled
def coupling(p: Floats, on: Flags) -> tuple[float, float, float]:
    """Stiffness [N m/rad], damping [N m s/rad] and half the gap [rad]."""
    share, _ = load_shares(p, on)
    reduced = p[INERTIA] * share * (1.0 - share)
    compliance = p[_ELASTIC] if on[_IS_ELASTIC] else p[_BACKLASH + 1]
    damping = p[_ELASTIC + 3] if on[_IS_ELASTIC] else p[_BACKLASH + 4]
    stiffness = min(1.0 / max(compliance, 1e-12), reduced * STIFFEST_RATE * STIFFEST_RATE)
    half = 0.5 * p[_BACKLASH] if on[_HAS_GAP] else 0.0
    return stiffness, 2.0 * damping * math.sqrt(stiffness * reduced), half


@compiled
def passed_torque(stiffness: float, damping: float, half: float, twist: float, rate: float) -> float:
    """Torque from motor to load [N m]."""
    if half == 0.0:
        return stiffness * twist + damping * rate
    if twist > half:
        return max(stiffness * (twist - half) + damping * rate, 0.0)
    if twist < -half:
        return min(stiffness * (twist + half) + damping * rate, 0.0)
    return 0.0


@compiled
def coupling_rate(p: Floats, on: Flags) -> float:
    """Angular frequency of motor against load [rad/s]; 0 where they are one mass."""
    if not has_load(on):
        return 0.0
    share, _ = load_shares(p, on)
    return math.sqrt(coupling(p, on)[0] / (p[INERTIA] * share * (1.0 - share)))
