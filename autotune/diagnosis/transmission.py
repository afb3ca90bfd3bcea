"""Spring or gap: which of two transmissions that look alike is between motor and load.

Backlash has a spring in its contact and one parameter more. As long as another effect is missing, a gap takes a part
of it over; and a small gap that is begun far from its size looks worse than a spring. So each is tried in the
other's place.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from autotune.core.arrays import Floats
from autotune.diagnosis.candidates import (
    FittedCandidate,
    Progress,
    error_left,
    explained_of_rest,
    explains_rest,
    leaves_about_as_little,
)
from autotune.diagnosis.refits import NEARLY, REFINED, judged, judged_again, refined, with_effects
from autotune.diagnosis.starts import Context, FitStart, led_on, scattered, scouted, starts_of, varying
from autotune.estimation.bias_corrected_fit import FreeAt, ModelFit, fit_from_starts, fit_inside_twin
from autotune.estimation.data import VETO
from autotune.estimation.least_squares import Free
from autotune.estimation.policy import Policy
from autotune.estimation.problem import Problem
from autotune.models import layout
from autotune.models.backlash import BACKLASH, damped_by_impact
from autotune.models.drive_model import Packed
from autotune.models.effect import Kind
from autotune.models.elastic_transmission import (
    CRITICAL,
    ELASTIC_TRANSMISSION,
    RESONANCES,
    creeps,
    hardened,
    relaxing,
)
from autotune.models.load_dependent_friction import LOAD_DEPENDENT_FRICTION
from autotune.models.load_side import AT_START, compliance_of_one_mass, ringing_compliance
from autotune.models.start_values import Vary
from autotune.models.transmission import BETWEEN

LOADS, PARTS = (0.0, 0.25, 0.5, 0.75, 1.0), (1.0, 0.25)
"""Of the torque, under which another contact gives way as far as the one before; and of the damping by impact, as
loads meet faster than friction alone lets them."""
HIT = 0.2
"""Of critical: what gaps of all sizes lose in an impact, where fits of contacts that are damped so begin."""
ADDED = (0.3, 1.0, 3.0)
"""Of a spring's stiffness without load, what the torque of the recordings adds to it where it hardens."""
SHARES, TURNS = (0.4, 1.0), (0.5, 2.0)
"""Of the stiffness that stays, what relaxes, and in how many radians of ringing."""
SPRING, GAP = ELASTIC_TRANSMISSION, BACKLASH
OF_THE_GAP = {"compliance": "contact_compliance"} | {
    name: name for name in ("load_inertia", "load_friction", "damping", "load_offset")
}
"""Parameters of a spring that begin at those of a gap."""
SIZES = ("compliance", "contact_compliance", "gap")
"""Of which starts have many, each with a scale and a step of its own."""


def without_needless_gap(problem: Problem, fits: Sequence[FittedCandidate]) -> list[FittedCandidate]:
    """The fits without backlash where an elastic transmission without a gap explains about as much."""
    found = {item.effect: item for item in fits}
    spring, gap = found.get(SPRING.name), found.get(GAP.name)
    if spring is None or gap is None or spring.share < NEARLY:
        return list(fits)
    times = problem.policy.spring_instead
    if not leaves_about_as_little(problem, spring.model_fit, gap.model_fit, times):
        return list(fits)
    return [item for item in fits if item is not gap]


