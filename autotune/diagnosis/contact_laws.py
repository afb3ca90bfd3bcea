"""The contact by elements: one or many that climb by another curve than a bristle, and the memory beyond them.

Elements may say that friction comes to its level by another curve than a bristle's exponential: one contact, elastic
until it slides, or many. That is a law of the base (`base_laws`) and no memory; what goes on beyond is one.

A memory that is one is resolved down to the first contacts that let go. A search adds a few elements beside the single
bristle, which then stands for all short ones at once: an exponential F·(1 − e^(−x/g)) where the axis has a chain of
straight pieces. That names the effect, but a feedforward built on it is wrong by several mN m in the first milliradians
after every reversal. Here the bristle is taken apart into elements of its own, started on its virgin curve, and
everything is fitted again inside the twin: torques and displacements of all elements, and whether they yield before
they slide, for a memory is as often one that is forgotten on the way (Dahl's, Bouc and Wen's) as one that is wiped out.
What the elements carry at rest together, with what is left of the bristle, is the one stiffness that presliding and
Dahl's curve have in common.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from autotune.core.arrays import Floats
from autotune.diagnosis.candidates import Asked, asked_for
from autotune.diagnosis.refits import kept_terms, without_effect
from autotune.estimation.bias_corrected_fit import ModelFit, fit_inside_twin
from autotune.estimation.contact_start import usual_damping
from autotune.estimation.cross_validation import gain_and_z, held_out
from autotune.estimation.data import VETO
from autotune.estimation.least_squares import Fitted, Free, standard_errors
from autotune.estimation.problem import Problem, refit, refits
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.reversal_memory import (
    AT_ONCE,
    ATTRACTION,
    DAMPING,
    ELEMENTS,
    REMEMBERS,
    REVERSAL_MEMORY,
    YIELDING,
    as_one_bristle,
    beyond_a_decade,
    climbing,
    closes_loops,
    contact_remembers,
    of_contacts,
    of_many_contacts,
    of_one_contact,
    share_damping,
)
from autotune.models.stribeck import FALLS

EFFECT = REVERSAL_MEMORY.name
NEW_ELEMENTS = 3
NEAREST, FARTHEST = 0.2, 1.4  # of the bristle's reach
LEAST_COUNTS = 3.0
KEPT = 0.1  # of the bristle
SPENT = 0.05  # of all friction: a bristle that carries less is not taken apart
HALF = 0.5
"""Of its stiffness: what an element loses where a fit begins in which it may yield."""
IDLE = 0.01  # of all friction: an element that carries less is given up
MOST_OF_A_BRISTLE = (
    0.5  # of all friction: beside a contact that lets go at once; one that is more is the contact
)
ROUNDS = 2
MORE_FITS = 3
LONGEST = 0.3  # of the travel: elements beyond it never slide
SHORT = 3
"""Steps of a fit by which its start is judged."""
PARTS = ((0.05, 0.05), (1.4, 0.3))
"""Of a bristle's reach and of its level: where elements of a climb begin, and what they carry."""
SHORTEST, SHORTER, ROOM = 0.1, 0.3, 3.0
"""Times where an element begins: how short it may become, of a climb and of a memory, and how long."""
BEYOND = (1.5, 5.0)
"""Times the way on which a contact climbs: where elements would go on that are memory."""
ELEMENT_SLOTS = tuple(parameter.slot for parameter in REVERSAL_MEMORY.parameters)
LINKS, MORE_LINKS = (0.5, 1.2), (0.3, 0.7, 1.2, 2.0)
"""Of a bristle's reach: where the contacts of a chain let go that take its place, and those of a finer one."""
MANY_LINKS = tuple(0.1 * 60.0 ** (i / 7.0) for i in range(8))
"""The same of a sum of many contacts, over a decade and a half."""
FASTEST_SEEN, SLOWEST_SEEN = 2.0 * np.pi, 0.01
"""Of the frequency up to which rows are compared, and of that rate: what is faster is at once, and what is slower is no
part of a contact that lets go."""
LEAST_LEVEL = 1e-3
"""Of all friction: what is left of the bristle at least, where a chain is in its place."""


@dataclass(frozen=True, slots=True)
class _Element:
    """One elastic element: travel until it slides [motion unit], and what it carries then [N m or N]."""

    displacement: float
    torque: float


def curved(packed: Packed) -> bool:
    """Whether the contact bends by another curve than a bristle's."""
    return bool(packed.p[layout.BENDS_BACK] > 0.0)


