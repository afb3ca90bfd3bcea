"""Elements of a memory that are no memory, but the way in which the axis's own contact lets go.

The root has them then, and what was found beside them must hold where that contact slides.
"""

from __future__ import annotations

from dataclasses import replace

from autotune.diagnosis.backward import tidy
from autotune.diagnosis.base_laws import has_other_law
from autotune.diagnosis.candidates import (
    FittedCandidate,
    ScreenedCandidate,
    asked_for,
    exchanged_for,
)
from autotune.diagnosis.contact_laws import EFFECT as MEMORY
from autotune.diagnosis.contact_laws import with_own_presliding, without_memory
from autotune.diagnosis.refits import (
    in_place_of,
    judged,
    judged_again,
)
from autotune.diagnosis.rounds import one_round
from autotune.diagnosis.screening import generic_gains
from autotune.diagnosis.search_state import Found, SearchState
from autotune.diagnosis.settling import take
from autotune.estimation.bias_corrected_fit import ModelFit, held_out_of
from autotune.estimation.cross_validation import (
    beyond_presliding,
    evenly,
    gain_and_z,
    goes_with_place,
)
from autotune.estimation.data import TRAINING
from autotune.estimation.problem import Problem


def beside_own_presliding(state: SearchState, found: Found) -> Found:
    """The same with elements that are no memory in the root: what was found beside them keeps its name."""
    chosen = found.chosen
    own = with_own_presliding(state.problem, state.root, chosen.model_fit) if chosen is not None else None
    if own is None or chosen is None:
        return found
    climbs = _remembered_beyond(state, own)
    if climbs is not None:
        remembers = judged_again(state.problem, climbs, chosen, chosen.model_fit)
        found = replace(found, root=climbs, chosen=remembers, presliding=chosen)
        return _rivals_in_the_climb(state, found, remembers)
    others = tuple(effect for effect in chosen.model_fit.effects if effect != MEMORY)
    beside = replace(_beside_elements(chosen), effect=others[-1]) if others else None
    beside = beside if beside is not None and _needed_beside(state, own, beside) else None
    alike = [_beside_elements(item) for item in found.exchanged if MEMORY in item.model_fit.effects]
    single = {item.effect: item for item in state.tried if item.effect != MEMORY}
    if len(others) == 1 and beside is not None:  # those by themselves lack the elements
        single |= {item.effect: item for item in alike}
    first, (chosen_then, further) = state.first, state.further
    if chosen_then == (MEMORY,) and not others:
        # what was looked at beside elements, by whatever name, has them; what was looked at before lacks them
        first, single = further, {}
    found = replace(
        found,
        root=own,
        chosen=beside,
        first=[item for item in first if item.effect != MEMORY],
        tried=list(single.values()),
        exchanged=alike if len(others) > 1 else (),
        presliding=chosen,
    )
    return found if found.chosen is not None else _begun_beside(state, found)


def _rivals_in_the_climb(state: SearchState, found: Found, remembers: FittedCandidate) -> Found:
    """The same with the climb of the root in what may stand for the memory: by themselves its rivals lack it."""
    alone = len(remembers.model_fit.effects) < 2
    root, begun = found.root, remembers
    if alone:
        begun = replace(remembers, model_fit=replace(root, effects=(MEMORY,)))

    def beside(item: FittedCandidate) -> FittedCandidate | None:
        own, new = exchanged_for(remembers, item)
        if own == {MEMORY} and len(new) == 1:
            return in_place_of(state.problem, root, begun, MEMORY, replace(item, effect=new.pop()))
        return judged_again(state.problem, root, item, item.model_fit)

    again = [beside(item) for item in (found.tried if alone else found.exchanged)]
    fits = [item for item in again if item is not None]
    return replace(found, tried=fits) if alone else replace(found, exchanged=fits)


def _beside_elements(item: FittedCandidate) -> FittedCandidate:
    """A fit with elements that are no memory: the root has them, and its effects are the others."""
    others = tuple(effect for effect in item.model_fit.effects if effect != MEMORY)
    return replace(item, model_fit=replace(item.model_fit, effects=others)).with_courses_of(item)