def other_transmission_tried(
    problem: Problem,
    root: ModelFit,
    nominal: Packed,
    chosen: FittedCandidate,
    seen: Sequence[ModelFit],
    progress: Progress,
) -> FittedCandidate:
    """The chosen model with the other transmission, where that does better.

    A spring is tried for every gap; for what is hardly a gap it is taken wherever it has a name. A gap is tried for a
    spring where that alone does not explain enough, and the gap was not `seen` by itself. Of single ones with a twin
    each was looked for everywhere. A gap that was given up for a spring by another law is tried beside what was found
    since: as long as that was missing, the law took a part of it over.
    """
    effects, policy = chosen.model_fit.effects, problem.policy
    if GAP.name in effects:
        if hardly_a_gap(policy, chosen.model_fit):
            progress(f"{SPRING.name} in place of {GAP.name}")
            return plainer_of(problem, chosen, spring_in_place(problem, root, nominal, chosen, seen))
        if problem.twin and effects == (GAP.name,):
            return chosen
        exchange = _Exchange(GAP, SPRING, policy.spring_instead_beside)
    elif effects == (SPRING.name,) and not (
        problem.twin or chosen.named or any(one.effects == (GAP.name,) for one in seen)
    ):
        exchange = _Exchange(SPRING, GAP, policy.clearly_less)
    elif len(effects) > 1 and by_another_law(chosen.model_fit) and chosen.share < REFINED:
        exchange = _Exchange(SPRING, GAP, 1.0)
    else:
        return chosen
    if exchange.new not in problem.candidates:
        return chosen
    progress(f"{exchange.new.name} in place of {exchange.old.name}")
    return exchange.tried(problem, root, nominal, chosen, seen)


def spring_in_place(
    problem: Problem, root: ModelFit, nominal: Packed, chosen: FittedCandidate, seen: Sequence[ModelFit] = ()
) -> FittedCandidate | None:
    """The chosen model with a spring where it has hardly a gap; None where it has no such thing, or none was found.

    Of the gap's contact and the springs of models `seen` that begins which costs least: a load that gives way in a
    small gap too is heavier and harder on a spring alone, and no few steps lead there from the contact.
    """
    policy = problem.policy
    if not hardly_a_gap(policy, chosen.model_fit) or SPRING not in problem.candidates:
        return None
    return _Exchange(GAP, SPRING, policy.spring_instead).fitted(problem, root, nominal, chosen, seen)


def with_springs(
    problem: Problem,
    root: ModelFit,
    nominal: Packed,
    fits: Sequence[FittedCandidate],
    seen: Sequence[ModelFit],
) -> list[FittedCandidate]:
    """The fits with a spring in the place of their gap, as what was chosen beside it has one now: only so can they be
    compared with that. Those without a gap as they are; none whose twin is unstable.
    """
    exchange = _Exchange(GAP, SPRING, problem.policy.spring_instead)
    again = [
        exchange.fitted(problem, root, nominal, one, seen) if GAP.name in one.model_fit.effects else one
        for one in fits
    ]
    return [one for one in again if one is not None]


def gap_is_told(problem: Problem, chosen: FittedCandidate, spring: FittedCandidate) -> bool:
    """Whether what is hardly a gap is one all the same: a spring in its place has no name, and is left far behind.

    Of what the spring leaves the gap explains as much as a name asks of all, on training and on the veto trajectory. A
    contact that gives way by more than its gap still parts; a spring by another law does not predict that.

    Where the spring explains less than half on one of them, all is left, and the gap must explain that of all. So bad
    is no spring by another law: as one whose compliance changes by a factor r with its load it leaves at most
    ((r - 1)/(r + 1))² of what it does, half for r = 6. What gives way six times as much unloaded has play.
    """
    if spring.named or not problem.has(VETO):
        return False
    if spring.share < problem.policy.partly:
        return chosen.share >= problem.policy.named
    parts = explained_of_rest(problem, spring.model_fit, chosen.model_fit)
    return all(part.plain_share >= problem.policy.named for part in parts)


def plainer_of(problem: Problem, gap: FittedCandidate, spring: FittedCandidate | None) -> FittedCandidate:
    """The spring in place of what is hardly a gap, where it has a name or leaves about as little; else the gap."""
    if spring is None:
        return gap
    times = problem.policy.spring_instead
    plain = spring.named or leaves_about_as_little(problem, spring.model_fit, gap.model_fit, times)
    return spring if plain else gap


def hardly_a_gap(policy: Policy, model_fit: ModelFit) -> bool:
    """Whether there is backlash that gives way in its contact by far more than its gap already at Coulomb friction."""
    if GAP.name not in model_fit.effects:
        return False
    p = model_fit.fitted.packed.p
    twist = p[GAP.slot("contact_compliance")] * p[layout.COULOMB]
    return bool(p[GAP.slot("gap")] < policy.hardly_a_gap * twist)


