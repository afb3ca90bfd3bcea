"""Candidates: an effect that may be what the model lacks, after a first fit and after a fit inside the twin.

And between a drive model with names and the vector that is fitted: free parameters, and back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from autotune.core.arrays import Floats
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.coordinates import Rests, without_rests
from autotune.estimation.cross_validation import (
    Explained,
    explained,
    gain_and_z,
    rests_of,
    shared,
    there_and_back,
    where_others_tell,
)
from autotune.estimation.data import TRAINING, VETO, repeats_alike
from autotune.estimation.least_squares import Fitted, Free
from autotune.estimation.problem import Problem, Scales
from autotune.models import layout
from autotune.models.drive_model import (
    CREEP,
    CURVE,
    DAMPING_VELOCITY,
    FADING,
    DriveModel,
    Packed,
    surface_parameter,
)
from autotune.models.effect import Effect, Kind, Parameter
from autotune.models.table import EFFECTS
from autotune.signals.chunks import beyond_chance

Progress = Callable[[str], None]
"""Is told what begins."""
Asked = Callable[[Problem, ModelFit, ModelFit], bool]
"""Whether a law of the base is wanted that a model has, and the one before has not."""


def no_progress(_: str) -> None:
    """Progress that nobody wants to see."""


@dataclass(frozen=True, slots=True)
class Gain:
    """Relative fall of the squared error on experiments held out; its paired z, and a sign test's, over chunks."""

    gain: float
    z: float
    evenly: float


@dataclass(frozen=True, slots=True)
class ScreenedCandidate:
    """An effect fitted on the measured motion, with the bias of the model without it.

    Attributes:
        fall: of the mean square [(N m)²]; gain, z, evenly: on experiments held out.
        others: where else it could begin: shorter fits, and their starts.
    """

    effect: str
    fitted: Fitted
    fall: float
    gain: float
    z: float
    others: tuple[Packed, ...] = ()
    evenly: float = 0.0


@dataclass(frozen=True, slots=True)
class FittedCandidate:
    """A model with one effect more, fitted inside the twin, and what it explains of training and veto.

    Attributes:
        gain: fall of the squared error on unseen data, relative to the model without the effect.
        named: whether so much is explained that the effects can be named.
        freed: those of its effects whose course is free, as their law differs; whether their own law would have named
            them too.
    """

    effect: str
    model_fit: ModelFit
    gain: float
    training: Explained
    veto: Explained | None
    named: bool
    freed: Mapping[str, bool] = field(default_factory=dict)

    def with_courses_of(self, begun: FittedCandidate | None) -> FittedCandidate:
        """The same with the marks of free courses of what its fit began with, of those effects that it has."""
        freed = begun.freed if begun is not None else {}
        own = {effect: named for effect, named in freed.items() if effect in self.model_fit.effects}
        return replace(self, freed=own)

    @property
    def share(self) -> float:
        """Of what can be explained: the lesser of training and veto."""
        return min(self.training.share, self.veto.share if self.veto else 1.0)

    @property
    def plain_share(self) -> float:
        """The same with nothing of what is left put down to the measurement chain."""
        return min(self.training.plain_share, self.veto.plain_share if self.veto else 1.0)


def error_left(problem: Problem, model_fit: ModelFit) -> float:
    """Error on training and veto together, each by its own share of the rows [(N m)²]."""
    error = model_fit.fitted.error
    total = problem.mean_square(error, TRAINING)
    return total + (problem.mean_square(error, VETO) if problem.has(VETO) else 0.0)


def leaves_about_as_little(problem: Problem, one: ModelFit, other: ModelFit, times: float) -> bool:
    """Whether a model leaves at most so many `times` what another leaves, on training and on veto, each by itself.

    A loud veto trajectory would hide in their sum that one leaves half as much again of what was fitted.
    """
    errors = one.fitted.error, other.fitted.error
    left = [[problem.mean_square(e, role) for e in errors] for role in (TRAINING, VETO) if problem.has(role)]
    return all(own <= times * others for own, others in left)


def explained_beside(problem: Problem, before: ModelFit, after: ModelFit, role: str) -> Explained:
    """Of a role, what a model explains of what another leaves; noise that it swallows is none of it."""
    return explained(problem, before.fitted, after.fitted, after.correction, role)


