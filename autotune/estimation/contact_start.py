"""The bristle in a single recording: where its stiffness starts, and whether the data tell it at all.

Without presliding experiments the error has several minima over the stiffness, and a base model left in a
poor one makes every candidate look good that moves it. Free although the data say nothing about it, the
bristle makes predictions of held-out data worse.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from autotune.core.arrays import Floats
from autotune.estimation.controller import asked
from autotune.estimation.disturbance import STILL
from autotune.estimation.least_squares import Fitted, Free, standard_errors
from autotune.estimation.problem import SEED, Correction, Study, refit
from autotune.estimation.residual import residual, run_twin
from autotune.models import layout
from autotune.models.drive_model import Packed

REACHES = (1e-5, 1e-4, 1e-3)  # of the travel
DAMPING = 0.3
"""Of what is critical."""
UNDAMPED = 0.05
"""Of the usual damping: a fit that ends there knows nothing about it."""
STIFFER = (1.0, 3.0, 10.0, 30.0)
QUIETER = 0.7
"""Of the cost: less must be left for another contact to be taken."""
MOST_NOISE = 25.0
"""Times its variance, by which the noise is corrected at most."""
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


def identifiable(study: Study, fitted: Fitted, free: Sequence[Free]) -> list[Free]:
    """The free parameters without those of the bristle that a single recording says nothing about."""
    errors = dict(zip((f.name for f in free), standard_errors(fitted, study.training), strict=True))
    values = fitted.packed.p
    return [f for f in free if f.name not in _CONTACT or errors[f.name] < LOOSE * abs(values[f.slot])]


def fitted_contact(
    study: Study, fitted: Fitted, correction: Correction, free: Sequence[Free]
) -> tuple[Fitted, list[Free]]:
    """Fit and free parameters that the search of a single recording begins with."""
    best = best_contact(study, fitted, correction)
    kept = identifiable(study, best, free)
    held = [f for f in kept if f.name not in _CONTACT]
    packed = quiet_contact(study, best.packed)
    if packed is None:
        return best, kept
    again = refit(study, packed, held, correction, 4)
    return (again, held) if np.isfinite(again.cost) else (best, kept)


def quiet_contact(study: Study, packed: Packed) -> Packed | None:
    """The model with another contact where its twin rings and the axis did not; None where it does not ring.

    Of presliding a single recording may tell nothing, but the loop would not have been stable on any contact.
    """
    own = packed.p.copy()
    usual = DAMPING * math.sqrt(own[layout.STIFFNESS] * own[layout.INERTIA])
    undamped = bool(own[layout.MICRO_DAMPING] < UNDAMPED * usual)
    if not undamped and not study.twin:
        return None
    trials = []
    for stiffer in STIFFER:
        p = own.copy()
        p[layout.STIFFNESS] *= stiffer
        p[layout.MICRO_DAMPING] = max(p[layout.MICRO_DAMPING], usual * math.sqrt(stiffer))
        trials.append(Packed(p, packed.on))
    if not study.twin:
        return trials[0]
    costs = [_twin_cost(study, trial) for trial in trials]
    at = int(np.argmin(costs))
    rings = costs[at] < QUIETER * _twin_cost(study, packed)
    return trials[at] if rings or undamped else None


def as_rough(study: Study, packed: Packed) -> Study:
    """The study with the noise that makes the twin's torque change from sample to sample as the measured one does.

    Without repeats what the model lacks would pass for noise, and a twin that is shaken so slides where the axis
    stuck.
    """
    if study.data.repeated or study.controller is None or study.disturbance.process <= 0.0:
        return study
    measured = _roughness(study, asked(study.data, study.controller))
    shares = []
    for shaken in (STILL, study.disturbance):
        run = run_twin(study.data, packed, study.controller, shaken, np.random.default_rng(SEED))
        if not run.stable:
            return study
        shares.append(_roughness(study, run.torque))
    calm, rough = shares
    if rough <= calm:
        return study
    factor = max(measured - calm, 0.0) / (rough - calm)
    return replace(study, disturbance=study.disturbance.louder(math.sqrt(min(factor, MOST_NOISE))))


def _roughness(study: Study, torque: Floats) -> float:
    """Variance of the torque's changes from sample to sample [(N m)²], by the quieter half of the recording."""
    pieces = [
        np.array_split(np.diff(torque[s.rows]), max(1, (s.stop - s.start) // 200))
        for s in study.data.stretches
    ]
    return float(np.median([np.var(piece) for part in pieces for piece in part]))


def _twin_cost(study: Study, packed: Packed) -> float:
    """Mean square of the residual less the bias of the twin [(N m)²]; infinite where it is unstable."""
    correction = study.correction(packed, 1)
    if not correction.stable:
        return math.inf
    error = residual(study.data, packed, study.moved) - correction.bias
    weight = study.training
    return float(np.dot(weight, error**2) / max(weight.sum(), 1.0))
