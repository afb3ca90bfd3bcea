"""The rounds of a search: which candidates are fitted inside the twin, and which of them is worth having.

The best are fitted down the ranking; the best fit must explain enough by itself, of what is explained already or of
what is left, and lower the error on the veto trajectory.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from autotune.core.time_limit import check_time
from autotune.diagnosis.base_beside import law_before_further, other_law
from autotune.diagnosis.candidates import (
    FittedCandidate,
    ScreenedCandidate,
    clearly_falls_on_veto,
    explained_beside,
    explained_of_rest,
    explains_rest,
    gain_by_way_back,
    gain_on_veto,
    least_fall,
    plainer,
)
from autotune.diagnosis.evidence.torque_path import lag_in_loop, late_anew, without_long_lag
from autotune.diagnosis.free_shape import with_free_shape
from autotune.diagnosis.refits import (
    NEARLY,
    REFINED,
    RIVAL_COST,
    best_refined,
    counted_beside,
    inside_twin,
    judged,
    looped_otherwise,
    refined,
    root_from,
    settled_in,
)
from autotune.diagnosis.screening import (
    NEAR_WORTH,
    generic_gains,
    rank,
    screen,
)
from autotune.diagnosis.search_state import SearchState
from autotune.diagnosis.transmission import (
    masses_scattered,
    other_contact_tried,
    without_needless_gap,
)
from autotune.estimation.bias_corrected_fit import ModelFit, fit_inside_twin
from autotune.estimation.data import TRAINING
from autotune.estimation.problem import Problem
from autotune.models.table import EFFECTS
from autotune.models.transmission import has_load

MOST_EFFECTS = 3
"""Effects that are added."""
MOST_FITS = 4
"""Candidates fitted inside the twin in a round."""
WORTH_A_FIT_BESIDE, CLOSE_RIVAL = 0.6, 0.75
"""Of the best candidate's gain: what is fitted beside another effect, and beside one that can be named already."""
WORTH_BESIDE_ELEMENTS = 0.25
"""The same beside elements that can be named: a gap that they stood for gained a third of what they did."""
LOOPS_ANEW = 2
"""Times that a twin may be shaken or controlled otherwise before a second mass: one for each."""


def next_best(state: SearchState, first: bool) -> FittedCandidate | None:
    """The best of a round, looked for again where its base or its loop was not right."""
    best = one_round(state, first)
    if best is not None and first and _rooted_anew(state, best):
        best = one_round(state, first)
    for _ in range(LOOPS_ANEW):
        if best is None or not _looped_anew(state, best):
            break
        best = one_round(state, first)
    return best


def _rooted_anew(state: SearchState, best: FittedCandidate) -> bool:
    """Whether the root was no minimum: a candidate that led its base away from there is no reason for a name."""
    root = root_from(state.problem, state.root, best.model_fit)
    if root is None:
        return False
    state.progress("fit of the model as it is, from elsewhere")
    state.root = root
    return True


def _looped_anew(state: SearchState, best: FittedCandidate) -> bool:
    """Whether a second mass made up for how the twin is shaken, or controlled: that is no reason for a name."""
    found = otherwise(state, state.model_fit, best.model_fit)
    if found is None:
        return False
    if state.chosen is None:
        state.problem, state.root = found
        return True
    before = state.problem
    state.chosen = state.moved(found[0], state.chosen)
    return state.problem is not before


def otherwise(state: SearchState, before: ModelFit, loaded: ModelFit) -> tuple[Problem, ModelFit] | None:
    """What stands for a second mass, by how the twin is shaken, controlled or late; None where nothing does."""
    has_mass = has_load(loaded.fitted.packed.on)
    lags = _lags_as_much(state, before, loaded) if has_mass else None
    if lags is not None:
        return lags
    late = late_anew(state.problem, before) if has_mass else None
    found = looped_otherwise(state.problem, before, loaded, late)
    if found is None:
        return None
    state.progress("twins that are shaken or controlled otherwise")
    return found if found is not late else settled_in(without_long_lag(*found), found[1])