def creeps(packed: Packed) -> bool:
    """Whether the contact has no static friction."""
    return bool(packed.p[layout.CREEP_VELOCITY] > 0.0)


def climbs_otherwise(packed: Packed) -> bool:
    """Whether the friction of one contact, or of many, climbs after a rest by another curve than an exponential."""
    return contact_remembers(packed.p, packed.on)


def of_many(packed: Packed) -> bool:
    """Whether that is the sum of many contacts, which close small loops where they began."""
    return bool(packed.on[REMEMBERS]) and of_many_contacts(packed.p)


def with_climb(problem: Problem, model_fit: ModelFit, asked: Asked = asked_for) -> ModelFit | None:
    """The model with elements that make its contact climb by another curve; None where the data do not ask for it.

    A part of friction that is there at once, as of a contact too short to be seen, and one that lets go where the
    bristle is bent: what powers of Dahl's law, elastic-then-plastic contacts and chains of them have in common. Or the
    bristle taken apart into a chain of contacts that are damped as long as they stick, as the generalised Maxwell-slip
    model has it, and into a sum of many where that predicts better. None where elements would go on beyond that
    contact: that is memory.
    """
    fitted = model_fit.fitted
    known = {layout.COULOMB, layout.STIFFNESS, layout.MICRO_DAMPING} <= {one.slot for one in model_fit.free}
    there = fitted.packed.on[REMEMBERS] or curved(fitted.packed) or creeps(fitted.packed)
    there = there or problem.two_masses(fitted.packed)
    if there or not known or problem.data.steady:
        return None
    starts = [(*start, None) for start in (_with_parts(model_fit), _as_chain(problem, model_fit, LINKS))]
    shorts = refits(problem, starts, model_fit.correction, SHORT)
    least = (1.0 - problem.policy.least_gain) * fitted.cost
    climbs = _one_contact(problem, model_fit, [short for short in shorts if short.cost < least])
    if climbs is not None and (not asked(problem, model_fit, climbs) or remembers_beyond(problem, climbs)):
        climbs = None
    if climbs is not None:
        climbs = _with_more_links(problem, model_fit, climbs) or climbs
    return _of_many(problem, model_fit, climbs or model_fit) or climbs


def _of_many(problem: Problem, model_fit: ModelFit, before: ModelFit) -> ModelFit | None:
    """The model with its bristle taken apart into many contacts, where it predicts better than another; else None.

    How far the last of them goes is told by ways of their own: two places of the raster are nearly a factor of two
    apart, and between them lies what a decade is.
    """
    short = refit(problem, *_as_chain(problem, model_fit, MANY_LINKS, held=True), model_fit.correction, SHORT)
    least = (1.0 - problem.policy.least_gain) * before.fitted.cost
    if short.cost > least or not closes_loops(short.packed.p):
        return None
    many = fit_inside_twin(problem, short.packed, list(short.free), ROUNDS + 1, model_fit.effects)
    if many is None or not closes_loops(many.fitted.packed.p) or not asked_for(problem, before, many):
        return None
    own = _after_own_ways(problem, many)
    if own is not None and not of_contacts(own.fitted.packed.p):
        return None
    many = own if own is not None and of_many(own.fitted.packed) else many
    told = of_many(many.fitted.packed) and _may_go_on(problem, many.fitted.packed.p)
    return many if told and _slides(problem, many) and not remembers_beyond(problem, many) else None


def _may_go_on(problem: Problem, p: Floats) -> bool:
    """Whether many contacts end within a decade, or the encoder shows that no part of what goes on beyond it forgets.

    On a way that it cannot see a bristle and elements are one, and what goes on may be a memory beside a bristle.
    """
    _, reach = as_one_bristle(p)
    return not beyond_a_decade(p) or reach > problem.policy.least_counts * problem.data.resolution


def _after_own_ways(problem: Problem, many: ModelFit) -> ModelFit | None:
    """A model whose elements let go after ways of their own, whatever it is then; None where it predicts no better."""
    p = many.fitted.packed.p
    level, _ = as_one_bristle(p)
    present = enumerate(_present(p), 1)
    ways = [_element_free(i, one.displacement, level, SHORTER * one.displacement)[0] for i, one in present]
    own = fit_inside_twin(problem, many.fitted.packed, [*many.free, *ways], ROUNDS, many.effects)
    return own if own is not None and asked_for(problem, many, own) else None


