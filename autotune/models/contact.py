"""The contact of the axis: what its friction level is now, and how it ages, warms and is pressed.

Every effect that changes friction, or adds a torque that depends on position, enters here and nowhere else: by the
kernels that its `Kind` names (`contributions`), or by its own line where it is more than a term. The forward routine
(`plant`) and the inverse one (`inverse`) call the same kernels.
"""

from __future__ import annotations

from autotune.core.arrays import Flags, Floats
from autotune.models.compiled import compiled
from autotune.models.contributions import all_added, all_multiplied
from autotune.models.dwell_time_break_away import AGES, grow_older
from autotune.models.lanes import anywhere, where
from autotune.models.layout import (
    BENDS_35,
    BENDS_65,
    BENDS_85,
    BENDS_BACK,
    BREAK_AWAY,
    COULOMB,
    CREEP_TAIL,
    CREEP_VELOCITY,
    DAMPING_TAIL,
    DAMPING_VELOCITY,
    MICRO_DAMPING,
    OFFSET,
    STIFFNESS,
    STRIBECK_VELOCITY,
    VISCOUS,
)
from autotune.models.lugre import (
    NEVER,
    bends,
    bent_on,
    bristle_rate,
    bristle_step,
    crept,
    faded_part,
    falling_level,
)
from autotune.models.reversal_memory import (
    ATTRACTION,
    DAMPING,
    REMEMBERS,
    memory_damping,
    memory_torque,
    more_to_carry,
)
from autotune.models.stribeck import EXPONENT, FALLS, TAIL

_torque = all_added("torque")
_level, _level_factor = all_added("level"), all_multiplied("level_factor")
_stiffening = all_added("stiffening")
_viscous, _viscous_factor = all_added("viscous"), all_multiplied("viscous_factor")
LEAST_DEFLECTION = 1e-15
LEAST_SHARE = 0.02  # of the Coulomb level, where effects together would take it to zero


@compiled
def raised_level(p: Floats, on: Flags, state: Floats, velocity: float) -> float:
    """The bristle's level with what effects add to that of friction, were it all of the contact [N m]."""
    level = float(p[COULOMB])
    if on[FALLS]:
        level = falling_level(velocity, level, p[BREAK_AWAY], p[STRIBECK_VELOCITY], p[EXPONENT], p[TAIL])
    return _level(level, p, on, state, velocity)


@compiled
def elements_carry(p: Floats, on: Flags, state: Floats, velocity: float) -> float:
    """How many times what they are said to carry the elements do now: all of a contact shares what is added to it."""
    if not anywhere(p[ATTRACTION] > 0.0):
        return 1.0 + 0.0 * velocity
    return more_to_carry(p, raised_level(p, on, state, velocity))


@compiled
def friction_limit(p: Floats, on: Flags, state: Floats, position: float, velocity: float) -> float:
    """g, the bristle's deflection in steady state [rad or m]."""
    level = raised_level(p, on, state, velocity)
    if on[REMEMBERS] and anywhere(p[ATTRACTION] > 0.0):
        level = where(p[ATTRACTION] > 0.0, p[COULOMB] * more_to_carry(p, level), level)
    level = _level_factor(level, p, on, state, position)
    stiffness = p[STIFFNESS] * stiffened(p, on, state, velocity)
    limit = max(max(level, LEAST_SHARE * p[COULOMB]) / stiffness, LEAST_DEFLECTION)
    if anywhere(p[CREEP_VELOCITY] > 0.0):
        speed = where(p[CREEP_VELOCITY] > 0.0, p[CREEP_VELOCITY], NEVER)
        limit *= where(p[CREEP_VELOCITY] > 0.0, crept(velocity, speed, p[CREEP_TAIL]), 1.0)
    return float(limit)


@compiled
def stiffened(p: Floats, on: Flags, state: Floats, velocity: float) -> float:
    """How many times as stiff as its bristle the contact is now, where what adds to its friction makes it stiffer."""
    more = _stiffening(0.0 * velocity, p, on, state, velocity)
    if not anywhere(more != 0.0):
        return 1.0 + 0.0 * velocity
    return float(1.0 + more / max(raised_level(p, on, state, velocity) - more, LEAST_SHARE * p[COULOMB]))


@compiled
def viscous_coefficient(p: Floats, on: Flags, state: Floats, velocity: float) -> float:
    """Viscous torque over velocity [N m s/rad]."""
    coefficient = _viscous(float(p[VISCOUS]), p, on, velocity)
    return _viscous_factor(coefficient, p, on, state)


@compiled
def bristle_damping(p: Floats, velocity: float) -> float:
    """σ1 of the bristle at a speed [N m s/rad]."""
    return float(p[MICRO_DAMPING] * faded_part(velocity, p[DAMPING_VELOCITY], p[DAMPING_TAIL]))


