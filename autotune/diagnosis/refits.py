"""Fits inside the twin: a model with one effect more, with one less, without terms that chance made, and more rounds.

What an unsettled fit leaves would look like a further effect, and a rival that has settled sooner like the better name.

A term is a numbered group of an effect's parameters: one wave of a ripple, one element of a memory. Its amplitudes a,
with their covariance C from the fit, are significant where aᵀ·C⁻¹·a is above what chance reaches once in a thousand
times (Wald's test, χ² with as many degrees of freedom as amplitudes).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.diagnosis.candidates import FittedCandidate, Progress, ScreenedCandidate, gain_on_veto
from autotune.diagnosis.ripple_orders import candidate_orders
from autotune.estimation.bias_corrected_fit import LEVEL_GROUND, ModelFit, fit_from_starts, fit_inside_twin
from autotune.estimation.contact_start import CONTACT, best_contact, damped_as_twins_creep, identifiable
from autotune.estimation.cross_validation import explained, gain_and_z
from autotune.estimation.data import TRAINING, VETO
from autotune.estimation.disturbance import Disturbance
from autotune.estimation.disturbance_estimate import (
    LOUDNESS,
    PARTS_ALONE,
    estimate_disturbance,
    level_of_least,
    with_counts,
    with_expected_noise,
)
from autotune.estimation.least_squares import Fitted, Free, covariance, followed
from autotune.estimation.model_error import told_beside, with_misfit_again
from autotune.estimation.problem import Problem, base_free, refit
from autotune.models.drive_model import Packed
from autotune.models.effect import Kind, Terms
from autotune.models.layout import flag
from autotune.models.table import EFFECTS
from autotune.models.torque_ripple import TORQUE_RIPPLE, scale_slot
from autotune.models.transmission import has_load

_TERM = re.compile(r"(?P<part>\w+)_(?P<number>\d+)$")
MOST_ROUNDS, WORTH_ANOTHER_ROUND = 3, 0.02
"""Rounds of a fit, and the relative fall of the cost in one of them that is worth the next."""
NEARLY, REFINED = 0.8, 0.99
"""Shares between which a fit is carried on: more rounds win hundredths, and above it no name changes."""
RIVAL_COST = 1.5
"""Of the lowest cost: a fit that will not come so near is given up, to save time."""
CONTACT_STEPS = ROOT_STEPS = 8
NOISE_CHANGED = 0.25
"""Relative change of the twin's noise that is worth fitting anew."""


def inside_twin(
    problem: Problem,
    root: ModelFit,
    model_fit: ModelFit,
    candidate: ScreenedCandidate,
    target: float = math.inf,
    best_start: bool = False,
) -> FittedCandidate | None:
    """A candidate fitted with its own bias; shares count from the model without any found effect.

    `target`: see `fit_inside_twin`. Two masses begin at the first start that is better than without the candidate,
    or at the `best_start` of all. None where the twin is unstable.
    """
    effects = tuple(dict.fromkeys([*model_fit.effects, candidate.effect]))
    fitted = candidate.fitted
    if problem.two_masses(fitted.packed):
        starts = [fitted.packed, *candidate.others]
        enough = 0.0 if best_start else model_fit.fitted.cost
        settled = fit_from_starts(problem, starts, enough, fitted.free, effects, target)
    else:
        settled = fit_inside_twin(problem, fitted.packed, fitted.free, 2, effects, fitted)
    if settled is None:
        return None
    if not problem.two_masses(fitted.packed):
        settled = _as_promised(problem, model_fit, fitted, settled)
    return judged(problem, root, settled, candidate.effect, model_fit)


def _as_promised(problem: Problem, before: ModelFit, screened: Fitted, settled: ModelFit) -> ModelFit:
    """The fit begun in the contact that was known `before`, where it leaves clearly more than was promised.

    A candidate is screened beside the bias of the model that lacks it: of a twin that rests and turns round where
    another friction holds it. There stiffness and damping in presliding make the torque, and are led to what makes up
    for that bias. Inside the twin, with a bias of its own, no way may lead back.
    """
    slots = [one.slot for one in screened.free if one.name in CONTACT]
    promised = screened.cost < problem.policy.clearly_less * settled.fitted.cost
    if not (problem.twin and slots and promised):
        return settled
    p = screened.packed.p.copy()
    p[slots] = before.fitted.packed.p[slots]
    again = fit_inside_twin(problem, Packed(p, screened.packed.on), screened.free, 2, settled.effects)
    return again if again is not None and again.fitted.cost < settled.fitted.cost else settled


