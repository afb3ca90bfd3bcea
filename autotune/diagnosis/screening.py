"""A first look at every candidate: short fits on the measured motion, ranked by what they gain on data held out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.time_limit import TimeIsUp, while_time
from autotune.diagnosis.candidates import Gain, Progress, ScreenedCandidate
from autotune.diagnosis.evidence.evidence import Evidence
from autotune.diagnosis.starts import Context, FitStart, scouted, shapes, starts_of
from autotune.diagnosis.transmission import adds_nothing
from autotune.estimation.bias_corrected_fit import (
    STEPS_A_ROUND,
    ModelFit,
    fit_inside_twin,
    held_out_of,
    stepped,
    twinned,
)
from autotune.estimation.coordinates import generic_columns
from autotune.estimation.cross_validation import (
    drift,
    evenly,
    gain_and_z,
    held_out,
    still_explainable,
    with_columns,
)
from autotune.estimation.data import TRAINING
from autotune.estimation.least_squares import Fitted, Steps, done_together, fitting
from autotune.estimation.problem import Problem, refit, refits
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.effect import Kind
from autotune.models.layout import flag
from autotune.models.spring import SPRING
from autotune.models.table import EFFECTS
from autotune.models.transmission import BETWEEN

PROMISING = 0.009
"""Relative fall of the cost in a short fit that is followed to its end: a third of the least gain."""
NEAR_BEST, NEAR_WORTH = 0.3, 0.5
"""Beside another effect: of the best short fit's fall, and of the fall that a further effect is worth having for."""
HOPEFUL = 3e-3
"""Relative fall of the cost that a short fit must be able to reach, to be begun."""
MOST_BACK = 0.5
"""Of the rows that were left out: an effect beside which no more of them stand out explains most."""
TO_ITS_END = 15
"""Rounds of a fit that is not given up."""


@dataclass(frozen=True, slots=True)
class _ShortFit:
    """A short fit, and the start that it was made from."""

    start: Packed
    fitted: Fitted


def screen(
    problem: Problem, evidence: Evidence, model_fit: ModelFit, nominal: Packed, effect: str
) -> ScreenedCandidate | None:
    """The best fit of one effect on the measured motion; None where it has no start here."""
    kind = EFFECTS[effect]
    tried = _short_fits(problem, model_fit, nominal, kind)
    return _followed(problem, evidence, model_fit, kind, tried, PROMISING) if tried else None


def at_its_best(
    problem: Problem, evidence: Evidence, model_fit: ModelFit, nominal: Packed, effect: str
) -> ScreenedCandidate | None:
    """The same with every start followed to its end, whatever it promises.

    A first look gives up what begins far from where it would be as good as another; whether it would be is asked then.
    """
    kind = EFFECTS[effect]
    starts = [
        (item.start, [*item.fitted.free, *shapes(effect, item.start)], None)
        for item in _short_fits(problem, model_fit, nominal, kind)
    ]
    fits = refits(problem, starts, model_fit.correction, TO_ITS_END)
    best = min(fits, key=lambda item: item.cost, default=None)
    return None if best is None else _judged(problem, model_fit, kind, best, ())


def rank(
    problem: Problem,
    evidence: Evidence,
    model_fit: ModelFit,
    nominal: Packed,
    progress: Progress,
    worth: float = 0.0,
) -> list[ScreenedCandidate]:
    """All candidates that are not in the model, by their gain on unseen experiments.

    Beside an effect that is there already only those are followed to the end whose short fits come near the
    best one, and near the fall of the mean square that a further effect is `worth` having for [(N m)²]. No spring
    is looked for beside a gap, which has one, and no weight beside a spring where it would be that spring's course.
    Where time is up those that were tried until then are told; what was not followed, as its short fit ended. The best
    are followed first.
    """
    base = _walked_on(problem, model_fit)
    tried: list[tuple[Kind, list[_ShortFit]]] = []
    for kind in sorted(evidence.candidates(problem), key=lambda kind: kind.in_transmission):
        there = model_fit.fitted.packed.on[flag(kind.name)] and not kind.may_grow
        if there or adds_nothing(kind, model_fit) or _is_its_course(problem, kind, model_fit):
            continue
        progress(f"candidate {kind.name}")
        needed = _needed(problem, evidence, base, tried, worth) if kind.in_transmission else 0.0
        try:
            fits = _short_fits(problem, base, nominal, kind, needed)
        except TimeIsUp:
            break
        if fits:
            tried.append((kind, fits))
    least = _least_fall(problem, base, [fits[0] for _, fits in tried], worth)
    best_first = sorted(range(len(tried)), key=lambda i: tried[i][1][0].fitted.cost)
    followed = {i: _followed(problem, evidence, base, *tried[i], least) for i in best_first}
    found = [followed[i] for i in range(len(tried))]
    found = evidence.borne_out(model_fit, [item for item in found if np.isfinite(item.gain)])
    return sorted(found, key=lambda item: -item.gain)


