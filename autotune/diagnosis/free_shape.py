"""An effect whose law is not the library's: the same place, and any course that the data ask for.

Where an effect explains the place of the error but not all of it, what its `Kind` names as `free_shape` is fitted
beside its own law, inside the twin: ramps, films, further contacts. Such a shape is taken where it predicts held-out
experiments better and lowers the error on the veto trajectory. A memory is resolved into its contacts (`contact_laws`).

What an effect only resembles has signs too: a smooth course, a parabola or a motor that falls short does as well, or
the effect lies at the edge of its law.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.arrays import Floats
from autotune.diagnosis.candidates import FittedCandidate, course_predicts, explained_of_rest, is_any_course
from autotune.diagnosis.contact_laws import ROUNDS, resolved
from autotune.diagnosis.refits import judged_again, taken_out
from autotune.diagnosis.screening import generic_gains
from autotune.diagnosis.starts import Context, FitStart, own_course, varying
from autotune.estimation.alignment import followed_late
from autotune.estimation.bias_corrected_fit import ModelFit, fit_inside_twin
from autotune.estimation.data import TRAINING, VETO
from autotune.estimation.least_squares import DIFFERENCE, Free, followed
from autotune.estimation.problem import Problem
from autotune.estimation.residual import residuals, smoothed
from autotune.models.drive_model import Packed
from autotune.models.effect import Kind, Proportion
from autotune.models.look_alikes import IN_TORQUE
from autotune.models.reversal_memory import REVERSAL_MEMORY
from autotune.models.spring import RAMPS, SPRING
from autotune.models.start_values import StartValues
from autotune.models.table import EFFECTS
from autotune.models.torque_saturation import torque_slope
from autotune.signals.chunks import beyond_chance, by_second
from autotune.signals.line_search import lowest

NEAR_AN_EDGE = 0.01
"""Of a parameter's scale: a bound that is so near is met."""
KNEES = (0.2, 0.35, 0.5, 0.65, 0.8)
"""Of the largest torque: where a course over it bends, to be any course."""
MET_AT = np.arange(1, 16) / 16.0
FINE_PLACE = 1e-3
"""Of the travel: where a spring may be met on the way, and to what that is found."""
PARTS_OF_A_TURN = np.arange(4, 25) / 16.0
"""Of a load behind a gear over the travel: further round it shows a wave's course."""
BETWEEN, WITHIN = (-1.0, 3.0), 0.02
"""Proportions that are looked at, and to what: further away it is the other part that is not there."""
SOONEST, RELAXATIONS, SEEN_TO_ITS_END = 0.1, 16, 1.0 / 3.0
"""s in which a torque relaxes at the soonest, as what goes sooner damps the motion itself; how many times are looked at
from there to a part of the longest stretch, in three of which all but a twentieth has gone."""


def with_free_shape(
    problem: Problem, root: ModelFit, nominal: Packed, chosen: FittedCandidate
) -> FittedCandidate | None:
    """The model with the course of its last effect free; None where that does not explain clearly more.

    By its own law the effect must explain most of the error that was fitted (`Kind.least_own`): a free course alone
    would explain what is none of it. On the veto trajectory a law that is another may err as much as none (a spring
    that hardens).
    """
    before = chosen.model_fit
    if chosen.training.share < problem.policy.partly * EFFECTS[chosen.effect].least_own:
        return None
    best: FittedCandidate | None = None
    for settled in _courses(problem, nominal, before, chosen.effect):
        if settled is None or not course_predicts(problem, before, settled):
            continue
        if not own_course(problem, settled, chosen.effect):
            continue
        if best is None or settled.fitted.cost < best.model_fit.fitted.cost:
            best = replace(judged_again(problem, root, chosen, settled), gain=chosen.gain)
        if best.named:
            break
    return best


def _courses(problem: Problem, nominal: Packed, before: ModelFit, effect: str) -> Iterator[ModelFit | None]:
    """Fits with the course of an effect free: beside its own law, plainest first, and in the place of that where it may
    be left out.

    From a smooth law, a course with a bend is not found: terms that begin at nothing beside it take what it leaves.
    What is another law without any number of its own (a contact that stiffens) is kept where it leaves less.
    """
    if effect == REVERSAL_MEMORY.name:
        yield resolved(problem, before)
        return
    kind, last = EFFECTS[effect], None
    for shape in (kind.plain_shape, kind.free_shape):
        start = shape(Context(problem, before.fitted, nominal)) if shape is not None else None
        if start is None:
            continue
        last = _freed(before, kind, start)
        settled = fit_inside_twin(problem, last.packed, list(last.free), ROUNDS + 1, before.effects)
        yield settled
        if not start.free and settled is not None and settled.fitted.cost < before.fitted.cost:
            before = settled
    if kind.own_size and last is not None:
        alone = last.packed.p.copy()
        alone[kind.slot(kind.own_size)] = 0.0
        packed = Packed(alone, before.fitted.packed.on)
        yield fit_inside_twin(problem, packed, list(last.free), ROUNDS + 1, before.effects)


