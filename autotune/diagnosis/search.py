"""Which effects: forward, one beside the other, as long as each is worth it, then backward.

The best candidates are fitted inside the twin down the ranking; a further effect must explain enough of what
is explained already, or of what is left, and lower the error on the veto trajectory.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from autotune.diagnosis.candidates import FittedCandidate, Progress, ScreenedCandidate, error_left
from autotune.diagnosis.evidence import evidence_of
from autotune.diagnosis.evidence.evidence import Evidence
from autotune.diagnosis.refits import (
    REFINED,
    best_refined,
    fitted_again,
    gain_on_veto,
    inside_twin,
    judged,
    refined,
    with_own_noise,
    without_effect,
    without_insignificant_terms,
)
from autotune.diagnosis.ripple_orders import with_whole_orders
from autotune.diagnosis.screening import NEAR_WORTH, generic_gains, rank, screen
from autotune.diagnosis.transmission import other_transmission_tried, without_needless_gap
from autotune.estimation.bias_corrected_fit import Level
from autotune.estimation.data import TRAINING, VETO
from autotune.estimation.problem import Study
from autotune.models.drive_model import Packed
from autotune.models.transmission import has_load

MOST_EFFECTS, MOST_FITS = 3, 4
"""Effects that are added, and candidates fitted inside the twin for each of them."""
WORTH_A_FIT_BESIDE, CLOSE_RIVAL = 0.6, 0.75
"""Of the best candidate's gain: what is fitted beside another effect, and beside one that can be named already."""
PLAINLY_NEEDED = 20.0
"""Times what is negligible: so much needs no fit without the effect to be seen."""
RIVAL_COST = 1.5
"""Of the lowest cost: a fit that will not come so near is given up, to save time."""


@dataclass(frozen=True, slots=True)
class Found:
    """What a search came to.

    Attributes:
        study, root: as they are after torque and motion were aligned to what was found.
        chosen: the model with all effects that were found; None where there are none.
        first: all candidates beside the root; `tried`: the best of them, fitted inside the twin.
        generic: gain of free functions of each coordinate.
    """

    study: Study
    root: Level
    chosen: FittedCandidate | None
    first: Sequence[ScreenedCandidate]
    tried: Sequence[FittedCandidate]
    generic: Mapping[str, float]


def search(study: Study, root: Level, nominal: Packed, progress: Progress) -> Found:
    """Adds the best candidate until nothing more is found, and drops what is not needed beside the others."""
    return _Search(study, root, nominal, progress, evidence_of(study.data)).found()