def judged(
    problem: Problem, root: ModelFit, settled: ModelFit, effect: str, model_fit: ModelFit | None = None
) -> FittedCandidate:
    """What a settled model explains; the gain counts from `model_fit`, or from the root."""
    gain = _gain_beside(problem, model_fit or root, settled)
    parts = [
        explained(problem, root.fitted, settled.fitted, settled.correction, role) for role in (TRAINING, VETO)
    ]
    veto = parts[1] if problem.has(VETO) else None
    found = FittedCandidate(effect, settled, gain, parts[0], veto, named=False)
    return replace(found, named=found.share >= needed_share(problem, found))


def judged_again(
    problem: Problem, root: ModelFit, chosen: FittedCandidate, settled: ModelFit
) -> FittedCandidate:
    """What a candidate explains whose model was fitted anew; courses that are free in it are so still."""
    return judged(problem, root, settled, chosen.effect).with_courses_of(chosen)


def _gain_beside(problem: Problem, before: ModelFit, settled: ModelFit) -> float:
    """Fall of the error on data that were not fitted, from a model to a settled one; see `gain_on_veto`."""
    if has_load(settled.fitted.packed.on) and problem.has_veto:
        return gain_on_veto(problem, before, settled)
    return gain_and_z(before.unseen, settled.unseen)[0]


def counted_beside(
    problem: Problem, before: ModelFit, best: FittedCandidate, led: FittedCandidate
) -> FittedCandidate:
    """A further effect that was led on from the best; its gain is from the model before it, and not from the root."""
    return replace(led, gain=max(best.gain, _gain_beside(problem, before, led.model_fit)))


def needed_share(problem: Problem, found: FittedCandidate) -> float:
    """Share for a name: more where something that repeats is left beyond doubt, unless the law is approximate."""
    certain = found.training.certain or (found.veto is not None and found.veto.certain)
    approximate = any(EFFECTS[name].approximate for name in found.model_fit.effects)
    return problem.policy.named_with_rest if certain and not approximate else problem.policy.named


def adds_beside(problem: Problem, root: ModelFit, model_fit: ModelFit, rival: ModelFit) -> float:
    """What a rival explains beside a model, of what both together explain beyond the rival; linearised, on training.

    The one encompasses the other where that is next to nothing (Davidson and MacKinnon 1981, Econometrica 49): all that
    the rival explains is in the model, and more. What both leave is left out of it.
    """
    weight, fitted = problem.training, model_fit.fitted
    slots = {parameter.slot for name in rival.effects for parameter in EFFECTS[name].parameters}
    own = [one.slot in slots for one in rival.fitted.free]
    without = problem.raw(taken_out(root, rival, *rival.effects)) - rival.correction.bias
    columns = np.column_stack([
        fitted.jacobian, rival.fitted.jacobian[:, own], rival.fitted.error - without
    ])  # fmt: skip
    alone, other, both = (
        float(weight @ followed(table, error, weight) ** 2)
        for table, error in (
            (fitted.jacobian, fitted.error),
            (rival.fitted.jacobian, rival.fitted.error),
            (columns, fitted.error),
        )
    )
    return (alone - both) / max(other - both, 1e-300)