def _freed(before: ModelFit, kind: Kind, start: StartValues) -> FitStart:
    """A model with the course of one of its effects begun, and all that is free then."""
    p = before.fitted.packed.p.copy()
    for name, value in start.values.items():
        p[kind.slot(name)] = value
    shape = [varying(kind, name, vary) for name, vary in start.free.items()]
    slots = {one.slot for one in shape}
    free = (*(one for one in before.free if one.slot not in slots), *shape)
    return FitStart(Packed(p, before.fitted.packed.on), free)


def any_course(problem: Problem, root: ModelFit, model_fit: ModelFit) -> bool:
    """Whether the one effect found leaves what a function of place explains, over too little travel to show its course.

    There it comes near to any smooth course: what it is not exactly, it is not by another law either. Unless a cubic,
    which has as many coefficients as a wave of free order, errs by more than that: then its own law is what is shown.
    """
    if len(model_fit.effects) != 1 or not without_own_course(problem, model_fit):
        return False
    over_place = generic_gains(problem, model_fit).get("position")
    gain = over_place.gain if over_place is not None else 0.0
    if (
        not problem.data.repeated
        and gain * model_fit.fitted.cost < (problem.policy.least_part * problem.scales.torque) ** 2
    ):
        return False
    if gain < problem.policy.least_gain:
        return False
    place = problem.data.position[problem.data.grid] / problem.scales.travel
    cubes = np.column_stack([place, place**2, place**3])
    own, cubic, _ = _left(problem, root, model_fit, model_fit.effects[0], cubes)
    told = cubic - own
    return bool(told.sum() <= gain * own.sum()) or not beyond_chance(told, problem.policy.apart_z)


def like_a_spring(
    problem: Problem, root: ModelFit, model_fit: ModelFit, alike: float, effect: str = ""
) -> bool:
    """Whether a spring of two coefficients explains as much as an effect, over too little travel to show its course.

    A wave of free phase has two as well; no better than a parabola, or than a spring that is met on the way from either
    side, a wave is a spring, too. So is an element that is bent over most of the travel. Beside a spring the two are
    those that bend its line: what adds no more is the spring's own course. `alike`: of the fall, what counts as no
    better. `effect`: of several, which one; what the others do is refitted beside either.
    """
    effect = effect or (model_fit.effects[0] if len(model_fit.effects) == 1 else "")
    if effect not in without_own_course(problem, model_fit):
        return False
    springs = _bent_springs(problem, beside_one=SPRING.name in model_fit.effects)
    return any(_as_well(problem, root, model_fit, effect, table, alike) for table in springs)


def like_a_weight(problem: Problem, root: ModelFit, model_fit: ModelFit, alike: float) -> bool:
    """Whether a weight behind a gear explains as much as a spring whose course is free, and more than plain springs.

    Over a part of its turn a wave is a smooth course, too; with its order and phase it has three coefficients for that,
    where the course has many. So has a spring that hardens, or is met on the way: where one of those errs no more
    beyond chance, it is a spring. `alike` as in `like_a_spring`.
    """
    ramps = {SPRING.slot(f"ramp_{i}") for i in range(1, RAMPS + 1)}
    freed = any(one.slot in ramps for one in model_fit.free)
    if not freed or problem.data.metadata.motion_unit != "rad":
        return False

    def left_by(columns: Floats) -> Floats:
        return _left(problem, root, model_fit, SPRING.name, columns)[1]

    place = _place(problem)
    angles = np.outer(2.0 * math.pi * PARTS_OF_A_TURN, place / np.ptp(place))
    waves = [np.column_stack([np.sin(angle), np.cos(angle)]) for angle in angles]
    errors = [left_by(wave) for wave in waves]
    nearest = int(np.argmin([error.sum() for error in errors]))
    if not _as_well(problem, root, model_fit, SPRING.name, waves[nearest], alike):
        return False
    springs = (left_by(columns) for columns in _plain_springs(place, left_by))
    return all(beyond_chance(spring - errors[nearest], problem.policy.apart_z) for spring in springs)


