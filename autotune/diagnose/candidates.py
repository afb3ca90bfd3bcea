"""The search for what is missing: screen every family, refit the best inside the twin, add, prune."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from autotune.diagnose.starts import FAMILIES, Context, Start, shapes
from autotune.estimation import speed_points as speed_curve
from autotune.estimation.alignment import best_shift, shifted
from autotune.estimation.bias_corrected_fit import Level, settle, settle_somewhere
from autotune.estimation.coordinates import generic_columns
from autotune.estimation.cross_validation import Explained, explained, gain_and_z, held_out
from autotune.estimation.data import TRAINING, VETO
from autotune.estimation.least_squares import Fitted, fit
from autotune.estimation.problem import Study, refit, without_outlying
from autotune.estimation.residual import measured_motion
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.table import EFFECTS
from autotune.models.transmission import has_load

Progress = Callable[[str], None]
HOPEFUL = 3e-3
"""Relative fall of the cost after which a short fit need not go on."""
APPROXIMATE = frozenset({"reversal_memory"})
"""Effects whose law is a few elements in place of a distribution: some rest is their own."""
TWO_MASSES = frozenset({"elastic_transmission", "backlash"})
"""Families that are followed inside the twin only: with a held bias a longer fit leads them away."""


@dataclass(frozen=True, slots=True)
class Screened:
    """A family refitted with the bias of the model without it.

    Attributes:
        fall: of the mean square [(N m)²]; gain, z: on experiments held out.
        others: where else it could begin: shorter fits, and their starts.
    """

    effect: str
    fitted: Fitted
    fall: float
    gain: float
    z: float
    others: tuple[Packed, ...] = ()


@dataclass(frozen=True, slots=True)
class Refitted:
    """A family refitted inside the twin, and what it explains of training and veto.

    `named`: whether that is so much that its effects can be named.
    """

    effect: str
    level: Level
    gain: float
    training: Explained
    veto: Explained | None
    named: bool = False

    @property
    def share(self) -> float:
        return min(self.training.share, self.veto.share if self.veto else 1.0)


def screen(study: Study, level: Level, nominal: Packed, effect: str) -> Screened | None:
    """The best refit of one family on the measured motion; None where it has no start here."""
    tried = _quick(study, level, nominal, effect)
    return _finished(study, level, effect, tried, study.policy.promising_fall) if tried else None


@dataclass(frozen=True, slots=True)
class _Tried:
    """A short refit, and the start that it was made from."""

    start: Packed
    fitted: Fitted


def _quick(study: Study, level: Level, nominal: Packed, effect: str) -> list[_Tried]:
    """Short refits from all starts of a family, the best first."""
    context = Context(study, level.fitted, nominal)
    tried: list[_Tried] = []
    for start in FAMILIES[effect](context):
        fitted = _try(study, level, start, 2, quick=True)
        if fitted is not None:
            tried.append(_Tried(start.packed, fitted))
    return sorted(tried, key=lambda item: item.fitted.cost)


def _finished(study: Study, level: Level, effect: str, tried: list[_Tried], least: float) -> Screened:
    """Promising starts followed to their end; `least` is the relative fall of the cost that promises."""
    found = [item.fitted for item in tried]
    best = found[0]
    fall = level.fitted.cost - best.cost
    in_twin = study.twin and effect in TWO_MASSES
    if not in_twin and (fall > least * level.fitted.cost or _promises(study, level, best)):
        close, most, rounds = (0.0, 9, 15) if study.data.steady else (study.policy.close_start, 2, 4)
        enough = close * fall if fall > 0.0 else -math.inf
        for start in [f for f in found if level.fitted.cost - f.cost > enough][:most]:
            near = start if level.effects else None
            free = [*start.free, *shapes(effect, start.packed)]
            finished = refit(study, start.packed, free, level.correction, rounds, near)
            best = finished if finished.cost <= best.cost else best
    gain, z = gain_and_z(level.unseen, held_out(study, best.error, best.jacobian))
    before = [item.packed for item in found] + [item.start for item in tried]
    others = tuple(packed for packed in before if packed is not best.packed)
    return Screened(effect, best, level.fitted.cost - best.cost, gain, z, others)


def _promises(study: Study, level: Level, short: Fitted) -> bool:
    """Whether a short refit that has not got below the model without the family would, by its linear model.

    Some base parameter then has further to go than two steps.
    """
    if short.cost <= level.fitted.cost or study.data.steady:
        return False
    return gain_and_z(level.unseen, held_out(study, short.error, short.jacobian))[0] > study.policy.clear_gain


def _try(study: Study, level: Level, start: Start, iterations: int, quick: bool = False) -> Fitted | None:
    """Fits from a start; `quick` takes the sensitivities of what is already in the model from there."""
    free = [*level.free, *start.free]
    known = (level.fitted.jacobian, level.fitted.scales) if quick else None
    hopeful = (1.0 - HOPEFUL) * level.fitted.cost if quick else math.inf
    fitted = fit(
        study.data, study.moved, start.packed, free, level.correction.bias, study.training, iterations,
        known=known, hopeful=hopeful, whole=False,
    )  # fmt: skip
    return fitted if math.isfinite(fitted.cost) else None


def rank(
    study: Study, level: Level, nominal: Packed, progress: Progress, worth: float = 0.0
) -> list[Screened]:
    """All families that are not in the model, by their gain on unseen experiments.

    Beside an effect that is there already only those are followed to the end whose short refits come near the
    best one, and near the fall of the mean square that a further effect is `worth` having for [(N m)²].
    """
    base = _walked_on(study, level)
    tried: dict[str, list[_Tried]] = {}
    for effect in study.candidates:
        if level.fitted.packed.on[layout.flag(effect)] and effect != "torque_ripple":
            continue
        if effect == "torque_lag" and not (study.twin or study.data.repeated):
            continue  # the torque was aligned with the motion by half samples: nothing to tell a lag by
        if study.data.steady and effect not in speed_curve.FAMILIES:
            continue
        progress(f"candidate {effect}")
        if fits := _quick(study, base, nominal, effect):
            tried[effect] = fits
    cost = base.fitted.cost
    largest = max((1.0 - fits[0].fitted.cost / cost for fits in tried.values()), default=0.0)
    near = (
        max(study.policy.near_best_beside * largest, study.policy.near_worth_beside * worth / cost)
        if level.effects
        else 0.0
    )
    least = max(study.policy.promising_fall, near)
    found = [_finished(study, base, effect, fits, least) for effect, fits in tried.items()]
    return sorted((item for item in found if np.isfinite(item.gain)), key=lambda item: -item.gain)


def _walked_on(study: Study, level: Level) -> Level:
    """What candidates are compared with: the model itself, fitted as they are.

    Between two masses a bias that is held lets every fit walk on a little, with or without a candidate.
    """
    if not (study.twin and has_load(level.fitted.packed.on)):
        return level
    known = (level.fitted.jacobian, level.fitted.scales)
    fitted = fit(
        study.data, study.moved, level.fitted.packed, level.free, level.correction.bias, study.training, 2,
        known=known,
    )  # fmt: skip
    return replace(level, fitted=fitted, unseen=held_out(study, fitted.error, fitted.jacobian))


def inside_twin(
    study: Study,
    root: Level,
    level: Level,
    candidate: Screened,
    target: float = math.inf,
    best_start: bool = False,
) -> Refitted | None:
    """A candidate refitted with its own bias; shares count from the model without any found effect.

    `target`: see `settle`. Two masses begin at the first start that is better than the model without the candidate,
    or at the `best_start` of all.
    """
    effects = tuple(dict.fromkeys([*level.effects, candidate.effect]))
    fitted = candidate.fitted
    if study.twin and has_load(fitted.packed.on):
        starts = [fitted.packed, *candidate.others]
        enough = 0.0 if best_start else level.fitted.cost
        settled = settle_somewhere(study, starts, enough, fitted.free, effects, target)
    else:
        settled = settle(study, fitted.packed, fitted.free, 2, effects, fitted)
    if settled is None:
        return None
    return judged(study, root, settled, candidate.effect, level)


def judged(study: Study, root: Level, settled: Level, effect: str, level: Level | None = None) -> Refitted:
    """What a settled model explains; the gain counts from `level`, or from the root."""
    gain = gain_on_veto if has_load(settled.fitted.packed.on) and study.has_veto else _gain_held_out
    parts = [
        explained(study, root.fitted, settled.fitted, settled.correction, role) for role in (TRAINING, VETO)
    ]
    veto = parts[1] if study.has(VETO) else None
    found = Refitted(effect, settled, gain(study, level or root, settled), parts[0], veto)
    certain = parts[0].certain or (veto is not None and veto.certain)
    approximate = not APPROXIMATE.isdisjoint(settled.effects)
    enough = study.policy.named_with_rest if certain and not approximate else study.policy.named
    return replace(found, named=found.share >= enough)


def _gain_held_out(study: Study, before: Level, after: Level) -> float:
    """Fall of the squared error on experiments held out, each predicted by a linearised refit."""
    return gain_and_z(before.unseen, after.unseen)[0]


def gain_on_veto(study: Study, before: Level, after: Level) -> float:
    """The same on the veto trajectory, which nothing is fitted to: blows between two masses are not linear."""
    errors = [study.mean_square(level.fitted.error, VETO) for level in (before, after)]
    return 1.0 - errors[1] / max(errors[0], 1e-300)


def generic_gains(study: Study, level: Level) -> dict[str, float]:
    """Gain on unseen experiments of free functions of a coordinate."""
    gains: dict[str, float] = {}
    for name, columns in generic_columns(study.data, study.training > 0).items():
        table = np.hstack([level.fitted.jacobian, columns * float(np.std(level.fitted.error))])
        gains[name] = gain_and_z(level.unseen, held_out(study, level.fitted.error, table))[0]
    return gains


def without_effect(study: Study, root: Level, level: Level, effect: str) -> Refitted | None:
    """The model refitted without one of the effects that were found."""
    kind = EFFECTS[effect]
    slots = {parameter.slot for parameter in kind.parameters}
    p, on = level.fitted.packed.p.copy(), level.fitted.packed.on.copy()
    for parameter in kind.parameters:
        p[parameter.slot] = root.fitted.packed.p[parameter.slot]
    on[layout.flag(effect)] = root.fitted.packed.on[layout.flag(effect)]
    kept = {f.name for f in root.free}
    free = [f for f in level.free if f.slot not in slots or f.name in kept]
    effects = tuple(name for name in level.effects if name != effect)
    settled = settle(study, Packed(p, on), free, 2, effects)
    if settled is None:
        return None
    return judged(study, root, settled, effects[-1])


def realigned(study: Study, level: Level) -> Study:
    """The study with torque and motion aligned, and rows left out, as this model suggests.

    Only where neither a controller nor repeats say how the columns belong together; the same study where
    nothing changes.
    """
    if study.twin or study.data.repeated or study.data.steady:
        return study
    weight = without_outlying(study, level.fitted.error)
    if np.mean(weight != study.weight) > 1e-3:
        study = replace(study, weight=weight)

    def moved_by(shift: float) -> Study:
        data = shifted(study.data, shift)
        return replace(study, data=data, moved=measured_motion(data))

    def cost(shift: float) -> float:
        return refit(moved_by(shift), level.fitted.packed, list(level.free), level.correction, 6).cost

    here = study.data.shift
    best, lowest = best_shift(cost, here, study.data.finer)
    return study if best == here or lowest > study.policy.worth_aligning * cost(here) else moved_by(best)