@dataclass(slots=True)
class _Search:
    """A search in progress: `study` and `root` change where torque and motion are aligned anew.

    `seen` are the models that were fitted inside the twin, `first` and `tried` those of the first round.
    """

    study: Study
    root: Level
    nominal: Packed
    progress: Progress
    evidence: Evidence
    chosen: FittedCandidate | None = None
    seen: list[Level] = field(default_factory=list)
    first: Sequence[ScreenedCandidate] = ()
    tried: Sequence[FittedCandidate] = ()
    generic: Mapping[str, float] = field(default_factory=dict)

    def found(self) -> Found:
        for number in range(MOST_EFFECTS):
            best = self._round(first=number == 0)
            if best is None:
                break
            chosen = self._take(best)
            if not self._more_to_explain(chosen.level):
                break
        self._tidy()
        return Found(self.study, self.root, self.chosen, self.first, self.tried, self.generic)

    def _round(self, first: bool) -> FittedCandidate | None:
        """The candidate that explains most beside what is chosen, if it is worth having."""
        study, level = self.study, self.chosen.level if self.chosen else self.root
        worth = least_fall(study, self.chosen) if self.chosen is not None else 0.0
        ranked = rank(study, self.evidence, level, self.nominal, self.progress, worth)
        if first:
            self.first, self.generic = ranked, generic_gains(study, self.root)
        near = [item for item in ranked if item.fall >= NEAR_WORTH * worth or first]
        passing = self.evidence.worth_fitting(study, level, near)
        fits = self._fit_down(level, passing)
        if not any(item.named for item in fits):
            fits += self._second_look(level, ranked, passing)
        self.seen += [item.level for item in fits]
        fits = without_needless_gap(study, fits)
        if first:
            self.tried = fits
        elif self.evidence.repeats and fits:
            fits = best_refined(study, self.root, fits, self.evidence.best(study, fits), self.progress)
        return self._best(fits)

    def _fit_down(self, level: Level, passing: Sequence[ScreenedCandidate]) -> list[FittedCandidate]:
        """Fits inside the twin down the ranking until one explains nearly everything, and its close rivals."""
        fits: list[FittedCandidate] = []
        for item in passing[:MOST_FITS]:
            done = any(r.named for r in fits)
            worth = WORTH_A_FIT_BESIDE if level.effects else self.study.policy.worth_refit
            least = CLOSE_RIVAL if done else worth
            if item.gain < least * passing[0].gain:
                break
            self.progress(f"refit inside the twin: {item.effect}")
            target = RIVAL_COST * min((r.level.fitted.cost for r in fits), default=math.inf)
            fitted = inside_twin(self.study, self.root, level, item, target)
            if fitted is not None:
                fits.append(fitted)
        return fits

    def _second_look(
        self, level: Level, ranked: Sequence[ScreenedCandidate], passing: Sequence[ScreenedCandidate]
    ) -> list[FittedCandidate]:
        """The candidate that lowers the error most, though a linearised hold-out does not say so.

        An effect that only the fastest experiment shows cannot be predicted for it from the others; the veto
        trajectory tells then.
        """
        study = self.study
        left = [item for item in ranked if item not in passing]
        best = min(left, key=lambda item: item.fitted.cost, default=None)
        enough = (1.0 - study.policy.clear_fall) * level.fitted.cost
        if best is None or not study.has_veto or best.fitted.cost > enough:
            return []
        self.progress(f"refit inside the twin: {best.effect}")
        fitted = inside_twin(study, self.root, level, best)
        return [] if fitted is None else [replace(fitted, gain=gain_on_veto(study, level, fitted.level))]

    def _best(self, fits: Sequence[FittedCandidate]) -> FittedCandidate | None:
        """The fit that explains most, if it is worth having beside what is chosen already."""
        study = self.study
        fits = [item for item in fits if item.training.fall > 0.0]
        if not fits:
            return None
        best = self.evidence.best(study, fits)
        worth = best.gain >= study.policy.least_gain
        if self.evidence.repeats and self.chosen is None:
            least = study.policy.least_gain * study.mean_square(self.root.fitted.error, TRAINING)
            worth &= best.training.fall >= least
        if self.chosen is not None:
            before = self.chosen.level
            worth &= _fall(study, before, best.level, TRAINING) >= least_fall(study, self.chosen)
            if study.has(VETO):
                worth &= _fall(study, before, best.level, VETO) > 0.0
        return best if worth else None

    def _take(self, best: FittedCandidate) -> FittedCandidate:
        """Makes it the chosen model, at its best."""
        best = other_transmission_tried(self.study, self.root, self.nominal, best, self.seen, self.progress)
        if self.evidence.repeats:
            self.study, best = with_own_noise(self.study, self.root, best)
        again = self.evidence.aligned(self.study, best.level)
        if again is not self.study:
            self.study = again
            self.root, best = fitted_again(again, self.root, best)
        if self.evidence.repeats and self._unsettled(best):
            best = refined(self.study, self.root, best, self.progress)
            best = self._begun_anew(best)
        self.chosen = best
        self.seen.append(best.level)
        return best

    def _unsettled(self, chosen: FittedCandidate) -> bool:
        return self.study.policy.partly < chosen.share < REFINED

    def _begun_anew(self, chosen: FittedCandidate) -> FittedCandidate:
        """Each effect looked for again beside the others, where together they do not explain what they should.

        The first of them took its shape while the second was missing: a wave over the travel for a tight spot. A
        single one is begun anew where it is a second mass, whose way downhill depends on where it begins.
        """
        policy = self.study.policy
        alone = len(chosen.level.effects) < 2
        if alone and not has_load(chosen.level.fitted.packed.on):
            return chosen
        for effect in chosen.level.effects:
            if chosen.share >= REFINED if alone else chosen.named:
                break
            self.progress(f"another beginning for {effect}")
            again = self._from_best_start(chosen, effect, alone)
            left = error_left(self.study, chosen.level)
            if again is not None and error_left(self.study, again.level) < policy.clearly_less * left:
                chosen = replace(again, effect=chosen.effect, gain=chosen.gain)
        return chosen

    def _from_best_start(self, chosen: FittedCandidate, effect: str, alone: bool) -> FittedCandidate | None:
        """The chosen model with one effect screened anew beside the others."""
        study, root, before = self.study, self.root, self.root
        if not alone:
            rest = without_effect(study, root, chosen.level, effect)
            if rest is None:
                return None
            before = rest.level
        screened = screen(study, self.evidence, before, self.nominal, effect)
        if screened is None:
            return None
        return inside_twin(study, root, before, screened, chosen.level.fitted.cost, best_start=True)

    def _more_to_explain(self, level: Level) -> bool:
        variance, error = self.study.repeatable(level.fitted.error, level.correction, TRAINING)
        noise = self.study.noise_variance(level.fitted.error, TRAINING)
        return not math.isfinite(variance) or variance + error > self.study.policy.rest_part * noise

    def _tidy(self) -> None:
        """Drops what is not needed beside the others, and refines what is left."""
        if self.chosen is None:
            return
        study, root = self.study, self.root
        chosen = self._pruned(self.chosen)
        if self._unsettled(chosen):
            chosen = refined(study, root, chosen, self.progress)
        level = with_whole_orders(study, without_insignificant_terms(study, chosen.level))
        self.chosen = chosen if level is chosen.level else judged(study, root, level, chosen.effect)

    def _pruned(self, chosen: FittedCandidate) -> FittedCandidate:
        """Drops every effect without which training and veto are hardly worse.

        Where a model without it was `seen` to be far worse, it is needed.
        """
        study, current = self.study, chosen
        for effect in chosen.level.effects:
            if len(current.level.effects) < 2:
                break
            rest = set(current.level.effects) - {effect}
            known = [level for level in self.seen if set(level.effects) == rest]
            times = PLAINLY_NEEDED
            if known and not any(negligible(study, current, level, times) for level in known):
                continue
            self.progress(f"is {effect} needed")
            less = without_effect(study, self.root, current.level, effect)
            if less is not None and (
                negligible(study, current, less.level) or _by_chance(study, current.level, less.level)
            ):
                current = less
        return current


