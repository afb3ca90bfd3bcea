"""Friction of the simulated axis: elastic elements in parallel, and a single LuGre bristle.

Elastic elements (Maxwell slip: Iwan 1966; Al-Bender, Lampaert, Swevers 2005). Element i follows the
motion with stiffness k_i until it carries its break-away torque W_i = k_i·d_i, then slides:

    z_i ← clip(z_i + Δq, −d_i·S, +d_i·S),    T = Σ k_i·z_i + v·Σ c_i over the elements that stick

LuGre bristle (Canudas de Wit et al. 1995), integrated exactly for a velocity that is constant during
one integration step h:

    ż = v − |v|·z/g(v),   g(v) = (S·F_c + C·(F_s − F_c)·exp(−|v/v_s|^δ))/σ0,   T = σ0·z + σ1·ż

σ1 may fade with speed, σ1·exp(−(v/v_d)²) (the same paper). Where the contact is elastic at first, ż = v − α(z)·|v|·z/g
with α from 0 to 1 by half a sine (Dupont, Hayward, Armstrong and Altpeter 2002). A film has no bristle at all but
T = σ0·g(v)·tanh(v/v_c).

S and C say how strong the contact is: 1 on the nominal axis, varied by planted effects (`strength`).
Each function is called once per integration step; `side` is 0 for the motor and 1 for the load.
"""

from __future__ import annotations

import math

from autotune_sim.kernel import Record, kernel

WEAKEST = 0.05  # of nominal friction, whatever the effects do


@kernel
def strength(p: Record, s: Record, q: float, v: float) -> tuple[float, float]:
    """Strength of the contact at position q [rad] and velocity v [rad/s].

    Returns the level S and the scale C in it: S = C·(1 + what Stribeck, rest and load add to 1).
    """
    scale = math.exp(-p.thermal_softening * s.warming)
    if p.bump_ratio != 0.0:
        scale *= 1.0 + p.bump_ratio * math.exp(-(((q - p.bump_centre) / p.bump_width) ** 2))
    scale = max(scale, WEAKEST)
    rise = p.load_ratio * s.load + p.dwell_ratio * s.age
    if p.stribeck_ratio != 0.0:
        rise += p.stribeck_ratio * math.exp(-((v / p.stribeck_velocity) ** 2))
    return scale * (1.0 + rise), scale


@kernel
def slide(p: Record, s: Record, side: int, share: float, displacement: float, level: float) -> float:
    """Moves all elements of one side; leaves their torque and damping in the state.

    Returns the mean distance that the contact slipped [rad], for what ages with slip.
    """
    elastic = 0.0
    damping = 0.0
    slip = 0.0
    upper = level * (1.0 + p.asymmetry)
    lower = -level * (1.0 - p.asymmetry)
    for i in range(p.element_count):
        limit = p.element_displacement[i]
        z = s.element_state[side, i] + displacement
        if z > upper * limit:
            slip += p.element_weight[i] * (z - upper * limit)
            z = upper * limit
        elif z < lower * limit:
            slip += p.element_weight[i] * (lower * limit - z)
            z = lower * limit
        else:
            damping += p.element_damping[i]
        s.element_state[side, i] = z
        elastic += p.element_stiffness[i] * z
    s.elastic[side] = share * elastic
    s.damping[side] = share * damping
    return slip


@kernel
def _plastic(sticks: float, ratio: float) -> float:
    """How much of the motion is slip by its law, where the bristle carries `ratio` of its level; 1: LuGre's."""
    if sticks == 0.0 or ratio >= 1.0:
        return 1.0
    if ratio <= sticks:
        return 0.0
    return 0.5 + 0.5 * math.sin(math.pi * (ratio - 0.5 * (1.0 + sticks)) / (1.0 - sticks))


@kernel
def bend(
    p: Record, s: Record, side: int, share: float, v: float, h: float, level: float, scale: float
) -> float:
    """Moves the LuGre bristle of one side at velocity v for the time h; adds torque and damping.

    Returns the distance slipped [rad].
    """
    if p.bristle_stiffness == 0.0:
        return 0.0
    old = s.bristle_state[side]
    z = old
    damping = p.bristle_damping
    if v != 0.0:
        direction = math.copysign(1.0, v)
        fall = (v / p.bristle_velocity) ** 2
        if p.bristle_exponent != 2.0:
            fall = abs(v / p.bristle_velocity) ** p.bristle_exponent
        excess = (p.bristle_break_away - p.bristle_coulomb) * math.exp(-fall)
        torque = (1.0 + direction * p.asymmetry) * (level * p.bristle_coulomb + scale * excess)
        if p.bristle_smooth_velocity > 0.0:
            s.elastic[side] += share * torque * math.tanh(abs(v) / p.bristle_smooth_velocity) * direction
            return abs(v * h)
        g = torque / p.bristle_stiffness
        plastic = _plastic(p.bristle_sticks, direction * old / g)
        if plastic > 0.0:
            decay = math.exp(-plastic * abs(v) * h / g)
            z = old * decay + direction * g / plastic * (1.0 - decay)
        else:
            z = old + v * h
        damping *= max(1.0 - _plastic(p.bristle_sticks, direction * z / g) * direction * z / g, 0.0)
        if p.bristle_fading_velocity > 0.0:
            damping *= math.exp(-((v / p.bristle_fading_velocity) ** 2))
    s.bristle_state[side] = z
    s.elastic[side] += share * p.bristle_stiffness * z
    s.damping[side] += share * damping
    return float(abs(v * h - (z - old)))
