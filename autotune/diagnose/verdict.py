"""From a model and recordings to a verdict: what is missing, how sure, and what to do next."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from autotune.diagnose.alternatives import challenged
from autotune.diagnose.baseline import begin, quiet
from autotune.diagnose.candidates import Progress, Refitted
from autotune.diagnose.evidence import (
    Candidate,
    candidates,
    likely_rivals,
    next_experiment,
    unknown_note,
)
from autotune.diagnose.further_rounds import error_left
from autotune.diagnose.second_recording import Elsewhere, carried_on, said
from autotune.diagnose.selection import Selection, select
from autotune.diagnose.single_recording import alike_where_motion_is
from autotune.diagnose.time_driven_lines import TimeLine, time_driven_line
from autotune.diagnose.transmissions import GAP, SPRING, hardly_a_gap
from autotune.diagnose.wording import TORQUE_CONSTANT
from autotune.estimation.bandwidth import prepared_for
from autotune.estimation.bias_corrected_fit import Level
from autotune.estimation.controller_torque import loop_like
from autotune.estimation.coordinates import variance_shares
from autotune.estimation.cross_validation import gain_and_z
from autotune.estimation.data import TEST, TRAINING, VETO
from autotune.estimation.model_error import model_error
from autotune.estimation.policy import POLICY, Policy
from autotune.estimation.problem import CHUNK, Study
from autotune.models.drive_model import DriveModel
from autotune.recordings.recording import Recording


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The verdict with all its evidence.

    Attributes:
        verdict: `named`, `none`, `unknown` or `ambiguous`; `effects`: names, strongest first.
        confidence: `confirmed`, `suspected` or None.
        confusable: sets of effects that these data cannot tell apart.
        where: share of the residual's variance by coordinate.
        error_test: rms on the unseen test trajectory; nan without one.
        error_rms, relative_error: of the model as it was given, before anything was fitted; as `compare` finds.
        notes: sentences for people.
    """

    verdict: str
    effects: tuple[str, ...]
    confidence: str | None
    candidates: tuple[Candidate, ...]
    confusable: tuple[tuple[str, ...], ...]
    where: Mapping[str, float]
    noise_floor_rms: float
    next_experiment: str | None
    twin: bool
    error_test: float = math.nan
    error_rms: float = math.nan
    relative_error: float = math.nan
    notes: tuple[str, ...] = ()
    study: Study | None = field(default=None, repr=False)
    level: Level | None = field(default=None, repr=False)
    root: Level | None = field(default=None, repr=False)


def diagnose(
    recordings: Sequence[Recording],
    model: DriveModel,
    progress: Progress = quiet,
    *,
    policy: Policy = POLICY,
    effects: Sequence[str] | None = None,
) -> Diagnosis:
    """What the model lacks, by the evidence of recordings.

    `effects` are the candidates; all of the library where none are given.

    Raises:
        RecordingError, ConfigurationError: recordings that cannot be used.
        NotEnoughExcitation: nothing to fit, or a model that does not fit the axis at all.
    """
    data = prepared_for(recordings, policy)
    study, root, nominal, notes = begin(data, model, progress, policy=policy)
    if effects is not None:
        study = replace(study, candidates=tuple(effects))
    given = model_error(data, model, policy)
    found = select(study, root, nominal, progress)
    chosen = found.chosen
    carried: list[Elsewhere] = []
    if chosen is not None:
        progress("does another trajectory confirm it")
        chosen, carried = carried_on(found.study, found.root, chosen)
        carried = challenged(found.study, found.root, chosen, carried, found.first, nominal)
    verdict = _judge(replace(found, chosen=chosen), (*notes, *said(carried)), carried)
    return replace(verdict, error_rms=given.error_rms, relative_error=given.relative_error)