def _with_more_links(problem: Problem, model_fit: ModelFit, climbs: ModelFit) -> ModelFit | None:
    """A chain of more contacts, where it predicts better than the model that `climbs`; else None."""
    if climbs.fitted.packed.p[DAMPING] == 0.0:
        return None
    short = refit(problem, *_as_chain(problem, model_fit, MORE_LINKS), model_fit.correction, SHORT)
    finer = _one_contact(problem, model_fit, [short])
    return finer if finer is not None and asked_for(problem, climbs, finer) else None


def _one_contact(problem: Problem, model_fit: ModelFit, near: Sequence[Fitted]) -> ModelFit | None:
    """Of several fits the lowest that is one contact inside the twin."""
    for short in sorted(near, key=lambda one: one.cost):
        climbs = fit_inside_twin(problem, short.packed, list(short.free), ROUNDS + 1, model_fit.effects)
        if climbs is not None and of_one_contact(climbs.fitted.packed.p) and _slides(problem, climbs):
            return climbs
    return None


def _slides(problem: Problem, model_fit: ModelFit) -> bool:
    """Whether all elements slide somewhere along the motion: one that never does is a spring by another name."""
    longest = LONGEST * problem.scales.travel
    return all(one.displacement <= longest for one in _present(model_fit.fitted.packed.p))


def _with_parts(model_fit: ModelFit) -> tuple[Packed, list[Free]]:
    """A start of elements beside the bristle, which keeps most of it."""
    packed = model_fit.fitted.packed
    p, on = packed.p.copy(), packed.on.copy()
    level, reach = _bristle(packed)
    on[REMEMBERS] = True
    p[layout.COULOMB] *= 1.0 - sum(share for _, share in PARTS)
    ways = [place * reach for place, _ in PARTS]
    more = [_element_free(i, way, level, SHORTEST * way) for i, way in enumerate(ways, 1)]
    for i, (place, share) in enumerate(PARTS, 1):
        p[_slot("displacement", i)], p[_slot("torque", i)] = place * reach, share * level
    return Packed(p, on), [*model_fit.free, *(one for pair in more for one in pair)]


def _bristle(packed: Packed) -> tuple[float, float]:
    """Level and reach of the bristle, without elements."""
    level = float(packed.p[layout.COULOMB])
    return level, level / float(packed.p[layout.STIFFNESS])


def _as_chain(
    problem: Problem, model_fit: ModelFit, links: Sequence[float], held: bool = False
) -> tuple[Packed, list[Free]]:
    """A start of elements in place of the bristle, on its virgin curve, with a damping of their own.

    `links`: of the bristle's reach, where elements slide; `held`: on a raster of so many that it need not be fitted.
    """
    packed = model_fit.fitted.packed
    level, reach = _bristle(packed)
    elements = _on_the_curve(level, reach, reach * np.array(links))
    started = _started(packed, elements)
    p, on = started.p, started.on.copy()
    on[REMEMBERS] = True
    p[layout.MICRO_DAMPING] = max(
        packed.p[layout.MICRO_DAMPING], usual_damping(level / reach, p[layout.INERTIA])
    )
    p[ATTRACTION] = AT_ONCE
    if on[FALLS]:
        p[layout.BREAK_AWAY] = p[layout.COULOMB] + _rise(packed)
        p[ATTRACTION] = FASTEST_SEEN * problem.data.cutoff
    share_damping(p, on)
    free = [_down_to(one, LEAST_LEVEL * level) for one in model_fit.free]
    for i, one in enumerate(elements, 1):
        way, torque = _element_free(i, one.displacement, level, SHORTER * one.displacement)
        free += [torque] if held else [torque, way]
    damping = REVERSAL_MEMORY.parameter("damping")
    scale = 0.3 * float(p[damping.slot])
    free.append(Free(REVERSAL_MEMORY.surface(damping.name), damping.slot, 0.0, damping.upper, scale, np.inf))
    return Packed(p, on), [*free, *([_attraction_free(float(p[ATTRACTION]))] if on[FALLS] else [])]


def _rise(packed: Packed) -> float:
    """By how much friction at rest is above that at speed, where it falls [N m or N]."""
    rise = packed.p[layout.BREAK_AWAY] - packed.p[layout.COULOMB]
    return max(float(rise), 0.0) if packed.on[FALLS] else 0.0


def _attraction_free(fastest: float) -> Free:
    """How fast elements follow a level that falls, as a free parameter, begun as fast as can be seen [1/s]."""
    attraction = REVERSAL_MEMORY.parameter("attraction")
    name = REVERSAL_MEMORY.surface(attraction.name)
    return Free(name, attraction.slot, SLOWEST_SEEN * fastest, AT_ONCE, fastest, relative=True)


