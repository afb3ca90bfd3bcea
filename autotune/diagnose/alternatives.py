"""Would another effect do as well on the other trajectory? Then that one confirms neither.

A second recording that lowers the error of Stribeck friction often lowers that of nonlinear viscosity too. So each
effect found is taken out, the best others are fitted in its place, and all are carried unchanged to the other
trajectory: confirmed is what errs clearly less there than every rival.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from autotune.core.arrays import Flags
from autotune.diagnose.candidates import Refitted, Screened, inside_twin, rank
from autotune.diagnose.second_recording import Elsewhere, carried_error, chunks_of, folds_of, level_without
from autotune.diagnose.single_recording import credible
from autotune.estimation.bias_corrected_fit import Level
from autotune.estimation.cross_validation import Unseen, gain_and_z
from autotune.estimation.policy import Policy
from autotune.estimation.problem import Study
from autotune.models.drive_model import Packed


def challenged(
    study: Study,
    root: Level,
    chosen: Refitted | None,
    carried: Sequence[Elsewhere],
    first: Sequence[Screened],
    nominal: Packed,
) -> list[Elsewhere]:
    """What another trajectory said, with the rivals that do nearly as well there.

    `first` are the candidates as they were ranked before anything was found.
    """
    folds = [] if chosen is None else list(folds_of(study))
    if chosen is None or not folds:
        return list(carried)

    def ranked(less: Level) -> Sequence[Screened]:
        return rank(study, less, nominal, lambda _: None) if less.effects else first

    return [_challenged(study, root, chosen, item, ranked, folds) for item in carried]


def _challenged(
    study: Study,
    root: Level,
    chosen: Refitted,
    item: Elsewhere,
    ranking: Callable[[Level], Sequence[Screened]],
    folds: Sequence[Flags],
) -> Elsewhere:
    if not item.lowers or item.effect not in chosen.level.effects:
        return item
    less = level_without(study, root, chosen.level, item.effect)
    if less is None:
        return item
    ranked = ranking(less)
    own = next((one.gain for one in ranked if one.effect == item.effect), item.gain)
    near = [one for one in ranked if _rival(study, one, item.effect, own)][: study.policy.most_alternatives]
    error = _pieces(study, chosen.level, folds)
    rivals = []
    for one in near:
        refitted = inside_twin(study, root, less, one)
        if refitted is not None and not _separated(
            study.policy, error, _pieces(study, refitted.level, folds)
        ):
            rivals.append(one.effect)
    return replace(item, rivals=tuple(rivals))


def _rival(study: Study, one: Screened, effect: str, gain: float) -> bool:
    return one.effect != effect and one.gain >= study.policy.rival_gain * gain and credible(study, one)


def _pieces(study: Study, level: Level, folds: Sequence[Flags]) -> Unseen:
    """Squared error on every trajectory, of the model fitted to the others."""
    return Unseen(np.array([p for held in folds for p in chunks_of(carried_error(study, level, held)[held])]))


def _separated(policy: Policy, own: Unseen, rival: Unseen) -> bool:
    """Whether the effect errs clearly less than its rival."""
    gain, z = gain_and_z(rival, own)
    return gain >= policy.confirming_gain or (gain >= policy.confirming_margin and z >= policy.apart_z)