def explained_of_rest(problem: Problem, before: ModelFit, after: ModelFit) -> list[Explained]:
    """The same of training and, where there is one, of the veto trajectory."""
    return [explained_beside(problem, before, after, role) for role in (TRAINING, VETO) if problem.has(role)]


def again_explained(problem: Problem, before: ModelFit, after: ModelFit) -> float:
    """By how much a model lowers what repeats share, or a level that drifts between them [(N m)²].

    As they are, or without what rests make, whichever is more: stretches that differ between repeats lower their
    product. Infinite where repeats are at different places: what belongs to the place need not come again there.
    """
    if not repeats_alike(problem.data):
        return math.inf

    def fall(rests: Rests | None) -> float:
        left = [shared(problem, item.fitted, item.correction, rests) for item in (before, after)]
        return left[0] - left[1]

    return max(fall(None), fall(rests_of(problem, after.fitted.packed)))


def fall_in_repeats(problem: Problem, before: ModelFit, after: ModelFit) -> float:
    """By how much a model lowers the mean square of the experiments that were repeated [(N m)²].

    What it lowers of the others cannot come again; that they were held out says of them what is to be said.
    """
    repeated = np.zeros(len(problem.weight))
    for block in problem.data.blocks:
        repeated[block.rows] = block.role == TRAINING and block.repeats > 1
    weight = problem.weight * repeated
    fall = before.fitted.error**2 - after.fitted.error**2
    return float(weight @ fall) / max(float(weight.sum()), 1e-300)


def least_fall(problem: Problem, chosen: FittedCandidate) -> float:
    """By how much an effect beside the chosen ones must lower the mean square [(N m)²]."""
    policy = problem.policy
    explained = max(chosen.training.fall, 0.0)
    left = problem.mean_square(chosen.model_fit.fitted.error, TRAINING)
    least = min(
        policy.worth_beside * explained, max(policy.clear_beside * left, policy.worth_if_clear * explained)
    )
    contact = problem.two_masses(chosen.model_fit.fitted.packed)
    return max(least, policy.chance_of_contact * left) if contact else least


def explains_rest(problem: Problem, chosen: FittedCandidate, more: FittedCandidate) -> bool:
    """Whether a model with a further effect explains enough of what the chosen ones leave, where data repeat.

    Half of it, where these need it for a name. Where they have one, they leave no more than true effects whose laws
    differ may leave, and such a rest resembles other effects in part: only what explains as much of it as a name asks
    of all, on training and veto, is told from that. A veto trajectory that was played once cannot say so of crumbs:
    what is left there is known by a bound, which is as loud as they are. And where the chosen ones leave less of
    a veto trajectory than a further effect must explain at all, that motion hardly shows it: half of it is asked there.
    """
    policy, parts = problem.policy, explained_of_rest(problem, chosen.model_fit, more.model_fit)
    if not chosen.named:
        return parts[0].share >= policy.partly
    if problem.has_veto and not problem.veto_repeats:
        return False
    shown = chosen.veto is None or chosen.veto.share < 1.0 - policy.worth_beside
    least = [policy.named, policy.named if shown else policy.partly]
    return all(part.share >= asked for part, asked in zip(parts, least, strict=False))


def plainer(
    problem: Problem, fits: Sequence[FittedCandidate], best: FittedCandidate, alike: float
) -> FittedCandidate:
    """The best candidate, or one that it becomes at an end of its parameters, where that explains as much.

    A sum of elements that hardly let go within the travel explained 0.1 % more than a spring, with ten coefficients
    more. Where another effect is missing as well neither has a name, and such a sum bends to a part of what the other
    does: it must predict more than its end does, too, of what was not fitted.
    """
    as_much = error_left(problem, best.model_fit) + alike * best.training.fall
    any_course = not best.named and is_any_course(problem, best.model_fit, best.effect)
    predicts = problem.policy.named * best.gain if any_course else math.inf
    ends = (item for item in fits if is_end_of(item, best))
    return next(
        (
            item
            for item in ends
            if item.gain >= predicts or (item.named and error_left(problem, item.model_fit) < as_much)
        ),
        best,
    )


def is_any_course(problem: Problem, model_fit: ModelFit, effect: str) -> bool:
    """Whether the course of a model's effect could be any smooth one over so little travel."""
    shown = EFFECTS[effect].shows_course
    return shown is not None and not shown(model_fit.fitted.packed.p, problem.scales.travel)