def _plain_springs(place: Floats, left_by: Callable[[Floats], Floats]) -> Iterator[Floats]:
    """Columns of springs that harden to one side or to both, and of those that are met on the way; (m, k) each."""
    middle = place - np.min(place) - 0.5 * np.ptp(place)
    for one, power in ((place, 2), (middle, 3)):
        yield np.column_stack([one, one**power])
    for side in (1.0, -1.0):
        yield _met(place, _where_met(place, side, left_by), side)


def rather_a_spring(problem: Problem, root: ModelFit, model_fit: ModelFit) -> bool:
    """Whether a spring of two coefficients is likelier than the one effect found, a wave that has as many.

    A spring hardens or gives way to one side, or on both sides of the middle of the travel alike; or it is met on the
    way, and where is told as well as how stiff it is. (A course of many coefficients comes near to any wave, and says
    nothing of either.) It is likelier where it errs less beyond chance. Where neither does, the travel tells: a spring
    turns round nowhere, and a wave of any phase does so within a quarter of its turn as often as not.
    """
    place, effect = _place(problem), model_fit.effects[0]
    wave = _left(problem, root, model_fit, effect, place[:, None])[0]

    def left_by(columns: Floats) -> Floats:
        return _left(problem, root, model_fit, effect, columns)[1]

    springs = [left_by(columns) for columns in _plain_springs(place, left_by)]
    apart = problem.policy.apart_z
    if any(beyond_chance(wave - one, apart) for one in springs):
        return True
    turns = EFFECTS[effect].waves
    angle = turns(model_fit.fitted.packed.p)[0] * problem.scales.travel * np.ptp(place) if turns else 0.0
    return angle > 0.5 * math.pi and not all(beyond_chance(one - wave, apart) for one in springs)


def _where_met(place: Floats, side: float, left_by: Callable[[Floats], Floats]) -> float:
    """Where a spring begins that is met on the way from one side and leaves least."""
    low, width = float(np.min(place)), float(np.ptp(place))

    def left(at: float) -> float:
        return float(left_by(_met(place, low + at * width, side)).sum())

    near = min(MET_AT.tolist(), key=left)
    return low + width * lowest(left, (near - MET_AT[0], near + MET_AT[0]), FINE_PLACE)


def _bent_springs(problem: Problem, beside_one: bool) -> list[Floats]:
    """Springs of two coefficients that are not straight: to one side, and met on the way, from either side; (m, k).

    `beside_one`: the straight line is a spring's already, and two coefficients bend it.
    """
    place = _place(problem)
    line = place**3 if beside_one else place
    inside = np.min(place) + MET_AT * np.ptp(place)
    met = [_met(place, at, side) for at in inside for side in (1.0, -1.0)]
    return [np.column_stack([line, place**2]), *met]


def _met(place: Floats, at: float, side: float) -> Floats:
    """A spring that is met at a place from one side, shape (m, 1)."""
    return np.asarray(side * np.maximum(side * (place - at), 0.0)[:, None])


def _place(problem: Problem) -> Floats:
    """Of the travel, on the grid."""
    return np.asarray(problem.data.position[problem.data.grid] / problem.scales.travel)


def without_own_course(problem: Problem, model_fit: ModelFit) -> list[str]:
    """Effects of a model whose course could be any smooth one over so little travel."""
    return [name for name in model_fit.effects if is_any_course(problem, model_fit, name)]


def like_a_motor(
    problem: Problem, root: ModelFit, model_fit: ModelFit, alike: float, effect: str = ""
) -> bool:
    """Whether what a motor falls short explains as much as an effect, friction that its load presses.

    Only while it brakes do they differ: friction helps it then, and a motor that saturates does not. `alike` and
    `effect` as in `like_a_spring`.
    """
    effect = effect or (model_fit.effects[0] if len(model_fit.effects) == 1 else "")
    if effect not in model_fit.effects:
        return False
    kind, data = EFFECTS[effect], problem.data
    if IN_TORQUE not in kind.look_alikes or kind.kernels.level is None:
        return False
    size = np.abs(data.torque) / float(np.max(np.abs(data.torque[data.grid])))
    short = [
        smoothed(data, np.ascontiguousarray(np.sign(data.torque) * np.maximum(size - knee, 0.0)))
        for knee in KNEES
    ]
    return _as_well(problem, root, model_fit, kind.name, np.column_stack(short), alike)


