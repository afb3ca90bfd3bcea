"""Laws of the base, which every drive has and no effect is: found where the data ask for them, told, and never named.

Damping in presliding that fades with speed, and a Stribeck curve of another shape where the model has one, are asked
before anything else is. A contact may climb to its level by another curve than a bristle's exponential, or be many
(`contact_laws`). That is the law of the base and no memory.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from autotune.diagnosis.candidates import Asked, asked_for
from autotune.diagnosis.contact_laws import (
    ELEMENT_SLOTS,
    ROUNDS,
    SHORT,
    climbs_otherwise,
    creeps,
    curved,
    of_many,
    with_climb,
    without_climb,
)
from autotune.diagnosis.starts import Context, own_course, varying
from autotune.diagnosis.wording import (
    FADING_DAMPING,
    MANY_CONTACTS,
    NO_STATIC_FRICTION,
    OTHER_BENDING,
    OTHER_CLIMB,
    OTHER_CURVE,
    WIDE_CONTACTS,
)
from autotune.estimation.bias_corrected_fit import ModelFit, fit_inside_twin
from autotune.estimation.contact_start import CONTACT, best_contact, usually_damped
from autotune.estimation.least_squares import Fitted, Free
from autotune.estimation.problem import Problem, base_free, creep_free, curve_free, fading_free, refit, refits
from autotune.models import layout
from autotune.models.drive_model import BRISTLES_CURVE, CREEP, CURVE, FADING, Packed
from autotune.models.effect import Kind
from autotune.models.reversal_memory import beyond_a_decade
from autotune.models.table import EFFECTS

FADES = (3e-3, 1e-2, 3e-2, 1e-1)
"""Of the speed: where fits begin of a damping in presliding that fades."""
FADING_SLOTS = tuple(parameter.slot for parameter in FADING)
CREEP_SLOTS = tuple(parameter.slot for parameter in CREEP)
CREEPS = (1e-3, 3e-3, 1e-2, 3e-2)
"""Of the speed: where fits begin of friction that has no static part."""
CURVE_SLOTS = tuple(parameter.slot for parameter in CURVE)
ELASTIC_CURVE = (1.0, 1.0, 0.9, 0.4)
"""Of a contact that is elastic until it slides (`lugre.bends`)."""


def fades(packed: Packed) -> bool:
    """Whether the damping in presliding fades with speed."""
    return bool(packed.p[layout.DAMPING_VELOCITY] > 0.0)


def with_fading(problem: Problem, model_fit: ModelFit, asked: Asked = asked_for) -> ModelFit | None:
    """The model with damping in presliding that fades with speed; None where the data do not ask for it."""
    fitted = model_fit.fitted
    damped = any(one.slot == layout.MICRO_DAMPING for one in model_fit.free)
    if fades(fitted.packed) or not damped or problem.data.steady or problem.two_masses(fitted.packed):
        return None
    starts: list[tuple[Packed, list[Free], Fitted | None]] = []
    for share in FADES:
        start = _begun(fitted.packed, (layout.DAMPING_VELOCITY,), (share * problem.scales.velocity,))
        starts.append((start, [*model_fit.free, *fading_free(start.p, problem.scales)], fitted))
    return _followed(problem, model_fit, refits(problem, starts, model_fit.correction, SHORT), ROUNDS, asked)


def without_fading(problem: Problem, model_fit: ModelFit) -> ModelFit | None:
    """The model with the same damping in presliding at all speeds; None where the twin is unstable."""
    return _given_up(problem, model_fit, FADING_SLOTS)


def with_creep(problem: Problem, model_fit: ModelFit, asked: Asked = asked_for) -> ModelFit | None:
    """The model whose contact has no static friction (`lugre.crept`); None where the data do not ask for it.

    Begun at a bristle that is relaxed within a sample: nothing but the film.
    """
    fitted = model_fit.fitted
    known = {layout.COULOMB, layout.STIFFNESS} <= {one.slot for one in model_fit.free}
    there = creeps(fitted.packed) or curved(fitted.packed) or climbs_otherwise(fitted.packed)
    if there or not known or problem.data.steady or problem.two_masses(fitted.packed):
        return None
    starts: list[tuple[Packed, list[Free], Fitted | None]] = []
    for share in CREEPS:
        speed = share * problem.scales.velocity
        start = _begun(fitted.packed, CREEP_SLOTS, (speed, 0.0))
        relaxed = start.p[layout.COULOMB] / (speed * problem.data.period)
        start.p[layout.STIFFNESS] = max(start.p[layout.STIFFNESS], relaxed)
        starts.append((start, [*model_fit.free, *creep_free(start.p, problem.scales)], None))
    return _followed(
        problem, model_fit, refits(problem, starts, model_fit.correction, SHORT), ROUNDS + 1, asked
    )


def without_creep(problem: Problem, model_fit: ModelFit) -> ModelFit | None:
    """The model with static friction; None where the twin is unstable."""
    return _given_up(problem, model_fit, CREEP_SLOTS)


def with_curve(problem: Problem, model_fit: ModelFit, asked: Asked = asked_for) -> ModelFit | None:
    """The model whose contact bends by a curve of its own (`lugre.bends`); None where the data do not ask for it.

    Begun at a bristle's, and at that of a contact that is elastic until it slides.
    """
    fitted = model_fit.fitted
    known = {layout.COULOMB, layout.STIFFNESS} <= {one.slot for one in model_fit.free}
    there = creeps(fitted.packed) or curved(fitted.packed) or climbs_otherwise(fitted.packed)
    if there or not known or problem.data.steady:
        return None
    starts: list[tuple[Packed, list[Free], Fitted | None]] = [
        (_begun(fitted.packed, CURVE_SLOTS, curve), [*model_fit.free, *curve_free()], None)
        for curve in (BRISTLES_CURVE, ELASTIC_CURVE)
    ]
    return _followed(
        problem, model_fit, refits(problem, starts, model_fit.correction, SHORT), ROUNDS + 1, asked
    )


def without_curve(problem: Problem, model_fit: ModelFit) -> ModelFit | None:
    """The model with a bristle's curve; None where the twin is unstable."""
    return _given_up(problem, model_fit, CURVE_SLOTS)


