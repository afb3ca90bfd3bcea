"""The evidence behind a verdict, in figures and words: candidates, why, what is left, what to record next."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from autotune.diagnose.candidates import Refitted, Screened
from autotune.diagnose.wording import separating_experiment, usual_rivals
from autotune.estimation.bias_corrected_fit import Level
from autotune.estimation.policy import Policy
from autotune.estimation.problem import Study

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
        text = why(study, item, refits, accepted)
        table.append(Candidate(item.effect, gain, before, after, accepted, text))
    return tuple(table)


def why(study: Study, item: Screened, refits: Mapping[str, Refitted], accepted: bool) -> str:
    """Why a candidate was taken or left; what is explainable is known from repeats only."""
    if item.effect in refits and not study.data.repeated:
        text = f"lowers the squared error on unseen stretches by {100 * refits[item.effect].gain:.0f} %"
        return text if accepted else text + "; not the best explanation"
    if item.effect in refits:
        done = refits[item.effect]
        veto = f", {100 * done.veto.share:.0f} % on the veto trajectory" if done.veto else ""
        text = f"explains {100 * done.training.share:.0f} % of the explainable error{veto}"
        return text if accepted else text + "; not the best explanation"
    if accepted:
        return "taken beside the others: lowers what they leave"
    if item.gain < study.policy.least_gain:
        gain = 100 * max(item.gain, WORST_GAIN)
        return f"gain {gain:.1f} % on unseen experiments; {100 * study.policy.least_gain:.0f} % are needed"
    return f"gain {100 * item.gain:.1f} % on unseen experiments, less than others"


def unknown_note(study: Study, coordinate: str, gain: float, chosen: Refitted | None) -> str:
    """What is known about what is unknown: where it sits, and what explains a part."""
    text = "Something repeatable is missing that none of the known effects explains"
    if gain > study.policy.generic_gain:
        text += f"; it is structured in {coordinate.replace('_', ' ')}"
    if chosen is not None and chosen.share >= study.policy.partly:
        names = ", ".join(chosen.level.effects).replace("_", " ")
        part = f"explains {100 * chosen.share:.0f} % of it" if study.data.repeated else "fits some of it"
        text += f"; {names} {part} and may be part of the truth"
    return text + "."


def likely_rivals(policy: Policy, effects: Sequence[str], first: Sequence[Screened]) -> list[str]:
    """Effects that usually look like the named ones and gain nearly as much here, the likeliest first."""
    gains = {item.effect: item.gain for item in first}
    least = policy.rival_gain * max((gains.get(effect, 0.0) for effect in effects), default=0.0)
    usual = dict.fromkeys(rival for effect in effects for rival in usual_rivals(effect))
    near = [r for r in usual if r not in effects and gains.get(r, 0.0) >= max(least, policy.least_gain)]
    return sorted(near, key=lambda rival: -gains[rival])


def next_experiment(
    verdict: str,
    effects: Sequence[str],
    confusable: Sequence[Sequence[str]],
    confidence: str | None,
    chosen: Refitted | None,
    own_axis: bool,
) -> str | None:
    """What to record next, where that would tell more; None where nothing is missing or all is confirmed."""
    if verdict == "ambiguous":
        return separating_experiment(confusable[0], own_axis)
    if verdict == "named" and confidence == "suspected":
        near = confusable[0] if confusable else effects
        return separating_experiment(near, own_axis) + ". A second trajectory confirms or refutes the name."
    if verdict == "unknown":
        return separating_experiment(chosen.level.effects if chosen else (), own_axis)
    return None