def _is_its_course(problem: Problem, kind: Kind, model_fit: ModelFit) -> bool:
    """Whether it is a weight beside a spring that was found, or a spring beside a weight, over too little travel for
    the weight to show its wave.

    A spring by another law is any smooth course of the place, and there the wave is one, too: both together are one
    spring that is not straight.
    """
    p, travel = model_fit.fitted.packed.p, problem.scales.travel
    both = [kind, *(EFFECTS[name] for name in model_fit.effects)]
    waves = [one for one in both if one.shows_course is not None and not one.shows_course(p, travel)]
    return kind in (*waves, SPRING) and bool(waves) and SPRING in both


def rows_back(
    problem: Problem, evidence: Evidence, root: ModelFit, nominal: Packed, progress: Progress
) -> tuple[Problem, ModelFit]:
    """Problem and root with those rows that were left out as events, where an effect explains most of them.

    What shows at reversals only, or at high torque, looks like starts and stops until it is looked for there.
    """
    out = float(np.mean(problem.weight == 0.0))
    whole = replace(problem, weight=np.ones_like(problem.weight))
    base = None
    if out > 0.0 and evidence.weights(problem, root.fitted.error) is not None:
        base = fit_inside_twin(whole, root.fitted.packed, list(root.free), 2, root.effects)
    if base is None:
        return problem, root
    found = [
        evidence.weights(whole, item.fitted.error) for item in rank(whole, evidence, base, nominal, progress)
    ]
    weight = max((one for one in found if one is not None), key=np.count_nonzero, default=problem.weight)
    if np.mean(weight == 0.0) > MOST_BACK * out:
        return problem, root
    again = replace(problem, weight=weight)
    there = fit_inside_twin(again, root.fitted.packed, list(root.free), 2, root.effects)
    return (problem, root) if there is None else (again, there)


def _least_fall(problem: Problem, base: ModelFit, best: Sequence[_ShortFit], worth: float) -> float:
    """Relative fall of the cost from which a short fit is followed to its end."""
    cost = base.fitted.cost
    if not base.effects:
        return PROMISING
    largest = max((1.0 - item.fitted.cost / cost for item in best), default=0.0)
    near = max(NEAR_BEST * largest, NEAR_WORTH * worth / cost)
    return max(PROMISING, near)


def _needed(
    problem: Problem,
    evidence: Evidence,
    base: ModelFit,
    tried: Sequence[tuple[Kind, Sequence[_ShortFit]]],
    worth: float,
) -> float:
    """Relative fall of the cost without which an effect comes to nothing, by itself or beside those that were tried.

    Two masses are looked for last, as that is dear: beside what explains most of the error, in the rows that were
    fitted and in those held out, they matter only if they explain a good part of as much. What they do comes again in
    every repeat: where nothing of that is left beyond doubt, what none of their starts shows a trace of is not sought.
    Nor is what is not `worth` having beside an effect that is there.
    """
    cost = base.fitted.cost
    leads = [
        min(1.0 - best.cost / cost, gain_and_z(base.unseen, held_out(problem, best.error, best.jacobian))[0])
        for best in (fits[0].fitted for kind, fits in tried if not kind.in_transmission)
    ]
    beside = NEAR_BEST * max((lead for lead in leads if math.isfinite(lead)), default=0.0)
    least = 0.0 if more_to_explain(problem, evidence, base) else problem.policy.least_gain
    return max(beside, least, min(NEAR_WORTH * worth / cost, problem.policy.clear_gain))