def adds_nothing(kind: Kind, model_fit: ModelFit) -> bool:
    """Whether it is a spring beside a gap, or a gap beside a spring: a gap has one in its contact.

    The two are one model, that of the gap, which was looked for by itself.
    """
    return (kind is SPRING and GAP.name in model_fit.effects) or (
        kind is GAP and SPRING.name in model_fit.effects
    )


def by_another_law(model_fit: ModelFit) -> bool:
    """Whether it has a spring that was free to harden or to relax."""
    own = {SPRING.slot(name) for name in ("hardening", "relaxing")}
    return any(one.slot in own for one in model_fit.free)


def pressed_transmission(model_fit: ModelFit) -> str:
    """The transmission beside friction that grows with the torque that it passes on; empty without either."""
    pressed = LOAD_DEPENDENT_FRICTION.name in model_fit.effects
    return next((k.name for k in (SPRING, GAP) if pressed and k.name in model_fit.effects), "")


def stiff_as_well(problem: Problem, less: ModelFit, model_fit: ModelFit) -> bool:
    """Whether a spring that no sample could see, damped critically and without a gap, does half of what the model's
    transmission does beyond a model that has `less`.

    Motor and load in one piece still are two sides: the load's part of inertia, friction and constant torque presses,
    the motor's does not. That is another law of what presses, and no elasticity.
    """
    fitted = model_fit.fitted
    p = fitted.packed.p.copy()
    spring = SPRING.name in model_fit.effects
    kind: Kind = GAP
    names: tuple[str, ...] = ("contact_compliance", "damping", "gap", "impact_damping")
    if spring:
        kind, names = SPRING, ("compliance", "damping", "hardening", "relaxing", "relaxation_time")
    held = [kind.slot(name) for name in names]
    p[held] = [kind.parameter(name).neutral for name in names]
    p[held[:2]] = compliance_of_one_mass(float(p[layout.INERTIA]), problem.data.period), CRITICAL
    free = [one for one in model_fit.free if one.slot not in held]
    stiff = fit_inside_twin(problem, Packed(p, fitted.packed.on), free, 4, model_fit.effects)
    if stiff is None:
        return False
    gained = less.fitted.cost - fitted.cost
    return less.fitted.cost - stiff.fitted.cost >= problem.policy.partly * gained


def other_contact_tried(
    problem: Problem, root: ModelFit, chosen: FittedCandidate, progress: Progress
) -> FittedCandidate:
    """The chosen model with a harder or softer contact in its gap, damped otherwise, where that does clearly better.

    The size of a gap and the spring behind it make the same course of the torque as long as the gap is small, so that
    a fit may end with the one in the place of the other. And surfaces that meet touch in a point first, so that the
    damping grows with the torque, while a damper beside the spring has all of its own at once: what is left of that
    makes a motor rattle in its gap, or rest. Contacts of that kind are begun at gaps of all sizes, too, as a damper
    hides which of them it is. What does better is led on from there.
    """
    begun, model_fit = chosen, chosen.model_fit
    if GAP.name not in model_fit.effects:
        return chosen
    progress(f"another contact of {GAP.name}")
    least = problem.policy.clearly_less
    for impact in (False, True):
        free = _free_with(model_fit, impact)
        slots = {GAP.slot(name) for name in (*OF_THE_GAP.values(), "gap", "impact_damping")}
        moved = tuple(one for one in free if one.slot in slots)
        contacts = _contacts(problem, model_fit.fitted.packed, impact)
        led = [
            start.packed for start in scouted(problem, model_fit, [FitStart(one, moved) for one in contacts])
        ]
        if impact:
            sizes = _of_all_sizes(problem, root, model_fit.fitted.packed)
            begun_at = [FitStart(one, moved) for one in sizes]
            led += [start.packed for start in scouted(problem, model_fit, begun_at, instead=True)]
        target = least * chosen.model_fit.fitted.cost
        settled = fit_from_starts(problem, led, 0.0, free, model_fit.effects, target)
        chosen = _instead(problem, root, chosen, settled, least)
    if chosen is begun:
        return chosen
    return masses_led_on(problem, root, refined(problem, root, chosen, progress), progress)