def exchanged_for(chosen: FittedCandidate, item: FittedCandidate) -> tuple[set[str], set[str]]:
    """Effects that a fit lacks of those of another one, and those that it has in their place."""
    own, others = set(chosen.model_fit.effects), set(item.model_fit.effects)
    return own - others, others - own


def is_end_of(item: FittedCandidate, other: FittedCandidate) -> bool:
    """Whether an effect is what another one becomes at an end of its parameters."""
    return other.effect in EFFECTS[item.effect].end_of


def free_of_model(model: DriveModel, scales: Scales) -> list[Free]:
    """Parameters of the model's effects that a refit may change."""
    free = []
    for effect in model.effects:
        for name, value in effect.values.items():
            parameter = effect.kind.parameter(name)
            if not parameter.held:
                free.append(_free(parameter, effect.kind.surface(name), value.value, scales))
    return free


def _free(parameter: Parameter, surface: str, value: float, scales: Scales) -> Free:
    typical = {
        "N m": 0.1 * scales.torque,
        "N m s/rad": 0.1 * scales.torque / scales.velocity,
        "N m/rad": 0.1 * scales.torque / scales.travel,
        "1": 0.2,
    }.get(parameter.unit, abs(value) or 1e-3)
    scale = max(0.3 * abs(value), 0.1 * typical) if value else typical
    bounded = parameter.lower >= 0.0 and value > 0.0
    step = 0.6 * value if bounded else np.inf
    least = parameter.lower if scales.steady else parameter.least(scales.velocity)
    lower = max(parameter.lower, min(least, value))  # a model that was given is not moved
    return Free(surface, parameter.slot, lower, parameter.upper, scale, step, above=parameter.above)


def model_from(
    model: DriveModel, packed: Packed, free: tuple[Free, ...], errors: Floats | None = None
) -> DriveModel:
    """The model with fitted values, and effects that the fit has added."""
    table = {f.name: (errors[i] if errors is not None else None) for i, f in enumerate(free)}
    for name, kind in EFFECTS.items():
        new = packed.on[layout.flag(name)] and name not in model
        if new or (name in model and (kind.terms is not None or _reshaped(model, kind, packed))):
            model = model.with_effect(_effect(kind, packed, table))
    if (packed.p[layout.DAMPING_VELOCITY] > 0.0) != (DAMPING_VELOCITY.name in model.base):
        model = model.with_fading(*(float(packed.p[parameter.slot]) for parameter in FADING))
    if (packed.p[layout.BENDS_BACK] > 0.0) != (CURVE[0].name in model.base):
        model = model.with_curve([float(packed.p[parameter.slot]) for parameter in CURVE])
    if (packed.p[layout.CREEP_VELOCITY] > 0.0) != (CREEP[0].name in model.base):
        model = model.with_creep(*(float(packed.p[parameter.slot]) for parameter in CREEP))
    values = {surface: float(packed.p[_slot(surface)]) for surface in model.parameters}
    return model.with_values(
        values, {k: float(v) for k, v in table.items() if v is not None and np.isfinite(v)}
    )


def _reshaped(model: DriveModel, kind: Kind, packed: Packed) -> bool:
    """Whether an effect of the model was fitted with a shape for which the model has no values."""
    there = model.effect(kind).values
    return any(packed.p[one.slot] != one.neutral for one in kind.parameters if one.name not in there)


def _slot(surface: str) -> int:
    return surface_parameter(surface).slot


def _effect(kind: Kind, packed: Packed, table: dict[str, float | None]) -> Effect:
    values = {}
    for parameter in kind.parameters:
        value = float(packed.p[parameter.slot])
        fitted = value != parameter.neutral or kind.surface(parameter.name) in table
        if _in_use(kind, parameter.name, packed) and (not parameter.optional or fitted):
            values[parameter.name] = value
    return kind.make(values)


def _in_use(kind: Kind, parameter: str, packed: Packed) -> bool:
    """Whether the numbered term that a parameter belongs to is in use; all others are."""
    number = parameter.rpartition("_")[2]
    return kind.terms is None or not number.isdigit() or int(number) in kind.terms_in_use(packed.p)