def with_contact(problem: Problem, root: ModelFit, chosen: FittedCandidate) -> FittedCandidate:
    """The chosen model with the bristle free again, where a recording tells of it now that the effect is there.

    Held at what drowned in the effect, it would leave a rest that memory explains.
    """
    model_fit = chosen.model_fit
    packed = Packed(model_fit.fitted.packed.p.copy(), model_fit.fitted.packed.on)
    known = {one.name for one in model_fit.free}
    base = base_free(packed, problem.scales, problem.data.metadata.motion_unit)
    held = [one for one in base if one.name in CONTACT and one.name not in known]
    if not held:
        return chosen
    fitted = refit(problem, packed, [*model_fit.free, *held], model_fit.correction, CONTACT_STEPS)
    best = best_contact(problem, fitted, model_fit.correction)
    free = identifiable(problem, best, best.free)
    if len(free) == len(model_fit.free):
        return chosen
    settled = fit_inside_twin(problem, best.packed, free, 2, model_fit.effects)
    if settled is None or settled.unseen.total >= model_fit.unseen.total:
        return chosen
    return replace(judged_again(problem, root, chosen, settled), gain=chosen.gain)


def without_effect(
    problem: Problem, root: ModelFit, model_fit: ModelFit, effect: str
) -> FittedCandidate | None:
    """The model fitted without one of the effects that were found; None where the twin is unstable."""
    slots = {parameter.slot for parameter in EFFECTS[effect].parameters}
    kept = {f.name for f in root.free}
    free = [f for f in model_fit.free if f.slot not in slots or f.name in kept]
    effects = tuple(name for name in model_fit.effects if name != effect)
    settled = fit_inside_twin(problem, taken_out(root, model_fit, effect), free, 2, effects)
    if settled is None:
        return None
    return judged(problem, root, settled, effects[-1])


def in_place_of(
    problem: Problem, root: ModelFit, chosen: FittedCandidate, effect: str, rival: FittedCandidate
) -> FittedCandidate | None:
    """The chosen model with a rival, as fitted by itself, in the place of an effect; None where it is unstable."""
    other = rival.model_fit
    taken = {one.slot for one in EFFECTS[effect].parameters}
    own = {one.slot for one in EFFECTS[rival.effect].parameters}
    without = taken_out(root, chosen.model_fit, effect)
    packed = with_effects(without, other.fitted.packed, (rival.effect,))
    kept = {one.name for one in root.free}
    free = [one for one in chosen.model_fit.free if one.slot not in taken or one.name in kept]
    free += [one for one in other.free if one.slot in own]
    effects = tuple(rival.effect if name == effect else name for name in chosen.model_fit.effects)
    settled = fit_inside_twin(problem, packed, free, 2, effects)
    if settled is None:
        return None
    found = judged(problem, root, settled, rival.effect).with_courses_of(chosen)
    course = {name: named for name, named in rival.freed.items() if name == rival.effect}
    return replace(found, freed={**found.freed, **course})


def root_from(problem: Problem, root: ModelFit, model_fit: ModelFit) -> ModelFit | None:
    """The root fitted again from the base of a model with one effect, which is taken out; None where that is no better.

    A first fit may end in a minimum that is none for what moves more freely, and any effect may be what moves.
    """
    if len(model_fit.effects) != len(root.effects) + 1:
        return None
    packed = taken_out(root, model_fit, model_fit.effects[-1])
    least = problem.policy.clearly_less * root.fitted.cost
    if refit(problem, packed, list(root.free), model_fit.correction, ROOT_STEPS).cost >= least:
        return None
    again = fit_inside_twin(problem, packed, list(root.free), 2, root.effects)
    return again if again is not None and again.fitted.cost < least else None


def taken_out(root: ModelFit, model_fit: ModelFit, *effects: str) -> Packed:
    """The parameters without those of effects, which are the root's."""
    return with_effects(model_fit.fitted.packed, root.fitted.packed, effects)


def with_effects(base: Packed, other: Packed, effects: Sequence[str]) -> Packed:
    """The parameters of a model, those of some effects as another one has them, where it has them."""
    p, on = base.p.copy(), base.on.copy()
    for name in effects:
        slots = [parameter.slot for parameter in EFFECTS[name].parameters]
        p[slots], on[flag(name)] = other.p[slots], other.on[flag(name)]
    return Packed(p, on)


