"""Laws of the base that data ask for instead of an effect, or beside what was found.

Before an effect is taken a law of the base is held against the best of them: what every drive has comes before what
may be missing. Beside an effect the data may ask for a law that the effect hid, or stood for; and a law that stood for
an effect is needed no more beside it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from autotune.diagnosis.base_laws import BASE_LAWS, CLIMB_LAW, BaseLaw, with_base_shapes
from autotune.diagnosis.candidates import (
    FittedCandidate,
    ScreenedCandidate,
    asked_for,
    error_left,
    gain_on_veto,
    not_refuted,
)
from autotune.diagnosis.contact_laws import EFFECT as MEMORY
from autotune.diagnosis.contact_laws import creeps, of_many
from autotune.diagnosis.refits import (
    REFINED,
    inside_twin,
    judged,
    judged_again,
    refined,
    settled_in,
    taken_out,
)
from autotune.diagnosis.search_state import SearchState
from autotune.estimation.bias_corrected_fit import LEVEL_GROUND, ModelFit, fit_inside_twin
from autotune.estimation.cross_validation import gain_and_z
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.table import EFFECTS


def shape_base(state: SearchState) -> None:
    """What textbooks have in the base may have another shape there: that is asked before anything else."""
    if not state.more_to_explain(state.root):
        return
    shaped = state.borne_out(with_base_shapes(state.problem, state.root, state.nominal))
    if shaped is not None:
        state.progress("another law of the base")
        state.take_root(shaped)


def other_law(state: SearchState, ranked: Sequence[ScreenedCandidate]) -> bool:
    """Whether an optional law of the base explains more than any effect: then the root has it.

    Memory is no effect beside the friction of many contacts, unless it goes on beyond them.
    """
    state.outdone = None  # of a round before, from another root
    asked = state.more_to_explain(state.root)
    if not asked and not state.evidence.worth_fitting(state.problem, state.root, ranked):
        return False
    best, other = _leading_law(state, state.root)
    if other is None:
        return False
    if not _leads(state, state.root, other, ranked):
        state.outdone = other
        return False
    state.progress(state.laws[best].about)
    state.take_root(other)
    state.begins_again()
    return True


def _leads(state: SearchState, before: ModelFit, law: ModelFit, ranked: Sequence[ScreenedCandidate]) -> bool:
    """Whether a law of the base beside `before` explains at least as much as any effect does there.

    Friction without a static part nearly as much, where the effect stands for it.
    """
    effects = [item for item in ranked if item.effect != MEMORY or not of_many(law.fitted.packed)]
    best = max(effects, key=lambda item: item.gain, default=None)
    gain = gain_and_z(before.unseen, law.unseen)[0]
    if best is None:
        return gain >= 0.0
    if gain >= best.gain:
        return True
    near = creeps(law.fitted.packed) and gain >= state.problem.policy.named * best.gain
    return near and _stands_for_coulomb(state, before, best)


def _stands_for_coulomb(state: SearchState, before: ModelFit, item: ScreenedCandidate) -> bool:
    """Whether an effect, fitted inside the twin, takes the place of most of the Coulomb friction `before` it.

    Friction without a static part goes through zero as a smooth function of the speed. A viscosity that bends by the
    tenth root of the speed does so nearly: beside a load dependence and a memory it gained 76 % where the true law
    gained 74, took three quarters of the Coulomb friction over, and was named, with a saturation, for the other two.
    """
    if EFFECTS[item.effect].approximate:
        return False
    state.progress(f"refit inside the twin: {item.effect}")
    fitted = inside_twin(state.problem, state.root, before, item)
    if fitted is None:
        return False
    left, was = (one.fitted.packed.p[layout.COULOMB] for one in (fitted.model_fit, before))
    return bool(left < state.problem.policy.partly * was)


def law_before_further(
    state: SearchState, ranked: Sequence[ScreenedCandidate], best: FittedCandidate
) -> bool:
    """Whether a law of the base is asked for beside what was found, before any further effect, the best of all.

    The effect that was found hid it in the root. A memory takes the place of a contact's own curve beside an
    effect as it does alone, worse than the curve and with a name: once it is there the law is not asked for. What two
    masses gain in a screening scatters: their fit is held against the law on the veto trajectory, where there is one.
    """
    if state.law_first or not state.more_to_explain(state.model_fit):
        return False
    _, law = _leading_law(state, state.model_fit)
    if law is None:
        return False
    if EFFECTS[best.effect].in_transmission and state.problem.has_veto:
        if gain_on_veto(state.problem, state.model_fit, law) < best.gain:
            return False
        ranked = [item for item in ranked if not EFFECTS[item.effect].in_transmission]
    state.law_first = _leads(state, state.model_fit, law, ranked)
    return state.law_first


def _leading_law(state: SearchState, before: ModelFit) -> tuple[int, ModelFit | None]:
    """Of the laws of the base the one that explains most beside `before`; None where data ask for none."""
    found = _other_laws(state, before)
    gains = [gain_and_z(before.unseen, one.unseen)[0] if one is not None else 0.0 for one in found]
    best = _plainest(state, found, max(range(len(found)), key=lambda i: gains[i]))
    return best, found[best]


def _other_laws(state: SearchState, before: ModelFit) -> list[ModelFit | None]:
    """A model with each law of the base that data ask for.

    One that leaves nothing beyond doubt is no reason not to ask the next: where repeats are few, doubt is wide, and a
    chain of elements stood for the curve of Dahl's law with twice the error of that.
    """
    return [state.borne_out(law.added(state.problem, before, asked_for), before) for law in state.laws]


def _plainest(state: SearchState, found: Sequence[ModelFit | None], best: int) -> int:
    """The best of several laws of the base; or one with fewer parameters, where data do not ask for more."""
    other = found[best]
    plainer = [
        (one.fitted.cost, i)
        for i, one in enumerate(found)
        if one is not None
        and other is not None
        and len(one.free) < len(other.free)
        and not asked_for(state.problem, one, other)
    ]
    return min(plainer)[1] if plainer else best


def other_law_beside(state: SearchState) -> bool:
    """Whether one does so beside what was found: then the root has it, and effects are looked for anew.

    Where what explained more could not be taken after all, or errs more inside the twin, it does.
    """
    other = _outdone_after_all(state)
    found, beside = state.chosen or _best_refused(state), state.beside
    if other is None and found is not None:
        other = _root_beside(state, found)
    if other is None:
        other = _law_in_place(state)
    if other is None or other.fitted.cost > LEVEL_GROUND * state.root.fitted.cost:
        state.beside = beside
        return False
    state.progress("another law of the base")
    state.take_root(other)
    return not state.begins_again()


def _outdone_after_all(state: SearchState) -> ModelFit | None:
    """The law of the base that the best effect seemed to outdo, if it explains more than what was found.

    Fitted to what is compared now: torque and motion may have been moved since, by what was found.
    """
    there = settled_in(state.problem, state.outdone) if state.outdone is not None else None
    if there is None or state.chosen is None:
        return None if there is None else there[1]
    problem, other = there
    less = error_left(problem, other) < error_left(problem, state.chosen.model_fit)
    return other if less else None


def _root_beside(state: SearchState, chosen: FittedCandidate) -> ModelFit | None:
    """The root with a law of the base that the data ask for beside an effect; None where they do not.

    Training may be explained where the veto trajectory is not.
    """
    if not (chosen.share < REFINED or state.more_to_explain(chosen.model_fit)):
        return None
    before = chosen.model_fit
    found = [
        (law, state.borne_out(law.added(state.problem, before, asked_for), before)) for law in state.laws
    ]
    beside = [(law, after) for law, after in found if after is not None]
    if not beside:
        return None
    law, after = min(beside, key=lambda item: item[1].fitted.cost)
    state.beside = replace(chosen, model_fit=after)
    starts = [taken_out(state.root, after, *after.effects)]
    if max(law.slots) < layout.BASE_PARAMETERS:
        p = state.root.fitted.packed.p.copy()
        p[list(law.slots)] = after.fitted.packed.p[list(law.slots)]
        starts.append(Packed(p, state.root.fitted.packed.on))
    free = [*state.root.free, *(one for one in after.free if one.slot in law.slots)]
    fits = [fit_inside_twin(state.problem, packed, free, 2, state.root.effects) for packed in starts]
    return min((one for one in fits if one is not None), key=lambda one: one.fitted.cost, default=None)


def _law_in_place(state: SearchState) -> ModelFit | None:
    """The root with a law of the base that leaves less than what was found, where the veto tells of neither.

    On a veto trajectory that is noise nearly all an effect has next to nothing to explain, and explains it; of a law of
    the base more is asked (`asked_for`). What every drive may have comes before what may be missing.
    """
    problem, chosen = state.problem, state.chosen
    if chosen is None or not problem.has_veto or chosen.share < problem.policy.partly:
        return None
    if gain_on_veto(problem, state.root, chosen.model_fit) >= problem.policy.clear_gain:
        return None
    found = [state.borne_out(law.added(problem, state.root, not_refuted)) for law in state.laws]
    best = min(
        (one for one in found if one is not None), key=lambda one: error_left(problem, one), default=None
    )
    less = best is not None and error_left(problem, best) < error_left(problem, chosen.model_fit)
    return best if less else None


def _best_refused(state: SearchState) -> FittedCandidate | None:
    """The best of the first round that explains half of all, where none was taken."""
    half = [one for one in state.tried if one.share >= state.problem.policy.partly]
    return min(half, key=lambda one: error_left(state.problem, one.model_fit), default=None)


def drop_laws(state: SearchState, only_where_less_is_left: bool = False) -> None:
    """The base is the plain one again where it needs no other law beside what was found.

    What has its name beside such a law, which the data did ask for, and would lose it without, keeps the law: in a
    recording whose experiments are few the held-out ones tell of a law by chance. `only_where_less_is_left`: before
    more is looked for the plain base must leave less than the law, which stood for what was missing then and bends the
    rest since: a memory is no answer to that.
    """
    for law in BASE_LAWS:
        if state.chosen is None or not (_has(law, state.root) and _has(law, state.chosen.model_fit)):
            continue
        less = law.removed(state.problem, state.chosen.model_fit)
        if less is None or asked_for(state.problem, less, state.chosen.model_fit):
            continue
        root = law.removed(state.problem, state.root)
        if root is None:
            continue
        plainer = judged_again(state.problem, root, state.chosen, less)
        if only_where_less_is_left:
            plainer = refined(state.problem, root, plainer, state.progress)
            if plainer.model_fit.fitted.cost >= state.chosen.model_fit.fitted.cost:
                continue
        if plainer.named or not state.chosen.named:
            _give_up(state, law, root, plainer)


def _give_up(state: SearchState, law: BaseLaw, root: ModelFit, plainer: FittedCandidate) -> None:
    """Makes it the root and the chosen model without a law of the base; what they are compared with has none either."""

    def without(model_fit: ModelFit) -> ModelFit | None:
        return law.removed(state.problem, model_fit) if _has(law, model_fit) else model_fit

    def compared(items: Sequence[FittedCandidate]) -> list[FittedCandidate]:
        own, again = plainer.model_fit.effects, []
        for one in items:
            bare = plainer.model_fit if one.model_fit.effects == own else without(one.model_fit)
            if bare is not None:
                known = plainer if bare is plainer.model_fit else one
                again.append(judged(state.problem, root, bare, one.effect).with_courses_of(known))
        return again

    tried, later = compared(state.tried), compared(state.later)
    state.unloaded = without(state.unloaded) if state.unloaded is not None else None
    state.root, state.chosen, state.tried, state.later = root, plainer, tried, later


def _has(law: BaseLaw, model_fit: ModelFit) -> bool:
    """Whether a model has a law of the base, and no memory by the same elements."""
    its_own = law is not CLIMB_LAW or MEMORY not in model_fit.effects
    return its_own and law.there(model_fit.fitted.packed)
