"""Confirmed is what the first recording names by itself, and what lowers the error of the others with only the base
refitted there.

Fitted together, two recordings bend one base until neither is right, and rivals are compared under that distortion:
where other joints moved in one of them, or another load was on the axis, names came out that neither of them bears.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.errors import AutotuneError
from autotune.diagnosis.baseline import begin
from autotune.diagnosis.candidates import Progress
from autotune.diagnosis.search import Found, search
from autotune.estimation.bandwidth import prepared_for
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.data import TRAINING
from autotune.estimation.policy import Policy
from autotune.estimation.problem import Problem, refit
from autotune.estimation.residual import smoothed
from autotune.models.drive_model import DriveModel, Packed
from autotune.models.effect import Kind
from autotune.models.layout import flag
from autotune.models.table import EFFECTS
from autotune.recordings.recording import Recording

ITERATIONS = 10
MOST_UNEXPLAINED = 0.25
"""Of a recording's torque variance: where more is left, it confirms nothing (an arm's joints, others moving)."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """Why what was found is not confirmed, in words; `nowhere`: no recording by itself shows all of it."""

    why: str
    nowhere: bool = False


def doubt_of(
    recordings: Sequence[Recording],
    model: DriveModel,
    effects: Sequence[str],
    progress: Progress,
    policy: Policy,
    candidates: tuple[Kind, ...],
) -> Doubt | None:
    """What speaks against calling effects confirmed that all recordings together have named; None if nothing does.

    Together alone they name what a base bends into that is two: warmer, or heavier, in one of them.
    """
    if len(recordings) < 2:
        return None
    try:
        progress("what the first recording names by itself")
        found = _by_itself(recordings[0], model, progress, policy, candidates)
        missing = nowhere = _not_shown(effects, found)
        if missing:
            progress("what the others name by themselves")
        for one in recordings[1:] if missing else ():
            nowhere = _not_shown(nowhere, _by_itself(one, model, progress, policy, candidates))
        if nowhere:
            return Doubt(f"no recording by itself shows {_listed(nowhere)}", nowhere=True)
        if missing or found.chosen is None:
            return Doubt(f"the first recording by itself does not show {_listed(missing or effects)}")
        share = unexplained(found.problem, found.chosen.model_fit)
        if share > MOST_UNEXPLAINED:
            return Doubt(_unexplained("the first recording", share))
        for number, recording in enumerate(recordings[1:], 2):
            why = _elsewhere(recording, number, model, found.chosen.model_fit, progress, policy)
            if why is not None:
                return Doubt(why)
    except AutotuneError as reason:
        return Doubt(f"a recording tells too little by itself ({reason})")
    return None


def _by_itself(
    recording: Recording,
    model: DriveModel,
    progress: Progress,
    policy: Policy,
    candidates: tuple[Kind, ...],
) -> Found:
    """What a search finds in one recording."""
    problem, root, nominal, _ = begin(prepared_for([recording], policy), model, progress, policy=policy)
    return search(replace(problem, candidates=candidates), root, nominal, progress)


def _not_shown(effects: Sequence[str], found: Found) -> list[str]:
    names = () if found.chosen is None else found.chosen.model_fit.effects
    return [name for name in effects if name not in names]


def unexplained(problem: Problem, model_fit: ModelFit) -> float:
    """Share of the torque's variance that a model leaves on the rows that count."""
    rows = problem.training > 0
    torque = smoothed(problem.data, problem.data.torque)[rows]
    return float(np.var(model_fit.fitted.error[rows])) / max(float(np.var(torque)), 1e-300)


def _elsewhere(
    recording: Recording,
    number: int,
    model: DriveModel,
    model_fit: ModelFit,
    progress: Progress,
    policy: Policy,
) -> str | None:
    """What another recording says against the effects of `model_fit`, with only the base refitted to it."""
    problem, root, _, _ = begin(prepared_for([recording], policy), model, progress, policy=policy)
    before = problem.mean_square(root.fitted.error, TRAINING)
    packed = with_effects(root.fitted.packed, model_fit.fitted.packed, model_fit.effects)
    correction = problem.correction(packed)
    if not correction.stable:
        return f"with these effects recording {number} cannot be simulated"
    fitted = refit(problem, packed, list(root.free), correction, ITERATIONS)
    after = problem.mean_square(fitted.error, TRAINING)
    if after >= (1.0 - policy.least_gain) * before:
        return f"recording {number}, with only the base refitted, errs no less with them than without"
    share = unexplained(problem, replace(root, fitted=fitted))
    return _unexplained(f"recording {number}", share) if share > MOST_UNEXPLAINED else None


def with_effects(base: Packed, other: Packed, effects: Sequence[str]) -> Packed:
    """A model with the effects of another one, unchanged."""
    p, on = base.p.copy(), base.on.copy()
    for name in effects:
        for parameter in EFFECTS[name].parameters:
            p[parameter.slot] = other.p[parameter.slot]
        on[flag(name)] = True
    return Packed(p, on)


def _unexplained(which: str, share: float) -> str:
    return f"{which} keeps {100 * share:.0f} % of the torque's variance unexplained"


def _listed(effects: Sequence[str]) -> str:
    return " and ".join(effect.replace("_", " ") for effect in effects)