def other_spring_tried(
    problem: Problem,
    root: ModelFit,
    nominal: Packed,
    chosen: FittedCandidate,
    gains: Mapping[str, float],
    seen: Sequence[ModelFit],
    progress: Progress,
) -> tuple[FittedCandidate, FittedCandidate | None]:
    """The chosen model with a spring that hardens, or a part of which relaxes, where that does better; and the best of
    such springs where it was a gap that did better.

    A gap is what hardens most of all: a spring that hardens looks like one, and one that does not gains half as much.
    So they are tried in place of a gap where a spring does that, by the `gains` of effects by themselves, and of what
    is hardly a gap. One that hardens has as many parameters as a gap. In place of a spring it has one more, and must
    leave clearly less, or earn a name that the spring has not; so must one that relaxes. A spring by whatever law
    explains half. One that leaves no more and rings is taken before one on which the load only creeps: a damper takes
    up what is not in a straight line.
    """
    policy, model_fit = problem.policy, chosen.model_fit
    if not problem.twin:
        return chosen, None
    if GAP.name in model_fit.effects:
        rival = gains.get(SPRING.name, 0.0) >= policy.partly * gains.get(GAP.name, math.inf)
        if SPRING not in problem.candidates or not (rival or hardly_a_gap(policy, model_fit)):
            return chosen, None
        progress(f"{SPRING.name} by another law")
        return _held_against_springs(problem, root, nominal, chosen, seen)
    if SPRING.name not in model_fit.effects or not policy.partly <= chosen.share < REFINED:
        return chosen, None
    progress(f"another law of {SPRING.name}")
    place = model_fit.fitted.packed
    least, creeping = policy.clearly_less, creeps(place.p, place.on)
    for law in (_hardening(problem, [place]), _relaxing([place])):
        settled = _other_spring(problem, model_fit, law, lambda _: model_fit.free, model_fit.effects)
        better = _instead(problem, root, chosen, settled, 1.0)
        if better is chosen:
            continue
        rings = creeping and not creeps(better.model_fit.fitted.packed.p, place.on)
        if not rings and error_left(problem, better.model_fit) > least * error_left(problem, model_fit):
            better = _if_it_earns_the_name(problem, root, chosen, better, progress)
        if better is not chosen:
            return better, None
    return chosen, None


def _if_it_earns_the_name(
    problem: Problem,
    root: ModelFit,
    chosen: FittedCandidate,
    other: FittedCandidate,
    progress: Progress,
) -> FittedCandidate:
    """A spring by another law, led on, in place of one without a name, where it has one and explains half of its rest.

    In noise what comes again of that rest is little of the error, and nobody can leave clearly less.
    """
    if chosen.named:
        return chosen
    led = refined(problem, root, masses_led_on(problem, root, other, progress), progress)
    return led if led.named and explains_rest(problem, chosen, led) else chosen


def _held_against_springs(
    problem: Problem, root: ModelFit, nominal: Packed, gap: FittedCandidate, seen: Sequence[ModelFit]
) -> tuple[FittedCandidate, FittedCandidate | None]:
    """The model with a spring by another law in place of its gap, where that does better; else the gap and the best
    of them, each begun as soft as contact and gap are together under several loads, and where one was `seen`.
    """
    model_fit, exchange = gap.model_fit, _Exchange(GAP, SPRING, 1.0)
    (soft, *_), free, effects = exchange.begun(problem, root, nominal, model_fit)
    places = [one.fitted.packed for one in seen if one.effects == effects][-1:]
    places += [_as_soft(problem, model_fit.fitted.packed, soft, load) for load in LOADS if load > 0.0]
    found: list[FittedCandidate] = []
    laws = [(_hardening(problem, places), 1.0)]
    if gap.plain_share < REFINED:
        laws.append((_relaxing(places), problem.policy.clearly_less))
    for law, least in laws:
        settled = _other_spring(problem, model_fit, law, free, effects)
        if settled is None:
            continue
        other = judged(problem, root, settled, exchange.leads(gap)).with_courses_of(gap)
        found.append(replace(other, gain=gap.gain))
        if error_left(problem, settled) <= least * error_left(problem, model_fit):
            return found[-1], None
    return gap, min(found, key=lambda one: error_left(problem, one.model_fit), default=None)