def more_to_explain(problem: Problem, evidence: Evidence, model_fit: ModelFit) -> bool:
    """Whether anything is left beyond doubt: certain to one standard error, or drifting."""
    fitted = model_fit.fitted
    noise = problem.noise_variance(fitted.error, TRAINING)
    if not math.isfinite(noise):
        return True
    drifting = drift(problem, fitted, model_fit.correction, TRAINING)[0]
    left = still_explainable(problem, fitted, model_fit.correction, TRAINING) - drifting
    return drifting > 0.0 or left > evidence.rest_that_is_none(problem, fitted.error, noise)


def _short_fits(
    problem: Problem, model_fit: ModelFit, nominal: Packed, kind: Kind, needed: float = 0.0
) -> list[_ShortFit]:
    """Short fits from all starts of an effect, the best first; `needed`: see `scouted`.

    A start that was given up by one run of its twin, and by as many as a fit takes falls by what is needed as it is, or
    gains as much on unseen experiments, is looked for after all: it would go on as a candidate whose own parameters
    nothing has moved.
    """
    starts = list(starts_of(kind, Context(problem, model_fit.fitted, nominal)))
    if kind.in_transmission:
        starts = scouted(problem, model_fit, starts, needed)
    ways = [
        way
        for start in starts
        for way in (_short_fit(problem, model_fit, start), _from_its_size(problem, model_fit, kind, start))
    ]
    done = done_together(ways, problem.moved)
    tried = [
        min(found, key=lambda item: item.fitted.cost)
        for both in zip(done[::2], done[1::2], strict=True)
        if (found := [one for one in both if one is not None])
    ]
    given_up = needed > 0.0 and not any(start.free for start in starts)
    if given_up and any(_comes_on(problem, model_fit, item.fitted, needed) for item in tried):
        return _short_fits(problem, model_fit, nominal, kind)
    return sorted(tried, key=lambda item: item.fitted.cost)


def _comes_on(problem: Problem, model_fit: ModelFit, fitted: Fitted, needed: float) -> bool:
    """Whether a fit falls, or gains on unseen experiments, by what is needed."""
    if fitted.cost < (1.0 - needed) * model_fit.fitted.cost:
        return True
    gain, _ = gain_and_z(model_fit.unseen, held_out(problem, fitted.error, fitted.jacobian))
    return gain >= needed


def _from_its_size(
    problem: Problem, model_fit: ModelFit, kind: Kind, start: FitStart
) -> Steps[_ShortFit | None]:
    """A short fit with the size that its shape asks for, as the base is fitted beside it; None where size is all.

    What a base takes up of an effect may be many times what it leaves. Begun as large as that, both are led by a shape
    that has hardly a size yet, along a curved valley: of a film that shears off, on one trajectory, such a fit
    explained a fifth after fifteen rounds, and this one five sixths after two.
    """
    size = [one for one in start.free if one.slot == kind.slot(kind.size)] if kind.size else []
    if not size or len(start.free) == 1:
        return None
    fitted = yield from fitting(
        problem.data, start.packed, [*model_fit.free, *size], model_fit.correction.bias, problem.training, 2,
        known=(model_fit.fitted.jacobian, model_fit.fitted.scales), whole=False,
    )  # fmt: skip
    if not math.isfinite(fitted.cost):
        return None
    return (yield from _short_fit(problem, model_fit, replace(start, packed=fitted.packed)))