def _lags_as_much(state: SearchState, before: ModelFit, loaded: ModelFit) -> tuple[Problem, ModelFit] | None:
    """The axis `before` a second mass where a lag of its loop explains as much as the mass, which has more parameters:
    its torque acting at once, so that the lag is a candidate like any other."""
    found = lag_in_loop(state.problem, before) if state.problem.data.repeated else None
    if found is None:
        return None
    by_lag, by_mass = (before.fitted.cost - one.fitted.cost for one in (found[1], loaded))
    if by_lag < state.problem.policy.named * by_mass:
        return None
    state.progress("a lag of the loop, by another way of recording")
    return settled_in(found[0], before)


def one_round(state: SearchState, first: bool) -> FittedCandidate | None:
    """The candidate that explains most beside what is chosen, if it is worth having."""
    problem, model_fit = state.problem, state.model_fit
    worth = least_fall(problem, state.chosen) if state.chosen is not None else 0.0
    ranked = rank(problem, state.evidence, model_fit, state.nominal, state.progress, worth)
    if first:
        state.first = ranked
        state.keep()
    else:
        state.further = model_fit.effects, ranked
    check_time()
    if first and other_law(state, ranked):
        if state.begin_again is not None:
            return None
        problem, model_fit = state.problem, state.root
        ranked = rank(problem, state.evidence, model_fit, state.nominal, state.progress)
    if first:
        state.first = ranked
        state.generic = state.evidence.telling(problem.policy, generic_gains(problem, state.root))
    near = [item for item in ranked if first or item.fall >= NEAR_WORTH * worth or _promises(state, item)]
    passing = state.evidence.worth_fitting(problem, model_fit, near)
    fits = _fit_down(state, model_fit, passing)
    if first and not any(item.named for item in fits):
        fits = _as_beside(state, fits)
    if not any(item.named for item in fits):
        fits += _second_look(state, model_fit, ranked, passing)
    if state.chosen is not None:
        fits = [item.with_courses_of(state.chosen) for item in fits]
    state.seen += [item.model_fit for item in fits]
    fits = without_needless_gap(problem, fits)
    if first:
        state.tried = fits
    else:
        state.later += fits
    if not first and state.evidence.repeats and fits:
        leads = state.evidence.best(problem, fits)
        fits = best_refined(problem, state.root, model_fit, fits, leads, state.progress)
        fits = [_led_beside(state, one) for one in fits]
    best = _best(state, fits)
    return None if best is not None and not first and law_before_further(state, ranked, best) else best


def best_in_haste(state: SearchState) -> FittedCandidate | None:
    """The best of the first candidates, fitted inside the twin from where it was best, if it is worth having.

    For a search whose time is up before any was taken: its rivals are not fitted, and stay what it may be confused
    with. One that began again has what its base was found beside, too.
    """
    passing = state.evidence.worth_fitting(state.problem, state.root, state.first)
    best = [replace(item, others=()) for item in passing[:1]]
    state.tried = _as_beside(state, _fit_down(state, state.root, best))
    fits = [one for one in state.tried if _explains(state, one)]
    found = state.evidence.best(state.problem, fits) if fits else None
    return found if found is not None and state.worth_having(found) else None


def _as_beside(state: SearchState, fits: list[FittedCandidate]) -> list[FittedCandidate]:
    """The fits, and what the root's law was found beside, fitted again from there, where that is better.

    In the root that law has taken the place of the effect, as far as it can: from there a screening looks for
    another one (dwell time beside a chain of contacts gained 5 % of what it explains).
    """
    if state.beside is None:
        return fits
    state.progress("what the law of the base was found beside")
    known = state.beside.model_fit
    again = fit_inside_twin(state.problem, known.fitted.packed, list(known.free), 2, known.effects)
    if again is None:
        return fits
    found = judged(state.problem, state.root, again, again.effects[-1]).with_courses_of(state.beside)
    same = [one for one in fits if one.model_fit.effects == again.effects]
    if any(one.model_fit.fitted.cost < again.fitted.cost for one in same):
        return fits
    return [*(one for one in fits if one.model_fit.effects != again.effects), found]


