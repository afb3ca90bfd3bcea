"""Does another trajectory confirm what was found, and would another effect do as well there?

Every effect found is carried unchanged to trajectories that were not fitted: the right one lowers the error there, the
wrong ones raise it. A second recording that lowers the error of Stribeck friction often lowers that of nonlinear
viscosity too. So each effect is taken out, the best alternatives are fitted in its place, and all are carried:
confirmed is what errs clearly less there than every rival.

What is not refitted must be the same there. A recording with a base of its own is no such trajectory: only the base is
refitted (`each_recording`), and what it cannot show says nothing. Of several effects that were found together each is
asked beside the others with values that they have there: what two share of one torque, one of them alone may carry.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.core.time_limit import TimeIsUp, is_over, limited
from autotune.diagnosis.backward import Backward
from autotune.diagnosis.candidates import FittedCandidate, ScreenedCandidate, exchanged_for, no_progress
from autotune.diagnosis.evidence import evidence_of
from autotune.diagnosis.evidence.evidence import Evidence, HoldoutResult
from autotune.diagnosis.evidence.single import carried_error, chunks_of
from autotune.diagnosis.evidence.visibility import visible
from autotune.diagnosis.free_shape import without_own_course
from autotune.diagnosis.refits import inside_twin, without_effect
from autotune.diagnosis.screening import rank
from autotune.diagnosis.search_state import Found
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.cross_validation import Unseen, gain_and_z
from autotune.estimation.policy import Policy
from autotune.estimation.problem import Problem
from autotune.models.drive_model import Packed
from autotune.models.spring import SPRING
from autotune.models.table import EFFECTS

MOST_RIVALS = 3
"""Fitted in the place of each effect."""


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """A trajectory that models are carried to.

    Attributes:
        error_of: what a model leaves there, shape (rows,) [N m or N]; None where its twin is unstable.
        own_base: whether the base is refitted there, and an effect is judged by its own part alone.
        beside: the same of a model of which some effects, by their names, have values of their own there.
    """

    error_of: Callable[[ModelFit], Floats | None]
    own_base: bool = False
    beside: Callable[[ModelFit, Collection[str]], Floats | None] | None = None

    def with_and_without(self, more: ModelFit, less: ModelFit) -> tuple[Floats | None, Floats | None]:
        """What models with and without an effect leave, beside the others that both have."""
        if self.beside is None or not less.effects:
            return self.error_of(more), self.error_of(less)
        return self.beside(more, less.effects), self.beside(less, less.effects)


def confirm(found: Found, nominal: Packed) -> tuple[FittedCandidate | None, list[HoldoutResult]]:
    """What was found, without the effects that another trajectory refutes, and what it said of each of them.

    Carried to trajectories of the same problem that are held out; nothing is refitted there.
    """
    problem = found.problem

    def unchanged(held: Flags) -> Elsewhere:
        return Elsewhere(lambda model_fit: carried_error(problem, model_fit, held)[held])

    folds = evidence_of(problem.data).other_trajectories(problem) if found.chosen is not None else []
    return confirm_by(found, nominal, [unchanged(held) for held in folds])


def confirm_in_time(
    found: Found, nominal: Packed, until: float
) -> tuple[Found, FittedCandidate | None, list[HoldoutResult]]:
    """What was found, and what `confirm` says of it; found cut short where the deadline `until` came before an effect
    was compared with all that may do as well.
    """
    try:
        with limited(math.inf if found.cut_short else until):
            chosen, carried = confirm(found, nominal)
    except TimeIsUp:
        found = replace(found, cut_short=True)
        chosen, carried = confirm(found, nominal)
    over = chosen is not None and is_over(until)
    return replace(found, cut_short=found.cut_short or over), chosen, carried


def confirm_by(
    found: Found, nominal: Packed, others: Sequence[Elsewhere], shown: Collection[str] = ()
) -> tuple[FittedCandidate | None, list[HoldoutResult]]:
    """The same by any trajectories; effects that are `shown` there by themselves are not refuted by other values.

    Where time was up nothing is confirmed, and no rivals are fitted: that is a round of a search.
    """
    chosen, problem, root = found.chosen, found.problem, found.root
    if chosen is None or not others:
        return chosen, []
    evidence = evidence_of(problem.data)
    carried = hold_out(problem, root, chosen, others, shown)
    left = without(problem, root, chosen, [item.effect for item in carried if item.refuted])
    if left is None or found.cut_short:
        return left, carried
    return left, [
        compare_alternatives(problem, evidence, left, item, found, nominal, others)
        if item.lowers and item.effect in left.model_fit.effects
        else item
        for item in carried
    ]


def hold_out(
    problem: Problem,
    root: ModelFit,
    chosen: FittedCandidate,
    others: Sequence[Elsewhere],
    shown: Collection[str] = (),
) -> list[HoldoutResult]:
    """For every effect found: what it does to the error on trajectories that were not fitted."""
    found = []
    for effect in chosen.model_fit.effects:
        result = _held_out(problem, root, chosen.model_fit, effect, others)
        if result is not None:
            found.append(replace(result, refuted=False) if effect in shown else result)
    return found


def _held_out(
    problem: Problem, root: ModelFit, model_fit: ModelFit, effect: str, others: Sequence[Elsewhere]
) -> HoldoutResult | None:
    """The same for one effect; None where nothing can be compared."""
    less = _fit_without(problem, root, model_fit, effect)
    return None if less is None else _carried(problem.policy, others, less, model_fit, effect)


def without(
    problem: Problem, root: ModelFit, chosen: FittedCandidate, effects: Sequence[str]
) -> FittedCandidate | None:
    """The model without these effects; None where no effect is left."""
    for effect in effects:
        if len(chosen.model_fit.effects) < 2:
            return None
        less = without_effect(problem, root, chosen.model_fit, effect)
        chosen = less.with_courses_of(chosen) if less is not None else chosen
    return chosen


def with_chosen(found: Found, chosen: FittedCandidate | None) -> Found:
    """What a search found with what is chosen at last: what tells of a second mass (`Found.unloaded`) anew, where other
    effects stand beside it since.
    """
    return replace(found, chosen=chosen, unloaded=_unloaded(found, chosen))


def _unloaded(found: Found, chosen: FittedCandidate | None) -> ModelFit | None:
    known = found.unloaded
    if chosen is None or known is None:
        return None
    beside = {effect for effect in chosen.model_fit.effects if not EFFECTS[effect].in_transmission}
    if set(known.effects) == beside:
        return known
    evidence = evidence_of(found.problem.data)
    return Backward(found.problem, found.root, evidence, no_progress).unloaded(chosen)


def compare_alternatives(
    problem: Problem,
    evidence: Evidence,
    chosen: FittedCandidate,
    item: HoldoutResult,
    found: Found,
    nominal: Packed,
    others: Sequence[Elsewhere],
) -> HoldoutResult:
    """The result with the rivals that do nearly as well on the other trajectories in place of the effect.

    Beside nothing else they are ranked already as they were before anything was found.
    """
    root = found.root
    less = _fit_without(problem, root, chosen.model_fit, item.effect)
    if less is None:
        return item
    ranked = rank(problem, evidence, less, nominal, no_progress) if less.effects else found.first
    own = next((one.gain for one in ranked if one.effect == item.effect), item.gain)
    near = [one for one in ranked if _rival(problem, one, item.effect, own)]
    error = _pieces(others, chosen.model_fit)
    rivals = []
    for one in near[:MOST_RIVALS]:
        fitted = inside_twin(problem, root, less, one)
        rival = None if fitted is None else _pieces(others, fitted.model_fit)
        if error is None or (rival is not None and not _clearly_less(problem.policy, error, rival)):
            rivals.append(one.effect)
    return replace(item, rivals=tuple(rivals))


def told_apart(found: Found, rivals: Collection[str], others: Sequence[Elsewhere]) -> Found:
    """Of effects that one recording cannot tell from each other the one that errs least on others, and no rivals that
    err clearly more there.

    Recordings on which that one lowers no error say nothing of it, and of its rivals only that they raise it more: a
    torque that comes from elsewhere hides there what is looked for, and what is fitted least harms least. Nor do they
    tell a wave over a part of its turn from a spring: what errs there is the spring's own straight line, and one that
    hardens, or is met on the way, is as smooth a course. The spring stays a rival then, but does not lead.
    """
    chosen = found.chosen
    if chosen is None:
        return found
    fits = found.exchanged if len(chosen.model_fit.effects) > 1 else found.tried
    fits = [item for item in fits if all(len(part) == 1 for part in exchanged_for(chosen, item))]
    near = [item for item in fits if item.effect in rivals]
    if not near:
        return found
    errors = [(item, _pieces(others, item.model_fit)) for item in (chosen, *near)]
    known = [(item, error) for item, error in errors if error is not None]
    if not known:
        return found
    best, least = min(known, key=lambda one: one[1].total)
    policy = found.problem.policy
    shapeless = best.effect in without_own_course(found.problem, best.model_fit)
    behind = [item for item, error in known if item is not best and _clearly_less(policy, least, error)]
    if best is not chosen and not any(item is chosen for item in behind):  # better by chance
        return found
    worse = {item.effect for item in behind if not (shapeless and item.effect == SPRING.name)}
    lost = {effect for item in behind for effect in set(best.model_fit.effects) - set(item.model_fit.effects)}
    seen = [_held_out(found.problem, found.root, best.model_fit, effect, others) for effect in sorted(lost)]
    if not all(result is not None and result.lowers for result in seen):
        return found
    return replace(found, chosen=best, told_apart=tuple(sorted(worse)))


def in_words(carried: Sequence[HoldoutResult]) -> tuple[str, ...]:
    """What another trajectory says, one sentence an effect."""
    return tuple(
        f"Carried unchanged to another trajectory, {item.effect.replace('_', ' ')} {_effect_there(item)}"
        for item in carried
    )


def _effect_there(item: HoldoutResult) -> str:
    size = f"{100 * abs(item.gain):.0f} %"
    if item.refuted:
        return f"raises the squared error there by {size}: it is not the cause."
    if item.gain < 0.0:
        moved = (
            "; has the zero of the position moved between them?" if EFFECTS[item.effect].keeps_zero else "."
        )
        return f"does not lower the squared error there (+{size}){moved}"
    if not item.lowers:
        return f"lowers the squared error there by {size}, which may be chance."
    rivals = f"; {_listed(item.rivals, 'or')} in its place does nearly as well." if item.rivals else "."
    return f"lowers the squared error there by {size}{rivals}"


def _listed(effects: Sequence[str], between: str) -> str:
    return f" {between} ".join(effect.replace("_", " ") for effect in effects)


def _fit_without(problem: Problem, root: ModelFit, model_fit: ModelFit, effect: str) -> ModelFit | None:
    """The model fitted without one of its effects."""
    if len(model_fit.effects) < 2:
        return root
    without = without_effect(problem, root, model_fit, effect)
    return None if without is None else without.model_fit


def _carried(
    policy: Policy, others: Sequence[Elsewhere], less: ModelFit, more: ModelFit, effect: str
) -> HoldoutResult | None:
    """None where both models are so far off on the other trajectories that nothing can be compared."""
    before: list[float] = []
    after: list[float] = []
    for other in others:
        with_effect, plain = other.with_and_without(more, less)
        if plain is None or with_effect is None:
            return None
        size = min(float(np.mean(error**2)) for error in (plain, with_effect))
        if not other.own_base and not size < policy.lost * max(less.fitted.cost, 1e-300):
            continue
        before += chunks_of(plain)
        after += chunks_of(with_effect)
    if not before:
        return None
    gain, z = gain_and_z(Unseen(np.array(before)), Unseen(np.array(after)))
    if not math.isfinite(gain):
        return None
    lowers = gain >= policy.confirming_gain or (gain >= policy.least_gain and z >= policy.apart_z)
    raises = gain < 0.0
    if others[0].own_base:  # refitted, a base differs by chance beside what is not seen there
        raises = gain <= -policy.least_gain and z <= -policy.apart_z and not EFFECTS[effect].keeps_zero
    return HoldoutResult(effect, gain, z, lowers, refuted=raises)


def _rival(problem: Problem, one: ScreenedCandidate, effect: str, gain: float) -> bool:
    return one.effect != effect and one.gain >= problem.policy.rival_gain * gain and visible(problem, one)


def _pieces(others: Sequence[Elsewhere], model_fit: ModelFit) -> Unseen | None:
    """Squared error on every trajectory that a model is carried to; None where one cannot be simulated."""
    errors = [other.error_of(model_fit) for other in others]
    if any(error is None for error in errors):
        return None
    return Unseen(np.array([piece for error in errors if error is not None for piece in chunks_of(error)]))


def _clearly_less(policy: Policy, own: Unseen, rival: Unseen) -> bool:
    """Whether the effect errs clearly less than its rival."""
    gain, z = gain_and_z(rival, own)
    return gain >= policy.confirming_gain or (gain >= policy.confirming_margin and z >= policy.apart_z)