@dataclass(frozen=True, slots=True)
class _Law:
    """Another law of a spring: where its fits begin, and what is free beside the spring's own parameters."""

    starts: tuple[Packed, ...]
    free: tuple[Free, ...]


def _hardening(problem: Problem, places: Sequence[Packed]) -> _Law:
    """Springs that harden, and give way as far as those of `places` under the torque of the recordings."""
    at = problem.scales.torque
    begun = [
        _spring(
            place, ("compliance", "hardening"), hardened(float(place.p[SPRING.slot("compliance")]), at, added)
        )
        for place, added in itertools.product(places, ADDED)
    ]
    largest = hardened(1.0, at, max(ADDED))[1]
    return _Law(tuple(begun), (varying(SPRING, "hardening", Vary(largest, largest)),))


def _relaxing(places: Sequence[Packed]) -> _Law:
    """Springs a part of which relaxes, as stiff and as damped as those of `places` where motor and load ring."""
    begun = [
        (place, relaxing(place.p, share, turns))
        for place, share, turns in itertools.product(places, SHARES, TURNS)
    ]
    longest = max(values["relaxation_time"] for _, values in begun)
    free = (
        varying(SPRING, "relaxing", Vary(max(SHARES), max(SHARES))),
        varying(SPRING, "relaxation_time", Vary(longest, longest)),
    )
    return _Law(tuple(_spring(place, tuple(one), tuple(one.values())) for place, one in begun), free)


def _other_spring(
    problem: Problem,
    model_fit: ModelFit,
    law: _Law,
    free: FreeAt,
    effects: tuple[str, ...],
) -> ModelFit | None:
    """The fit of the model with a spring by another law, led to its best in the place of what there is between the
    masses; None where its twin is unstable.
    """
    own = {one.slot for one in law.free}
    slots = {parameter.slot for parameter in SPRING.parameters}

    def free_at(packed: Packed) -> list[Free]:
        return [*(one for one in free(packed) if one.slot not in own), *law.free]

    starts = [FitStart(at, tuple(one for one in free_at(at) if one.slot in slots)) for at in law.starts]
    led = [one.packed for one in scouted(problem, model_fit, starts, instead=True)]
    return fit_from_starts(problem, led, 0.0, free_at, effects)


def _spring(place: Packed, names: Sequence[str], values: Sequence[float]) -> Packed:
    """The same model with other values of its spring."""
    p = place.p.copy()
    p[[SPRING.slot(name) for name in names]] = values
    return Packed(p, place.on)


def _as_soft(problem: Problem, gap: Packed, spring: Packed, load: float) -> Packed:
    """A model with a spring that gives way as far under so much of the torque of the recordings as contact and gap."""
    p = spring.p.copy()
    p[SPRING.slot("compliance")] += 0.5 * gap.p[GAP.slot("gap")] / (load * problem.scales.torque)
    return Packed(p, spring.on)


def _may_move(problem: Problem, model_fit: ModelFit) -> bool:
    """Whether a twin follows two masses of which something between them is free."""
    free = any(one.slot in BETWEEN for one in model_fit.free)
    return free and problem.twin and problem.two_masses(model_fit.fitted.packed)


def masses_led_on(
    problem: Problem, root: ModelFit, chosen: FittedCandidate, progress: Progress
) -> FittedCandidate:
    """The chosen model with two masses, the fit led on by twins from where it stopped, where that comes lower.

    Across its valley too while it has no name: there a fit that stops short makes a true one nameless.
    """
    model_fit = chosen.model_fit
    if not _may_move(problem, model_fit):
        return chosen
    progress("motor and load led on")
    packed = led_on(problem, model_fit, across=not chosen.named)
    settled = fit_inside_twin(problem, packed, list(model_fit.free), 2, model_fit.effects)
    if settled is None or settled.fitted.cost >= model_fit.fitted.cost:
        return chosen
    return replace(judged_again(problem, root, chosen, settled), gain=chosen.gain)