def _begun(packed: Packed, slots: Sequence[int], values: Sequence[float]) -> Packed:
    """Where a fit of another law of the contact begins; without that law its damping may have gone to 0."""
    p = packed.p.copy()
    p[list(slots)] = values
    return usually_damped(Packed(p, packed.on))


def _followed(
    problem: Problem, model_fit: ModelFit, shorts: Sequence[Fitted], rounds: int, asked: Asked
) -> ModelFit | None:
    """The best of some short fits, followed inside the twin; None where the data do not ask for what it has more."""
    best = min(shorts, key=lambda one: one.cost)
    if not best.cost < (1.0 - problem.policy.least_gain) * model_fit.fitted.cost:
        return None
    after = fit_inside_twin(problem, best.packed, list(best.free), rounds, model_fit.effects)
    return after if after is not None and asked(problem, model_fit, after) else None


def _given_up(problem: Problem, model_fit: ModelFit, slots: Sequence[int]) -> ModelFit | None:
    """The model fitted without what stands in some slots of its base; None where the twin is unstable."""
    p = model_fit.fitted.packed.p.copy()
    p[list(slots)] = 0.0
    free = [one for one in model_fit.free if one.slot not in slots]
    packed = Packed(p, model_fit.fitted.packed.on)
    return fit_inside_twin(problem, packed, free, ROUNDS, model_fit.effects)


@dataclass(frozen=True, slots=True)
class BaseLaw:
    """An optional law of the base: found where the data ask for it, told, and never named.

    Attributes:
        there: whether a model has it, and no effect by the same parameters.
        added, removed: the model with it, where it is wanted, and without it.
        slots: where its parameters are; all are 0 without it.
        note: the sentence on it, with the motion's unit.
    """

    about: str
    there: Callable[[Packed], bool]
    added: Callable[[Problem, ModelFit, Asked], ModelFit | None]
    removed: Callable[[Problem, ModelFit], ModelFit | None]
    slots: tuple[int, ...]
    note: Callable[[Packed, str], str]

    def new(self, found: Packed, given: Packed) -> bool:
        """Whether a model that was found has such parameters, and the one that was given has none."""
        own = list(self.slots)
        return bool(np.any(found.p[own])) and not np.any(given.p[own])


def _creeps_note(packed: Packed, motion_unit: str) -> str:
    return NO_STATIC_FRICTION.format(speed=float(packed.p[layout.CREEP_VELOCITY]), unit=f"{motion_unit}/s")


def many_contacts_note(packed: Packed) -> str:
    """The sentence on friction of many contacts (`of_many`), by how far the last of them go."""
    return WIDE_CONTACTS if beyond_a_decade(packed.p) else MANY_CONTACTS