def _element_free(number: int, place: float, level: float, shortest: float = 0.0) -> tuple[Free, Free]:
    """Displacement and torque of an element that begins at a place, as free parameters.

    `level` is all friction; an element slides after the `shortest` way or more.
    """
    torque, way = (REVERSAL_MEMORY.parameter(f"{part}_{number}") for part in ("torque", "displacement"))
    carried = 0.0, torque.upper, 0.1 * level, 0.5 * level
    slides = shortest, ROOM * place, 0.3 * place, 0.3 * place
    return (
        Free(REVERSAL_MEMORY.surface(way.name), way.slot, *slides),
        Free(REVERSAL_MEMORY.surface(torque.name), torque.slot, *carried),
    )


def is_a_memory(problem: Problem, climbs: ModelFit) -> bool:
    """Whether elements that were told as a contact's are a memory beside what was missing then.

    Once they let go after ways of their own they are none of one contact any more (those of many stand on a raster
    where nothing better was found), or they go on beyond it.
    """
    own = _after_own_ways(problem, climbs) if of_many(climbs.fitted.packed) and _on_a_raster(climbs) else None
    return (own is not None and not of_contacts(own.fitted.packed.p)) or remembers_beyond(problem, climbs)


def remembers_beyond(problem: Problem, climbs: ModelFit) -> bool:
    """Whether elements that go on where that contact slides would gain as much as an effect must."""
    p, (level, _) = climbs.fitted.packed.p.copy(), as_one_bristle(climbs.fitted.packed.p)
    _, way = climbing(p)
    free = list(climbs.free)
    for i, times in enumerate(BEYOND, len(_present(p)) + 1):
        p[_slot("displacement", i)], p[_slot("torque", i)] = times * way, 0.0
        free.append(_element_free(i, times * way, level)[1])
    longer = refit(problem, Packed(p, climbs.fitted.packed.on), free, climbs.correction, SHORT)
    gain, z = gain_and_z(climbs.unseen, held_out(problem, longer.error, longer.jacobian))
    return gain >= problem.policy.least_gain and problem.policy.no_chance(gain, z)


def _on_a_raster(climbs: ModelFit) -> bool:
    """Whether the ways after which its contacts let go are held."""
    ways = {_slot("displacement", i) for i in range(1, ELEMENTS + 1)}
    return not ways & {one.slot for one in climbs.free}


def without_climb(problem: Problem, model_fit: ModelFit) -> ModelFit | None:
    """The model with one bristle again; None where the twin is unstable."""
    p, on = model_fit.fitted.packed.p.copy(), model_fit.fitted.packed.on.copy()
    level, reach = as_one_bristle(p)
    rise = _rise(model_fit.fitted.packed)
    p[layout.COULOMB], p[layout.STIFFNESS] = level, level / reach
    p[layout.BREAK_AWAY] = level + rise if on[FALLS] else p[layout.BREAK_AWAY]
    p[layout.MICRO_DAMPING] += p[DAMPING]
    p[[*ELEMENT_SLOTS]], on[REMEMBERS] = 0.0, False
    free = [one for one in model_fit.free if one.slot not in ELEMENT_SLOTS]
    return fit_inside_twin(problem, Packed(p, on), free, ROUNDS, model_fit.effects)


def with_own_presliding(problem: Problem, root: ModelFit, chosen: ModelFit) -> ModelFit | None:
    """The root with the elements of a memory that is none: together they climb no longer than a bristle does.

    None where there is no such memory, or the twin is unstable without what else was found.
    """
    if EFFECT not in chosen.effects or not of_contacts(chosen.fitted.packed.p):
        return None
    if chosen.fitted.cost >= root.fitted.cost:
        return None
    for effect in chosen.effects:
        if effect != EFFECT:
            less = without_effect(problem, root, chosen, effect)
            if less is None:
                return None
            chosen = less.model_fit
    return replace(chosen, effects=root.effects)


def goes_on(problem: Problem, own: ModelFit) -> bool:
    """Whether elements of a memory that is none (`with_own_presliding`) go on where its contact has come to its level.

    So that experiments held out are predicted better by them, certain to one standard error.
    """
    kept = without_tail(problem, own)
    if kept is None:
        return False
    gain, z = gain_and_z(kept.unseen, own.unseen)
    return gain > 0.0 and z > 1.0


