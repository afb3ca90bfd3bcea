"""Does another trajectory confirm what was found, and would another effect do as well there?

Every effect found is carried unchanged to trajectories that were not fitted: the right one lowers the error there, the
wrong ones raise it. A second recording that lowers the error of Stribeck friction often lowers that of nonlinear
viscosity too. So each effect is taken out, the best alternatives are fitted in its place, and all are carried:
confirmed is what errs clearly less there than every rival.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from autotune.core.arrays import Flags
from autotune.diagnosis.candidates import FittedCandidate, ScreenedCandidate, no_progress
from autotune.diagnosis.evidence import evidence_of
from autotune.diagnosis.evidence.evidence import Evidence, HoldoutResult
from autotune.diagnosis.evidence.single import carried_error, chunks_of
from autotune.diagnosis.evidence.visibility import visible
from autotune.diagnosis.refits import inside_twin, without_effect
from autotune.diagnosis.screening import rank
from autotune.diagnosis.search import Found
from autotune.estimation.bias_corrected_fit import Level
from autotune.estimation.cross_validation import Unseen, gain_and_z
from autotune.estimation.policy import Policy
from autotune.estimation.problem import Study
from autotune.models.drive_model import Packed

MOST_RIVALS = 3
"""Fitted in the place of each effect."""


def confirm(found: Found, nominal: Packed) -> tuple[FittedCandidate | None, list[HoldoutResult]]:
    """What was found, without the effects that another trajectory refutes, and what it said of each of them."""
    chosen, study, root = found.chosen, found.study, found.root
    evidence = evidence_of(study.data)
    folds = evidence.other_trajectories(study)
    if chosen is None or not folds:
        return chosen, []
    carried = hold_out(study, root, chosen, folds)
    left = without_refuted(study, root, chosen, carried)
    if left is None:
        return None, carried
    return left, [
        compare_alternatives(study, evidence, root, left, item, found.first, nominal, folds)
        if item.lowers and item.effect in left.level.effects
        else item
        for item in carried
    ]


def hold_out(
    study: Study, root: Level, chosen: FittedCandidate, folds: Sequence[Flags]
) -> list[HoldoutResult]:
    """For every effect found: what it does to the error on trajectories that were not fitted."""
    found = []
    for effect in chosen.level.effects:
        less = _level_without(study, root, chosen.level, effect)
        result = None if less is None else _carried(study, folds, less, chosen.level, effect)
        if result is not None:
            found.append(result)
    return found


def without_refuted(
    study: Study, root: Level, chosen: FittedCandidate, carried: Sequence[HoldoutResult]
) -> FittedCandidate | None:
    """The model without the effects that another trajectory refutes; None where no effect is left."""
    for item in carried:
        if not item.refuted:
            continue
        if len(chosen.level.effects) < 2:
            return None
        less = without_effect(study, root, chosen.level, item.effect)
        chosen = less if less is not None else chosen
    return chosen


def compare_alternatives(
    study: Study,
    evidence: Evidence,
    root: Level,
    chosen: FittedCandidate,
    item: HoldoutResult,
    first: Sequence[ScreenedCandidate],
    nominal: Packed,
    folds: Sequence[Flags],
) -> HoldoutResult:
    """The result with the rivals that do nearly as well on the other trajectories in place of the effect.

    `first` are the candidates as they were ranked before anything was found.
    """
    less = _level_without(study, root, chosen.level, item.effect)
    if less is None:
        return item
    ranked = rank(study, evidence, less, nominal, no_progress) if less.effects else first
    own = next((one.gain for one in ranked if one.effect == item.effect), item.gain)
    near = [one for one in ranked if _rival(study, one, item.effect, own)]
    error = _pieces(study, chosen.level, folds)
    rivals = []
    for one in near[:MOST_RIVALS]:
        fitted = inside_twin(study, root, less, one)
        if fitted is not None and not _clearly_less(study.policy, error, _pieces(study, fitted.level, folds)):
            rivals.append(one.effect)
    return replace(item, rivals=tuple(rivals))


def in_words(carried: Sequence[HoldoutResult]) -> tuple[str, ...]:
    """What another trajectory says, one sentence an effect."""
    return tuple(
        f"Carried unchanged to another trajectory, {item.effect.replace('_', ' ')} "
        + (
            f"raises the squared error there by {-100 * item.gain:.0f} %: it is not the cause."
            if item.refuted
            else f"lowers the squared error there by {100 * item.gain:.0f} %"
            + (f"; {_listed(item.rivals)} in its place does nearly as well." if item.rivals else ".")
        )
        for item in carried
    )


def _listed(effects: Sequence[str]) -> str:
    return " or ".join(effect.replace("_", " ") for effect in effects)


def _level_without(study: Study, root: Level, level: Level, effect: str) -> Level | None:
    """The model fitted without one of its effects."""
    if len(level.effects) < 2:
        return root
    without = without_effect(study, root, level, effect)
    return None if without is None else without.level


def _carried(
    study: Study, folds: Sequence[Flags], less: Level, more: Level, effect: str
) -> HoldoutResult | None:
    """None where both models are so far off on the other trajectories that nothing can be compared."""
    before: list[float] = []
    after: list[float] = []
    for held in folds:
        plain, with_effect = carried_error(study, less, held), carried_error(study, more, held)
        size = min(float(np.mean(error[held] ** 2)) for error in (plain, with_effect))
        if not size < study.policy.lost * max(less.fitted.cost, 1e-300):
            continue
        before += chunks_of(plain[held])
        after += chunks_of(with_effect[held])
    if not before:
        return None
    gain, z = gain_and_z(Unseen(np.array(before)), Unseen(np.array(after)))
    if not math.isfinite(gain):
        return None
    policy = study.policy
    lowers = gain >= policy.confirming_gain or (gain >= policy.least_gain and z >= policy.apart_z)
    return HoldoutResult(effect, gain, z, lowers)


def _rival(study: Study, one: ScreenedCandidate, effect: str, gain: float) -> bool:
    return one.effect != effect and one.gain >= study.policy.rival_gain * gain and visible(study, one)


def _pieces(study: Study, level: Level, folds: Sequence[Flags]) -> Unseen:
    """Squared error on every trajectory, of the model fitted to the others."""
    return Unseen(np.array([p for held in folds for p in chunks_of(carried_error(study, level, held)[held])]))


def _clearly_less(policy: Policy, own: Unseen, rival: Unseen) -> bool:
    """Whether the effect errs clearly less than its rival."""
    gain, z = gain_and_z(rival, own)
    return gain >= policy.confirming_gain or (gain >= policy.confirming_margin and z >= policy.apart_z)