def _as_well(
    problem: Problem, root: ModelFit, model_fit: ModelFit, effect: str, columns: Floats, alike: float
) -> bool:
    """Whether columns, shape (m, k), explain as much in the place of an effect of a model.

    That is all of its fall but the part `alike`, or as much by chance.
    """
    left = _left(problem, root, model_fit, effect, columns)
    surplus = left[1] - left[0]
    if surplus.sum() < alike * (left[2] - left[0]).sum():
        return True
    return not beyond_chance(surplus, problem.policy.apart_z)


def _left(
    problem: Problem, root: ModelFit, model_fit: ModelFit, effect: str, columns: Floats
) -> list[Floats]:
    """Squared error of an effect, of columns, shape (m, k), in its place, and of none; shape (m,) each.

    The base and what other effects there are refitted to first order with each of them.
    """
    kind, fitted = EFFECTS[effect], model_fit.fitted
    base = fitted.jacobian[:, [one.slot not in {q.slot for q in kind.parameters} for one in fitted.free]]
    without = problem.raw(taken_out(root, model_fit, kind.name)) - model_fit.correction.bias
    weight = problem.training
    return [
        weight * followed(table, error, weight) ** 2
        for table, error in (
            (fitted.jacobian, fitted.error),
            (np.column_stack([base, columns]), without),
            (base, without),
        )
    ]


def at_an_edge(problem: Problem, model_fit: ModelFit) -> bool:
    """Whether the one effect found would go on beyond a bound of its law, by more than chance.

    There it is another effect: contacts that age within a tenth of a second are friction that falls with speed, and
    friction that the load presses and that falls with itself is a motor that saturates. So it is too where a bound
    away from nothing is met and the data do not tell the parameter from nothing. A course in the place of its law is at
    no bound of that.
    """
    if len(model_fit.effects) != 1:
        return False
    fitted, weight, kind = model_fit.fitted, problem.training, EFFECTS[model_fit.effects[0]]
    own = {one.slot for one in kind.parameters if not (one.optional or one.whole)}
    if kind.own_size and fitted.packed.p[kind.slot(kind.own_size)] == 0.0:
        own.discard(kind.slot(kind.own_size))
    for i, one in enumerate(fitted.free):
        value, near = fitted.packed.p[one.slot], NEAR_AN_EDGE * one.scale
        at = int(value - one.lower <= near) - int(one.upper - value <= near)
        if one.slot not in own or at == 0:
            continue
        column = followed(np.delete(fitted.jacobian, i, axis=1), fitted.jacobian[:, i], weight)
        pieces = by_second(at * weight * column * fitted.error)
        chance = problem.policy.apart_z * math.sqrt(float(pieces @ pieces))
        least = value / fitted.scales[i] * float(weight * column @ column)
        if pieces.sum() > chance or (at > 0 and one.lower > near and chance > least):
            return True
    return False


@dataclass(frozen=True, slots=True)
class OtherProportion:
    """A part of an effect's torque is so many times what its law makes of it, with this standard error."""

    effect: str
    times: float
    error: float


def out_of_proportion(problem: Problem, root: ModelFit, model_fit: ModelFit) -> OtherProportion | None:
    """The first effect whose parts are not in its law's proportion, or may as well be in that of a stranger's law.

    It is measured on training and veto with all else refitted to first order: beside the effect's own law and, as a
    large effect is not the sum of its parts, by the parts in its place; what leaves less tells. It is the effect's
    where it is nearer to its law's than to the stranger's, told from that, and not beyond chance further off than half
    the way there, on the other side neither. Where the stranger is rare, the last is enough.
    """
    found = (_proportion(problem, root, model_fit, effect) for effect in model_fit.effects)
    return next((one for one in found if one is not None), None)


def _proportion(problem: Problem, root: ModelFit, model_fit: ModelFit, effect: str) -> OtherProportion | None:
    """One effect's, where it is not its law's."""
    told = EFFECTS[effect].proportion
    if told is None:
        return None
    found = _measured(_Proportioned.of(problem, root, model_fit, effect, told))
    chance = problem.policy.apart_z * found.error
    own, strangers = abs(found.times - 1.0), abs(found.times - told.other)
    its = own - chance <= 0.5 * abs(told.other - 1.0)
    if told.common:
        its = its and own < strangers and strangers > chance
    return None if its else found