def best_refined(
    problem: Problem,
    root: ModelFit,
    before: ModelFit,
    fits: Sequence[FittedCandidate],
    best: FittedCandidate,
    progress: Progress,
) -> list[FittedCandidate]:
    """The fits with the best of them refined: beside another effect it has not settled after two rounds.

    Its gain counts from the model `before` it, as that of the others does.
    """
    if not NEARLY < best.share < REFINED:
        return list(fits)
    done = counted_beside(problem, before, best, refined(problem, root, best, progress))
    done = replace(done, effect=best.effect)
    return [done if one is best else one for one in fits]


def unsettled(problem: Problem, chosen: FittedCandidate) -> bool:
    """Whether more rounds of a fit may change its name."""
    return problem.policy.partly < chosen.share < REFINED


def refined(
    problem: Problem,
    root: ModelFit,
    chosen: FittedCandidate,
    progress: Progress,
    enough: float = REFINED,
) -> FittedCandidate:
    """More rounds of the same fit, as long as they help and it explains less than `enough`: two masses need them, and
    what they leave misleads."""
    damped = damped_as_twins_creep(problem, chosen.model_fit)
    if damped is not chosen.model_fit:
        chosen = judged_again(problem, root, chosen, damped)
    for _ in range(MOST_ROUNDS):
        model_fit = chosen.model_fit
        if model_fit.converged:
            break
        progress(f"refinement with {' and '.join(model_fit.effects)}")
        better = fit_inside_twin(
            problem, model_fit.fitted.packed, list(model_fit.free), 4, model_fit.effects, model_fit.fitted
        )
        if better is None or better.fitted.cost >= model_fit.fitted.cost:
            return replace(chosen, model_fit=replace(model_fit, converged=True))
        gained = 1.0 - better.fitted.cost / model_fit.fitted.cost
        converged = better.converged or gained < WORTH_ANOTHER_ROUND
        chosen = judged_again(problem, root, chosen, replace(better, converged=converged))
        if chosen.share >= enough:
            break
    return chosen


def negligible(problem: Problem, current: FittedCandidate, less: ModelFit, times: float = 1.0) -> bool:
    """Whether what `less` lacks is worth next to nothing, beside what all explain and what is left.

    `times` is how much more than that it may be worth.
    """
    policy = problem.policy
    falls = {TRAINING: current.training.fall, VETO: current.veto.fall if current.veto else math.inf}
    for role in (TRAINING, VETO):
        if not problem.has(role):
            continue
        left = problem.mean_square(current.model_fit.fitted.error, role)
        lost = _fall(problem, less, current.model_fit, role)
        hardly = lost < times * policy.negligible * max(falls[role], 0.0)
        if not (hardly and lost < times * policy.negligible_left * left):
            return False
    return True


def differ_by_chance(problem: Problem, model_fit: ModelFit, less: ModelFit) -> bool:
    """Whether two fits between two masses differ by no more than their chance, though one has an effect more."""
    if not problem.two_masses(less.fitted.packed):
        return False
    left = problem.mean_square(less.fitted.error, TRAINING)
    return _fall(problem, less, model_fit, TRAINING) < problem.policy.chance_of_contact * left


def _fall(problem: Problem, before: ModelFit, after: ModelFit, role: str) -> float:
    """Of a role's mean square [(N m)²]."""
    return problem.mean_square(before.fitted.error, role) - problem.mean_square(after.fitted.error, role)


def with_own_noise(
    problem: Problem, root: ModelFit, chosen: FittedCandidate
) -> tuple[Problem, FittedCandidate]:
    """The twin disturbed as much as the axis is by this model, and the model settled in it.

    Near the limit of stability, as with a strong lag, a model that lacks the effect needs twice the noise.
    """
    model_fit = chosen.model_fit
    if not problem.twin:
        return problem, chosen
    disturbance = estimate_disturbance(problem, model_fit.fitted.packed)
    before = problem.disturbance.process
    if abs(disturbance.process - before) <= NOISE_CHANGED * before:
        return problem, chosen
    quieter = with_expected_noise(replace(problem, disturbance=disturbance), model_fit.fitted.packed)
    settled = fit_inside_twin(
        quieter, model_fit.fitted.packed, list(model_fit.free), 2, model_fit.effects, model_fit.fitted
    )
    if settled is None or settled.fitted.cost > model_fit.fitted.cost:
        return problem, chosen
    quieter = _counted_anew(quieter, root, model_fit.fitted.packed)
    return quieter, judged_again(quieter, root, chosen, settled)


