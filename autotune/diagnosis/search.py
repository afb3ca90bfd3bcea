"""Which effects: forward, one beside the other, as long as each is worth it, then backward.

The order of a search's steps: laws of the base first, then round by round (`rounds`) an effect that is settled
(`settling`), and backward what the others do not need (`backward`); last, what stands beside a presliding of its own
(`base_beside`). Between them the steps that ask whether the way of recording is what was found: a lag, whole cycles.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace

from autotune.core.time_limit import TimeIsUp, check_time, limited, while_time
from autotune.diagnosis.backward import backward_of, in_place, tidy, try_look_alikes, try_motor
from autotune.diagnosis.base_beside import drop_laws, other_law_beside, shape_base
from autotune.diagnosis.base_laws import CLIMB_LAW
from autotune.diagnosis.candidates import (
    FittedCandidate,
    Progress,
    ScreenedCandidate,
    explained_of_rest,
)
from autotune.diagnosis.contact_laws import EFFECT as MEMORY
from autotune.diagnosis.contact_laws import (
    climbs_otherwise,
    is_a_memory,
    with_own_presliding,
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
from autotune.diagnosis.own_presliding import beside_own_presliding, where_it_slides
from autotune.diagnosis.refits import (
    judged,
    settled_in,
    with_noise_of,
    without_effect,
)
from autotune.diagnosis.rounds import MOST_EFFECTS, best_in_haste, next_best, otherwise
from autotune.diagnosis.screening import (
    rows_back,
    screen,
)
from autotune.diagnosis.search_state import Found, SearchState
from autotune.diagnosis.settling import led_from_elsewhere, take
from autotune.diagnosis.transmission import (
    plainer_of,
    spring_in_place,
    with_springs,
)
from autotune.estimation.bias_corrected_fit import LEVEL_GROUND, ModelFit
from autotune.estimation.cross_validation import (
    gain_and_z,
)
from autotune.estimation.problem import Problem
from autotune.models.drive_model import Packed
from autotune.models.table import EFFECTS, usual_rivals
from autotune.models.torque_lag import TORQUE_LAG

LAG = TORQUE_LAG.name


def search(
    problem: Problem,
    root: ModelFit,
    nominal: Packed,
    progress: Progress,
    may_begin_again: bool = False,
    beside: FittedCandidate | None = None,
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
            found = _found(state)
            if found.begin_again is not None:
                check_time()
            return found
    except TimeIsUp:
        if state.begin_again is not None:  # what was seen before is of another base
            anew = replace(state, chosen=None, first=(), tried=(), generic={})
            return _found_so_far(anew)
        return _found_so_far(state.kept or state)


def _found_so_far(state: SearchState) -> Found:
    """What a search has found whose time is up.

    Of several effects those that the others do not need are dropped still, and a memory is none that may be the base's
    own presliding: a name that is wrong is worse than a few seconds. What is left is refined no more.
    """
    if state.chosen is None and (state.first or state.beside is not None):
        state.chosen = best_in_haste(state)
    if state.chosen is not None and len(state.chosen.model_fit.effects) > 1:
        needed = backward_of(state).pruned(state.chosen, state.seen)
        state.chosen = backward_of(state).without_stiff_load(needed)
    chosen = state.chosen
    if chosen is not None and MEMORY in chosen.model_fit.effects:
        own = with_own_presliding(state.problem, state.root, chosen.model_fit)
        state.chosen = chosen if own is None else None
    return replace(_in_state(state), cut_short=True)


def _in_state(state: SearchState) -> Found:
    """What a search holds."""
    seen = (state.problem, state.root, state.chosen, state.first, state.tried, state.generic)
    return Found(*seen, unloaded=state.unloaded, later=state.later)


def _found(state: SearchState) -> Found:
    """All steps, one after the other."""
    shape_base(state)
    state.problem, state.root = rows_back(
        state.problem, state.evidence, state.root, state.nominal, state.progress
    )
    _seek(state)
    led, state.law_first = state.law_first, True  # asked so far
    if state.begin_again is None and other_law_beside(state):
        _seek(state)
    elif state.begin_again is None and led:
        _seek_on(state)
    if state.begin_again is None:
        _seek_memory_in_the_climb(state)
    if state.begin_again is not None:
        anew = Found(state.problem, state.root, None, (), (), {}, begin_again=state.begin_again)
        return replace(anew, beside=state.beside)
    led_from_elsewhere(state)
    tidy(state)
    state.keep()
    if _loaded_by_the_loop(state):
        _seek_on(state)
        tidy(state)
    if _lags_after_all(state):
        _seek_on(state)
        tidy(state)
    if _is_dead_time(state):
        _seek(state)
        tidy(state)
    _without_chains_lag(state)
    if state.chosen is not None:
        state.chosen, state.unloaded = backward_of(state).without_doubtful_load(state.chosen, state.first)
    drop_laws(state)
    try_look_alikes(state)
    try_motor(state)
    exchanged = in_place(state)
    found = replace(_in_state(state), exchanged=exchanged)
    lagging = state.chosen is not None and LAG in state.chosen.model_fit.effects
    found = replace(found, delayed=lagging and state.delayed)
    found = where_it_slides(state, beside_own_presliding(state, found))
    if found.chosen is None or not state.evidence.accepts(state.problem.policy, found.chosen):
        found = replace(found, without_twin=_without_twin(state, found))
    return found if found.chosen is None else _or_a_spring(state, found, found.chosen)


def _without_twin(state: SearchState, found: Found) -> list[ScreenedCandidate]:
    """Second masses by what they gain beyond chance on the measured motion, where there is no twin to name them by.

    A loop or a memory may look like a spring or a gap there, so that it is no name; but an axis that lacks nothing has
    none that halves its error.
    """
    problem, root, evidence = found.problem, found.root, state.evidence
    if problem.twin or problem.data.steady:
        return []
    asked = evidence.candidates(problem)
    unasked = [kind for kind in problem.candidates if kind.in_transmission and kind not in asked]
    if not unasked:
        return []
    state.progress("what only a twin could tell")

    def screened() -> list[ScreenedCandidate]:
        found = (screen(problem, evidence, root, state.nominal, kind.name) for kind in unasked)
        return [item for item in found if item is not None and item.z >= problem.policy.least_z_single]

    return while_time(screened, [])


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
    left = MOST_EFFECTS - _count(state.chosen)
    while left > 0:
        if state.chosen is not None and state.chosen.named and not state.more_to_explain(state.model_fit):
            break
        drop_laws(state, only_where_less_is_left=True)
        best = next_best(state, first=state.chosen is None)
        if best is None:
            break
        state.keep(best)
        if not _shaped_instead(state, best):
            left -= max(_count(best) - _count(state.chosen), 1)
            take(state, best)
        state.keep()


def _count(chosen: FittedCandidate | None) -> int:
    """How many effects a model that was found has; 0 where there is none."""
    return len(chosen.model_fit.effects) if chosen is not None else 0


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


def _seek_memory_in_the_climb(state: SearchState) -> None:
    """Effects looked for anew without the base's climb where elements go on beyond it, if that explains enough.

    Whether they do was asked when that law was told, and what was missing then hid it: a ripple is louder than the
    longest elements of a memory.
    """
    chosen = state.chosen
    if not state.evidence.repeats or chosen is None or chosen.named:
        return
    # without the effect the root's contact may be just off what makes it one
    climbs = any(climbs_otherwise(one.fitted.packed) for one in (state.root, chosen.model_fit))
    goes_on = climbs and is_a_memory(state.problem, chosen.model_fit)
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
