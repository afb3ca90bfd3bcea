"""Does another trajectory confirm what was found, and would another effect do as well there?

Every effect found is carried unchanged to trajectories that were not fitted: the right one lowers the error there, the
wrong ones raise it. A second recording that lowers the error of Stribeck friction often lowers that of nonlinear
viscosity too. So each effect is taken out, the best alternatives are fitted in its place, and all are carried:
confirmed is what errs clearly less there than every rival.

Confirmed is what the first recording names by itself, and what lowers the error of the others with only the base
refitted there.

Fitted together, two recordings bend one base until neither is right, and rivals are compared under that distortion:
where other joints moved in one of them, or another load was on the axis, names came out that neither of them bears.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.arrays import Flags
from autotune.core.errors import AutotuneError
from autotune.diagnosis.baseline import begin
from autotune.diagnosis.candidates import FittedCandidate, Progress, ScreenedCandidate, no_progress
from autotune.diagnosis.evidence import evidence_of
from autotune.diagnosis.evidence.evidence import Evidence, HoldoutResult
from autotune.diagnosis.evidence.single import carried_error, chunks_of
from autotune.diagnosis.evidence.visibility import visible
from autotune.diagnosis.refits import inside_twin, without_effect
from autotune.diagnosis.screening import rank
from autotune.diagnosis.search import Found, search
from autotune.estimation.bandwidth import prepared_for
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.cross_validation import Unseen, gain_and_z
from autotune.estimation.data import TRAINING
from autotune.estimation.pieces import UNFITTED
from autotune.estimation.policy import Policy
from autotune.estimation.problem import Problem, refit
from autotune.estimation.residual import smoothed
from autotune.models.drive_model import DriveModel, Packed
from autotune.models.effect import Kind
from autotune.models.layout import flag
from autotune.models.table import EFFECTS
from autotune.recordings.recording import Recording

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
            + (f"; {_listed(item.rivals, 'or')} in its place does nearly as well." if item.rivals else ".")
        )
        for item in carried
    )


def _listed(effects: Sequence[str], between: str) -> str:
    return f" {between} ".join(effect.replace("_", " ") for effect in effects)


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


ITERATIONS = 10
MOST_UNEXPLAINED = 0.25
"""Of a recording's torque variance: where more is left, it confirms nothing (an arm's joints, others moving)."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """Why what was found is not confirmed, in words; `nowhere`: no recording by itself shows all of it."""

    why: str
    nowhere: bool = False


def doubt_of(
    recordings: Sequence[Recording],
    model: DriveModel,
    effects: Sequence[str],
    progress: Progress,
    policy: Policy,
    candidates: tuple[Kind, ...],
) -> Doubt | None:
    """What speaks against calling effects confirmed that all recordings together have named; None if nothing does.

    Together alone they name what a base bends into that is two: warmer, or heavier, in one of them. A file that holds
    nothing but a veto, a test or conditioning is no recording of its own.
    """
    recordings = [
        one for one in recordings if any(part.experiment not in UNFITTED for part in one.segments())
    ]
    if len(recordings) < 2:
        return None
    try:
        progress("what the first recording names by itself")
        found = _by_itself(recordings[0], model, progress, policy, candidates)
        missing = nowhere = _not_shown(effects, found)
        if missing:
            progress("what the others name by themselves")
        for one in recordings[1:] if missing else ():
            nowhere = _not_shown(nowhere, _by_itself(one, model, progress, policy, candidates))
        if nowhere:
            return Doubt(f"no recording by itself shows {_listed(nowhere, 'and')}", nowhere=True)
        if missing or found.chosen is None:
            return Doubt(f"the first recording by itself does not show {_listed(missing or effects, 'and')}")
        share = unexplained(found.problem, found.chosen.model_fit)
        if share > MOST_UNEXPLAINED:
            return Doubt(_unexplained("the first recording", share))
        for number, recording in enumerate(recordings[1:], 2):
            why = _elsewhere(recording, number, model, found.chosen.model_fit, progress, policy)
            if why is not None:
                return Doubt(why)
    except AutotuneError as reason:
        return Doubt(f"a recording tells too little by itself ({reason})")
    return None


def _by_itself(
    recording: Recording,
    model: DriveModel,
    progress: Progress,
    policy: Policy,
    candidates: tuple[Kind, ...],
) -> Found:
    """What a search finds in one recording."""
    problem, root, nominal, _ = begin(prepared_for([recording], policy), model, progress, policy=policy)
    return search(replace(problem, candidates=candidates), root, nominal, progress)


def _not_shown(effects: Sequence[str], found: Found) -> list[str]:
    names = () if found.chosen is None else found.chosen.model_fit.effects
    return [name for name in effects if name not in names]


def unexplained(problem: Problem, model_fit: ModelFit) -> float:
    """Share of the torque's variance that a model leaves on the rows that count."""
    rows = problem.training > 0
    torque = smoothed(problem.data, problem.data.torque)[rows]
    return float(np.var(model_fit.fitted.error[rows])) / max(float(np.var(torque)), 1e-300)


def _elsewhere(
    recording: Recording,
    number: int,
    model: DriveModel,
    model_fit: ModelFit,
    progress: Progress,
    policy: Policy,
) -> str | None:
    """What another recording says against the effects of `model_fit`, with only the base refitted to it."""
    problem, root, _, _ = begin(prepared_for([recording], policy), model, progress, policy=policy)
    before = problem.mean_square(root.fitted.error, TRAINING)
    packed = with_effects(root.fitted.packed, model_fit.fitted.packed, model_fit.effects)
    correction = problem.correction(packed)
    if not correction.stable:
        return f"with these effects recording {number} cannot be simulated"
    fitted = refit(problem, packed, list(root.free), correction, ITERATIONS)
    after = problem.mean_square(fitted.error, TRAINING)
    if after >= (1.0 - policy.least_gain) * before:
        return f"recording {number}, with only the base refitted, errs no less with them than without"
    share = unexplained(problem, replace(root, fitted=fitted))
    return _unexplained(f"recording {number}", share) if share > MOST_UNEXPLAINED else None


def with_effects(base: Packed, other: Packed, effects: Sequence[str]) -> Packed:
    """A model with the effects of another one, unchanged."""
    p, on = base.p.copy(), base.on.copy()
    for name in effects:
        for parameter in EFFECTS[name].parameters:
            p[parameter.slot] = other.p[parameter.slot]
        on[flag(name)] = True
    return Packed(p, on)


def _unexplained(which: str, share: float) -> str:
    return f"{which} keeps {100 * share:.0f} % of the torque's variance unexplained"
