"""Another trajectory decides: an effect found on one recording, carried unchanged to another.

In one recording several effects may explain the same error. Carried to a second trajectory the right one
lowers the error there, the wrong ones raise it. Each recording is held out in turn, the model with and
without the effect is fitted on the others and not changed any more; a `veto` segment is held out always.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.diagnose.candidates import Refitted, without_effect
from autotune.estimation.bias_corrected_fit import Level
from autotune.estimation.cross_validation import Unseen, gain_and_z
from autotune.estimation.data import VETO
from autotune.estimation.problem import CHUNK, Study, refit

LEAST_ROWS = 60
LEAST_REST = 0.25
"""Of the rows: with fewer left the other recordings say too little to be carried anywhere."""
ITERATIONS = 10


@dataclass(frozen=True, slots=True)
class Elsewhere:
    """What an effect does to the error on trajectories that were not fitted.

    Attributes:
        gain: relative fall of the squared error there; below 0 it rose.
        lowers: whether it lowers it beyond chance.
        rivals: effects in its place that do nearly as well there.
    """

    effect: str
    gain: float
    z: float
    lowers: bool = False
    rivals: tuple[str, ...] = ()

    @property
    def confirmed(self) -> bool:
        return self.lowers and not self.rivals

    @property
    def refuted(self) -> bool:
        return self.gain < 0.0


def elsewhere(study: Study, root: Level, chosen: Refitted) -> list[Elsewhere]:
    """For every effect found: what it does on other trajectories; empty where there is none."""
    folds = list(folds_of(study))
    if study.data.repeated or study.data.steady or not folds:
        return []
    found = []
    for effect in chosen.level.effects:
        less = level_without(study, root, chosen.level, effect)
        if less is not None:
            found += _judged(study, folds, less, chosen.level, effect)
    return found


def level_without(study: Study, root: Level, level: Level, effect: str) -> Level | None:
    """The model refitted without one of its effects."""
    if len(level.effects) < 2:
        return root
    without = without_effect(study, root, level, effect)
    return None if without is None else without.level


def best_elsewhere(study: Study, refits: Sequence[Refitted]) -> Refitted:
    """Of candidates that explain nearly alike the one that errs least on other trajectories.

    The one of the highest gain where there is no other trajectory.
    """
    best = max(refits, key=lambda item: item.gain)
    near = [item for item in refits if item.gain >= study.policy.alike_elsewhere * best.gain]
    folds = list(folds_of(study)) if len(near) > 1 and not study.data.steady else []
    if not folds:
        return best
    return min(near, key=lambda item: _error_elsewhere(study, folds, item.level))


def _error_elsewhere(study: Study, folds: list[Flags], level: Level) -> float:
    return sum(float(np.sum(carried_error(study, level, held)[held] ** 2)) for held in folds)


def carried_on(study: Study, root: Level, chosen: Refitted) -> tuple[Refitted | None, list[Elsewhere]]:
    """What was found, without the effects that another trajectory refutes."""
    carried = elsewhere(study, root, chosen)
    for item in carried:
        if not item.refuted:
            continue
        if len(chosen.level.effects) < 2:
            return None, carried
        less = without_effect(study, root, chosen.level, item.effect)
        chosen = less if less is not None else chosen
    return chosen, carried


def said(carried: Sequence[Elsewhere]) -> tuple[str, ...]:
    """What another trajectory says, one sentence an effect."""
    return tuple(
        f"Carried unchanged to another trajectory, {item.effect.replace('_', ' ')} "
        + (
            f"raises the squared error there by {-100 * item.gain:.0f} %: it is not the cause."
            if item.refuted
            else f"lowers the squared error there by {100 * item.gain:.0f} %"
            + (f"; {_listed(item.rivals)} in its place does nearly as well." if item.rivals else ".")
        )
        for item in carried
    )


def _listed(effects: Sequence[str]) -> str:
    return " or ".join(effect.replace("_", " ") for effect in effects)


def _judged(study: Study, folds: list[Flags], less: Level, more: Level, effect: str) -> list[Elsewhere]:
    before: list[float] = []
    after: list[float] = []
    for held in folds:
        plain, with_effect = carried_error(study, less, held), carried_error(study, more, held)
        size = min(float(np.mean(error[held] ** 2)) for error in (plain, with_effect))
        if not size < study.policy.lost * max(less.fitted.cost, 1e-300):
            continue
        before += chunks_of(plain[held])
        after += chunks_of(with_effect[held])
    if not before:
        return []
    gain, z = gain_and_z(Unseen(np.array(before)), Unseen(np.array(after)))
    if not math.isfinite(gain):
        return []
    policy = study.policy
    lowers = gain >= policy.confirming_gain or (gain >= policy.least_gain and z >= policy.apart_z)
    return [Elsewhere(effect, gain, z, lowers)]


def folds_of(study: Study) -> Iterator[Flags]:
    """Grid rows to be held out: the veto trajectory, else each recording in turn."""
    data = study.data
    if study.has(VETO):
        yield data.role(VETO) & (study.weight > 0)
        return
    if len(data.starts) < 2:
        return
    number = np.searchsorted(np.array(data.starts), data.grid, side="right")
    fitted = study.training > 0
    for one in np.unique(number):
        held = fitted & (number == one)
        left = fitted & (number != one)
        if held.sum() >= LEAST_ROWS and left.sum() >= LEAST_REST * fitted.sum():
            yield held


def carried_error(study: Study, level: Level, held: Flags) -> Floats:
    """Error of the model fitted without the rows held out, shape (m,)."""
    others = replace(study, weight=study.weight * ~held)
    return refit(others, level.fitted.packed, list(level.free), level.correction, ITERATIONS).error


def chunks_of(error: Floats) -> list[float]:
    """Squared error of pieces that are compared pairwise."""
    pieces = max(1, min(len(error) // 20, max(10, len(error) // CHUNK)))
    return [float(np.sum(part**2)) for part in np.array_split(error, pieces)]
