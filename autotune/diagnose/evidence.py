"""The evidence behind a verdict, in figures and words: candidates, why, what is left, what to record next."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from autotune.diagnose.families import FAMILIES
from autotune.diagnose.search import LEAST_GAIN, Refitted, Screened
from autotune.diagnose.settling import Level
from autotune.diagnose.study import Study
from autotune.diagnose.words import separating_experiment, usual_rivals

GENERIC_GAIN = 0.05
PARTLY = 0.5
WORST_GAIN = -1.0
"""Told of a candidate that is worse than nothing: how much worse an extrapolation is says nothing."""


@dataclass(frozen=True, slots=True)
class Candidate:
    """One family's evidence.

    Attributes:
        gain: fall of the squared error on unseen experiments, relative.
        error_before, error_after: rms on unseen experiments [N m or N].
    """

    effect: str
    gain: float
    error_before: float
    error_after: float
    accepted: bool
    why: str


def candidates(
    study: Study, root: Level, first: Sequence[Screened], tried: Sequence[Refitted], effects: Sequence[str]
) -> tuple[Candidate, ...]:
    """One row for every family that was tried."""
    count = max(float(study.training.sum()), 1.0)
    before = math.sqrt(root.unseen.total / count)
    refits = {item.effect: item for item in tried}
    table = []
    for item in first:
        accepted = item.effect in effects
        gain = max(refits[item.effect].gain if item.effect in refits else item.gain, WORST_GAIN)
        after = before * math.sqrt(max(1.0 - gain, 0.0))
        text = why(item, refits, accepted, study.data.repeated)
        table.append(Candidate(item.effect, gain, before, after, accepted, text))
    return tuple(table)


def why(item: Screened, refits: Mapping[str, Refitted], accepted: bool, repeated: bool) -> str:
    """Why a candidate was taken or left; what is explainable is known from repeats only."""
    if item.effect in refits and not repeated:
        text = f"lowers the squared error on unseen stretches by {100 * refits[item.effect].gain:.0f} %"
        return text if accepted else text + "; not the best explanation"
    if item.effect in refits:
        done = refits[item.effect]
        veto = f", {100 * done.veto.share:.0f} % on the veto trajectory" if done.veto else ""
        text = f"explains {100 * done.training.share:.0f} % of the explainable error{veto}"
        return text if accepted else text + "; not the best explanation"
    if accepted:
        return "taken beside the others: lowers what they leave"
    if item.gain < LEAST_GAIN:
        gain = 100 * max(item.gain, WORST_GAIN)
        return f"gain {gain:.1f} % on unseen experiments; {100 * LEAST_GAIN:.0f} % are needed"
    return f"gain {100 * item.gain:.1f} % on unseen experiments, less than others"


def unknown_note(coordinate: str, gain: float, chosen: Refitted | None, repeated: bool) -> str:
    """What is known about what is unknown: where it sits, and what explains a part."""
    text = "Something repeatable is missing that none of the known effects explains"
    if gain > GENERIC_GAIN:
        text += f"; it is structured in {coordinate.replace('_', ' ')}"
    if chosen is not None and chosen.share >= PARTLY:
        names = ", ".join(chosen.level.effects).replace("_", " ")
        part = f"explains {100 * chosen.share:.0f} % of it" if repeated else "fits some of it"
        text += f"; {names} {part} and may be part of the truth"
    return text + "."


def next_experiment(
    verdict: str,
    effects: Sequence[str],
    confusable: Sequence[Sequence[str]],
    confidence: str | None,
    chosen: Refitted | None,
) -> str | None:
    """What to record next, where that would tell more; None where nothing is missing or all is confirmed."""
    if verdict == "ambiguous":
        return separating_experiment(set(confusable[0]))
    if verdict == "named" and confidence == "suspected":
        near = set(effects) | {r for e in effects for r in usual_rivals(e)}
        return separating_experiment(near) + ". A second trajectory confirms or refutes the name."
    if verdict == "unknown":
        near = set(chosen.level.effects) if chosen else set(FAMILIES)
        return separating_experiment(near | {r for e in near for r in usual_rivals(e)})
    return None
