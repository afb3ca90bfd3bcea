"""From a model and recordings to a verdict: what is missing, how sure, and what to do next."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from autotune.core.errors import NotEnoughExcitation
from autotune.core.recording import Recording
from autotune.diagnose.bandwidth import prepared_for
from autotune.diagnose.contact import as_rough, settled_contact
from autotune.diagnose.controller import find_controller, with_feedforward
from autotune.diagnose.coordinates import variance_shares
from autotune.diagnose.elsewhere import Elsewhere, best_elsewhere, carried_on, said
from autotune.diagnose.evidence import (
    GENERIC_GAIN,
    PARTLY,
    Candidate,
    candidates,
    next_experiment,
    unknown_note,
)
from autotune.diagnose.filtered import without_twin
from autotune.diagnose.fit import Free
from autotune.diagnose.linear import loop_like, loop_note, refuse_answers
from autotune.diagnose.lines import time_driven_line
from autotune.diagnose.model_values import free_of_model
from autotune.diagnose.polish import (
    NEARLY,
    POLISHED,
    best_polished,
    error_left,
    polished,
    without_needless_gap,
)
from autotune.diagnose.prepared import TEST, TRAINING, VETO, Prepared
from autotune.diagnose.residual import smoothed
from autotune.diagnose.rivals import challenged
from autotune.diagnose.score import gain_and_z
from autotune.diagnose.search import (
    GAIN_WITHOUT_TWIN,
    LEAST_GAIN,
    MOST_EFFECTS,
    WALK,
    Refitted,
    Screened,
    generic_gains,
    inside_twin,
    judged,
    rank,
    realigned,
    without_effect,
)
from autotune.diagnose.settling import Level, settle
from autotune.diagnose.single import alike_where_motion_is, capped, credible, limits, noticeable
from autotune.diagnose.study import (
    Study,
    base_free,
    by_steadiness,
    estimate_noise,
    refit,
    start_study,
    without_outlying,
)
from autotune.diagnose.surrogates import beats_surrogates
from autotune.diagnose.words import TORQUE_CONSTANT, usual_rivals
from autotune.models.drive_model import DriveModel, Packed
from autotune.models.transmission import has_load

Progress = Callable[[str], None]
GENERIC_LEAD = 1.5
LEAST_Z_ALONE = 2.5
LEAST_Z_BY_PHASE = 2.0
"""Where ranges of phases are held out, which differ more from one another than stretches of time."""
LEAST_GAIN_ALONE = 0.08
"""Without repeats: smaller gains are as often the measurement chain as the axis."""
HOPELESS = 0.35
"""Part of the best candidate's gain below which a refit inside the twin is not worth its time."""
LEFT_TO_EXPLAIN = 0.02
"""Of the noise: repeatable rest, with its standard error, below which no second effect is looked for."""
NOISE_CHANGED = 0.25
"""Relative change of the twin's noise that is worth settling a model anew."""
HOPELESS_BESIDE = 0.6
"""The same for a further effect."""
WORTH_BESIDE = 0.01
"""Of what is explained already: the least that a further effect must explain."""
CLEAR_BESIDE, WORTH_IF_CLEAR = 0.1, 0.005
"""Of what is left: an effect that explains so much of it may be smaller beside a strong one."""
NEGLIGIBLE, NEGLIGIBLE_LEFT = 0.02, 0.05
"""Of what is explained, and of what is left: an effect that is worth less than both is dropped."""
WORSE_WITH_TWIN = 2.0
"""Times the cost before: a twin that rings where the axis did not corrects nothing."""
NEAR, NEAR_ALONE = 0.03, 0.1
"""Of the fall: rivals that come so near cannot be told apart, with repeats and without."""


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """The verdict with all its evidence.

    Attributes:
        verdict: `named`, `none`, `unknown` or `ambiguous`; `effects`: names, strongest first.
        confidence: `confirmed`, `suspected` or None.
        confusable: sets of effects that these data cannot tell apart.
        where: share of the residual's variance by coordinate.
        error_test: rms on the unseen test trajectory; nan without one.
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
    notes: tuple[str, ...] = ()
    study: Study | None = field(default=None, repr=False)
    level: Level | None = field(default=None, repr=False)
    root: Level | None = field(default=None, repr=False)


def quiet(_: str) -> None:
    """Progress that nobody wants to see."""


def begin(
    data: Prepared, model: DriveModel, progress: Progress = quiet, simulations: int = 2
) -> tuple[Study, Level, Packed, tuple[str, ...]]:
    """Controller, noise and the fit of the model as it is.

    Raises:
        NotEnoughExcitation: the model cannot be made to fit this axis at all.
    """
    refuse_answers(data)
    found = find_controller(data)
    data = with_feedforward(data, found)
    packed = model.pack()
    notes: tuple[str, ...] = ()
    if found.controller is None:
        data, said = without_twin(data)
        notes = (f"No twin: {found.why}. Confidence is lower.", *said, *loop_note(data))
    study = start_study(data, found.controller)
    progress("fit of the model as it is")
    free = [*base_free(packed, study.scales, data.metadata.motion_unit), *free_of_model(model, study.scales)]
    level = _first_level(replace(study, simulations=simulations), packed, free)
    if level is None and study.twin:
        data, said = without_twin(data)
        notes = ("No twin: a simulation of the model with this controller is unstable or rings.", *said)
        study = start_study(data, None)
        level = _first_level(study, packed, free)
    if level is None:
        raise NotEnoughExcitation(
            "the model does not fit these recordings at all; check that model and recordings are of the "
            "same axis, or fit a new model: autotune model fit"
        )
    study, settled = _aligned(*level)
    _refuse_misfit(study, settled)
    dropped = 1.0 - float(np.mean(study.weight > 0))
    if dropped > 0.0:
        notes = (*notes, f"{100 * dropped:.1f} % of the rows were left out: starts, stops or disturbances.")
    return study, settled, packed, (*notes, *limits(study))


def _first_level(study: Study, packed: Packed, free: list[Free]) -> tuple[Study, Level] | None:
    start = study.correction(packed, 1)
    if not start.stable:
        start = replace(start, stable=True)
    fitted = refit(study, packed, free, start, 8)
    if not np.isfinite(fitted.cost):
        return None
    if not study.data.repeated and not study.data.steady:
        study = replace(study, weight=without_outlying(study, fitted.error))
        fitted = refit(study, fitted.packed, free, start, 4)
        fitted, free = settled_contact(study, fitted, start, free)
    plain = fitted.cost
    for _ in range(2):
        study = replace(study, noise=estimate_noise(study, fitted.packed, fitted.error))
        study = as_rough(study, fitted.packed)
        correction = study.correction(fitted.packed, 1)
        if not correction.stable:
            return None
        fitted = refit(study, fitted.packed, free, correction, 4)
    study = by_steadiness(study, fitted.error)
    level = settle(study, fitted.packed, free, 2)
    if study.twin and has_load(packed.on):  # with a held bias these fits walk off: the model may be nearer
        as_given = settle(study, packed, free, 2)
        if level is None or (as_given is not None and as_given.fitted.cost < level.fitted.cost):
            level = as_given
    if level is not None and not study.data.repeated and level.fitted.cost > WORSE_WITH_TWIN * plain:
        return None
    return None if level is None else (study, level)


def _aligned(study: Study, level: Level) -> tuple[Study, Level]:
    """Torque and motion of a single recording aligned to this model, and the model fitted again."""
    again = realigned(study, level)
    if again is study:
        return study, level
    return again, settle(again, level.fitted.packed, list(level.free), 2) or level


def _refuse_misfit(study: Study, level: Level) -> None:
    rows = study.training > 0
    torque = smoothed(study.data, study.data.torque)[rows]
    share = float(np.var(level.fitted.error[rows])) / max(float(np.var(torque)), 1e-300)
    if share > 0.8:
        raise NotEnoughExcitation(
            f"the model explains only {100 * max(1 - share, 0.0):.0f} % of the torque even after refitting; is the "
            "sign or the unit of the torque wrong, or the model of another axis? Fit a new model with "
            "'autotune model fit', or import the file again with another torque factor"
        )


def diagnose(recordings: Sequence[Recording], model: DriveModel, progress: Progress = quiet) -> Diagnosis:
    """What the model lacks, by the evidence of recordings.

    Raises:
        RecordingError, ConfigurationError: recordings that cannot be used.
        NotEnoughExcitation: nothing to fit, or a model that does not fit the axis at all.
    """
    study, root, nominal, notes = begin(prepared_for(recordings), model, progress)
    return search_effects(study, root, nominal, notes, progress)


def search_effects(
    study: Study, root: Level, nominal: Packed, notes: tuple[str, ...], progress: Progress = quiet
) -> Diagnosis:
    """Adds the best candidate until nothing more is found, prunes, and judges."""
    level = root
    first: list[Screened] = []
    tried: list[Refitted] = []
    generic: dict[str, float] = {}
    chosen: Refitted | None = None
    for number in range(MOST_EFFECTS):
        ranked = rank(study, level, nominal, progress)
        if not study.data.repeated:
            ranked = capped(level, ranked)
        if number == 0:
            first, generic = ranked, generic_gains(study, root)
        passing = _passing(study, level, ranked)
        refits = without_needless_gap(study, _walk(study, root, level, passing, progress))
        if number == 0:
            tried = refits
        if chosen is not None and study.data.repeated:
            refits = best_polished(study, root, refits, progress)
        best = _best(study, chosen, refits)
        if best is None:
            break
        study, chosen = _with_own_noise(study, root, best)
        level = chosen.level
        again = realigned(study, level)
        if again is not study:
            study, root, chosen = _once_more(again, root, chosen)
        if study.data.repeated and NEARLY < chosen.share < POLISHED:
            chosen = polished(study, root, chosen, progress)
        level = chosen.level
        if chosen.share >= 0.995 and not _more_to_explain(study, level):
            break
    if chosen is not None and len(chosen.level.effects) > 1:
        chosen = _pruned(study, root, chosen, progress)
    if chosen is not None and PARTLY < chosen.share < POLISHED:
        chosen = polished(study, root, chosen, progress)
    carried: list[Elsewhere] = []
    if chosen is not None:
        progress("does another trajectory confirm it")
        chosen, carried = carried_on(study, root, chosen)
        carried = challenged(study, root, chosen, carried, first, nominal)
    return _judge(study, root, chosen, first, tried, generic, (*notes, *said(carried)), carried)


def _with_own_noise(study: Study, root: Level, chosen: Refitted) -> tuple[Study, Refitted]:
    """The twin shaken as much as the axis is by this model, and the model settled in it.

    Near the limit of stability, as with a strong lag, a model that lacks the effect needs twice the noise.
    """
    if not study.data.repeated or not study.twin:
        return study, chosen
    level = chosen.level
    noise = estimate_noise(study, level.fitted.packed, level.fitted.error)
    if abs(noise - study.noise) <= NOISE_CHANGED * study.noise:
        return study, chosen
    quieter = replace(study, noise=noise)
    settled = settle(quieter, level.fitted.packed, list(level.free), 2, level.effects, level.fitted)
    if settled is None or settled.fitted.cost > level.fitted.cost:
        return study, chosen
    return quieter, judged(quieter, root, settled, chosen.effect)


def _once_more(study: Study, root: Level, chosen: Refitted) -> tuple[Study, Level, Refitted]:
    """Both models fitted again after torque and motion were aligned anew."""
    before = settle(study, root.fitted.packed, list(root.free), 2) or root
    after = settle(study, chosen.level.fitted.packed, list(chosen.level.free), 2, chosen.level.effects)
    if after is None:
        return study, before, chosen
    return study, before, judged(study, before, after, chosen.effect)


def _passing(study: Study, level: Level, ranked: Sequence[Screened]) -> list[Screened]:
    """Candidates worth a refit; without repeats they must also beat chance."""
    if study.data.repeated:
        least = LEAST_GAIN if study.twin else GAIN_WITHOUT_TWIN
        return [item for item in ranked if item.passes and item.gain >= least]
    least = LEAST_GAIN if study.data.steady else LEAST_GAIN_ALONE
    least_z = LEAST_Z_BY_PHASE if study.data.periodic else LEAST_Z_ALONE
    likely = [item for item in ranked if item.gain >= least and item.z >= least_z]
    likely = [item for item in likely if credible(study, item)][: WALK + 2]
    if study.data.steady:
        return likely
    likely = [item for item in likely if noticeable(study, level, item)]
    return [item for item in likely if beats_surrogates(study, level.fitted, item.fitted)]


def _walk(
    study: Study, root: Level, level: Level, passing: Sequence[Screened], progress: Progress
) -> list[Refitted]:
    """Full refits down the ranking until one explains nearly everything, and its close rivals."""
    refits: list[Refitted] = []
    for item in passing[:WALK]:
        done = any(r.named for r in refits)
        close = 0.75 if study.data.repeated or len(study.data.starts) > 1 else 0.9
        hopeless = HOPELESS_BESIDE if level.effects else HOPELESS
        if item.gain < (close if done else hopeless) * passing[0].gain:
            break
        progress(f"refit inside the twin: {item.effect}")
        refitted = inside_twin(study, root, level, item)
        if refitted is not None:
            refits.append(refitted)
    return refits


def _best(study: Study, chosen: Refitted | None, refits: Sequence[Refitted]) -> Refitted | None:
    """The refit that explains most, if it is worth having beside what is chosen already."""
    refits = [item for item in refits if item.training.fall > 0.0]
    if not refits:
        return None
    if study.data.repeated:
        best = min(refits, key=lambda item: error_left(study, item.level))
    else:
        best = best_elsewhere(study, refits)
    if chosen is None:
        return best if best.gain >= LEAST_GAIN else None
    before = chosen.level
    fall = _mean_square(study, before, TRAINING) - _mean_square(study, best.level, TRAINING)
    worth = fall >= _least_fall(study, chosen) and best.gain >= LEAST_GAIN
    if study.has(VETO):
        worth &= _mean_square(study, best.level, VETO) < _mean_square(study, before, VETO)
    return best if worth else None


def _least_fall(study: Study, chosen: Refitted) -> float:
    """By how much an effect beside the chosen ones must lower the mean square [(N m)²]."""
    explained = max(chosen.training.fall, 0.0)
    left = _mean_square(study, chosen.level, TRAINING)
    return min(WORTH_BESIDE * explained, max(CLEAR_BESIDE * left, WORTH_IF_CLEAR * explained))


def _mean_square(study: Study, level: Level, role: str) -> float:
    return study.mean_square(level.fitted.error, role)


def _more_to_explain(study: Study, level: Level) -> bool:
    variance, error = study.repeatable(level.fitted.error, level.correction, TRAINING)
    noise = study.noise_variance(level.fitted.error, TRAINING)
    if not math.isfinite(variance):
        return True
    return variance + error > LEFT_TO_EXPLAIN * noise


def _pruned(study: Study, root: Level, chosen: Refitted, progress: Progress) -> Refitted:
    """Drops every effect without which training and veto are hardly worse."""
    current = chosen
    for effect in chosen.level.effects:
        if len(current.level.effects) < 2:
            break
        progress(f"is {effect} needed")
        less = without_effect(study, root, current.level, effect)
        if less is None:
            continue
        falls = {TRAINING: current.training.fall, VETO: current.veto.fall if current.veto else math.inf}
        roles = [role for role in (TRAINING, VETO) if study.has(role)]
        if all(_negligible(study, current.level, less.level, role, falls[role]) for role in roles):
            current = less
    return current


def _negligible(study: Study, level: Level, less: Level, role: str, fall: float) -> bool:
    """Whether an effect is worth next to nothing on one role, beside what all explain and what is left."""
    left = _mean_square(study, level, role)
    lost = _mean_square(study, less, role) - left
    return lost < NEGLIGIBLE * max(fall, 0.0) and lost < NEGLIGIBLE_LEFT * left


def _judge(
    study: Study,
    root: Level,
    chosen: Refitted | None,
    first: Sequence[Screened],
    tried: Sequence[Refitted],
    generic: Mapping[str, float],
    notes: tuple[str, ...],
    carried: Sequence[Elsewhere] = (),
) -> Diagnosis:
    lead = max((item.gain for item in first), default=0.0)
    if chosen is not None:
        lead = max(lead, gain_and_z(root.unseen, chosen.level.unseen)[0])
    coordinate, free = max(generic.items(), key=lambda item: item[1], default=("", 0.0))
    structured = free > GENERIC_GAIN and free > GENERIC_LEAD * max(lead, 0.0)
    verdict, confidence = "none", None
    effects: tuple[str, ...] = ()
    confusable: tuple[tuple[str, ...], ...] = ()
    if chosen is not None:
        rivals = _rivals(study, root, chosen, tried)
        good = chosen.named if study.data.repeated else chosen.share >= PARTLY
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
        verdict = "unknown" if verdict == "none" else verdict
    if verdict == "unknown":
        notes = (*notes, unknown_note(coordinate, free, chosen, study.data.repeated))
    if not confusable and confidence == "suspected":
        near = [r for item in carried for r in item.rivals]
        near += [r for e in effects for r in usual_rivals(e)]
        confusable = (tuple(dict.fromkeys([*effects, *near])),)
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
        next_experiment(verdict, effects, confusable, confidence, chosen),
        study.twin,
        math.sqrt(study.mean_square(final.fitted.error, TEST)) if study.has(TEST) else math.nan,
        (*notes, TORQUE_CONSTANT),
        study,
        final,
        root,
    )


def _confirmed(study: Study, effects: Sequence[str], carried: Sequence[Elsewhere]) -> bool:
    """Whether data that were not fitted confirm every effect."""
    if study.data.repeated:
        return study.twin and study.has_veto
    sure = {item.effect for item in carried if item.confirmed}
    return set(effects) <= (sure if study.twin else sure - loop_like(study.data))


def _rivals(study: Study, root: Level, chosen: Refitted, tried: Sequence[Refitted]) -> list[str]:
    """Single effects that explain as much as the chosen single one."""
    if len(chosen.level.effects) != 1:
        return []
    best = error_left(study, chosen.level)
    start = error_left(study, root)
    near = NEAR if study.data.repeated or study.data.steady or len(study.data.starts) > 1 else NEAR_ALONE
    return [
        item.effect
        for item in tried
        if item.effect != chosen.effect
        and item.named
        and error_left(study, item.level) - best < near * (start - best)
    ]


def _structure_left(study: Study, root: Level) -> bool:
    if not study.data.repeated:
        return alike_where_motion_is(study, root.fitted.error)
    variance, error = study.repeatable(root.fitted.error, root.correction, TRAINING)
    noise = study.noise_variance(root.fitted.error, TRAINING)
    return math.isfinite(variance) and variance > 1.5 * error and variance > 0.15 * noise


def _floor(study: Study, level: Level) -> float:
    return (
        math.sqrt(max(study.noise_variance(level.fitted.error, TRAINING, plain=True), 0.0))
        if study.data.repeated
        else math.nan
    )
