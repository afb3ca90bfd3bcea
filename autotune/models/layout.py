"""Where each quantity lives in the arrays that the compiled routine works on.

One vector of parameters holds the base model and a block for every effect, one vector of states the
motion, the bristle and a block for every effect, one vector of flags which effects are present. The
places are fixed, so that kernels of different effects can be compiled into one routine.

`EFFECT_NAMES` is the table of effects: each name is a module beside this one, whose `Kind` is the constant of that
name in capitals. A new effect goes to the end, so that the places of the others stay.
"""

from __future__ import annotations

BASE = ("inertia", "viscous", "coulomb", "stiffness", "micro_damping", "offset")
(
    INERTIA, VISCOUS, COULOMB, STIFFNESS, MICRO_DAMPING, OFFSET, BREAK_AWAY, STRIBECK_VELOCITY, DAMPING_VELOCITY,
    DAMPING_TAIL, BENDS_BACK, BENDS_35, BENDS_65, BENDS_85, CREEP_VELOCITY, CREEP_TAIL,
) = range(16)  # fmt: skip
BASE_PARAMETERS = 16

EFFECT_NAMES = (
    "torque_ripple",
    "direction_asymmetry",
    "stribeck",
    "nonlinear_viscous",
    "position_dependent_friction",
    "gravity_imbalance",
    "spring",
    "reversal_memory",
    "thermal_drift",
    "elastic_transmission",
    "backlash",
    "torque_lag",
    "torque_saturation",
    "dwell_time_break_away",
    "load_dependent_friction",
    "encoder_eccentricity",
)

BLOCK = 32
"""Parameters an effect may have."""
STATE_BLOCK = 16
"""States an effect may have."""
BASE_STATES = 8
POSITION, VELOCITY, BRISTLE = range(3)

PARAMETERS = BASE_PARAMETERS + BLOCK * len(EFFECT_NAMES)
STATES = BASE_STATES + STATE_BLOCK * len(EFFECT_NAMES)


def flag(effect: str) -> int:
    """Place of an effect in the vector of flags."""
    return EFFECT_NAMES.index(effect)


def block(effect: str) -> int:
    """First parameter of an effect."""
    return BASE_PARAMETERS + BLOCK * flag(effect)


def state_block(effect: str) -> int:
    """First state of an effect."""
    return BASE_STATES + STATE_BLOCK * flag(effect)