def _promises(state: SearchState, item: ScreenedCandidate) -> bool:
    """Whether two masses, which are followed inside the twin only, would lower the error by their linear model."""
    in_transmission = EFFECTS[item.effect].in_transmission and state.problem.twin
    return in_transmission and item.gain >= state.problem.policy.clear_gain


def _fit_down(
    state: SearchState, model_fit: ModelFit, passing: Sequence[ScreenedCandidate]
) -> list[FittedCandidate]:
    """Fits inside the twin down the ranking until one explains nearly everything, and its close rivals.

    Elements bend to whatever has a way and a level: of a gap with friction at the load they explained all, with 1.5
    times its gain on the measured motion. They are no reason to ask for closer rivals than a round without a name does.
    """
    fits: list[FittedCandidate] = []
    for item in passing[:MOST_FITS]:
        named = [EFFECTS[r.effect] for r in fits if r.named]
        done = any(not kind.approximate for kind in named)
        alone = WORTH_BESIDE_ELEMENTS if named else state.problem.policy.worth_refit
        worth = WORTH_A_FIT_BESIDE if model_fit.effects else alone
        least = CLOSE_RIVAL if done else worth
        if item.gain < least * passing[0].gain:
            break
        state.progress(f"refit inside the twin: {item.effect}")
        target = RIVAL_COST * min((r.model_fit.fitted.cost for r in fits), default=math.inf)
        fitted = inside_twin(state.problem, state.root, model_fit, item, target)
        if fitted is not None:
            fits.append(fitted)
    return fits


def _led_beside(state: SearchState, item: FittedCandidate) -> FittedCandidate:
    """A further effect beside what has a name, led on where it explains half of what that leaves, and not nearly all.

    With what is named it explains nearly all of everything after a step, and looks settled: beside Stribeck friction,
    which explained 99 %, a motor that saturates was 90 and 83 % of the rest and not taken.
    """
    problem, before, policy = state.problem, state.model_fit, state.problem.policy
    asked = state.chosen is not None and state.chosen.named and not item.model_fit.converged
    parts = explained_of_rest(problem, before, item.model_fit) if asked else []
    if not policy.partly < min((part.share for part in parts), default=0.0) < REFINED:
        return item
    led = refined(problem, state.root, item, state.progress, enough=math.inf)
    return counted_beside(problem, before, item, replace(led, effect=item.effect))


def _second_look(
    state: SearchState,
    model_fit: ModelFit,
    ranked: Sequence[ScreenedCandidate],
    passing: Sequence[ScreenedCandidate],
) -> list[FittedCandidate]:
    """The candidate that lowers the error most, though a linearised hold-out does not say so.

    An effect that only the fastest experiment shows cannot be predicted for it from the others; the veto
    trajectory tells then.
    """
    problem = state.problem
    left = [item for item in ranked if item not in passing]
    best = min(left, key=lambda item: item.fitted.cost, default=None)
    enough = (1.0 - problem.policy.clear_fall) * model_fit.fitted.cost
    if best is None or not problem.has_veto:
        return []
    if best.fitted.cost > enough:
        return (
            _loaded_on_veto(state, model_fit, left) if state.chosen is None else _asked_of_veto(state, best)
        )
    state.progress(f"refit inside the twin: {best.effect}")
    fitted = inside_twin(problem, state.root, model_fit, best)
    if fitted is None:
        return []
    return [replace(fitted, gain=gain_on_veto(problem, model_fit, fitted.model_fit))]