def least_fall(study: Study, chosen: FittedCandidate) -> float:
    """By how much an effect beside the chosen ones must lower the mean square [(N m)²]."""
    policy = study.policy
    explained = max(chosen.training.fall, 0.0)
    left = study.mean_square(chosen.level.fitted.error, TRAINING)
    least = min(
        policy.worth_beside * explained, max(policy.clear_beside * left, policy.worth_if_clear * explained)
    )
    contact = study.two_masses(chosen.level.fitted.packed)
    return max(least, policy.chance_of_contact * left) if contact else least


def negligible(study: Study, current: FittedCandidate, less: Level, times: float = 1.0) -> bool:
    """Whether what `less` lacks is worth next to nothing, beside what all explain and what is left.

    `times` is how much more than that it may be worth.
    """
    policy = study.policy
    falls = {TRAINING: current.training.fall, VETO: current.veto.fall if current.veto else math.inf}
    for role in (TRAINING, VETO):
        if not study.has(role):
            continue
        left = study.mean_square(current.level.fitted.error, role)
        lost = _fall(study, less, current.level, role)
        hardly = lost < times * policy.negligible * max(falls[role], 0.0)
        if not (hardly and lost < times * policy.negligible_left * left):
            return False
    return True


def _by_chance(study: Study, level: Level, less: Level) -> bool:
    """Whether two fits between two masses differ by no more than their chance, though one has an effect more."""
    if not study.two_masses(less.fitted.packed):
        return False
    left = study.mean_square(less.fitted.error, TRAINING)
    return _fall(study, less, level, TRAINING) < study.policy.chance_of_contact * left


def _fall(study: Study, before: Level, after: Level, role: str) -> float:
    """Of a role's mean square [(N m)²]."""
    return study.mean_square(before.fitted.error, role) - study.mean_square(after.fitted.error, role)
