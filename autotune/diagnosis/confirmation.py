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
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.cross_validation import Unseen, gain_and_z
from autotune.estimation.policy import Policy
from autotune.estimation.problem import Problem
from autotune.models.drive_model import Packed

MOST_RIVALS = 3
"""Fitted in the place of each effect."""


def confirm(found: Found, nominal: Packed) -> tuple[FittedCandidate | None, list[HoldoutResult]]:
    """What was found, without the effects that another trajectory refutes, and what it said of each of them."""
    chosen, problem, root = found.chosen, found.problem, found.root
    evidence = evidence_of(problem.data)
    folds = evidence.other_trajectories(problem)
    if chosen is None or not folds:
        return chosen, []
    carried = hold_out(problem, root, chosen, folds)
    left = without_refuted(problem, root, chosen, carried)
    if left is None:
        return None, carried
    return left, [
        compare_alternatives(problem, evidence, root, left, item, found.first, nominal, folds)
        if item.lowers and item.effect in left.model_fit.effects
        else item
        for item in carried
    ]


def hold_out(
    problem: Problem, root: ModelFit, chosen: FittedCandidate, folds: Sequence[Flags]
) -> list[HoldoutResult]:
    """For every effect found: what it does to the error on trajectories that were not fitted."""
    found = []
    for effect in chosen.model_fit.effects:
        less = _fit_without(problem, root, chosen.model_fit, effect)
        result = None if less is None else _carried(problem, folds, less, chosen.model_fit, effect)
        if result is not None:
            found.append(result)
    return found


def without_refuted(
    problem: Problem, root: ModelFit, chosen: FittedCandidate, carried: Sequence[HoldoutResult]
) -> FittedCandidate | None:
    """The model without the effects that another trajectory refutes; None where no effect is left."""
    for item in carried:
        if not item.refuted:
            continue
        if len(chosen.model_fit.effects) < 2:
            return None
        less = without_effect(problem, root, chosen.model_fit, item.effect)
        chosen = less if less is not None else chosen
    return chosen


def compare_alternatives(
    problem: Problem,
    evidence: Evidence,
    root: ModelFit,
    chosen: FittedCandidate,
    item: HoldoutResult,
    first: Sequence[ScreenedCandidate],
    nominal: Packed,
    folds: Sequence[Flags],
) -> HoldoutResult:
    """The result with the rivals that do nearly as well on the other trajectories in place of the effect.

    `first` are the candidates as they were ranked before anything was found.
    """
    less = _fit_without(problem, root, chosen.model_fit, item.effect)
    if less is None:
        return item
    ranked = rank(problem, evidence, less, nominal, no_progress) if less.effects else first
    own = next((one.gain for one in ranked if one.effect == item.effect), item.gain)
    near = [one for one in ranked if _rival(problem, one, item.effect, own)]
    error = _pieces(problem, chosen.model_fit, folds)
    rivals = []
    for one in near[:MOST_RIVALS]:
        fitted = inside_twin(problem, root, less, one)
        if fitted is not None and not _clearly_less(
            problem.policy, error, _pieces(problem, fitted.model_fit, folds)
        ):
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


def _fit_without(problem: Problem, root: ModelFit, model_fit: ModelFit, effect: str) -> ModelFit | None:
    """The model fitted without one of its effects."""
    if len(model_fit.effects) < 2:
        return root
    without = without_effect(problem, root, model_fit, effect)
    return None if without is None else without.model_fit


def _carried(
    problem: Problem, folds: Sequence[Flags], less: ModelFit, more: ModelFit, effect: str
) -> HoldoutResult | None:
    """None where both models are so far off on the other trajectories that nothing can be compared."""
    before: list[float] = []
    after: list[float] = []
    for held in folds:
        plain, with_effect = carried_error(problem, less, held), carried_error(problem, more, held)
        size = min(float(np.mean(error[held] ** 2)) for error in (plain, with_effect))
        if not size < problem.policy.lost * max(less.fitted.cost, 1e-300):
            continue
        before += chunks_of(plain[held])
        after += chunks_of(with_effect[held])
    if not before:
        return None
    gain, z = gain_and_z(Unseen(np.array(before)), Unseen(np.array(after)))
    if not math.isfinite(gain):
        return None
    policy = problem.policy
    lowers = gain >= policy.confirming_gain or (gain >= policy.least_gain and z >= policy.apart_z)
    return HoldoutResult(effect, gain, z, lowers)


def _rival(problem: Problem, one: ScreenedCandidate, effect: str, gain: float) -> bool:
    return one.effect != effect and one.gain >= problem.policy.rival_gain * gain and visible(problem, one)


def _pieces(problem: Problem, model_fit: ModelFit, folds: Sequence[Flags]) -> Unseen:
    """Squared error on every trajectory, of the model fitted to the others."""
    return Unseen(
        np.array([p for held in folds for p in chunks_of(carried_error(problem, model_fit, held)[held])])
    )


def _clearly_less(policy: Policy, own: Unseen, rival: Unseen) -> bool:
    """Whether the effect errs clearly less than its rival."""
    gain, z = gain_and_z(rival, own)
    return gain >= policy.confirming_gain or (gain >= policy.confirming_margin and z >= policy.apart_z)