def masses_scattered(
    problem: Problem, root: ModelFit, chosen: FittedCandidate, progress: Progress
) -> FittedCandidate:
    """The chosen model with two masses, fitted anew from places around where it stopped, where that explains more.

    What does not come again is most of the error in some experiments, and the valley that costs least is not the one
    that leaves least of what comes again.
    """
    model_fit = chosen.model_fit
    if not _may_move(problem, model_fit):
        return chosen
    progress("motor and load fitted from elsewhere")
    best = chosen
    for packed in scattered(problem, model_fit):
        settled = fit_inside_twin(problem, packed, list(model_fit.free), 2, model_fit.effects)
        if settled is not None:
            other = replace(judged_again(problem, root, chosen, settled), gain=chosen.gain)
            best = other if other.training.share > best.training.share else best
    return chosen if best is chosen else masses_led_on(problem, root, best, progress)


def _free_with(model_fit: ModelFit, impact: bool) -> list[Free]:
    """What is free of a gap's model, the damping per torque of its contact too where that is asked for."""
    slot, p = GAP.slot("impact_damping"), model_fit.fitted.packed.p
    free = [one for one in model_fit.free if one.slot != slot]
    large = damped_by_impact(p, AT_START["damping"])
    return [*free, varying(GAP, "impact_damping", Vary(large, large))] if impact else free


def _contacts(problem: Problem, packed: Packed, impact: bool) -> list[Packed]:
    """The model with other contacts in its gap, which is as wide as it was, or gives way as far in all under a load."""
    contacts = []
    slots = [GAP.slot(name) for name in ("gap", "contact_compliance", "damping", "impact_damping")]
    share, (gap, at) = packed.p[GAP.slot("load_inertia")], packed.p[slots[:2]]
    for ratio, load in itertools.product(RESONANCES, LOADS):
        compliance = ringing_compliance(packed.p[layout.INERTIA], share, ratio * problem.data.cutoff)
        width = gap + 2.0 * load * problem.scales.torque * (at - compliance)
        if width <= 0.0:
            continue
        p = packed.p.copy()
        p[slots] = width, compliance, AT_START["damping"], 0.0
        found = [_hit(p, AT_START["damping"], part) for part in PARTS] if impact else [p]
        contacts += [Packed(one, packed.on) for one in found]
    return contacts


def _of_all_sizes(problem: Problem, root: ModelFit, packed: Packed) -> list[Packed]:
    """A model with the gaps of all sizes at which fits begin, in contacts that are damped by their torque.

    With a damper beside its spring the true gap may leave more than a narrower one in a harder contact does, from which
    no step leads to it: of 48 µm by Hunt and Crossley's law, 11 µm explained 68 %, the true width 50, and damped by its
    impact 95.
    """
    begun = [start.packed for start in starts_of(GAP, Context(problem, root.fitted, root.fitted.packed))]
    damping = GAP.slot("damping")
    least = min((one.p[damping] for one in begun), default=0.0)
    sizes = [one for one in begun if one.p[damping] == least]  # one of those that differ by a damper only
    models = [with_effects(packed, one, (GAP.name,)) for one in sizes]
    return [Packed(_hit(model.p, HIT), model.on) for model in models]


def _hit(p: Floats, damping: float, part: float = 1.0) -> Floats:
    """The same gap in a contact that is damped by its torque, by a part of what that share of critical takes from an
    impact, and not by a damper beside its spring."""
    found = p.copy()
    found[[GAP.slot("damping"), GAP.slot("impact_damping")]] = 0.0, part * damped_by_impact(p, damping)
    return found


def _instead(
    problem: Problem, root: ModelFit, chosen: FittedCandidate, settled: ModelFit | None, least: float
) -> FittedCandidate:
    """Another model in place of the chosen one where it leaves at most `least` of its error."""
    if settled is None or error_left(problem, settled) > least * error_left(problem, chosen.model_fit):
        return chosen
    return replace(judged_again(problem, root, chosen, settled), gain=chosen.gain)