def without_tail(problem: Problem, own: ModelFit) -> ModelFit | None:
    """A root with elements (`with_own_presliding`) without those that go on where its contact has come to its level.

    What they carry while all slides the bristle carries, which may not go on so far where it is less than half of all.
    None where there are no such elements, or the twin is unstable without them.
    """
    packed = own.fitted.packed
    keep, way = climbing(packed.p)
    if not keep or len(keep) == len(_present(packed.p)):
        return None
    kept, free = kept_terms(REVERSAL_MEMORY, packed, own.free, keep)
    p, level = kept.p.copy(), as_one_bristle(packed.p)[0]
    p[layout.COULOMB] += level - as_one_bristle(p)[0]
    least = MOST_OF_A_BRISTLE * level / way
    p[layout.STIFFNESS] = max(p[layout.COULOMB] / _bristle(packed)[1], least)
    most = np.inf if _is_contact(own) else MOST_OF_A_BRISTLE * level
    p[layout.COULOMB] = min(p[layout.COULOMB], most)
    short = [
        replace(
            one,
            upper=min(one.upper, most) if one.slot == layout.COULOMB else one.upper,
            lower=least if one.slot == layout.STIFFNESS else one.lower,
        )
        for one in free
    ]
    return fit_inside_twin(problem, Packed(p, kept.on), short, ROUNDS + 1, own.effects)


def without_memory(problem: Problem, root: ModelFit, own: ModelFit) -> ModelFit | None:
    """The root with a contact of its own beside which elements (`with_own_presliding`) may be a memory.

    That without those that go on. But a bristle that is more than half of all friction is itself the contact, and no
    more elements are its own then than the law of one needs: many would be the memory that is asked for. None where
    there is no such contact, or nothing goes on beyond it.
    """
    if not _is_contact(own):
        return without_tail(problem, own)
    if not goes_on(problem, own):
        return None
    parts = refit(problem, *_with_parts(root), root.correction, SHORT)
    return _one_contact(problem, root, [parts])


def _is_contact(own: ModelFit) -> bool:
    """Whether most of all friction is the bristle's, so that elements beside it are not the contact."""
    p = own.fitted.packed.p
    return bool(p[layout.COULOMB] > MOST_OF_A_BRISTLE * as_one_bristle(p)[0])


def resolved(problem: Problem, model_fit: ModelFit) -> ModelFit | None:
    """The model with its bristle taken apart, of elements that may yield; None where unseen data say no better.

    Args:
        problem: of the diagnosis that named the effect.
        model_fit: the model with it.
    """
    best = _yields(problem, model_fit)
    for _ in range(ROUNDS):
        more = _taken_apart(problem, best or model_fit)
        if more is None:
            break
        best = more
    return best


def _yields(problem: Problem, model_fit: ModelFit) -> ModelFit | None:
    """The model whose elements yield before they slide; None where that is chance, or unseen data say no better."""
    packed = model_fit.fitted.packed
    if not packed.on[REMEMBERS] or packed.p[YIELDING] > 0.0:
        return None
    yielding = REVERSAL_MEMORY.parameter("yielding")
    p = packed.p.copy()
    p[YIELDING] = HALF
    free = _free(problem, model_fit, _present(p))
    free.append(Free(REVERSAL_MEMORY.surface(yielding.name), YIELDING, 0.0, yielding.upper, HALF, HALF))
    short = refit(problem, Packed(p, packed.on), free, model_fit.correction)
    if short.cost > (1.0 - problem.policy.least_gain) * model_fit.fitted.cost:
        return None
    more = _settled(problem, short.packed, free, model_fit.effects)
    if more is None or not _better(problem, model_fit, more):
        return None
    error = standard_errors(more.fitted, problem.training)[-1]
    return more if more.fitted.packed.p[YIELDING] > problem.policy.least_z * error else None


def _taken_apart(problem: Problem, model_fit: ModelFit) -> ModelFit | None:
    """One step of it; None where there is nothing left of the bristle, or no gain."""
    packed = model_fit.fitted.packed
    elements = _elements(problem, packed) if packed.on[layout.flag(EFFECT)] else []
    if not elements:
        return None
    more = _settled(
        problem, _started(packed, elements), _free(problem, model_fit, elements), model_fit.effects
    )
    return more if more is not None and _better(problem, model_fit, more) else None


