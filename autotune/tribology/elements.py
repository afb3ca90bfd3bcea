"""Friction before break-away as many springs with Coulomb sliders of different strength.

With an exponential distribution of strengths (2.18) the virgin curve is F_s (1 − exp(−σ0 x/F_s)) (2.19), and so is
Dahl's with exponent one (2.22). The thesis calls the two models equivalent; they are, on this curve only. After a
reversal each slider must first be unloaded and then loaded the other way, twice its strength, so the elements
follow Masing's rule (the virgin curve, doubled in both directions) where Dahl's equation decays from where it is:
up to F_s/2 apart. What such an element arrangement remembers of its reversals is the program's `reversal_memory`.

Sources: thesis, sections 2.3.1 and 2.3.5; Masing, Proc. 2nd Int. Congr. Appl. Mech. (1926) 332.
"""

from __future__ import annotations

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError

ELEMENTS = 2000
"""Sliders that stand for the distribution; the curve is then within 10⁻³ F_s of (2.19)."""


def virgin_curve(displacement: Floats, *, stiffness: float, break_away: float) -> Floats:
    """Force [N] over displacement x ≥ 0 [m] from rest without load, (2.19)."""
    curve: Floats = -break_away * np.expm1(-stiffness * displacement / break_away)
    return curve


def distributed_elements(
    displacement: Floats, *, stiffness: float, break_away: float, elements: int = ELEMENTS
) -> Floats:
    """Force [N] along any path of displacements [m] that begins at rest without load, (2.18) to (2.19).

    Args:
        displacement: shape (n,).
        stiffness: σ0 of all elements together [N/m].
        break_away: F_s, their strength together [N].

    Raises:
        ConfigurationError: stiffness or break-away force not above zero.
    """
    _refuse(stiffness, break_away)
    level = (np.arange(elements) + 0.5) / elements
    strength = -np.log1p(-level) * break_away
    strength *= break_away / strength.mean()  # the last quantile's tail belongs to the sum too
    spring = np.zeros(elements)
    force = np.empty(displacement.size)
    before = 0.0
    for k, x in enumerate(displacement):
        spring = np.clip(spring + stiffness * (x - before), -strength, strength)
        force[k], before = spring.mean(), x
    return force


def dahl(displacement: Floats, *, stiffness: float, break_away: float) -> Floats:
    """Force [N] along a path by Dahl's equation with exponent one, (2.20), exact between any two points."""
    _refuse(stiffness, break_away)
    force = np.empty(displacement.size)
    now = before = 0.0
    for k, x in enumerate(displacement):
        towards = break_away * np.sign(x - before)
        now = towards + (now - towards) * np.exp(-stiffness * abs(x - before) / break_away)
        force[k], before = now, x
    return force


def after_reversal(travel: Floats, *, stiffness: float, break_away: float) -> tuple[Floats, Floats]:
    """Force [N] of elements (Masing) and of Dahl over the travel back [m] from sliding forwards at +F_s."""
    share = stiffness * travel / break_away
    return break_away * (2.0 * np.exp(-0.5 * share) - 1.0), break_away * (2.0 * np.exp(-share) - 1.0)


def _refuse(stiffness: float, break_away: float) -> None:
    if not (stiffness > 0.0 and break_away > 0.0):
        raise ConfigurationError(
            f"elements: stiffness {stiffness:g} N/m and break-away force {break_away:g} N must be above zero"
        )