def _counted_anew(problem: Problem, root: ModelFit, packed: Packed) -> Problem:
    """The problem with what counts make of a model where its twin is shaken so; of two masses, of the root.

    Where that was asked at all: how loud a twin is shaken rules how often its encoder's counts turn over alike.
    """
    if problem.by_counts is None:
        return problem
    return with_counts(problem, root.fitted.packed if problem.two_masses(packed) else packed)


def looped_otherwise(
    problem: Problem, before: ModelFit, loaded: ModelFit, late: tuple[Problem, ModelFit] | None
) -> tuple[Problem, ModelFit] | None:
    """The axis `before` a second mass in twins that are shaken more or less, or have another law of their controller,
    or are as `late` as they are found to be anew; None where none stands for half of what the mass explains.

    An axis that rests next to break-away creeps as it is shaken, and motor and load on a spring are shaken otherwise
    than one mass is: so that may be shaken by as much more as a disturbance is uncertain (`LOUDNESS`), and by as much
    less as twins with two masses are (`in_quieter_twin`). And a law was told by a base that may have got another shape
    since: what its loop lacks of phase is a spring's, too. So is what it lacks, or has too much, for a lag, or for the
    row in which its torque was recorded.
    """
    if not problem.twin or not problem.two_masses(loaded.fitted.packed):
        return None
    tried = [
        settled_in(again, before)
        for again in (
            _shaken_best(problem, before),
            told_beside(problem, before.fitted),
            *a_row_otherwise(problem),
        )
        if again is not problem
    ]
    every = [one for one in (*tried, late) if one is not None]
    found = min(every, key=lambda one: one[1].fitted.cost, default=None)
    if found is None:
        return None
    gained, stands_for = (before.fitted.cost - one.fitted.cost for one in (loaded, found[1]))
    return found if stands_for >= problem.policy.partly * gained else None


def a_row_otherwise(problem: Problem) -> list[Problem]:
    """The problem with its loop a row sooner, where that can be, and a row later; none where its law tells the row.

    A torque that is recorded a row late has a law that sees all a row late, along the recorded motion: nothing there
    tells which of them is late, and the twin's loop is as late as the law says. Along the motion such a torque is moved
    to where it acted; that delays no loop. One that is held from its own row on, as behind an exact law, is not moved.
    """
    law, row = problem.controller, problem.data.upsampling
    if law is None or law.exact or law.ticks > 1:
        return []
    delays = ((law.reference_delay + rows, law.position_delay + rows) for rows in (-row, row))
    return [
        replace(problem, controller=replace(law, reference_delay=reference, position_delay=position))
        for reference, position in delays
        if min(reference, position) >= 0
    ]


def _shaken_best(problem: Problem, model_fit: ModelFit) -> Problem:
    """The problem with its disturbance as loud as leaves least beside a model."""
    packed = model_fit.fitted.packed
    levels = [problem.disturbance.louder(part) for part in (1.0, *PARTS_ALONE, *LOUDNESS)]
    return _shaken_by(problem, level_of_least(problem, packed, levels), packed)


def _shaken_by(problem: Problem, disturbance: Disturbance, packed: Packed) -> Problem:
    """The problem with another disturbance, what counts and noise make of the twin with it, and what its law leaves."""
    again = with_misfit_again(replace(problem, disturbance=disturbance))
    if problem.by_counts is not None:
        again = with_counts(again, packed)
    return with_expected_noise(again, packed)


def settled_in(problem: Problem, model_fit: ModelFit) -> tuple[Problem, ModelFit] | None:
    """A model fitted anew in another problem; None where its twin is unstable there."""
    fitted = model_fit.fitted
    settled = fit_inside_twin(problem, fitted.packed, list(fitted.free), 2, model_fit.effects)
    return None if settled is None else (problem, settled)


