"""A first look at every candidate: short fits on the measured motion, ranked by what they gain on data held out."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from autotune.diagnosis.candidates import Progress, ScreenedCandidate
from autotune.diagnosis.evidence.evidence import Evidence
from autotune.diagnosis.starts import Context, Start, shapes, starts_of
from autotune.estimation.bias_corrected_fit import Level
from autotune.estimation.coordinates import generic_columns
from autotune.estimation.cross_validation import gain_and_z, held_out
from autotune.estimation.least_squares import Fitted, fit
from autotune.estimation.problem import Study, refit
from autotune.models.drive_model import Packed
from autotune.models.effect import Kind
from autotune.models.layout import flag
from autotune.models.table import EFFECTS

PROMISING = 0.009
"""Relative fall of the cost in a short fit that is followed to its end: a third of the least gain."""
NEAR_BEST, NEAR_WORTH = 0.3, 0.5
"""Beside another effect: of the best short fit's fall, and of the fall that a further effect is worth having for."""
HOPEFUL = 3e-3
"""Relative fall of the cost that a short fit must be able to reach, to be begun."""


@dataclass(frozen=True, slots=True)
class _ShortFit:
    """A short fit, and the start that it was made from."""

    start: Packed
    fitted: Fitted


def screen(
    study: Study, evidence: Evidence, level: Level, nominal: Packed, effect: str
) -> ScreenedCandidate | None:
    """The best fit of one effect on the measured motion; None where it has no start here."""
    kind = EFFECTS[effect]
    tried = _short_fits(study, level, nominal, kind)
    return _followed(study, evidence, level, kind, tried, PROMISING) if tried else None


def rank(
    study: Study, evidence: Evidence, level: Level, nominal: Packed, progress: Progress, worth: float = 0.0
) -> list[ScreenedCandidate]:
    """All candidates that are not in the model, by their gain on unseen experiments.

    Beside an effect that is there already only those are followed to the end whose short fits come near the
    best one, and near the fall of the mean square that a further effect is `worth` having for [(N m)²].
    """
    base = _walked_on(study, level)
    tried: list[tuple[Kind, list[_ShortFit]]] = []
    for kind in evidence.candidates(study):
        if level.fitted.packed.on[flag(kind.name)] and not kind.may_grow:
            continue
        progress(f"candidate {kind.name}")
        if fits := _short_fits(study, base, nominal, kind):
            tried.append((kind, fits))
    least = _least_fall(study, base, [fits[0] for _, fits in tried], worth)
    found = [_followed(study, evidence, base, kind, fits, least) for kind, fits in tried]
    found = evidence.borne_out(level, [item for item in found if np.isfinite(item.gain)])
    return sorted(found, key=lambda item: -item.gain)


def _least_fall(study: Study, base: Level, best: Sequence[_ShortFit], worth: float) -> float:
    """Relative fall of the cost from which a short fit is followed to its end."""
    cost = base.fitted.cost
    if not base.effects:
        return PROMISING
    largest = max((1.0 - item.fitted.cost / cost for item in best), default=0.0)
    near = max(NEAR_BEST * largest, NEAR_WORTH * worth / cost)
    return max(PROMISING, near)


def _short_fits(study: Study, level: Level, nominal: Packed, kind: Kind) -> list[_ShortFit]:
    """Short fits from all starts of an effect, the best first."""
    context = Context(study, level.fitted, nominal)
    tried: list[_ShortFit] = []
    for start in starts_of(kind, context):
        fitted = _short_fit(study, level, start)
        if fitted is not None:
            tried.append(_ShortFit(start.packed, fitted))
    return sorted(tried, key=lambda item: item.fitted.cost)


def _short_fit(study: Study, level: Level, start: Start) -> Fitted | None:
    """Two steps from a start, with the sensitivities of what is already in the model taken from there."""
    fitted = fit(
        study.data, study.moved, start.packed, [*level.free, *start.free], level.correction.bias, study.training, 2,
        known=(level.fitted.jacobian, level.fitted.scales), hopeful=(1.0 - HOPEFUL) * level.fitted.cost, whole=False,
    )  # fmt: skip
    return fitted if math.isfinite(fitted.cost) else None


def _followed(
    study: Study, evidence: Evidence, level: Level, kind: Kind, tried: list[_ShortFit], least: float
) -> ScreenedCandidate:
    """Promising starts followed to their end; `least` is the relative fall of the cost that promises."""
    found = [item.fitted for item in tried]
    best, cost = found[0], level.fitted.cost
    fall = cost - best.cost
    # two masses are followed inside the twin only: with a held bias a longer fit leads them away
    inside_only = study.twin and kind.in_transmission
    if not inside_only and (fall > least * cost or _promises(study, evidence, level, best)):
        effort = evidence.effort(study)
        enough = effort.close * fall if fall > 0.0 else -math.inf
        for start in [f for f in found if cost - f.cost > enough][: effort.starts]:
            near = start if level.effects else None
            free = [*start.free, *shapes(kind.name, start.packed)]
            finished = refit(study, start.packed, free, level.correction, effort.rounds, near)
            best = finished if finished.cost <= best.cost else best
    gain, z = gain_and_z(level.unseen, held_out(study, best.error, best.jacobian))
    before = [item.packed for item in found] + [item.start for item in tried]
    others = tuple(packed for packed in before if packed is not best.packed)
    return ScreenedCandidate(kind.name, best, cost - best.cost, gain, z, others)


def _promises(study: Study, evidence: Evidence, level: Level, short: Fitted) -> bool:
    """Whether a short fit that has not got below the model without the effect would, by its linear model.

    Some base parameter then has further to go than two steps.
    """
    if short.cost <= level.fitted.cost or not evidence.effort(study).follows_promises:
        return False
    gain, _ = gain_and_z(level.unseen, held_out(study, short.error, short.jacobian))
    return gain > study.policy.clear_gain


def _walked_on(study: Study, level: Level) -> Level:
    """What candidates are compared with: the model itself, fitted as they are.

    Between two masses a bias that is held lets every fit walk on a little, with or without a candidate.
    """
    if not study.two_masses(level.fitted.packed):
        return level
    fitted = fit(
        study.data, study.moved, level.fitted.packed, level.free, level.correction.bias, study.training, 2,
        known=(level.fitted.jacobian, level.fitted.scales),
    )  # fmt: skip
    return replace(level, fitted=fitted, unseen=held_out(study, fitted.error, fitted.jacobian))


def generic_gains(study: Study, level: Level) -> dict[str, float]:
    """Gain on unseen experiments of free functions of a coordinate."""
    gains: dict[str, float] = {}
    for name, columns in generic_columns(study.data, study.training > 0).items():
        table = np.hstack([level.fitted.jacobian, columns * float(np.std(level.fitted.error))])
        gains[name] = gain_and_z(level.unseen, held_out(study, level.fitted.error, table))[0]
    return gains