@compiled
def additive(p: Floats, on: Flags, position: float) -> float:
    """Torque needed beside inertia and friction [N m]."""
    return _torque(float(p[OFFSET]), p, on, position)


@compiled
def bent(p: Floats, bristle: float, velocity: float, limit: float, duration: float) -> float:
    """The bristle after `duration` at a constant velocity, by its own curve where it has one."""
    plain = bristle_step(bristle, velocity, limit, duration)
    if not anywhere(p[BENDS_BACK] > 0.0):
        return plain
    distance = abs(velocity) * duration / limit
    ratio = where(velocity < 0.0, -bristle, bristle) / limit
    ratio = bent_on(ratio, distance, p[BENDS_BACK], p[BENDS_35], p[BENDS_65], p[BENDS_85])
    own = where(velocity < 0.0, -ratio, ratio) * limit
    moved = where(p[BENDS_BACK] > 0.0, own, plain)
    return float(where(distance < 1e-12, bristle, moved))


@compiled
def bending(p: Floats, bristle: float, velocity: float, limit: float) -> float:
    """z', how fast the bristle is bent [rad/s or m/s]."""
    plain = bristle_rate(bristle, velocity, limit)
    if not anywhere(p[BENDS_BACK] > 0.0):
        return plain
    ratio = where(velocity < 0.0, -bristle, bristle) / limit
    own = velocity * bends(ratio, p[BENDS_BACK], p[BENDS_35], p[BENDS_65], p[BENDS_85])
    return float(where(p[BENDS_BACK] > 0.0, own, plain))


@compiled
def bend(
    p: Floats,
    on: Flags,
    state: Floats,
    at: int,
    share: float,
    position: float,
    velocity: float,
    duration: float,
) -> float:
    """Moves the bristle that is in state `at` for `duration`; returns its limit g.

    `share` is the side's part of the friction: what both sides do to one contact is their mean.
    """
    limit = friction_limit(p, on, state, position, velocity)
    before = state[at]
    state[at] = bent(p, before, velocity, limit, duration)
    if on[AGES]:
        slip = abs(velocity * duration - (state[at] - before))
        grow_older(p, state, slip, abs(velocity * duration), duration, share)
    return limit


@compiled
def remembered(
    p: Floats,
    on: Flags,
    state: Floats,
    at: int,
    position: float,
    displacement: float,
    velocity: float,
    duration: float,
) -> float:
    """Torque of the hysteresis elements after a displacement [N m]; what multiplies the level does so with theirs.

    `at` is where the states of one side's elements begin.
    """
    if not on[REMEMBERS]:
        return 0.0
    more = elements_carry(p, on, state, velocity)
    return _level_factor(memory_torque(p, state, at, displacement, more, duration), p, on, state, position)


@compiled
def remembered_damping(
    p: Floats, on: Flags, state: Floats, at: int, displacement: float, velocity: float
) -> float:
    """Damping of the hysteresis elements over a displacement, asked before they make it [N m s/rad]."""
    if on[REMEMBERS] and anywhere(p[DAMPING] > 0.0):
        part = faded_part(velocity, p[DAMPING_VELOCITY], p[DAMPING_TAIL])
        return part * memory_damping(p, state, at, displacement, elements_carry(p, on, state, velocity))
    return 0.0


@compiled
def kept_by_elements(
    p: Floats,
    on: Flags,
    state: Floats,
    at: int,
    position: float,
    displacement: float,
    velocity: float,
    duration: float,
) -> tuple[float, float]:
    """What one side's hysteresis elements hold back after a displacement [N m], and its slope over velocity."""
    damping = remembered_damping(p, on, state, at, displacement, velocity)
    torque = remembered(p, on, state, at, position, displacement, velocity, duration)
    return torque + damping * velocity, damping


@compiled
def damping_slope(p: Floats, damping: float, bristle: float, velocity: float, limit: float) -> float:
    """How much the torque of the bristle's damping at a speed grows with velocity [N m s/rad], at least 0."""
    size = abs(bristle) / limit
    if anywhere(p[CREEP_VELOCITY] > 0.0):  # there the limit falls below what the bristle still has
        size = where(p[CREEP_VELOCITY] > 0.0, min(size, 1.0), size)
    ratio = where(bristle * velocity < 0.0, -size, size)
    part = 1.0 - ratio
    if anywhere(p[BENDS_BACK] > 0.0):
        own = bends(ratio, p[BENDS_BACK], p[BENDS_35], p[BENDS_65], p[BENDS_85])
        part = where(p[BENDS_BACK] > 0.0, own, part)
    return float(max(damping * part, 0.0))