def _asked_of_veto(state: SearchState, item: ScreenedCandidate) -> list[FittedCandidate]:
    """A further candidate where only the veto trajectory refuses what is chosen, and bears the further one out.

    The base may lack what shows most in other motion than that which was fitted: friction that falls with speed, beside
    a memory that explains all of the training and nothing of the veto.
    """
    problem, chosen = state.problem, state.chosen
    if chosen is None or chosen.named or chosen.veto is None or chosen.training.share < problem.policy.named:
        return []
    state.progress(f"refit inside the twin: {item.effect}")
    fitted = inside_twin(problem, state.root, chosen.model_fit, item)
    if fitted is None or not fitted.named:
        return []
    if not clearly_falls_on_veto(problem, chosen.model_fit, fitted.model_fit):
        return []
    return [replace(fitted, gain=gain_on_veto(problem, chosen.model_fit, fitted.model_fit))]


def _loaded_on_veto(
    state: SearchState, model_fit: ModelFit, left: Sequence[ScreenedCandidate]
) -> list[FittedCandidate]:
    """Two masses that gain in too few experiments, where the veto trajectory bears their fit out beyond chance.

    Between two masses motion is not linear, and a screening ends a few steps from a start: what its linear model
    says of experiments held out scatters. Inside the twin it is a fit, and the veto trajectory was never fitted.
    """
    problem, policy = state.problem, state.problem.policy
    loads = [
        item
        for item in left
        if problem.twin and EFFECTS[item.effect].in_transmission and item.gain >= policy.least_gain
    ]
    if not loads:
        return []
    best = min(loads, key=lambda item: item.fitted.cost)
    state.progress(f"refit inside the twin: {best.effect}")
    fitted = inside_twin(problem, state.root, model_fit, best)
    if fitted is None or fitted.share < policy.partly:
        return []
    return [fitted] if clearly_falls_on_veto(problem, model_fit, fitted.model_fit) else []


def _best(state: SearchState, fits: Sequence[FittedCandidate]) -> FittedCandidate | None:
    """The fit that explains most, if it is worth having beside what is chosen already.

    Where the fastest experiment alone shows an effect, its hold-out says nothing; the veto trajectory does.
    """
    problem = state.problem
    fits = [one for one in fits if _explains(state, one)]
    if not fits:
        return None
    best = state.evidence.best(problem, fits)
    best = plainer(problem, fits, best, state.evidence.alike(problem))
    if best.gain < problem.policy.least_gain:
        best = replace(best, gain=_gain_where_one_tells(problem, state.model_fit, best))
    if state.worth_having(best):
        return best
    led = _worth_at_its_best(state, best) or _other_worth_having(state, fits, best)
    led = led or _other_by_its_course(state, fits, best)
    return led or _two_at_once(state, fits) or _one_after_another(state, best)


def _other_worth_having(
    state: SearchState, fits: Sequence[FittedCandidate], best: FittedCandidate
) -> FittedCandidate | None:
    """Beside what needs more for a name: the further effect that explains most of those that are worth having.

    Where two are missing beside it, each explains about half of what it leaves, and the one that predicts better
    may be the one with the smaller half.
    """
    if state.chosen is None or state.chosen.named:
        return None
    worth = [one for one in fits if one.effect != best.effect and state.worth_having(one)]
    return min(worth, key=lambda one: one.model_fit.fitted.cost, default=None)


def _other_by_its_course(
    state: SearchState, fits: Sequence[FittedCandidate], best: FittedCandidate
) -> FittedCandidate | None:
    """Beside what has a name: another further effect that by its course is worth having, where the best is not.

    By their own laws two that look alike explain about as much of the rest: beside Stribeck friction a motor that
    saturates 91 and 90 %, friction that the load presses 85 and 90.
    """
    if state.chosen is None or not state.chosen.named or not state.evidence.repeats:
        return None
    others = [one for one in fits if one.effect != best.effect and not EFFECTS[one.effect].in_transmission]
    for one in sorted(others, key=lambda item: item.model_fit.fitted.cost):
        parts = explained_of_rest(state.problem, state.model_fit, one.model_fit)
        if all(part.share >= state.problem.policy.partly for part in parts):
            found = one if state.worth_having(one) else _worth_by_its_course(state, one)
            if found is not None:
                return found
    return None


