"""Terms of an effect that the data do not tell from zero are taken out of the model again.

A term is a numbered group of an effect's parameters: one wave of a ripple, one element of a memory. Its
amplitudes a, with their covariance C from the fit, are significant where aᵀ·C⁻¹·a is above what chance
reaches once in a thousand times (Wald's test, χ² with as many degrees of freedom as amplitudes).
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from autotune.core.arrays import Floats
from autotune.estimation.bias_corrected_fit import Level, settle
from autotune.estimation.least_squares import Free, covariance
from autotune.estimation.problem import Study
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.effect import Kind, Terms
from autotune.models.table import EFFECTS

_TERM = re.compile(r"(?P<part>\w+)_(?P<number>\d+)$")


def without_insignificant_terms(study: Study, level: Level) -> Level:
    """The model without the terms that it does not need, fitted again; the same where all are needed.

    One term of each effect stays: whether the effect itself is there is for others to judge.
    """
    spread = covariance(level.fitted, study.training)
    packed, free = level.fitted.packed, level.free
    for kind in EFFECTS.values():
        if kind.terms is not None and packed.on[layout.flag(kind.name)]:
            keep = _significant(kind, kind.terms, packed, level.free, spread, study.policy.term_chance)
            packed, free = _kept(kind, packed, free, keep)
    if len(free) == len(level.free):
        return level
    return settle(study, packed, free, 2, level.effects) or level


def _significant(
    kind: Kind, terms: Terms, packed: Packed, free: tuple[Free, ...], spread: Floats, chance: float
) -> list[int]:
    """Terms to keep: those beyond chance, and those that were not fitted; at least the clearest of all."""
    places = {one.slot: i for i, one in enumerate(free)}
    worth: dict[int, float] = {}
    for number in kind.terms_in_use(packed.p):
        slots = [kind.slot(f"{part}_{number}") for part in terms.amplitudes]
        if not all(slot in places for slot in slots):
            worth[number] = np.inf
            continue
        at = [places[slot] for slot in slots]
        size = packed.p[slots]
        square = float(size @ np.linalg.pinv(spread[np.ix_(at, at)], hermitian=True) @ size)
        worth[number] = square / float(chi2.ppf(1.0 - chance, len(slots)))
    clearest = max(worth, key=lambda number: worth[number], default=0)
    return [number for number in worth if worth[number] > 1.0 or number == clearest]


def _kept(
    kind: Kind, packed: Packed, free: tuple[Free, ...], keep: list[int]
) -> tuple[Packed, tuple[Free, ...]]:
    """The parameters with only the terms in `keep`, numbered anew from 1."""
    number_of = {old: new for new, old in enumerate(keep, 1)}
    p = packed.p.copy()
    moved: dict[int, int] = {}
    for parameter in kind.parameters:
        match = _TERM.match(parameter.name)
        if match is None:
            continue
        p[parameter.slot] = parameter.neutral
        if int(match["number"]) in number_of:
            moved[parameter.slot] = kind.parameter(f"{match['part']}_{number_of[int(match['number'])]}").slot
    for old, new in moved.items():
        p[new] = packed.p[old]
    names = {parameter.slot: kind.surface(parameter.name) for parameter in kind.parameters}
    own = {parameter.slot for parameter in kind.parameters if _TERM.match(parameter.name)}
    kept = tuple(
        replace(one, slot=moved[one.slot], name=names[moved[one.slot]]) if one.slot in own else one
        for one in free
        if one.slot not in own or one.slot in moved
    )
    return Packed(p, packed.on), kept