def _measured(parted: _Proportioned) -> OtherProportion:
    """What of the second part is there, by the model that leaves less."""
    lows = [(_lowest(left), left) for left in (parted.beside_own_law, parted.in_its_place)]
    best, left = min(lows, key=lambda one: float(one[1](one[0]).sum()))
    return OtherProportion(parted.effect, best, _error_of(left, best))


def _lowest(left: Callable[[float], Floats]) -> float:
    return lowest(lambda times: float(left(times).sum()), BETWEEN, WITHIN)


@dataclass(frozen=True, slots=True)
class _Proportioned:
    """An effect of a model, its torque taken apart, on the rows of training and veto; each table has shape (m, k).

    What the law makes beside its two parts, as the shaft's friction that follows the place, is free in both models: a
    stranger's differs from it by nothing that is known, and it must say nothing of the second part.

    Attributes:
        weight: of the rows, shape (m,).
        whole: the second part as the model has it, shape (m,).
        first, second, beside: what each of the effect's free parameters adds to both parts, and to the rest.
        base, error: what the others change of the model's residual, and that one, shape (m,).
        bare_base, bare_error: the same of the model without the effect.
    """

    effect: str
    weight: Floats
    whole: Floats
    first: Floats
    second: Floats
    beside: Floats
    base: Floats
    error: Floats
    bare_base: Floats
    bare_error: Floats

    @classmethod
    def of(
        cls, problem: Problem, root: ModelFit, model_fit: ModelFit, effect: str, told: Proportion
    ) -> _Proportioned:
        fitted, bias = model_fit.fitted, model_fit.correction.bias
        slots = {one.slot for one in EFFECTS[effect].parameters}
        own, others = (
            [one for one in fitted.free if (one.slot in slots) is inside] for inside in (True, False)
        )
        here, bare = fitted.packed, taken_out(root, model_fit, effect)
        first, second = _parts_of_each(problem, here, own, told)
        weight = problem.weight * problem.data.role(TRAINING, VETO)
        changed = _changes(problem, here, [*others, *own])
        base, law = changed[:, : len(others)], changed[:, len(others) :]
        return cls(
            effect, weight, _parts(problem, here, told)[1], first, second, law + first + second, base,
            fitted.error, _changes(problem, bare, others), problem.raw(bare) - bias,
        )  # fmt: skip

    def beside_own_law(self, times: float) -> Floats:
        """Times the second part → the squared error with so much of it in all, shape (m,)."""
        law = self.beside - self.first - times * self.second
        table = np.hstack([self.base, law, self.beside])
        return self._left(table, self.error - (times - 1.0) * self.whole)

    def in_its_place(self, times: float) -> Floats:
        """The same of a model that has the parts in the place of the effect."""
        table = np.hstack([self.bare_base, self.first + times * self.second, self.beside])
        return self._left(table, self.bare_error)

    def _left(self, table: Floats, error: Floats) -> Floats:
        return np.asarray(self.weight * followed(table, error, self.weight) ** 2)


def _changes(problem: Problem, packed: Packed, free: Sequence[Free]) -> Floats:
    """What each parameter changes of the residual of all recordings, as long as its scale, shape (m, parameters)."""
    models, parts = [packed], []
    for one in free:
        value = float(packed.p[one.slot])
        part = DIFFERENCE if value + DIFFERENCE * one.scale_at(value) <= one.upper else -DIFFERENCE
        p = packed.p.copy()
        p[one.slot] += part * one.scale_at(value)
        models.append(Packed(p, packed.on))
        parts.append(part)
    found = residuals(problem.data, models, problem.moved)
    return np.asarray((found[1:] - found[0]).T / parts)


def _seen(problem: Problem, packed: Packed, torque: Floats) -> Floats:
    """A torque at the shaft [N m], shape (n,), as a residual has it: in the demand's scale, low-passed, shape (m,)."""
    slope = torque_slope(packed.p, packed.on, problem.moved.torque)
    return smoothed(problem.data, np.ascontiguousarray(torque / slope))


def _parts(problem: Problem, packed: Packed, told: Proportion) -> tuple[Floats, Floats]:
    """Both parts as a residual has them, shape (m,) each."""
    moved = problem.moved
    first, second = told.parts(packed.p, moved.position, moved.velocity, moved.acceleration)
    return _seen(problem, packed, first), _seen(problem, packed, second)