def _short_fit(problem: Problem, model_fit: ModelFit, start: FitStart) -> Steps[_ShortFit | None]:
    """Two steps from a start, with the sensitivities of what is already in the model taken from there.

    What a second mass does only its own twin tells, from which a fit inside it goes on.
    """
    if problem.two_masses(start.packed) and (not start.free or start.free[0].slot in BETWEEN):
        here = twinned(problem, start.packed)
        if here is None:
            return None
        if not start.free:
            known_here = replace(model_fit.fitted, packed=here.packed, error=here.error, cost=here.cost)
            return _ShortFit(start.packed, known_here)
        hopeful = (1.0 - HOPEFUL) * model_fit.fitted.cost
        free = [*model_fit.free, *start.free]
        return _ShortFit(start.packed, stepped(problem, here, free, STEPS_A_ROUND, hopeful=hopeful))
    same = start.packed.p[layout.INERTIA] == model_fit.fitted.packed.p[layout.INERTIA]
    known = (model_fit.fitted.jacobian, model_fit.fitted.scales) if same else None
    fitted = yield from fitting(
        problem.data, start.packed, [*model_fit.free, *start.free], model_fit.correction.bias,
        problem.training, 2, known=known, hopeful=(1.0 - HOPEFUL) * model_fit.fitted.cost, whole=False,
    )  # fmt: skip
    return _ShortFit(start.packed, fitted) if math.isfinite(fitted.cost) else None


def _followed(
    problem: Problem,
    evidence: Evidence,
    model_fit: ModelFit,
    kind: Kind,
    tried: list[_ShortFit],
    least: float,
) -> ScreenedCandidate:
    """Promising starts followed to their end, while there is time; `least`: relative fall of the cost that promises."""
    found = [item.fitted for item in tried]
    best, cost = found[0], model_fit.fitted.cost
    fall = cost - best.cost
    # two masses are followed inside the twin only: with a held bias a longer fit leads them away
    inside_only = problem.twin and kind.in_transmission
    falls = fall > least * cost
    if not inside_only and (falls or any(_promises(problem, evidence, model_fit, one) for one in found)):
        effort = evidence.effort(problem)
        # a start that has come to nothing, as it was without the effect, is no measure of the others
        enough = effort.close * fall if falls else -math.inf
        starts = [
            (one.packed, [*one.free, *shapes(kind.name, one.packed)], one if model_fit.effects else None)
            for one in [f for f in found if cost - f.cost > enough][: effort.starts]
        ]
        ends = while_time(lambda: refits(problem, starts, model_fit.correction, effort.rounds), ())
        for finished in ends:
            best = finished if finished.cost <= best.cost else best
    before = [item.packed for item in found] + [item.start for item in tried]
    others = tuple(packed for packed in before if packed is not best.packed)
    return _judged(problem, model_fit, kind, best, others)


def _judged(
    problem: Problem, model_fit: ModelFit, kind: Kind, best: Fitted, others: tuple[Packed, ...]
) -> ScreenedCandidate:
    """What the best fit of an effect gains on unseen experiments."""
    unseen = held_out(problem, best.error, best.jacobian)
    gain, z = gain_and_z(model_fit.unseen, unseen)
    fall = model_fit.fitted.cost - best.cost
    return ScreenedCandidate(kind.name, best, fall, gain, z, others, evenly(model_fit.unseen, unseen))


def _promises(problem: Problem, evidence: Evidence, model_fit: ModelFit, short: Fitted) -> bool:
    """Whether a short fit that has not got below the model without the effect would, by its linear model.

    Some base parameter then has further to go than two steps.
    """
    if short.cost <= model_fit.fitted.cost or not evidence.effort(problem).follows_promises:
        return False
    gain, _ = gain_and_z(model_fit.unseen, held_out(problem, short.error, short.jacobian))
    return gain > problem.policy.clear_gain


def _walked_on(problem: Problem, model_fit: ModelFit) -> ModelFit:
    """What candidates are compared with: the model itself, fitted as they are.

    Between two masses a bias that is held lets every fit walk on a little, with or without a candidate.
    """
    if not problem.two_masses(model_fit.fitted.packed):
        return model_fit
    before = model_fit.fitted
    fitted = refit(problem, before.packed, list(model_fit.free), model_fit.correction, 2, near=before)
    return held_out_of(problem, replace(model_fit, fitted=fitted))


def generic_gains(problem: Problem, model_fit: ModelFit) -> dict[str, Gain]:
    """Gain on unseen experiments of free functions of a coordinate."""
    gains: dict[str, Gain] = {}
    for name, columns in generic_columns(problem.data, problem.training > 0).items():
        after = with_columns(problem, model_fit.fitted, columns)
        gains[name] = Gain(*gain_and_z(model_fit.unseen, after), evenly(model_fit.unseen, after))
    return gains