def _better(problem: Problem, before: ModelFit, after: ModelFit) -> bool:
    """Whether elements of another kind explain experiments that were held out, and the veto trajectory."""
    if after.unseen.total > (1.0 - problem.policy.least_gain) * before.unseen.total:
        return False
    errors = [problem.mean_square(one.fitted.error, VETO) for one in (before, after)]
    return not problem.has(VETO) or errors[1] < errors[0]


def _settled(problem: Problem, packed: Packed, free: list[Free], effects: tuple[str, ...]) -> ModelFit | None:
    """Fits inside the twin until no more is gained: two elements that should be one find it slowly."""
    model_fit = fit_inside_twin(problem, packed, free, 2, effects)
    for _ in range(MORE_FITS):
        if model_fit is None:
            break
        again = fit_inside_twin(problem, model_fit.fitted.packed, free, 2, effects, model_fit.fitted)
        if again is None or again.fitted.cost >= model_fit.fitted.cost:
            break
        gained = model_fit.fitted.cost - again.fitted.cost > problem.policy.least_gain * model_fit.fitted.cost
        model_fit = again
        if not gained:
            break
    return model_fit


def _slot(part: str, number: int) -> int:
    return REVERSAL_MEMORY.parameter(f"{part}_{number}").slot


def _present(p: Floats) -> list[_Element]:
    pairs = [(p[_slot("displacement", i)], p[_slot("torque", i)]) for i in range(1, ELEMENTS + 1)]
    return [_Element(float(d), float(w)) for d, w in pairs if d > 0.0]


def _elements(problem: Problem, packed: Packed) -> list[_Element]:
    """Those that the bristle is taken apart into, then those that carry something already."""
    p = packed.p
    coulomb, reach = _bristle(packed)
    present = _present(p)
    friction = coulomb + sum(one.torque for one in present)
    if coulomb < SPENT * friction:
        return []
    longest = LONGEST * problem.scales.travel
    used = [one for one in present if one.torque > IDLE * friction and one.displacement < longest]
    places = np.geomspace(
        max(NEAREST * reach, LEAST_COUNTS * problem.data.resolution),
        max(FARTHEST * reach, 2.0 * LEAST_COUNTS * problem.data.resolution),
        max(min(NEW_ELEMENTS, ELEMENTS - len(used)), 1),
    )
    if len(used) >= ELEMENTS:
        return []
    return [*_on_the_curve(coulomb, reach, places), *used]


def _on_the_curve(coulomb: float, reach: float, places: Floats) -> list[_Element]:
    """Elements that slide at `places` and follow the bristle's virgin curve, less what is kept of it."""
    way = np.geomspace(0.05 * places[0], 4.0 * reach + places[-1], 200)
    columns = np.minimum(way[:, None] / places[None, :], 1.0)
    curve = coulomb * (1.0 - np.exp(-way / reach)) - KEPT * coulomb * (1.0 - np.exp(-way / places[0]))
    torques, _ = scipy.optimize.nnls(columns, curve)
    least = 1e-3 * coulomb
    return [_Element(float(d), max(float(w), least)) for d, w in zip(places, torques, strict=True)]


def _started(packed: Packed, elements: list[_Element]) -> Packed:
    p = packed.p.copy()
    for i in range(1, ELEMENTS + 1):
        p[_slot("displacement", i)] = p[_slot("torque", i)] = 0.0
    for i, one in enumerate(elements, 1):
        p[_slot("displacement", i)], p[_slot("torque", i)] = one.displacement, one.torque
    p[layout.COULOMB] *= KEPT
    p[layout.STIFFNESS] = p[layout.COULOMB] / elements[0].displacement
    p[layout.MICRO_DAMPING] *= 0.5
    p[layout.BREAK_AWAY] *= KEPT
    return Packed(p, packed.on)


def _down_to(one: Free, least: float) -> Free:
    """A free parameter; the bristle's level may come as low as that."""
    return replace(one, lower=min(one.lower, least)) if one.slot == layout.COULOMB else one


def _free(problem: Problem, model_fit: ModelFit, elements: list[_Element]) -> list[Free]:
    coulomb = float(model_fit.fitted.packed.p[layout.COULOMB])
    friction = coulomb + sum(one.torque for one in elements)
    free = [f for f in model_fit.free if f.slot not in ELEMENT_SLOTS or f.slot == YIELDING]
    free = [_down_to(f, LEAST_LEVEL * friction) for f in free]
    for i, one in enumerate(elements, 1):
        shortest = max(SHORTER * one.displacement, problem.data.resolution)
        way, torque = _element_free(i, one.displacement, friction, shortest)
        free += [torque, way]
    return free