def _as_large(start: FitStart, packed: Packed) -> list[Free]:
    """What is free of a start, with scales and steps as if the sizes in a model were where it began.

    The last of all starts is the hardest spring or the widest gap, up to some hundred times as hard or as wide as where
    a fit begins: by its steps that hardly moves, or leaves its valley at once.
    """
    found = []
    for one in start.free:
        told, size = (float(model.p[one.slot]) for model in (start.packed, packed))
        sized = one.name.rpartition(".")[2] in SIZES and told > 0.0 and size > 0.0
        times = size / told if sized else 1.0
        found.append(replace(one, scale=times * one.scale, step=times * one.step))
    return found


class _Exchange:
    """One transmission in place of the `old` one, if that leaves at most `least` of the error."""

    def __init__(self, old: Kind, new: Kind, least: float) -> None:
        self.old, self.new, self.least = old, new, least

    def tried(
        self,
        problem: Problem,
        root: ModelFit,
        nominal: Packed,
        chosen: FittedCandidate,
        seen: Sequence[ModelFit],
    ) -> FittedCandidate:
        """The model with the new one where that is better, else the chosen one."""
        other = self.fitted(problem, root, nominal, chosen, seen)
        least = self.least * error_left(problem, chosen.model_fit)
        return chosen if other is None or error_left(problem, other.model_fit) > least else other

    def fitted(
        self,
        problem: Problem,
        root: ModelFit,
        nominal: Packed,
        chosen: FittedCandidate,
        seen: Sequence[ModelFit] = (),
    ) -> FittedCandidate | None:
        """The model with the new one, begun where models `seen` have it too; None where its twin is unstable."""
        model_fit = chosen.model_fit
        starts, free, effects = self.begun(problem, root, nominal, model_fit)
        starts += [one.fitted.packed for one in seen if one.effects == effects]
        if self.new is GAP:
            alone = [one.fitted.packed for one in seen if one.effects == (GAP.name,)]
            beside = [with_effects(model_fit.fitted.packed, one, (GAP.name,)) for one in alone]
            starts += [self._start(one, root) for one in beside]
        target = max(self.least, 1.0) * model_fit.fitted.cost if self.new is GAP else math.inf
        settled = fit_from_starts(problem, starts, 0.0, free, effects, target)
        if settled is None:
            return None
        other = judged(problem, root, settled, self.leads(chosen)).with_courses_of(chosen)
        return replace(other, gain=chosen.gain)

    def leads(self, chosen: FittedCandidate) -> str:
        """The effect that leads with the new one in place of the old one."""
        return self.new.name if chosen.effect == self.old.name else chosen.effect

    def begun(
        self, problem: Problem, root: ModelFit, nominal: Packed, model_fit: ModelFit
    ) -> tuple[list[Packed], FreeAt, tuple[str, ...]]:
        """Where the model with the new one begins, what is free of it there, and its effects; a spring at one place."""
        begun = list(starts_of(self.new, Context(problem, model_fit.fitted, nominal)))
        starts = [self._start(start.packed, root) for start in (begun[:1] if self.new is SPRING else begun)]
        slots = {parameter.slot for parameter in self.old.parameters}
        kept, last = [one for one in model_fit.free if one.slot not in slots], begun[-1]

        def free_at(packed: Packed) -> list[Free]:
            return [*kept, *_as_large(last, packed)]

        return (
            starts,
            free_at,
            tuple(self.new.name if name == self.old.name else name for name in model_fit.effects),
        )

    def _start(self, start: Packed, root: ModelFit) -> Packed:
        """A start of the new one without the old one; a spring begins where the gap's contact is."""
        p, on = start.p.copy(), start.on.copy()
        for name, source in OF_THE_GAP.items() if self.new is SPRING else ():
            p[self.new.slot(name)] = p[self.old.slot(source)]
        slots = [parameter.slot for parameter in self.old.parameters]
        p[slots] = root.fitted.packed.p[slots]
        on[layout.flag(self.old.name)] = False
        return Packed(p, on)
