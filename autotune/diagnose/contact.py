"""The bristle in a single recording: where its stiffness starts, and whether the data tell it at all.

Without presliding experiments the error has several minima over the stiffness, and a base model left in a
poor one makes every candidate look good that moves it. Free although the data say nothing about it, the
bristle makes predictions of held-out data worse.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from autotune.diagnose.fit import Fitted, Free, standard_errors
from autotune.diagnose.study import Correction, Study, refit
from autotune.models import layout
from autotune.models.drive_model import Packed

REACHES = (1e-5, 1e-4, 1e-3)  # of the travel
DAMPING = 0.3
"""Of what is critical."""
UNDAMPED = 0.05
"""Of the usual damping: a fit that ends there knows nothing about it."""
LOOSE = 1.0
"""Relative standard error from which a contact parameter is held."""
_CONTACT = ("stiffness", "micro_damping")


def best_contact(study: Study, fitted: Fitted, correction: Correction) -> Fitted:
    """The best of several fits that start from other stiffnesses; never worse than `fitted`."""
    free = list(fitted.free)
    found = [fitted]
    for reach in REACHES:
        p = fitted.packed.p.copy()
        p[layout.STIFFNESS] = p[layout.COULOMB] / (reach * study.scales.travel)
        p[layout.MICRO_DAMPING] = DAMPING * math.sqrt(p[layout.STIFFNESS] * p[layout.INERTIA])
        again = refit(study, Packed(p, fitted.packed.on), free, correction, 8)
        if np.isfinite(again.cost):
            found.append(again)
    return min(found, key=lambda item: item.cost)


def told(study: Study, fitted: Fitted, free: Sequence[Free]) -> list[Free]:
    """The free parameters without those of the bristle that a single recording says nothing about."""
    errors = dict(zip((f.name for f in free), standard_errors(fitted, study.training), strict=True))
    values = fitted.packed.p
    return [f for f in free if f.name not in _CONTACT or errors[f.name] < LOOSE * abs(values[f.slot])]


def settled_contact(
    study: Study, fitted: Fitted, correction: Correction, free: Sequence[Free]
) -> tuple[Fitted, list[Free]]:
    """Fit and free parameters that the search of a single recording begins with."""
    best = best_contact(study, fitted, correction)
    kept = told(study, best, free)
    p = best.packed.p.copy()
    usual = DAMPING * math.sqrt(p[layout.STIFFNESS] * p[layout.INERTIA])
    if p[layout.MICRO_DAMPING] > UNDAMPED * usual:
        return best, kept
    p[layout.MICRO_DAMPING] = usual  # without any its twin rings in the loop
    kept = [f for f in kept if f.slot != layout.MICRO_DAMPING]
    damped = refit(study, Packed(p, best.packed.on), kept, correction, 4)
    return (damped, kept) if np.isfinite(damped.cost) else (best, kept)