def _two_at_once(state: SearchState, fits: Sequence[FittedCandidate]) -> FittedCandidate | None:
    """Beside what needs more for a name: two further effects, each of which explains hardly half of what it leaves.

    Each is what the other leaves. With both that is nearly nothing, and without either half of it and more is back.
    """
    problem, before = state.problem, state.model_fit
    if state.chosen is None or state.chosen.named or not _room_for_two(state):
        return None
    shares = {one.effect: explained_of_rest(problem, before, one.model_fit)[0].share for one in fits}
    ranked = sorted(fits, key=lambda one: shares[one.effect], reverse=True)
    loads = [one for one in ranked if EFFECTS[one.effect].in_transmission][:1]
    pair = (loads + [one for one in ranked if not EFFECTS[one.effect].in_transmission])[:2]
    if len(pair) < 2 or sum(shares[one.effect] for one in pair) < NEARLY:
        return None
    first, second = pair
    state.progress(f"two further effects at once: {first.effect}, {second.effect}")
    screened = screen(problem, state.evidence, first.model_fit, state.nominal, second.effect)
    both = inside_twin(problem, state.root, first.model_fit, screened) if screened is not None else None
    if both is None:
        return None
    alone = [part for one in pair for part in explained_of_rest(problem, one.model_fit, both.model_fit)]
    if any(part.share < problem.policy.partly for part in alone):
        return None
    return _both_if_worth_having(state, both)


def _one_after_another(state: SearchState, first: FittedCandidate) -> FittedCandidate | None:
    """Beside what has a name: a further effect that explains half of what that leaves, with the one that explains what
    both leave.

    Stribeck friction of the base may be twenty times what two others make, and explain as much of all as a name asks.
    Of its rest the one explains half, and by experiments held out the other hardly anything as long as the first is
    missing. Together they must explain as much of it as a name asks of all.
    """
    problem, before = state.problem, state.model_fit
    if state.chosen is None or not state.chosen.named or not _room_for_two(state):
        return None
    least = least_fall(problem, state.chosen)
    beside = explained_of_rest(problem, before, first.model_fit)[0]
    if beside.share < problem.policy.partly or beside.fall < least:
        return None
    ranked = rank(problem, state.evidence, first.model_fit, state.nominal, state.progress, least)
    passing = state.evidence.worth_fitting(problem, first.model_fit, ranked)
    if not passing:
        return None
    state.progress(f"two further effects: {first.effect}, {passing[0].effect}")
    both = inside_twin(problem, state.root, first.model_fit, passing[0])
    if both is None:
        return None
    second = explained_of_rest(problem, first.model_fit, both.model_fit)[0]
    if second.share < problem.policy.partly:
        return None
    return _both_if_worth_having(state, both)


def _room_for_two(state: SearchState) -> bool:
    """Whether two further effects may be asked at once: repeats tell what is left, and a model has so many at most."""
    return state.evidence.repeats and len(state.model_fit.effects) + 2 <= MOST_EFFECTS


def _both_if_worth_having(state: SearchState, both: FittedCandidate) -> FittedCandidate | None:
    """A fit with two further effects, judged by what it explains beside what is chosen."""
    both = counted_beside(state.problem, state.model_fit, both, both)
    return both if state.worth_having(both) else None


def _explains(state: SearchState, item: FittedCandidate) -> bool:
    """Whether a fit leaves less than before, and is no part of the measurement chain."""
    return item.training.fall > 0.0 and not state.evidence.of_the_chain(state.problem, item)