def _begun_beside(state: SearchState, found: Found) -> Found:
    """The search begun anew beside a presliding of its own, where something is left while that contact slides.

    What it leaves elsewhere is what no two laws of it have in common; an effect must hold where it slides.
    """
    own, problem = found.root, state.problem
    sliding = beyond_presliding(problem, own.fitted.packed)
    if sliding is None:
        return found
    there = held_out_of(sliding, own)
    generic = state.evidence.telling(problem.policy, generic_gains(sliding, there))
    found = replace(found, generic=generic, sliding=sliding)
    structured = max(generic.values(), default=0.0) > problem.policy.generic_gain
    left = state.evidence.structure_left(sliding, own) if state.evidence.repeats else structured
    left = left or goes_with_place(sliding, own.fitted)
    if not left:
        return found
    again = SearchState(problem, own, state.nominal, state.progress, state.evidence)
    best = one_round(again, first=True)
    if best is not None:
        take(again, best)
        tidy(again)
    beside = replace(found, first=again.first, tried=again.tried)
    if again.problem is not problem:  # aligned, or shaken, as the effect suggests
        sliding = beyond_presliding(again.problem, again.root.fitted.packed)
    if again.chosen is None or sliding is None:
        return beside
    chosen = _while_sliding(again, sliding, again.chosen)
    if chosen is None:
        return beside
    found = replace(beside, problem=again.problem, root=again.root, sliding=sliding)
    return replace(found, chosen=chosen)


def where_it_slides(state: SearchState, found: Found) -> Found:
    """What was found, by what it explains while the contact slides, where the base has another law of presliding.

    No two such laws are alike near a reversal, and what the law that was found leaves there is as much a part of
    what repeats as an effect is. An effect that explains half of all, and all that is left where any contact
    slides, is no worse for it.
    """
    chosen, root = found.chosen, found.root
    if chosen is None or chosen.named or found.sliding is not None or not has_other_law(root.fitted.packed):
        return found
    sliding = beyond_presliding(state.problem, root.fitted.packed)
    if sliding is None or not _shares_with_repeats(state, sliding, chosen):
        return found
    part = judged_again(sliding, root, chosen, chosen.model_fit)
    if part.share <= chosen.share:
        return found
    return replace(found, chosen=replace(part, gain=chosen.gain), sliding=sliding)


def _shares_with_repeats(state: SearchState, sliding: Problem, chosen: FittedCandidate) -> bool:
    """Whether repeats tell that something is left while the contact slides, of which half of all is explained."""
    if not state.evidence.repeats or chosen.share < state.problem.policy.partly:
        return False
    return state.evidence.structure_left(sliding, state.root)


def _while_sliding(state: SearchState, sliding: Problem, chosen: FittedCandidate) -> FittedCandidate | None:
    """An effect by what it explains while the contact slides; None where it hardly lowers what is left there.

    On the rows around it leaves what the law of presliding is not exactly, which no effect explains.
    """
    policy, root = state.problem.policy, state.root
    part = judged_again(sliding, root, chosen, chosen.model_fit)
    least = policy.least_gain if state.evidence.repeats else policy.least_gain_single
    if part.training.fall < least * sliding.mean_square(root.fitted.error, TRAINING):
        return None
    return replace(part, gain=chosen.gain) if part.share >= policy.partly else None


def _remembered_beyond(state: SearchState, own: ModelFit) -> ModelFit | None:
    """The root with a presliding of its own, where elements that go on beyond it are a memory; else None.

    That contact lets go at once, so that what goes on may be a small part of all friction; it must be an effect by
    itself, as any other beside that root.
    """
    climbs = without_memory(state.problem, state.root, own)
    if climbs is None or not asked_for(state.problem, climbs, own):
        return None
    tail = judged(state.problem, climbs, replace(own, effects=(*own.effects, MEMORY)), MEMORY)
    fall = climbs.fitted.cost - own.fitted.cost
    gain, z = gain_and_z(climbs.unseen, own.unseen)
    item = ScreenedCandidate(MEMORY, own.fitted, fall, gain, z, evenly=evenly(climbs.unseen, own.unseen))
    stopped = state.evidence.stopped_by(state.problem, climbs, item)
    return climbs if tail.named and not stopped and state.worth_having(tail, climbs) else None


def _needed_beside(state: SearchState, own: ModelFit, chosen: FittedCandidate) -> bool:
    """Whether effects explain most of what another law of presliding leaves: that law explains the rest of all."""
    alone = judged(state.problem, own, chosen.model_fit, chosen.effect)
    return not state.evidence.repeats or alone.share >= state.problem.policy.partly