def _fades_note(packed: Packed, motion_unit: str) -> str:
    return FADING_DAMPING.format(speed=float(packed.p[layout.DAMPING_VELOCITY]), unit=f"{motion_unit}/s")


FADING_LAW = BaseLaw(
    "damping in presliding that fades with speed",
    fades,
    with_fading,
    without_fading,
    FADING_SLOTS,
    _fades_note,
)
CLIMB_LAW = BaseLaw(
    "another law of presliding",
    climbs_otherwise,
    with_climb,
    without_climb,
    ELEMENT_SLOTS,
    lambda packed, _: many_contacts_note(packed) if of_many(packed) else OTHER_CLIMB,
)
CURVE_LAW = BaseLaw(
    "another curve of presliding",
    curved,
    with_curve,
    without_curve,
    CURVE_SLOTS,
    lambda *_: OTHER_BENDING,
)
CREEP_LAW = BaseLaw(
    "friction without a static part",
    creeps,
    with_creep,
    without_creep,
    CREEP_SLOTS,
    _creeps_note,
)
BASE_LAWS = (CREEP_LAW, FADING_LAW, CLIMB_LAW, CURVE_LAW)


def has_other_law(packed: Packed) -> bool:
    """Whether the base has another law than a bristle's, whichever of them."""
    return any(law.there(packed) for law in BASE_LAWS)


def without_effects(problem: Problem, root: ModelFit) -> ModelFit | None:
    """The model fitted without all effects that it has; None where it has none, or its twin is unstable.

    Elements that stand for a law of the base are no effect. The bristle is free, where the model's may be held: at what
    belongs to the effects it would leave more than any base does.
    """
    packed = root.fitted.packed
    bases = {slot for law in BASE_LAWS if law.there(packed) for slot in law.slots}
    kinds = [kind for kind in EFFECTS.values() if packed.on[layout.flag(kind.name)]]
    kinds = [kind for kind in kinds if not bases.intersection(one.slot for one in kind.parameters)]
    if not kinds:
        return None
    bare = Packed(packed.p.copy(), packed.on.copy())
    for kind in kinds:
        bare.on[layout.flag(kind.name)] = False
        for one in kind.parameters:
            bare.p[one.slot] = one.neutral
    taken = {one.slot for kind in kinds for one in kind.parameters}
    free = [one for one in root.free if one.slot not in taken]
    known = {one.name for one in free}
    base = base_free(bare, problem.scales, problem.data.metadata.motion_unit)
    free += [one for one in base if one.name in CONTACT and one.name not in known]
    fitted = refit(problem, bare, free, root.correction, ROUNDS)
    packed = best_contact(problem, fitted, root.correction).packed
    return fit_inside_twin(problem, packed, free, ROUNDS)


def told_of_base(root: Packed, nominal: Packed, motion_unit: str, climbs: bool = True) -> tuple[str, ...]:
    """Sentences on laws of the base that the root has, and the model that was given has not.

    `climbs`: whether elements are such a law; else they were found as a memory that is none, and that is said.
    """
    laws = BASE_LAWS if climbs else (CREEP_LAW, FADING_LAW, CURVE_LAW)
    notes = [law.note(root, motion_unit) for law in laws if law.new(root, nominal)]
    for kind in _in_textbooks(root):
        slots = [parameter.slot for parameter in kind.parameters if parameter.optional]
        if np.any(root.p[slots] != nominal.p[slots]):
            notes.append(OTHER_CURVE)
    return tuple(notes)


def _in_textbooks(packed: Packed) -> list[Kind]:
    """Kinds in the model that every textbook's base has."""
    return [kind for kind in EFFECTS.values() if kind.in_lugre and packed.on[layout.flag(kind.name)]]


def with_base_shapes(problem: Problem, root: ModelFit, nominal: Packed) -> ModelFit | None:
    """The model with the shape of what is in every textbook's base free, where it has that and the data ask for it."""
    best: ModelFit | None = None
    for kind in _in_textbooks(root.fitted.packed):
        here = best or root
        packed = here.fitted.packed
        start = kind.free_shape(Context(problem, here.fitted, nominal)) if kind.free_shape else None
        if start is None:
            continue
        shape = [varying(kind, name, vary) for name, vary in start.free.items()]
        slots = {one.slot for one in shape}
        free = [*(one for one in here.free if one.slot not in slots), *shape]
        shaped = fit_inside_twin(problem, packed, free, ROUNDS + 1, here.effects)
        if shaped is not None and asked_for(problem, here, shaped):
            best = shaped if own_course(problem, shaped, kind.name) else best
    return best
