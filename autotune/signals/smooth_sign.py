"""Signs of a speed without their step, as drives and robot controllers feed friction forward by them.

A step at each reversal of a set point would ring, so that what is fed forward turns over a small speed:
tanh(v/w), or v/w held between −1 and 1 (Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30 (1994) 1083,
section 5: fixed compensation of Coulomb friction by the reference).
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from autotune.core.arrays import Floats


def by_tanh(velocity: Floats, width: float) -> Floats:
    """tanh(v/w), shape (n,); velocity and `width` in the same unit."""
    return np.asarray(np.tanh(velocity / width))


def by_ramp(velocity: Floats, width: float) -> Floats:
    """v/w between −1 and 1, shape (n,); velocity and `width` in the same unit."""
    return np.asarray(np.clip(velocity / width, -1.0, 1.0))


SMOOTH_SIGNS: tuple[Callable[[Floats, float], Floats], ...] = (by_tanh, by_ramp)