def predicts_better(problem: Problem, before: ModelFit, after: ModelFit) -> bool:
    """Whether data that were not fitted are explained better, beyond chance, whatever rests make of them.

    The veto trajectory says it where there is one: a course is told by all experiments together, and one that is left
    out of the fit may be the only one that goes as far or as fast. Played once it may be at a few of the places only;
    experiments that were held out say it then, too, where it errs no more.
    """
    policy = problem.policy
    if problem.has_veto:
        rests = rests_of(problem, after.fitted.packed)
        left = [problem.mean_square(without_rests(one.fitted.error, rests), VETO) for one in (before, after)]
        fitted = after.fitted.cost <= (1.0 - policy.least_gain) * before.fitted.cost
        told = fitted and left[1] <= (1.0 - policy.least_gain) * left[0]
        if told or problem.veto_repeats or left[1] > left[0]:
            return told
    gain, z = gain_and_z(before.unseen, after.unseen)
    return gain >= policy.least_gain and policy.no_chance(gain, z)


def gain_by_way_back(problem: Problem, before: ModelFit, after: ModelFit) -> tuple[float, float]:
    """Gain and z on ways held out, each told by its way back; (0, 0) where other experiments speak against it.

    A place, a speed, a torque may be reached in one experiment only, of which others say nothing.
    """
    first, second = where_others_tell(problem, before.fitted, after.fitted)
    if second > first:
        return 0.0, 0.0
    return gain_and_z(*(there_and_back(problem, one.fitted) for one in (before, after)))


def course_predicts(problem: Problem, before: ModelFit, after: ModelFit) -> bool:
    """Whether an effect with a course of its own explains data that were not fitted better, beyond chance.

    Where no veto trajectory says it, and what one experiment alone reaches is told by no other, its way there must tell
    the way back.
    """
    policy = problem.policy
    if predicts_better(problem, before, after):
        return True
    if problem.has_veto or after.fitted.cost > (1.0 - policy.least_gain) * before.fitted.cost:
        return False
    gain, z = gain_by_way_back(problem, before, after)
    return gain >= policy.least_gain and policy.no_chance(gain, z)


def asked_for(problem: Problem, before: ModelFit, after: ModelFit) -> bool:
    """Whether data ask for another law of the base: held-out experiments and the veto trajectory, beyond chance."""
    return _gains(problem, before, after) and predicts_better(problem, before, after)


def not_refuted(problem: Problem, before: ModelFit, after: ModelFit) -> bool:
    """Whether another law of the base gains on held-out experiments, beyond chance, and the veto errs no more by it.

    Of a veto trajectory that is noise nearly all, no law that is right lowers the error by what `asked_for` wants.
    """
    falls = after.fitted.cost <= (1.0 - problem.policy.least_gain) * before.fitted.cost
    return _gains(problem, before, after) and falls and gain_on_veto(problem, before, after) >= 0.0


def _gains(problem: Problem, before: ModelFit, after: ModelFit) -> bool:
    """Whether held-out experiments are explained better, beyond chance.

    What only the quickest experiment shows scatters over the others; the veto trajectory tells then.
    """
    policy = problem.policy
    gain, z = gain_and_z(before.unseen, after.unseen)
    least = policy.least_gain if problem.twin else policy.clear_gain
    clear = policy.no_chance(gain, z)
    if problem.has_veto and not clear:
        fall = problem.weight * (before.fitted.error**2 - after.fitted.error**2)
        clear = beyond_chance(fall[problem.data.role(VETO)], policy.least_z)
    return gain >= least and clear


def falls_on_veto(problem: Problem, before: ModelFit, after: ModelFit) -> bool:
    """Whether a model lowers the veto trajectory's error beyond chance, second by second."""
    weight = problem.weight * problem.data.role(VETO)
    fall = weight * (before.fitted.error**2 - after.fitted.error**2)
    return beyond_chance(fall[weight > 0.0], problem.policy.apart_z)


def clearly_falls_on_veto(problem: Problem, before: ModelFit, after: ModelFit) -> bool:
    """Whether a model lowers the veto trajectory's error beyond chance, and by what counts as a clear gain."""
    enough = gain_on_veto(problem, before, after) >= problem.policy.clear_gain
    return enough and falls_on_veto(problem, before, after)


def gain_on_veto(problem: Problem, before: ModelFit, after: ModelFit) -> float:
    """Fall of the squared error on the veto trajectory, relative: contact between two masses is not linear."""
    errors = [problem.mean_square(model_fit.fitted.error, VETO) for model_fit in (before, after)]
    return 1.0 - errors[1] / max(errors[0], 1e-300)