def in_quieter_twin(
    problem: Problem, root: ModelFit, chosen: FittedCandidate
) -> tuple[Problem, FittedCandidate]:
    """Two masses fitted in twins that are shaken less, as long as these leave clearly less.

    A motor that its load lets go for a while answers to a torque by more than a rigid axis does. So a rigid twin must
    be shaken more for its repeats to differ as the axis's do, and a gap that is begun in it ends where it answers by
    as much: there the level is right again. What is left tells that it is not.
    """
    if not problem.twin or not problem.two_masses(chosen.model_fit.fitted.packed):
        return problem, chosen
    told = problem.disturbance
    for part in PARTS_ALONE:
        model_fit = chosen.model_fit
        packed, free = model_fit.fitted.packed, list(model_fit.free)
        quieter = with_expected_noise(replace(problem, disturbance=told.louder(part)), packed)
        settled = fit_inside_twin(quieter, packed, free, 4, model_fit.effects, model_fit.fitted)
        if settled is None or settled.fitted.cost > problem.policy.clearly_less * model_fit.fitted.cost:
            break
        problem = _counted_anew(quieter, root, packed)
        chosen = judged_again(problem, root, chosen, settled)
    return problem, chosen


def with_noise_of(problem: Problem, root: ModelFit) -> tuple[Problem, ModelFit]:
    """The twin disturbed as much as the axis is by another root, and that root settled in it."""
    packed = root.fitted.packed
    if not problem.twin:
        return problem, root
    again = _shaken_by(problem, estimate_disturbance(problem, packed), packed)
    settled = fit_inside_twin(again, packed, list(root.free), 2, root.effects, root.fitted)
    if settled is None or settled.fitted.cost > LEVEL_GROUND * root.fitted.cost:
        return problem, root
    return again, settled


def fitted_again(
    problem: Problem, root: ModelFit, candidates: Sequence[FittedCandidate]
) -> tuple[ModelFit, list[FittedCandidate | None]] | None:
    """All models fitted again after torque and motion were aligned anew: only so can they be compared.

    None for those whose twin is unstable there: what they left before says nothing of what is compared now. None at all
    where it is the root's: what a model explains counts from that.
    """
    before = fit_inside_twin(problem, root.fitted.packed, list(root.free), 2, root.effects)
    if before is None:
        return None
    again: list[FittedCandidate | None] = []
    for item in candidates:
        own = item.model_fit
        after = fit_inside_twin(problem, own.fitted.packed, list(own.free), 2, own.effects)
        again.append(None if after is None else judged_again(problem, before, item, after))
    return before, again


def without_insignificant_terms(problem: Problem, model_fit: ModelFit) -> ModelFit:
    """The model without the terms that it does not need, fitted again; the same where all are needed.

    One term of each effect stays: whether the effect itself is there is for others to judge.
    """
    spread = covariance(model_fit.fitted, problem.training)
    packed, free = model_fit.fitted.packed, model_fit.free
    for kind in EFFECTS.values():
        if kind.terms is not None and packed.on[flag(kind.name)]:
            keep = _significant(
                kind, kind.terms, packed, model_fit.free, spread, _chance(problem, packed, kind)
            )
            packed, free = kept_terms(kind, packed, free, keep)
    if len(free) == len(model_fit.free):
        return model_fit
    return fit_inside_twin(problem, packed, free, 2, model_fit.effects) or model_fit


def is_chance(problem: Problem, model_fit: ModelFit, kind: Kind) -> bool:
    """Whether no term of an effect that has terms is beyond what chance makes of noise in these data."""
    packed, places = model_fit.fitted.packed, {one.slot: i for i, one in enumerate(model_fit.free)}
    if kind.terms is None:
        return False
    spread, value = (
        covariance(model_fit.fitted, problem.training),
        packed.p[[one.slot for one in model_fit.free]],
    )
    least = float(scipy.stats.chi2.ppf(1.0 - _chance(problem, packed, kind), len(kind.terms.amplitudes)))
    slots = [
        [kind.slot(f"{part}_{n}") for part in kind.terms.amplitudes] for n in kind.terms_in_use(packed.p)
    ]
    return all(
        all(slot in places for slot in one) and _wald(value, spread, [places[slot] for slot in one]) <= least
        for one in slots
    )


