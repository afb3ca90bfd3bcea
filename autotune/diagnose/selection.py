"""Which effects: forward, one beside the other, as long as each is worth it, then backward.

The best candidates are refitted inside the twin down the ranking; a further effect must explain enough of what
is explained already, or of what is left, and lower the error on the veto trajectory.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from autotune.diagnose.candidates import (
    Progress,
    Refitted,
    Screened,
    gain_on_veto,
    generic_gains,
    inside_twin,
    judged,
    rank,
    realigned,
    screen,
    without_effect,
)
from autotune.diagnose.further_rounds import (
    best_polished,
    error_left,
    polished,
)
from autotune.diagnose.second_recording import best_elsewhere
from autotune.diagnose.significance import without_insignificant_terms
from autotune.diagnose.single_recording import capped, credible, noticeable
from autotune.diagnose.surrogates import beats_surrogates
from autotune.diagnose.transmissions import the_other_tried, without_needless_gap
from autotune.estimation.bias_corrected_fit import Level, settle
from autotune.estimation.data import TRAINING, VETO
from autotune.estimation.problem import Study, estimate_noise
from autotune.models.drive_model import Packed
from autotune.models.transmission import has_load


@dataclass(frozen=True, slots=True)
class Selection:
    """What a search came to.

    Attributes:
        study, root: as they are after torque and motion were aligned to what was found.
        chosen: the model with all effects that were found; None where there are none.
        first: all families beside the root; `tried`: the best of them, refitted inside the twin.
        generic: gain of free functions of each coordinate.
    """

    study: Study
    root: Level
    chosen: Refitted | None
    first: Sequence[Screened]
    tried: Sequence[Refitted]
    generic: Mapping[str, float]


def select(study: Study, root: Level, nominal: Packed, progress: Progress) -> Selection:
    """Adds the best candidate until nothing more is found, and drops what is not needed beside the others."""
    level = root
    first: list[Screened] = []
    tried: list[Refitted] = []
    generic: dict[str, float] = {}
    chosen: Refitted | None = None
    seen: list[Level] = []
    for number in range(study.policy.most_effects):
        worth = _least_fall(study, chosen) if chosen is not None else 0.0
        ranked = rank(study, level, nominal, progress, worth)
        if not study.data.repeated:
            ranked = capped(level, ranked)
        if number == 0:
            first, generic = ranked, generic_gains(study, root)
        near = [
            item for item in ranked if chosen is None or item.fall >= study.policy.near_worth_beside * worth
        ]
        passing = _passing(study, level, near)
        refits = _walk(study, root, level, passing, progress)
        if not any(item.named for item in refits):
            refits += _second_look(study, root, level, ranked, passing, progress)
        seen += [item.level for item in refits]
        refits = without_needless_gap(study, refits)
        if number == 0:
            tried = refits
        if chosen is not None and study.data.repeated:
            refits = best_polished(study, root, refits, progress)
        best = _best(study, chosen, refits)
        if best is None:
            break
        best = the_other_tried(study, root, nominal, best, seen, progress)
        study, chosen = _with_own_noise(study, root, best)
        again = realigned(study, chosen.level)
        if again is not study:
            study, root, chosen = _once_more(again, root, chosen)
        if study.data.repeated and study.policy.partly < chosen.share < study.policy.refined:
            chosen = polished(study, root, chosen, progress)
            chosen = _begun_anew(study, root, nominal, chosen, progress)
        level = chosen.level
        seen.append(level)
        if chosen.share >= study.policy.all_explained and not _more_to_explain(study, level):
            break
    if chosen is not None and len(chosen.level.effects) > 1:
        chosen = _pruned(study, root, chosen, seen, progress)
    if chosen is not None and study.policy.partly < chosen.share < study.policy.refined:
        chosen = polished(study, root, chosen, progress)
    if chosen is not None:
        chosen = _with_significant_terms(study, root, chosen)
    return Selection(study, root, chosen, first, tried, generic)


def _with_significant_terms(study: Study, root: Level, chosen: Refitted) -> Refitted:
    level = without_insignificant_terms(study, chosen.level)
    return chosen if level is chosen.level else judged(study, root, level, chosen.effect)


def _with_own_noise(study: Study, root: Level, chosen: Refitted) -> tuple[Study, Refitted]:
    """The twin shaken as much as the axis is by this model, and the model settled in it.

    Near the limit of stability, as with a strong lag, a model that lacks the effect needs twice the noise.
    """
    if not study.data.repeated or not study.twin:
        return study, chosen
    level = chosen.level
    noise = estimate_noise(study, level.fitted.packed, level.fitted.error)
    if abs(noise - study.noise) <= study.policy.noise_changed * study.noise:
        return study, chosen
    quieter = replace(study, noise=noise)
    settled = settle(quieter, level.fitted.packed, list(level.free), 2, level.effects, level.fitted)
    if settled is None or settled.fitted.cost > level.fitted.cost:
        return study, chosen
    return quieter, judged(quieter, root, settled, chosen.effect)


def _begun_anew(study: Study, root: Level, nominal: Packed, chosen: Refitted, progress: Progress) -> Refitted:
    """Each effect looked for again beside the others, where together they do not explain what they should.

    The first of them took its shape while the second was missing: a wave over the travel for a tight spot. A single
    one is begun anew where it is a second mass, whose way downhill depends on where it begins.
    """
    alone = len(chosen.level.effects) < 2
    if alone and not has_load(chosen.level.fitted.packed.on):
        return chosen
    for effect in chosen.level.effects:
        if chosen.share >= study.policy.well_begun if alone else chosen.named:
            break
        progress(f"another beginning for {effect}")
        before = root
        if not alone:
            rest = without_effect(study, root, chosen.level, effect)
            if rest is None:
                continue
            before = rest.level
        screened = screen(study, before, nominal, effect)
        if screened is None:
            continue
        cost = chosen.level.fitted.cost
        again = inside_twin(study, root, before, screened, cost, best_start=True)
        left = error_left(study, chosen.level)
        if again is not None and error_left(study, again.level) < study.policy.much_better * left:
            chosen = replace(again, effect=chosen.effect, gain=chosen.gain)
    return chosen


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
        least = study.policy.least_gain if study.twin else study.policy.least_gain_without_twin
        return [
            item
            for item in ranked
            if item.gain >= least and (item.z >= study.policy.least_z or item.gain >= study.policy.clear_gain)
        ]
    least = study.policy.least_gain if study.data.steady else study.policy.least_gain_single
    least_z = study.policy.least_z_by_phase if study.data.periodic else study.policy.least_z_single
    likely = [item for item in ranked if item.gain >= least and item.z >= least_z]
    likely = [item for item in likely if credible(study, item)][: study.policy.most_refits + 2]
    if study.data.steady:
        return likely
    likely = [item for item in likely if noticeable(study, level, item)]
    return [item for item in likely if beats_surrogates(study, level.fitted, item.fitted)]


def _walk(
    study: Study, root: Level, level: Level, passing: Sequence[Screened], progress: Progress
) -> list[Refitted]:
    """Full refits down the ranking until one explains nearly everything, and its close rivals."""
    policy = study.policy
    refits: list[Refitted] = []
    for item in passing[: study.policy.most_refits]:
        done = any(r.named for r in refits)
        close = (
            policy.close_rival
            if study.data.repeated or len(study.data.starts) > 1
            else policy.close_rival_single
        )
        hopeless = study.policy.worth_refit_beside if level.effects else study.policy.worth_refit
        if item.gain < (close if done else hopeless) * passing[0].gain:
            break
        progress(f"refit inside the twin: {item.effect}")
        target = study.policy.rival_cost * min((r.level.fitted.cost for r in refits), default=math.inf)
        refitted = inside_twin(study, root, level, item, target)
        if refitted is not None:
            refits.append(refitted)
    return refits


def _second_look(
    study: Study,
    root: Level,
    level: Level,
    ranked: Sequence[Screened],
    passing: Sequence[Screened],
    progress: Progress,
) -> list[Refitted]:
    """The candidate that lowers the error most, though a linearised hold-out does not say so.

    An effect that only the fastest experiment shows cannot be predicted for it from the others; the veto
    trajectory tells then.
    """
    left = [item for item in ranked if item not in passing]
    best = min(left, key=lambda item: item.fitted.cost, default=None)
    if (
        best is None
        or not study.has_veto
        or best.fitted.cost > (1.0 - study.policy.clear_fall) * level.fitted.cost
    ):
        return []
    progress(f"refit inside the twin: {best.effect}")
    refitted = inside_twin(study, root, level, best)
    return [] if refitted is None else [replace(refitted, gain=gain_on_veto(study, level, refitted.level))]


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
        return best if best.gain >= study.policy.least_gain else None
    before = chosen.level
    fall = _mean_square(study, before, TRAINING) - _mean_square(study, best.level, TRAINING)
    worth = fall >= _least_fall(study, chosen) and best.gain >= study.policy.least_gain
    if study.has(VETO):
        worth &= _mean_square(study, best.level, VETO) < _mean_square(study, before, VETO)
    return best if worth else None


def _least_fall(study: Study, chosen: Refitted) -> float:
    """By how much an effect beside the chosen ones must lower the mean square [(N m)²]."""
    explained = max(chosen.training.fall, 0.0)
    left = _mean_square(study, chosen.level, TRAINING)
    least = min(
        study.policy.worth_beside * explained,
        max(study.policy.clear_beside * left, study.policy.worth_if_clear * explained),
    )
    blows = study.twin and has_load(chosen.level.fitted.packed.on)
    return max(least, study.policy.chance_of_contact * left) if blows else least


def _mean_square(study: Study, level: Level, role: str) -> float:
    return study.mean_square(level.fitted.error, role)


def _more_to_explain(study: Study, level: Level) -> bool:
    variance, error = study.repeatable(level.fitted.error, level.correction, TRAINING)
    noise = study.noise_variance(level.fitted.error, TRAINING)
    if not math.isfinite(variance):
        return True
    return variance + error > study.policy.nothing_left * noise


def _pruned(
    study: Study, root: Level, chosen: Refitted, seen: Sequence[Level], progress: Progress
) -> Refitted:
    """Drops every effect without which training and veto are hardly worse.

    Where a model without it was `seen` to be far worse, it is needed.
    """
    current = chosen
    for effect in chosen.level.effects:
        if len(current.level.effects) < 2:
            break
        rest = set(current.level.effects) - {effect}
        known = [level for level in seen if set(level.effects) == rest]
        if known and not any(
            _negligible(study, current, level, study.policy.plainly_needed) for level in known
        ):
            continue
        progress(f"is {effect} needed")
        less = without_effect(study, root, current.level, effect)
        if less is not None and (
            _negligible(study, current, less.level) or _by_chance(study, current.level, less.level)
        ):
            current = less
    return current


def _by_chance(study: Study, level: Level, less: Level) -> bool:
    """Whether two fits between two masses differ by no more than their chance, though one has an effect more."""
    if not (study.twin and has_load(less.fitted.packed.on)):
        return False
    left = _mean_square(study, less, TRAINING)
    return left - _mean_square(study, level, TRAINING) < study.policy.chance_of_contact * left


def _negligible(study: Study, current: Refitted, less: Level, times: float = 1.0) -> bool:
    """Whether what `less` lacks is worth next to nothing, beside what all explain and what is left.

    `times` is how much more than that it may be worth.
    """
    falls = {TRAINING: current.training.fall, VETO: current.veto.fall if current.veto else math.inf}
    for role in (TRAINING, VETO):
        if not study.has(role):
            continue
        left = _mean_square(study, current.level, role)
        lost = _mean_square(study, less, role) - left
        if not (
            lost < times * study.policy.negligible * max(falls[role], 0.0)
            and lost < times * study.policy.negligible_left * left
        ):
            return False
    return True