def _parts_of_each(
    problem: Problem, packed: Packed, own: Sequence[Free], told: Proportion
) -> tuple[Floats, Floats]:
    """Both parts that each of the effect's parameters, as long as its scale, adds; shape (m, parameters) each."""
    here, found = _parts(problem, packed, told), []
    for one in own:
        more = packed.p.copy()
        more[one.slot] += one.scale_at(float(packed.p[one.slot]))
        there = _parts(problem, Packed(more, packed.on), told)
        found.append((there[0] - here[0], there[1] - here[1]))
    first, second = (np.column_stack(columns) for columns in zip(*found, strict=True))
    return first, second


def _error_of(left: Callable[[float], Floats], best: float) -> float:
    """Standard error of where a squared error is lowest, by its slope second by second."""
    below, here, above = (left(best + step) for step in (-WITHIN, 0.0, WITHIN))
    bend = float((above - 2.0 * here + below).sum()) / WITHIN**2
    slopes = by_second(above - below) / (2.0 * WITHIN)
    return math.sqrt(float(slopes @ slopes)) / bend if bend > 0.0 else math.inf


@dataclass(frozen=True, slots=True)
class Relaxed:
    """A torque over the place of which a part `held` stays at rest, ± its `error`; the rest goes in `seconds`."""

    effect: str
    held: float
    seconds: float
    error: float = 0.0


def relaxing(problem: Problem, model_fit: ModelFit) -> Relaxed | None:
    """The first effect of the place whose torque goes while the axis stays; None where each holds.

    A spring and a weight pull as much after an hour as after a move. A gas that warms and cools or leaks, a dashpot
    behind a spring do not: beside the effect the same course behind a first-order lag, all else refitted to first order
    (the contact, too, which keeps where the motion turned), errs less beyond chance, explains half of what the effect
    leaves, on training and veto, and takes beyond chance more of the torque away than a name may leave.
    """
    found = (_relaxed(problem, model_fit, effect) for effect in model_fit.effects)
    z, least = problem.policy.apart_z, problem.policy.named
    return next((one for one in found if one is not None and one.held + z * one.error < least), None)


def _relaxed(problem: Problem, model_fit: ModelFit, effect: str) -> Relaxed | None:
    """How much of an effect's torque stays at rest; None where nothing tells of its going, or it has none."""
    kind = EFFECTS[effect]
    torque_at = kind.kernels.torque
    if torque_at is None or kind.terms is not None:
        return None
    data, packed, error = problem.data, model_fit.fitted.packed, model_fit.fitted.error
    course = np.array([torque_at(packed.p, place) for place in problem.moved.position])
    weight = problem.weight * data.role(TRAINING, VETO)
    changed = _changes(problem, packed, model_fit.free)
    longest = data.period * max(one.stop - one.start for one in data.stretches)
    times = np.geomspace(SOONEST, max(SEEN_TO_ITS_END * longest, 2.0 * SOONEST), RELAXATIONS)
    lates = [_seen(problem, packed, followed_late(data, course, seconds)) for seconds in times]
    lefts = [followed(np.column_stack([changed, late]), error, weight) for late in lates]
    best = min(range(len(times)), key=lambda i: float(weight @ lefts[i] ** 2))
    if best in (0, len(times) - 1):  # sooner or later still: not what is looked for
        return None
    both = [followed(changed, error, weight), lefts[best]]
    here, there = (replace(model_fit, fitted=replace(model_fit.fitted, error=one)) for one in both)
    if not _explains_rest(problem, here, there):
        return None
    slots = {one.slot for one in kind.parameters}
    others = changed[:, [one.slot not in slots for one in model_fit.free]]
    table = np.column_stack([others, _seen(problem, packed, course), lates[best]])
    root = np.sqrt(weight)
    *_, more, late = np.linalg.lstsq(table * root[:, None], error * root, rcond=None)[0]
    alone = weight * followed(table[:, :-1], table[:, -1], weight)
    slopes = by_second(alone * followed(table, error, weight))
    spread = math.sqrt(float(slopes @ slopes)) / max(float(alone @ table[:, -1]), 1e-300)
    whole = max(1.0 + float(more), 1e-3)
    return Relaxed(effect, 1.0 + float(late) / whole, float(times[best]), spread / whole)


def _explains_rest(problem: Problem, before: ModelFit, after: ModelFit) -> bool:
    """Whether a model errs less beyond chance than one before it, and explains half of its rest."""
    weight = problem.weight * problem.data.role(TRAINING, VETO)
    less = weight * (before.fitted.error**2 - after.fitted.error**2)
    half = [part.share >= problem.policy.partly for part in explained_of_rest(problem, before, after)]
    return all(half) and beyond_chance(less, problem.policy.apart_z)
