"""A candidate that was taken, settled: the problem made as it is beside it, and the candidate led to its best.

What it explained was in the way of how loud the disturbance is, how torque and motion belong together, and how late the
loop is: each is told again beside it, and the fit led on from there; last its course is freed where its law leaves a
part unexplained. Whatever leaves more than before is undone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from autotune.diagnosis.candidates import (
    FittedCandidate,
    error_left,
    predicts_better,
)
from autotune.diagnosis.evidence.time_driven import without_clocked, without_reading_waves, without_wander
from autotune.diagnosis.evidence.torque_path import (
    is_recorded_late,
    late_anew,
    recorded_late,
    recorded_otherwise,
    without_long_lag,
)
from autotune.diagnosis.free_shape import rather_a_spring, with_free_shape, without_own_course
from autotune.diagnosis.refits import (
    REFINED,
    a_row_otherwise,
    in_place_of,
    in_quieter_twin,
    inside_twin,
    refined,
    settled_in,
    unsettled,
    with_contact,
    with_own_noise,
    without_effect,
)
from autotune.diagnosis.screening import (
    screen,
)
from autotune.diagnosis.search_state import SearchState
from autotune.diagnosis.transmission import (
    masses_led_on,
    masses_scattered,
    other_contact_tried,
    other_spring_tried,
    other_transmission_tried,
)
from autotune.estimation.bias_corrected_fit import LEVEL_GROUND, fit_inside_twin
from autotune.estimation.model_error import told_beside
from autotune.models.spring import SPRING
from autotune.models.table import EFFECTS, usual_rivals
from autotune.models.torque_lag import IS_LATE
from autotune.models.transmission import has_load

TIMES_SCATTERED, WORTH_SCATTERING = 3, 0.95
"""Times that a model with two masses is fitted from places around where it stopped, at most; and of what comes again,
the part that the last may leave of the one before it for the next."""


def take(state: SearchState, best: FittedCandidate) -> FittedCandidate:
    """Makes it the chosen model, at its best."""
    best = other_transmission_tried(
        state.problem, state.root, state.nominal, best, state.seen, state.progress
    )
    if state.evidence.repeats:
        state.problem, best = with_own_noise(state.problem, state.root, best)
    for steadied in (without_wander, without_clocked):
        fitted = best.model_fit.fitted
        clockless = steadied(state.problem, fitted.packed, fitted.error)
        if clockless is not None:
            best = state.moved(clockless, best)
    true = without_reading_waves(state.problem, best.model_fit)
    if true is not None:
        best = state.moved(true, best)
    best = _recorded_late(state, _recorded_otherwise(state, _aligned(state, best)))
    if not state.evidence.repeats:
        best = with_contact(state.problem, state.root, best)
    if state.evidence.repeats and unsettled(state.problem, best):
        best = _a_row_beside(state, best)
        best = _shaken_less(state, best)
        best = refined(state.problem, state.root, best, state.progress)
        best = _begun_anew(state, best)
        if unsettled(state.problem, best):
            best = masses_led_on(state.problem, state.root, best, state.progress)
        best = _or_other_transmission(state, best)
        if best.share < REFINED:
            best = other_contact_tried(state.problem, state.root, best, state.progress)
        best = _late_beside(state, _told_beside(state, best))
    elif state.evidence.repeats and state.more_to_explain(best.model_fit):
        best = _told_beside(state, best)
    if state.evidence.repeats:
        best = _other_spring(state, best)
    if state.evidence.repeats and (best.plain_share < REFINED or state.more_to_explain(best.model_fit)):
        best = _freed(state, best)
    best = spring_as_well(state, best)
    if state.chosen is not None and state.evidence.repeats and state.more_to_explain(best.model_fit):
        best = _first_exchanged(state, best)
    state.chosen = best
    state.seen.append(best.model_fit)
    return best


def led_from_elsewhere(state: SearchState) -> None:
    """What was chosen, where it has two masses and no name: fitted from places around it, as long as that helps.

    Once nothing more is found beside it: before that, what it leaves is most of all another effect. Where it helps the
    law of its spring and the courses of the others are told anew, as the fit that stopped short hid them.
    """
    begun = state.chosen
    if begun is None or not state.evidence.repeats:
        return
    best = begun
    for _ in range(TIMES_SCATTERED):
        if best.named or best.training.share < state.problem.policy.partly:
            break
        before = best.training
        best = masses_scattered(state.problem, state.root, best, state.progress)
        if best.training.left > WORTH_SCATTERING * before.left:
            break
    if best is begun:
        return
    if not best.named:
        best = _others_freed(state, _other_spring(state, best))
    state.chosen = best
    state.seen.append(best.model_fit)


def _or_other_transmission(state: SearchState, best: FittedCandidate) -> FittedCandidate:
    """The best transmission, or the other one led on as it was, where that leaves less of what comes again.

    After the few steps by which a round compares them both stop short, and what they leave does not tell which of them
    is on its way: a gap with a damped contact explained 70 % beside a spring's 78 %, and 93 % when it was led on.
    """
    if best.named or not state.problem.twin or not _is_transmission(best):
        return best
    rival = next((one for one in state.tried if one.effect != best.effect and _is_transmission(one)), None)
    if rival is None or not unsettled(state.problem, rival):
        return best
    other = refined(state.problem, state.root, rival, state.progress)
    other = masses_led_on(state.problem, state.root, other, state.progress)
    state.tried = [other if one is rival else one for one in state.tried]
    return other if other.training.left < best.training.left else best


def _is_transmission(candidate: FittedCandidate) -> bool:
    """Whether it is one, and nothing beside it."""
    return len(candidate.model_fit.effects) == 1 and EFFECTS[candidate.effect].in_transmission


def _other_spring(state: SearchState, best: FittedCandidate) -> FittedCandidate:
    """The best candidate with a spring by another law where that does better, led on from there.

    Where a gap does better, that spring is the one that it is compared with: each effect at its best.
    """
    gains = {item.effect: item.gain for item in state.first}
    other, behind = other_spring_tried(
        state.problem, state.root, state.nominal, best, gains, state.seen, state.progress
    )
    if behind is not None:
        state.seen.append(behind.model_fit)
        known = [one for one in state.tried if one.model_fit.effects == behind.model_fit.effects]
        left = error_left(state.problem, behind.model_fit)
        if all(left < error_left(state.problem, one.model_fit) for one in known):
            state.tried = [
                *(one for one in state.tried if one.model_fit.effects != behind.model_fit.effects),
                behind,
            ]
    return best if other is best else refined(state.problem, state.root, other, state.progress)


def _a_row_beside(state: SearchState, best: FittedCandidate) -> FittedCandidate:
    """The best candidate with two masses in a loop a row sooner or later, where that leaves clearly less.

    In which row a torque was recorded tells how late a loop is by a row; one mass hardly moves otherwise in a loop as
    late as that, but motor and load ring in it, or hunt.
    """
    problem, model_fit = state.problem, best.model_fit
    if not problem.twin or not problem.two_masses(model_fit.fitted.packed):
        return best
    packed, free = model_fit.fitted.packed, list(model_fit.free)
    least = problem.policy.clearly_less * model_fit.fitted.cost
    found = [
        (again, fit_inside_twin(again, packed, free, 2, model_fit.effects))
        for again in a_row_otherwise(problem)
    ]
    there = [(again, one) for again, one in found if one is not None and one.fitted.cost < least]
    if not there:
        return best
    state.progress("a loop a row sooner or later")
    again, settled = min(there, key=lambda one: one[1].fitted.cost)
    return _kept(state, best, least, lambda: state.moved(again, replace(best, model_fit=settled)))


def _shaken_less(state: SearchState, best: FittedCandidate) -> FittedCandidate:
    """The best candidate in twins that are shaken less, where these leave clearly less; led on, and as loud again.

    What it leaves is the least that is to be had then, and tells how much the axis is shaken.
    """
    before = state.problem
    state.problem, best = in_quieter_twin(before, state.root, best)
    if state.problem is before:
        return best
    state.progress("twins that are shaken less")
    best = masses_led_on(state.problem, state.root, best, state.progress)
    state.problem, best = with_own_noise(state.problem, state.root, best)
    return best


def _told_beside(state: SearchState, best: FittedCandidate) -> FittedCandidate:
    """The best candidate beside the law that is told by it, where it leaves less so."""
    again = told_beside(state.problem, best.model_fit.fitted, state.root.fitted.packed)
    if again is state.problem:
        return best
    state.progress("another law of the controller")

    def moved() -> FittedCandidate:
        less = _shaken_less(state, state.moved(again, best))
        return refined(state.problem, state.root, less, state.progress)

    return _kept(state, best, best.model_fit.fitted.cost, moved)


def _late_beside(state: SearchState, best: FittedCandidate) -> FittedCandidate:
    """The best candidate in a loop that is as late as it is found to be beside it, where that leaves clearly less.

    A second mass moves in the twin, and how late its loop is rules what it does there.
    """
    loaded = state.problem.twin and state.problem.two_masses(best.model_fit.fitted.packed)
    found = late_anew(state.problem, best.model_fit) if loaded and best.share < REFINED else None
    least = state.problem.policy.clearly_less * best.model_fit.fitted.cost
    if found is None or found[1].fitted.cost >= least:
        return best
    state.progress("how late the loop is, anew")
    late, settled = found

    def moved() -> FittedCandidate:
        there = state.moved(without_long_lag(late, settled), replace(best, model_fit=settled))
        return refined(state.problem, state.root, there, state.progress)

    return _kept(state, best, least, moved)


def _kept(
    state: SearchState, best: FittedCandidate, least: float, moved: Callable[[], FittedCandidate]
) -> FittedCandidate:
    """What the best candidate becomes where it is `moved` to; it, and the search, as they were unless it costs less
    than `least` there. What could not be moved (`SearchState.moved`) is a fit to another problem.
    """
    before = state.problem, state.root, state.tried
    there = moved()
    if there.model_fit.fitted.cost < least and state.problem is not before[0]:
        return there
    state.problem, state.root, state.tried = before
    return best


def _aligned(state: SearchState, best: FittedCandidate) -> FittedCandidate:
    """The best candidate with torque and motion aligned by it; as it was where the twin then leaves more.

    Beside a lag of the loop a shift takes what the lag's law has too much or too little along the measured motion:
    but rows that were written late delay no loop, and twins tell the one from the other. Where its name is lost so, its
    course may do better than the shift.
    """
    again = state.evidence.aligned(state.problem, best.model_fit)
    if again is state.problem:
        return best
    before = problem, root, _ = state.problem, state.root, state.tried
    moved = state.moved(again, best)
    left, least = moved.model_fit.fitted.cost, LEVEL_GROUND * best.model_fit.fitted.cost
    if again.twin and left <= least and best.named and not moved.named:
        course = with_free_shape(problem, root, state.nominal, best)
        least = least if course is None else min(least, course.model_fit.fitted.cost)
    if not again.twin or left <= least:
        return moved
    state.problem, state.root, state.tried = before
    return best


def _recorded_otherwise(state: SearchState, best: FittedCandidate) -> FittedCandidate:
    """The best candidate with its torque recorded in another way, where that leaves clearly less beside it.

    How late the torque acts may be known only since the candidate is: ways are told anew by that.
    """
    found = recorded_otherwise(state.problem, best.model_fit) if state.evidence.repeats else None
    if found is None:
        return best
    state.progress("another way of recording")
    again, settled = found
    least = best.model_fit.fitted.cost
    return _kept(state, best, least, lambda: state.moved(again, replace(best, model_fit=settled)))


def _recorded_late(state: SearchState, best: FittedCandidate) -> FittedCandidate:
    """The best candidate with its torque taken as recorded a sample late, where that is told beside it.

    It was asked beside a model that lacked the candidate, and what was missing left as much in either loop. A lag in
    the loop undoes a row that is taken so.
    """
    problem, law, model_fit = state.problem, state.problem.controller, best.model_fit
    exact = law is not None and law.exact and not model_fit.fitted.packed.on[IS_LATE]
    if not exact or not state.evidence.repeats or not state.more_to_explain(model_fit):
        return best
    sooner = recorded_late(problem)
    there = settled_in(sooner, model_fit) if sooner is not None else None
    if there is None or not is_recorded_late(problem, model_fit.fitted, there[0], there[1].fitted):
        return best
    state.progress("a torque that was recorded a sample late")
    again, settled = there

    def moved() -> FittedCandidate:
        late = state.moved(again, replace(best, model_fit=settled))
        state.problem, late = with_own_noise(state.problem, state.root, late)
        return late

    return _kept(state, best, model_fit.fitted.cost, moved)


def _freed(state: SearchState, chosen: FittedCandidate) -> FittedCandidate:
    """The model with the course of its last effect free, where its own law leaves a part unexplained.

    Others that came near it get the same chance: what is compared is each effect at its best, here and where it is a
    rival later. Of two that leave as little the one that can be named is taken.
    """
    best = state.shaped(chosen) or chosen
    if state.chosen is not None:
        return _others_freed(state, best)
    for item in [one for one in state.tried if _contends(state, chosen, one, best is not chosen)]:
        shaped = state.shaped(item)
        if shaped is None or state.evidence.only_at_rests(state.problem, state.root, shaped):
            continue
        state.tried = [shaped if one is item else one for one in state.tried]
        level = LEVEL_GROUND if shaped.named and not best.named else 1.0
        if error_left(state.problem, shaped.model_fit) < level * error_left(state.problem, best.model_fit):
            state.tried = [best if one.effect == best.effect else one for one in state.tried]
            best = shaped
    return best


def _others_freed(state: SearchState, chosen: FittedCandidate) -> FittedCandidate:
    """The same with the courses of those before it free, while they have no name together, or leave more beyond doubt.

    By itself none of them explained enough to tell its course, or what was missing hid it. A course that costs the name
    is not taken.
    """
    for effect in chosen.model_fit.effects:
        if chosen.named and not (state.evidence.repeats and state.more_to_explain(chosen.model_fit)):
            break
        if effect == chosen.effect or effect in chosen.freed:
            continue
        shaped = state.shaped(replace(chosen, effect=effect))
        if shaped is not None and (shaped.named or not chosen.named):
            chosen = replace(shaped, effect=chosen.effect)
    return chosen


def spring_as_well(state: SearchState, best: FittedCandidate) -> FittedCandidate:
    """The spring in the place of a weight that turns too little to show its wave, where it does as well.

    Each at its best: by its own law a spring is a straight line, and what hardens, gives way or is met on the way is
    one that a wave of free phase comes nearer to. With its course free it comes near to most waves in turn; so it is
    taken only where a spring of no more coefficients than the wave is likelier. The weight stays its rival. Only data
    that repeat tell so little apart: of one trajectory a law that is not quite the axis's errs by more, and the spring
    must predict better.
    """
    problem, root = state.problem, state.root
    if len(best.model_fit.effects) > 1 or best.effect not in without_own_course(problem, best.model_fit):
        return best
    straight = _pulling(state)
    if straight is None or straight.training.share < problem.policy.partly:
        return best
    if not rather_a_spring(problem, root, best.model_fit):
        return best
    spring = state.shaped(straight) or straight
    predicts = state.evidence.repeats or predicts_better(problem, best.model_fit, spring.model_fit)
    left = [error_left(problem, one.model_fit) for one in (spring, best)]
    if not predicts or (left[0] >= left[1] and not state.evidence.comes_near(problem, root, best, spring)):
        return best
    others = [one for one in state.tried if one.effect not in (spring.effect, best.effect)]
    state.tried = [*others, best, spring]
    return spring


def _pulling(state: SearchState) -> FittedCandidate | None:
    """The spring of the first round, by its own law inside the twin; None where it was no candidate."""
    found = next((one for one in state.tried if one.effect == SPRING.name), None)
    if found is not None:
        return found
    screened = next((one for one in state.first if one.effect == SPRING.name), None)
    return None if screened is None else inside_twin(state.problem, state.root, state.root, screened)


def _first_exchanged(state: SearchState, chosen: FittedCandidate) -> FittedCandidate:
    """The model with a rival of its first effect in the place of that, each with its own course, if it leaves less.

    The first was found while the others were missing, and what they explain may have been why it led: a weight for
    a buffer that is met on the way, beside contacts that age. A gap holds a spring, and leaves no more than it.
    """
    policy, first = state.problem.policy, chosen.model_fit.effects[0]
    known = next((item for item in state.tried if item.effect == first), None)
    if known is None:
        return chosen
    for item in state.tried:
        led = item.gain >= policy.rival_gain * known.gain and item.share >= min(policy.partly, known.share)
        masses = EFFECTS[item.effect].in_transmission and has_load(chosen.model_fit.fitted.packed.on)
        if item.effect in chosen.model_fit.effects or masses or not led:
            continue
        state.progress(f"{item.effect} in the place of {first}")
        other = in_place_of(state.problem, state.root, chosen, first, item)
        if other is None:
            continue
        other = state.shaped(other) or other
        left = [error_left(state.problem, one.model_fit) for one in (other, chosen)]
        if left[0] < left[1]:  # the one that it takes the place of stays a rival: a fit of the last round
            last = item.effect if chosen.effect == first else chosen.effect
            chosen, first = replace(other, effect=last), item.effect
    return chosen


def _contends(
    state: SearchState, chosen: FittedCandidate, item: FittedCandidate, another_law: bool = False
) -> bool:
    """Whether another effect came near the chosen one by its own law.

    Near is what is asked before its course is free (`Kind.least_own`): of an encoder off centre one wave a turn is a
    quarter of what two are. Where the chosen one can be named so, only one that can be too, and errs no more: an
    element of memory that hardly slides is a spring. If the chosen one does better by `another_law`, its look-alikes
    may as well: friction that the load presses, by the root of squares, was a motor that saturates by a course of its
    own. A spring's free course comes near to any weight over a part of a turn: where the weight leaves nothing beyond
    doubt, that says nothing of it (`spring_as_well`).
    """
    policy = state.problem.policy
    if item.effect == chosen.effect:
        return False
    certain = chosen.training.certain or (chosen.veto is not None and chosen.veto.certain)
    if item.effect == SPRING.name and not certain and without_own_course(state.problem, chosen.model_fit):
        return False
    if another_law and item.effect in usual_rivals(chosen.effect):
        return item.share >= policy.partly
    if not chosen.named:
        own = policy.partly * EFFECTS[item.effect].least_own
        return item.gain >= policy.rival_gain * chosen.gain and item.share >= own
    return item.named and state.evidence.comes_near(state.problem, state.root, chosen, item)


def _begun_anew(state: SearchState, chosen: FittedCandidate) -> FittedCandidate:
    """Each effect looked for again beside the others, where together they do not explain what they should.

    The first of them took its shape while the second was missing: a wave over the travel for a tight spot. A
    single one is begun anew where it is a second mass, whose way downhill depends on where it begins; with a
    twin it has begun where that is best.
    """
    policy = state.problem.policy
    alone = len(chosen.model_fit.effects) < 2
    if alone and (state.problem.twin or not has_load(chosen.model_fit.fitted.packed.on)):
        return chosen
    for effect in chosen.model_fit.effects:
        if chosen.share >= REFINED if alone else chosen.named:
            break
        state.progress(f"another beginning for {effect}")
        again = _from_best_start(state, chosen, effect, alone)
        left = error_left(state.problem, chosen.model_fit)
        if again is not None and error_left(state.problem, again.model_fit) < policy.clearly_less * left:
            chosen = replace(again, effect=chosen.effect, gain=chosen.gain, freed=chosen.freed)
    return chosen


def _from_best_start(
    state: SearchState, chosen: FittedCandidate, effect: str, alone: bool
) -> FittedCandidate | None:
    """The chosen model with one effect screened anew beside the others."""
    problem, root, before = state.problem, state.root, state.root
    if not alone:
        rest = without_effect(problem, root, chosen.model_fit, effect)
        if rest is None:
            return None
        before = rest.model_fit
    screened = screen(problem, state.evidence, before, state.nominal, effect)
    if screened is None:
        return None
    return inside_twin(problem, root, before, screened, chosen.model_fit.fitted.cost, best_start=True)
