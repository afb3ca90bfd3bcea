"""The contact of the axis: what its friction level is now, and how it ages, warms and is pressed.

Every effect that changes friction enters here and nowhere else; the forward routine (`plant`) and the
inverse one (`inverse`) call the same kernels.
"""

from __future__ import annotations

from autotune.core.arrays import Flags, Floats
from autotune.models.compiled import compiled
from autotune.models.direction_asymmetry import level_difference, viscous_difference
from autotune.models.dwell_time_break_away import age_level, grow_older
from autotune.models.gravity_imbalance import imbalance_torque
from autotune.models.layout import (
    BREAK_AWAY,
    COULOMB,
    MICRO_DAMPING,
    OFFSET,
    STIFFNESS,
    STRIBECK_VELOCITY,
    VISCOUS,
    flag,
)
from autotune.models.load_dependent_friction import load_level
from autotune.models.lugre import bristle_step, falling_level
from autotune.models.nonlinear_viscous import curved_coefficient
from autotune.models.position_dependent_friction import place_factor
from autotune.models.reversal_memory import memory_torque
from autotune.models.spring import spring_torque
from autotune.models.stribeck import EXPONENT
from autotune.models.thermal_drift import warm_factor
from autotune.models.torque_ripple import ripple

_STRIBECK = flag("stribeck")
_ASYMMETRY = flag("direction_asymmetry")
_RIPPLE = flag("torque_ripple")
_CURVED = flag("nonlinear_viscous")
_PLACE = flag("position_dependent_friction")
_IMBALANCE = flag("gravity_imbalance")
_SPRING = flag("spring")
_MEMORY = flag("reversal_memory")
_WARM = flag("thermal_drift")
_DWELL = flag("dwell_time_break_away")
_LOAD = flag("load_dependent_friction")
_LEAST_DEFLECTION = 1e-15
_LEAST_SHARE = 0.02  # of the Coulomb level, where effects together would take it to zero


@compiled
def friction_limit(p: Floats, on: Flags, state: Floats, position: float, velocity: float) -> float:
    """g, the bristle's deflection in steady state [rad or m]."""
    level = float(p[COULOMB])
    if on[_STRIBECK]:
        level = falling_level(velocity, level, p[BREAK_AWAY], p[STRIBECK_VELOCITY], p[EXPONENT])
    if on[_ASYMMETRY]:
        level += level_difference(p, velocity)
    if on[_DWELL]:
        level += age_level(p, state)
    if on[_LOAD]:
        level += load_level(p, state)
    if on[_PLACE]:
        level *= place_factor(p, position)
    if on[_WARM]:
        level *= warm_factor(p, state)
    return float(max(max(level, _LEAST_SHARE * p[COULOMB]) / p[STIFFNESS], _LEAST_DEFLECTION))


@compiled
def viscous_coefficient(p: Floats, on: Flags, state: Floats, velocity: float) -> float:
    """Viscous torque over velocity [N m s/rad]."""
    coefficient = float(p[VISCOUS])
    if on[_ASYMMETRY]:
        coefficient += viscous_difference(p, velocity)
    if on[_CURVED]:
        coefficient += curved_coefficient(p, velocity)
    if on[_WARM]:
        coefficient *= warm_factor(p, state)
    return coefficient


@compiled
def additive(p: Floats, on: Flags, position: float) -> float:
    """Torque needed beside inertia and friction [N m]."""
    total = float(p[OFFSET])
    if on[_RIPPLE]:
        total += ripple(p, position)
    if on[_IMBALANCE]:
        total += imbalance_torque(p, position)
    if on[_SPRING]:
        total += spring_torque(p, position)
    return total


@compiled
def bend(
    p: Floats, on: Flags, state: Floats, at: int, position: float, velocity: float, duration: float
) -> float:
    """Moves the bristle that is in state `at` for `duration`; returns its limit g."""
    limit = friction_limit(p, on, state, position, velocity)
    before = state[at]
    state[at] = bristle_step(before, velocity, limit, duration)
    if on[_DWELL]:
        slip = abs(velocity * duration - (state[at] - before))
        grow_older(p, state, slip, duration)
    return limit


@compiled
def remembered(p: Floats, on: Flags, state: Floats, displacement: float) -> float:
    """Torque of the hysteresis elements after a displacement [N m]."""
    return memory_torque(p, state, displacement) if on[_MEMORY] else 0.0


@compiled
def damping_slope(p: Floats, bristle: float, velocity: float, limit: float) -> float:
    """How much the bristle's damping torque grows with velocity [N m s/rad], at least 0."""
    ratio = abs(bristle) / limit
    if bristle * velocity < 0.0:
        ratio = -ratio
    return float(max(p[MICRO_DAMPING] * (1.0 - ratio), 0.0))
