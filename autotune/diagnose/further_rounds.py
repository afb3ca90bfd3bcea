"""More rounds for fits that two do not settle: two masses, and effects beside others.

What an unsettled fit leaves would look like a further effect, and a rival that has settled sooner like the
better name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from autotune.diagnose.candidates import Progress, Refitted, judged
from autotune.estimation.bias_corrected_fit import Level, settle
from autotune.estimation.data import TRAINING, VETO
from autotune.estimation.problem import Study

MOST_POLISHES = 3


def best_polished(
    study: Study, root: Level, refits: Sequence[Refitted], progress: Progress
) -> list[Refitted]:
    """The refit that leaves least, polished: beside another effect it has not settled after two rounds."""
    if not refits:
        return []
    best = min(refits, key=lambda item: error_left(study, item.level))
    if not study.policy.nearly < best.share < study.policy.refined:
        return list(refits)
    done = polished(study, root, best, progress)
    return [replace(done, effect=best.effect, gain=max(best.gain, done.gain))]


def polished(study: Study, root: Level, chosen: Refitted, progress: Progress) -> Refitted:
    """More rounds of the same fit, as long as they help: two masses need them, and what they leave misleads."""
    for _ in range(MOST_POLISHES):
        level = chosen.level
        if level.settled:
            break
        progress(f"refinement with {' and '.join(level.effects)}")
        better = settle(study, level.fitted.packed, list(level.free), 4, level.effects, level.fitted)
        if better is None or better.fitted.cost >= level.fitted.cost:
            return replace(chosen, level=replace(level, settled=True))
        gained = 1.0 - better.fitted.cost / level.fitted.cost
        settled = better.settled or gained < study.policy.worth_refining
        chosen = judged(study, root, replace(better, settled=settled), chosen.effect)
        if chosen.share >= study.policy.refined:
            break
    return chosen


def error_left(study: Study, level: Level) -> float:
    """Error on training and veto together, each by its own share of the rows."""
    error = level.fitted.error
    total = study.mean_square(error, TRAINING)
    return total + (study.mean_square(error, VETO) if study.has(VETO) else 0.0)
