"""Which effects: forward, one beside the other, as long as each is worth it, then backward.

The order of a search's steps: laws of the base first, then round by round (`rounds`) an effect that is settled
(`settling`), and backward what the others do not need; last, what stands beside a presliding of its own.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields, replace

from autotune.core.time_limit import TimeIsUp, limited
from autotune.diagnosis.backward import Backward
from autotune.diagnosis.base_laws import BASE_LAWS, CLIMB_LAW, BaseLaw, has_other_law, with_base_shapes
from autotune.diagnosis.candidates import (
    FittedCandidate,
    Progress,
    ScreenedCandidate,
    asked_for,
    error_left,
    exchanged_for,
    explained_of_rest,
    gain_on_veto,
    not_refuted,
)
from autotune.diagnosis.contact_laws import EFFECT as MEMORY
from autotune.diagnosis.contact_laws import (
    climbs_otherwise,
    remembers_beyond,
    with_own_presliding,
    without_memory,
)
from autotune.diagnosis.evidence import evidence_of
from autotune.diagnosis.evidence.torque_path import (
    CLEARLY_LESS,
    CYCLES,
    cycles_in_place,
    dead_time_in_place,
    lag_in_loop,
    sees_late,
)
from autotune.diagnosis.free_shape import like_a_motor
from autotune.diagnosis.refits import (
    REFINED,
    in_place_of,
    inside_twin,
    judged,
    judged_again,
    refined,
    settled_in,
    taken_out,
    unsettled,
    with_contact,
    with_noise_of,
    without_effect,
)
from autotune.diagnosis.rounds import best_in_haste, next_best, one_round, otherwise
from autotune.diagnosis.screening import (
    at_its_best,
    generic_gains,
    rows_back,
)
from autotune.diagnosis.search_state import Found, SearchState
from autotune.diagnosis.settling import led_from_elsewhere, take
from autotune.diagnosis.transmission import (
    plainer_of,
    spring_in_place,
    with_springs,
)
from autotune.estimation.bias_corrected_fit import LEVEL_GROUND, ModelFit, fit_inside_twin, held_out_of
from autotune.estimation.cross_validation import (
    beyond_presliding,
    evenly,
    gain_and_z,
    goes_with_place,
)
from autotune.estimation.data import TRAINING
from autotune.estimation.problem import Problem
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.table import EFFECTS, usual_rivals
from autotune.models.torque_lag import TORQUE_LAG
from autotune.models.torque_saturation import TORQUE_SATURATION

LAG, MOTOR = TORQUE_LAG.name, TORQUE_SATURATION.name
MOST_EFFECTS = 3
"""Effects that are added."""


def search(
    problem: Problem,
    root: ModelFit,
    nominal: Packed,
    progress: Progress,
    may_begin_again: bool = False,
    beside: ModelFit | None = None,
    until: float = math.inf,
) -> Found:
    """Adds the best candidate until nothing more is found, and drops what is not needed beside the others.

    Where the base turns out to have another law, a search that `may_begin_again` ends there: how torque and motion
    belong together, and how the twin is shaken, were found with another base. `beside`: what it was found beside then.
    After the deadline `until` it ends with what was found so far.
    """
    evidence = evidence_of(problem.data)
    state = SearchState(problem, root, nominal, progress, evidence, may_begin_again, beside=beside)
    state.keep()
    try:
        with limited(until):
            return _found(state)
    except TimeIsUp:
        return _found_so_far(state.kept or state)


def _found_so_far(state: SearchState) -> Found:
    """What a search has found whose time is up.

    Of several effects those that the others do not need are dropped still, and a memory is none that may be the base's
    own presliding: a name that is wrong is worse than a few seconds. What is left is refined no more.
    """
    if state.chosen is None and (state.first or state.beside is not None):
        state.chosen = best_in_haste(state)
    if state.chosen is not None and len(state.chosen.model_fit.effects) > 1:
        needed = _backward(state).pruned(state.chosen, state.seen)
        state.chosen = _backward(state).without_stiff_load(needed)
    chosen = state.chosen
    if chosen is not None and MEMORY in chosen.model_fit.effects:
        own = with_own_presliding(state.problem, state.root, chosen.model_fit)
        state.chosen = chosen if own is None else None
    return replace(_in_state(state), cut_short=True)


def _in_state(state: SearchState) -> Found:
    """What a search holds."""
    seen = (state.problem, state.root, state.chosen, state.first, state.tried, state.generic)
    return Found(*seen, unloaded=state.unloaded)


def _found(state: SearchState) -> Found:
    """All steps, one after the other."""
    _shape_base(state)
    state.problem, state.root = rows_back(
        state.problem, state.evidence, state.root, state.nominal, state.progress
    )
    _seek(state)
    led, state.law_first = state.law_first, True  # asked so far
    if state.begin_again is None and _other_law_beside(state):
        _seek(state)
    elif state.begin_again is None and led:
        _seek_on(state)
    if state.begin_again is None:
        _seek_memory_in_the_climb(state)
    if state.begin_again is not None:
        anew = Found(state.problem, state.root, None, (), (), {}, begin_again=state.begin_again)
        return replace(anew, beside=state.beside)
    led_from_elsewhere(state)
    _tidy(state)
    state.keep()
    if _loaded_by_the_loop(state):
        _seek_on(state)
        _tidy(state)
    if _lags_after_all(state):
        _seek_on(state)
        _tidy(state)
    if _is_dead_time(state):
        _seek(state)
        _tidy(state)
    _without_chains_lag(state)
    if state.chosen is not None:
        state.chosen, state.unloaded = _backward(state).without_doubtful_load(state.chosen, state.first)
    _drop_laws(state)
    _try_look_alikes(state)
    _try_motor(state)
    exchanged = _in_place(state)
    found = replace(_in_state(state), exchanged=exchanged)
    lagging = state.chosen is not None and LAG in state.chosen.model_fit.effects
    found = replace(found, delayed=lagging and state.delayed)
    found = _where_it_slides(state, _beside_own_presliding(state, found))
    if found.chosen is None:
        return found
    return _or_a_spring(state, found, found.chosen)


def _or_a_spring(state: SearchState, found: Found, chosen: FittedCandidate) -> Found:
    """The same with a spring where what was chosen has hardly a gap: in its place, and in what may stand for others
    beside it, or kept to be compared with.
    """
    known = found.problem, found.root, state.nominal
    spring = spring_in_place(*known, chosen, state.seen)
    if spring is None or plainer_of(found.problem, chosen, spring) is not spring:
        return replace(found, spring=spring)
    if len(spring.model_fit.effects) > 1:
        exchanged = with_springs(*known, found.exchanged, state.seen)
        return replace(found, chosen=spring, exchanged=exchanged)
    given_up = {chosen.effect, spring.effect}
    tried = [one for one in found.tried if one.effect not in given_up]
    return replace(found, chosen=spring, tried=[*tried, spring])


def _seek(state: SearchState) -> None:
    """Adds effects to the root, one beside the other, as long as they explain enough."""
    state.chosen, state.first, state.tried, state.generic = None, (), (), {}
    state.seen, state.later = [], []
    state.keep()
    _seek_on(state)


def _seek_on(state: SearchState) -> None:
    """Adds effects beside what is chosen already; another course of one of them is none."""
    left = MOST_EFFECTS - (len(state.chosen.model_fit.effects) if state.chosen is not None else 0)
    while left > 0:
        if state.chosen is not None and state.chosen.named and not state.more_to_explain(state.model_fit):
            break
        _drop_laws(state, only_where_less_is_left=True)
        best = next_best(state, first=state.chosen is None)
        if best is None:
            break
        state.keep(best)
        if not _shaped_instead(state, best):
            take(state, best)
            left -= 1
        state.keep()


def _shaped_instead(state: SearchState, further: FittedCandidate) -> bool:
    """Whether the one effect of a lone recording by another course of its own predicts better than with a further one.

    Then it has that course, and what is left is looked for anew. Without repeats nothing tells how much an effect
    should explain, so that its own law is never left for that; and what the law leaves takes a name of its own. One
    that looks like it (a weight beside a spring that hardens) must predict clearly better than the course.
    """
    chosen = state.chosen
    if state.evidence.repeats or chosen is None or len(chosen.model_fit.effects) > 1 or chosen.freed:
        return False
    shaped = state.shaped(chosen)
    if shaped is None or _predicts_more(state, shaped, further):
        return False
    state.chosen = shaped
    state.seen.append(shaped.model_fit)
    return True


def _predicts_more(state: SearchState, shaped: FittedCandidate, further: FittedCandidate) -> bool:
    """Whether a further effect leaves no more of unseen stretches than a course; one that looks alike clearly less."""
    gain, z = gain_and_z(shaped.model_fit.unseen, further.model_fit.unseen)
    if further.effect not in usual_rivals(shaped.effect):
        return gain >= 0.0
    return gain >= state.problem.policy.clear_gain and z >= state.problem.policy.least_z_single


def _shape_base(state: SearchState) -> None:
    """What textbooks have in the base may have another shape there: that is asked before anything else."""
    if not state.more_to_explain(state.root):
        return
    shaped = state.borne_out(with_base_shapes(state.problem, state.root, state.nominal))
    if shaped is not None:
        state.progress("another law of the base")
        state.take_root(shaped)


def _other_law_beside(state: SearchState) -> bool:
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


def _seek_memory_in_the_climb(state: SearchState) -> None:
    """Effects looked for anew without the base's climb where elements go on beyond it, if that explains enough.

    Whether they do was asked when that law was told, and what was missing then hid it: a ripple is louder than the
    longest elements of a memory.
    """
    chosen = state.chosen
    if not state.evidence.repeats or chosen is None or chosen.named:
        return
    climbs = climbs_otherwise(state.root.fitted.packed)
    goes_on = climbs and remembers_beyond(state.problem, chosen.model_fit)
    bare = CLIMB_LAW.removed(state.problem, state.root) if goes_on else None
    if bare is None:
        return
    state.progress("memory in the place of a law of the base")
    before = replace(state)
    state.laws = [law for law in state.laws if law is not CLIMB_LAW]
    state.take_root(bare)
    _seek(state)
    if state.chosen is None or not state.chosen.named or MEMORY not in state.chosen.model_fit.effects:
        for one in fields(before):
            setattr(state, one.name, getattr(before, one.name))


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
    state.beside = after
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


def _try_look_alikes(state: SearchState) -> None:
    """Effects that may do as well as a single one that was found are fitted to their end, too.

    Where one trajectory is all there is, a candidate may have been passed over that explains it as well.
    """
    chosen = state.chosen
    if chosen is None or len(chosen.model_fit.effects) != 1:
        return
    for effect in state.evidence.look_alikes(state.problem, chosen.effect):
        state.progress(f"does {effect} do as well")
        item = at_its_best(state.problem, state.evidence, state.root, state.nominal, effect)
        fitted = inside_twin(state.problem, state.root, state.root, item) if item is not None else None
        if fitted is not None:
            fitted = with_contact(state.problem, state.root, fitted)
            better = [one for one in state.tried if one.effect == effect and one.gain > fitted.gain]
            if not better:
                state.tried = [*(one for one in state.tried if one.effect != effect), fitted]


def _try_motor(state: SearchState) -> None:
    """A motor that falls short in the place of friction that a load presses, if it leaves less; else a rival of it.

    It is followed to its end, its course as free, where a free course over the motor's torque does as well along the
    recorded motion. What the fastest experiment shows alone gains nothing while that is held out, so that nothing else
    may have followed it.
    """
    problem, chosen = state.problem, state.chosen
    sought = any(kind.name == MOTOR for kind in problem.candidates)
    if chosen is None or not sought or not state.evidence.repeats or MOTOR in chosen.model_fit.effects:
        return
    alike = state.evidence.alike(problem)
    pressed = [
        one
        for one in chosen.model_fit.effects
        if like_a_motor(problem, state.root, chosen.model_fit, alike, one)
    ]
    other = _motor_in_place(state, chosen, pressed[0]) if pressed else None
    if other is None:
        return
    better = other.named and error_left(problem, other.model_fit) < error_left(problem, chosen.model_fit)
    state.chosen = other if better else chosen
    if len(chosen.model_fit.effects) > 1:
        state.later.append(replace(chosen, effect=pressed[0]) if better else other)
    else:
        own = [one for one in state.tried if one.effect not in (chosen.effect, MOTOR)]
        state.tried = [*own, chosen, other]


def _motor_in_place(state: SearchState, chosen: FittedCandidate, effect: str) -> FittedCandidate | None:
    """A motor that falls short beside all effects but one, by its own law or a course; None where it does not fit."""
    state.progress(f"a motor that saturates in the place of {effect}")
    problem, root, before = state.problem, state.root, state.root
    if len(chosen.model_fit.effects) > 1:
        rest = without_effect(problem, root, chosen.model_fit, effect)
        if rest is None:
            return None
        before = rest.model_fit
    item = at_its_best(problem, state.evidence, before, state.nominal, MOTOR)
    other = inside_twin(problem, root, before, item) if item is not None else None
    if other is None:
        return None
    other = other.with_courses_of(chosen)
    other = state.shaped(other) or (
        refined(problem, root, other, state.progress) if unsettled(problem, other) else other
    )
    if problem.has_veto and other.gain < problem.policy.least_gain:
        other = replace(other, gain=gain_on_veto(problem, before, other.model_fit))
    return other


def _drop_laws(state: SearchState, only_where_less_is_left: bool = False) -> None:
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


def _loaded_by_the_loop(state: SearchState) -> bool:
    """Whether a second mass beside others made up for how the twin is shaken, controlled or late.

    That was asked before the others were found, and what they explain was in the way.
    """
    chosen = state.chosen
    if chosen is None or len(chosen.model_fit.effects) < 2 or not state.evidence.repeats:
        return False
    loads = [effect for effect in chosen.model_fit.effects if EFFECTS[effect].in_transmission]
    less = without_effect(state.problem, state.root, chosen.model_fit, loads[0]) if loads else None
    found = otherwise(state, less.model_fit, chosen.model_fit) if less is not None else None
    if less is None or found is None:
        return False
    before = state.problem
    bare = state.moved(found[0], replace(less, model_fit=found[1]).with_courses_of(chosen))
    if state.problem is before:
        return False
    state.chosen = bare
    return True


def _lags_after_all(state: SearchState) -> bool:
    """Whether a lag was taken for the way of recording: beside all that was found it is asked once more.

    It must explain beyond chance what the model as it is leaves, and as much of that as a name asks of all, on training
    and veto: a law of the drive that is a little off looks like a part of a lag. All must be named with it that was
    without it. What a loop's lag does comes again in every repeat: where nothing of that is left beyond doubt, it is
    not asked.
    """
    before, left = (state.problem, state.root, state.chosen, state.tried), state.model_fit
    asked = state.evidence.repeats and state.more_to_explain(left)
    found = lag_in_loop(state.problem, left) if asked else None
    if found is None or not state.evidence.apart(state.problem, found[1], left):
        return False
    parts = explained_of_rest(state.problem, left, found[1])
    if any(part.share < state.problem.policy.named for part in parts):
        return False
    state.progress("a lag of the loop, by another way of recording")
    problem, lagging = with_noise_of(*found)
    best = state.moved(problem, judged(problem, state.root, lagging, LAG).with_courses_of(state.chosen))
    if state.problem is before[0]:
        return False
    known = before[2] is not None and before[2].named
    if best.named or (before[2] is not None and not known):
        take(state, best)
        if not known or (state.chosen is not None and state.chosen.named):
            return True
    state.problem, state.root, state.chosen, state.tried = before
    return False


def _is_dead_time(state: SearchState) -> bool:
    """Whether what looks like a lag is a dead time of three rows at most: then the chain has it, and all begins anew.

    A lag is told from a delay by how it bends the torque. Beside all that was found, what errs less beyond chance is
    what it is. Where neither does, of a row or of three, the lag keeps its name and is not confirmed
    (`SearchState.delayed`).
    """
    chosen, apart = state.chosen, state.evidence.apart
    state.delayed = False
    if chosen is None or LAG not in chosen.model_fit.effects or not state.evidence.repeats:
        return False
    lags = chosen.model_fit
    for most in (1, max(CYCLES)):
        found = dead_time_in_place(state.problem, lags, most)
        if found is None:
            continue
        if apart(state.problem, found[1], lags):
            there = settled_in(found[0], state.root)
            if there is None:  # nothing can be begun anew from there
                state.delayed = True
                break
            state.progress("a dead time in the place of a lag")
            state.problem, state.root = with_noise_of(*there)
            return True
        state.delayed = state.delayed or not apart(state.problem, lags, found[1])
        if state.delayed:
            break
    return False


def _without_chains_lag(state: SearchState) -> None:
    """Beside other effects a lag is needed only where the chain, asked again beside them, cannot be what is late.

    It was asked while they were missing, and what they explain may have bent the lag's way.
    """
    chosen = state.chosen
    if chosen is None or len(chosen.model_fit.effects) < 2 or LAG not in chosen.model_fit.effects:
        return
    if _cycles_do(state, chosen):
        return
    less = without_effect(state.problem, state.root, chosen.model_fit, LAG)
    again = state.evidence.aligned(state.problem, less.model_fit) if less is not None else state.problem
    if less is None or again is state.problem:
        return
    before = state.problem, state.root, state.tried
    bare, least = (
        state.moved(again, less.with_courses_of(chosen)),
        LEVEL_GROUND * chosen.model_fit.fitted.cost,
    )
    if state.problem is not before[0] and bare.model_fit.fitted.cost <= least:
        state.chosen = bare
    else:
        state.problem, state.root, state.tried = before


def _cycles_do(state: SearchState, chosen: FittedCandidate) -> bool:
    """Whether whole cycles leave as little in the place of the chosen lag, in the twin: then they are taken."""
    least = (CLEARLY_LESS if sees_late(state.problem) else LEVEL_GROUND) * chosen.model_fit.fitted.cost
    found = cycles_in_place(state.problem, chosen.model_fit) if state.problem.twin else []
    again, bare = min(found, key=lambda one: one[1].fitted.cost, default=(state.problem, chosen.model_fit))
    if again is state.problem or bare.fitted.cost > least:
        return False
    state.progress("whole cycles in the place of a lag")
    leads, before = chosen.effect if chosen.effect in bare.effects else bare.effects[-1], state.problem
    moved = state.moved(again, judged(again, state.root, bare, leads).with_courses_of(chosen))
    if state.problem is before:
        return False
    state.chosen = moved
    return True


def _beside_own_presliding(state: SearchState, found: Found) -> Found:
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
    found = replace(
        found,
        root=own,
        chosen=beside,
        first=[item for item in state.first if item.effect != MEMORY],
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
        _tidy(again)
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


def _where_it_slides(state: SearchState, found: Found) -> Found:
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


def _backward(state: SearchState) -> Backward:
    return Backward(state.problem, state.root, state.evidence, state.progress)


def _tidy(state: SearchState) -> None:
    """Drops what is not needed beside the others, and refines what is left."""
    if state.chosen is not None:
        state.chosen = _backward(state).tidied(state.chosen, state.seen)
        state.chosen = _backward(state).without_stiff_load(state.chosen)


def _in_place(state: SearchState) -> list[FittedCandidate]:
    """What may stand for one of several effects, each at its best.

    What the chosen ones explain of the error of another may be no more than its course: beside others it was judged by
    its own law, while theirs are free. With a free course it is chosen where it leaves less, and what was chosen may
    stand for it.
    """
    if state.chosen is None:
        return []
    chosen, again = state.chosen, []
    for item in _backward(state).exchanged(chosen, state.later, _like_the_first(state, chosen)):
        lost = set(chosen.model_fit.effects) - set(item.model_fit.effects)
        if len(lost) == 1 and state.evidence.explains_rest_of(state.problem, chosen, item):
            shaped = state.shaped(item)
            if shaped is not None and shaped.named and _leaves_less(state, shaped, chosen):
                chosen, item = shaped, replace(chosen, effect=lost.pop())
        again.append(item)
    state.chosen = chosen
    return again


def _like_the_first(state: SearchState, chosen: FittedCandidate) -> list[FittedCandidate]:
    """What looks like the first of several effects, and came near it while the others were missing.

    A weight over a part of a turn stays the rival of a spring when a drift is found beside it.
    """
    first, policy = chosen.model_fit.effects[0], state.problem.policy
    known = next((one for one in state.tried if one.effect == first), None)
    if known is None or len(chosen.model_fit.effects) < 2:
        return []
    alike = set(usual_rivals(first)) - set(chosen.model_fit.effects)
    least = policy.rival_gain * known.gain
    return [one for one in state.tried if one.effect in alike and one.gain >= least]


def _leaves_less(state: SearchState, one: FittedCandidate, other: FittedCandidate) -> bool:
    return error_left(state.problem, one.model_fit) < error_left(state.problem, other.model_fit)