def _gain_where_one_tells(problem: Problem, before: ModelFit, best: FittedCandidate) -> float:
    """The gain of an effect that one experiment alone may show: on the veto trajectory, or by its way back.

    A motor that saturates at the fastest experiment's torque is predicted by no other, however much it explains. Of the
    veto it must explain half; where there is none, each way must be told by the way back, beyond chance, and half of
    the training be explained. Else its gain stays that of experiments held out.
    """
    policy, after = problem.policy, best.model_fit
    if problem.has_veto:
        told = best.named or (best.veto is not None and best.veto.share >= policy.partly)
        return gain_on_veto(problem, before, after) if told else best.gain
    if best.training.share < policy.partly:
        return best.gain
    gain, z = gain_by_way_back(problem, before, after)
    return gain if policy.no_chance(gain, z) else best.gain


def _worth_at_its_best(state: SearchState, best: FittedCandidate) -> FittedCandidate | None:
    """A further effect that is not worth having as its fit ended, led on: two masses from elsewhere, its course free.

    The first effect of a search is led on once it is taken; beside another one a fit that stops short is not taken.
    """
    if state.chosen is None or not state.evidence.repeats:
        return None
    led = _masses_at_their_best(state, best)
    if led is not best:
        led = counted_beside(state.problem, state.model_fit, best, led)
        if state.worth_having(led):
            return led
    return _worth_by_its_course(state, led)


def _masses_at_their_best(state: SearchState, best: FittedCandidate) -> FittedCandidate:
    """A further transmission in another contact, led on, where what it explains of the rest is clear.

    A gap that is damped beside its spring stopped at a third of what the same one explains that is damped by its
    impact. Beside what has a name it must explain nearly all of the rest, and is looked for from elsewhere too.
    """
    problem, before, policy = state.problem, state.model_fit, state.problem.policy
    if not EFFECTS[best.effect].in_transmission or not problem.twin:
        return best
    if best.model_fit.fitted.cost > (1.0 - policy.clear_beside) * before.fitted.cost:
        return best
    led = other_contact_tried(problem, state.root, best, state.progress)
    parts = explained_of_rest(problem, before, led.model_fit)
    if state.chosen is not None and state.chosen.named and all(one.share >= policy.partly for one in parts):
        led = masses_scattered(problem, state.root, led, state.progress)
    return led


def _worth_by_its_course(state: SearchState, best: FittedCandidate) -> FittedCandidate | None:
    """A further effect that by its own law explains less than half of what the others leave, with its course free.

    Of an encoder that is tilted too the second wave makes more torque than the first. By its course it must explain
    as much of that as a name asks of all, on training and veto.
    """
    problem, before = state.problem, state.model_fit
    beside = explained_beside(problem, before, best.model_fit, TRAINING)
    if (
        state.chosen is None
        or beside.fall < least_fall(problem, state.chosen)
        or explains_rest(problem, state.chosen, best)
    ):
        return None
    shaped = state.shaped(best)
    if shaped is None or not shaped.named:
        return _both_by_their_courses(state, shaped or best)
    parts = explained_of_rest(problem, before, shaped.model_fit)
    told = all(part.share >= problem.policy.named for part in parts)
    shaped = counted_beside(problem, before, best, shaped)
    return shaped if told and state.worth_having(shaped) else None


def _both_by_their_courses(state: SearchState, second: FittedCandidate) -> FittedCandidate | None:
    """A first and a second effect, where neither has a name by its own law, with the course of the first free too.

    Each of two laws that differ leaves what the other does not explain, and alone neither course explains clearly
    more.
    """
    chosen = state.chosen
    if chosen is None or chosen.named or len(chosen.model_fit.effects) > 1 or chosen.effect in chosen.freed:
        return None
    state.progress(f"another law of {chosen.effect}")
    both = with_free_shape(state.problem, state.root, state.nominal, replace(second, effect=chosen.effect))
    if both is None:
        return None
    both = replace(both, effect=second.effect, gain=second.gain)
    if not both.named and second.effect not in both.freed:
        both = counted_beside(state.problem, state.model_fit, second, state.shaped(both) or both)
    return replace(both, freed={**both.freed, chosen.effect: False}) if state.worth_having(both) else None