def _chance(problem: Problem, packed: Packed, kind: Kind) -> float:
    """With which a term of noise alone would be kept."""
    chance = problem.policy.term_chance
    if kind is TORQUE_RIPPLE:  # the best of all orders that were looked at
        chance /= max(len(candidate_orders(problem, float(packed.p[scale_slot()]))), 1)
    return chance


def _significant(
    kind: Kind, terms: Terms, packed: Packed, free: tuple[Free, ...], spread: Floats, chance: float
) -> list[int]:
    """Terms to keep: those beyond chance, and those that were not fitted; at least the clearest of all.

    The weakest is taken out first, and the others are judged as they would be fitted without it: of two terms that
    stand for one thing, each seems needless beside the other.
    """
    places = {one.slot: i for i, one in enumerate(free)}
    kept = kind.terms_in_use(packed.p)
    slots = {n: [kind.slot(f"{part}_{n}") for part in terms.amplitudes] for n in kept}
    fitted = [n for n in kept if all(slot in places for slot in slots[n])]
    value = packed.p[[one.slot for one in free]]
    least = float(scipy.stats.chi2.ppf(1.0 - chance, len(terms.amplitudes)))
    while len(fitted) > (len(fitted) == len(kept)):
        worth = {n: _wald(value, spread, [places[slot] for slot in slots[n]]) for n in fitted}
        weakest = min(fitted, key=lambda n: worth[n])
        if worth[weakest] > least:
            break
        value, spread = _without(value, spread, *_places_of(kind, terms, weakest, places))
        fitted.remove(weakest)
        kept.remove(weakest)
    return kept


def _places_of(
    kind: Kind, terms: Terms, number: int, places: Mapping[int, int]
) -> tuple[list[int], list[int]]:
    """Where the amplitudes of a term are among the free parameters, and where all that belongs to it is."""
    own = {parameter.slot for parameter in kind.parameters if parameter.name.endswith(f"_{number}")}
    amplitudes = [places[kind.slot(f"{part}_{number}")] for part in terms.amplitudes]
    return amplitudes, [places[slot] for slot in own if slot in places]


def _wald(value: Floats, spread: Floats, at: list[int]) -> float:
    size = value[at]
    return float(size @ np.linalg.pinv(spread[np.ix_(at, at)], hermitian=True) @ size)


def _without(value: Floats, spread: Floats, amplitudes: list[int], own: list[int]) -> tuple[Floats, Floats]:
    """Values and covariance of a linear fit in which these amplitudes are 0; what is taken out varies no more."""
    change = np.zeros(len(value))
    change[amplitudes] = -value[amplitudes]
    share = spread[:, own] @ np.linalg.pinv(spread[np.ix_(own, own)], hermitian=True)
    return np.asarray(value + share @ change[own]), np.asarray(spread - share @ spread[own])


def kept_terms(
    kind: Kind, packed: Packed, free: tuple[Free, ...], keep: list[int]
) -> tuple[Packed, tuple[Free, ...]]:
    """The parameters with only the terms in `keep`, numbered anew from 1."""
    number_of = {old: new for new, old in enumerate(keep, 1)}
    p = packed.p.copy()
    moved: dict[int, int] = {}
    for parameter in kind.parameters:
        match = _TERM.match(parameter.name)
        if match is None:
            continue
        p[parameter.slot] = parameter.neutral
        if int(match["number"]) in number_of:
            moved[parameter.slot] = kind.parameter(f"{match['part']}_{number_of[int(match['number'])]}").slot
    for old, new in moved.items():
        p[new] = packed.p[old]
    names = {parameter.slot: kind.surface(parameter.name) for parameter in kind.parameters}
    own = {parameter.slot for parameter in kind.parameters if _TERM.match(parameter.name)}
    kept = tuple(
        replace(one, slot=moved[one.slot], name=names[moved[one.slot]]) if one.slot in own else one
        for one in free
        if one.slot not in own or one.slot in moved
    )
    return Packed(p, packed.on), kept