def _judge(found: Selection, notes: tuple[str, ...], carried: Sequence[Elsewhere]) -> Diagnosis:
    study, root, chosen, first, tried = found.study, found.root, found.chosen, found.first, found.tried
    lead = max((item.gain for item in first), default=0.0)
    if chosen is not None:
        lead = max(lead, gain_and_z(root.unseen, chosen.level.unseen)[0])
    coordinate, free = max(found.generic.items(), key=lambda item: item[1], default=("", 0.0))
    structured = free > study.policy.generic_gain and free > study.policy.generic_lead * max(lead, 0.0)
    verdict, confidence = "none", None
    effects: tuple[str, ...] = ()
    confusable: tuple[tuple[str, ...], ...] = ()
    if chosen is not None:
        rivals = _rivals(study, root, chosen, tried)
        good = chosen.named if study.data.repeated else chosen.share >= study.policy.partly
        good &= not (GAP in chosen.level.effects and hardly_a_gap(study.policy, chosen.level.fitted.packed))
        if good and not structured and rivals:
            verdict, confusable = "ambiguous", ((*chosen.level.effects, *rivals),)
            confidence, effects = "suspected", chosen.level.effects
        elif good and not structured:
            verdict, effects = "named", chosen.level.effects
            confidence = "confirmed" if _confirmed(study, effects, carried) else "suspected"
        else:
            verdict = "unknown"
    elif structured or carried or _structure_left(study, root):
        verdict = "unknown"
    line = time_driven_line(study, (chosen.level if chosen else root).fitted.error)
    if line is not None:
        notes = (
            *notes,
            f"A disturbance of {line.hertz:.2f} Hz runs through all experiments whatever the motion "
            f"({100 * line.share:.0f} % of the residual's variance): look for mains, fans, pumps, neighbours.",
        )
        if chosen is None or _drowned(study, chosen, line):
            verdict, confidence, effects, confusable, chosen = "unknown", None, (), (), None
    if verdict == "unknown":
        notes = (*notes, unknown_note(study, coordinate, free, chosen))
    if not confusable and confidence == "suspected":
        near = [r for item in carried for r in item.rivals]
        near += likely_rivals(study.policy, effects, first)
        confusable = (tuple(dict.fromkeys([*effects, *near])),) if near else ()
    final = chosen.level if chosen is not None and effects else root
    rows = study.training > 0
    return Diagnosis(
        verdict,
        effects,
        confidence,
        candidates(study, root, first, tried, effects),
        confusable,
        variance_shares(study.data, root.fitted.error, rows),
        _floor(study, final),
        next_experiment(
            verdict, effects, confusable, confidence, chosen, bool(study.data.metadata.fingerprint)
        ),
        study.twin,
        math.sqrt(study.mean_square(final.fitted.error, TEST)) if study.has(TEST) else math.nan,
        notes=(*notes, TORQUE_CONSTANT),
        study=study,
        level=final,
        root=root,
    )


def _drowned(study: Study, chosen: Refitted, line: TimeLine) -> bool:
    """Whether what was found is smaller than a disturbance that shakes the axis in time, and so may be its shadow."""
    return chosen.training.fall < line.share * study.mean_square(chosen.level.fitted.error, TRAINING)


def _confirmed(study: Study, effects: Sequence[str], carried: Sequence[Elsewhere]) -> bool:
    """Whether data that were not fitted confirm every effect."""
    if study.data.repeated:
        return study.twin and study.has_veto
    sure = {item.effect for item in carried if item.confirmed}
    return set(effects) <= (sure if study.twin else sure - loop_like(study.data, study.policy))


def _rivals(study: Study, root: Level, chosen: Refitted, tried: Sequence[Refitted]) -> list[str]:
    """Single effects that explain as much as the chosen single one; hardly a gap is no rival of a spring."""
    if len(chosen.level.effects) != 1:
        return []
    if chosen.effect == SPRING:
        tried = [
            item
            for item in tried
            if item.effect != GAP or not hardly_a_gap(study.policy, item.level.fitted.packed)
        ]
    best = error_left(study, chosen.level)
    start = error_left(study, root)
    several = study.data.repeated or study.data.steady or len(study.data.starts) > 1
    near = study.policy.alike if several else study.policy.alike_single
    return [
        item.effect
        for item in tried
        if item.effect != chosen.effect
        and item.named
        and (
            error_left(study, item.level) - best < near * (start - best)
            or (study.data.repeated and not _separated(study, chosen.level, item.level))
        )
    ]


def _separated(study: Study, better: Level, worse: Level) -> bool:
    """Whether one model errs less than another beyond chance, second by second of training and veto."""
    weight = study.weight * study.data.role(TRAINING, VETO)
    surplus = weight * (worse.fitted.error**2 - better.fitted.error**2)
    seconds = np.array([part.sum() for part in np.array_split(surplus, max(3, len(surplus) // CHUNK))])
    return float(seconds.mean()) > study.policy.apart_z * float(seconds.std(ddof=1)) / math.sqrt(len(seconds))


def _structure_left(study: Study, root: Level) -> bool:
    if not study.data.repeated:
        return alike_where_motion_is(study, root.fitted.error)
    variance, error = study.repeatable(root.fitted.error, root.correction, TRAINING)
    noise = study.noise_variance(root.fitted.error, TRAINING)
    return (
        math.isfinite(variance)
        and variance > study.policy.structure_errors * error
        and variance > study.policy.structure_part * noise
    )


def _floor(study: Study, level: Level) -> float:
    return (
        math.sqrt(max(study.noise_variance(level.fitted.error, TRAINING, plain=True), 0.0))
        if study.data.repeated
        else math.nan
    )
