"""What a search holds while it goes on, and what it came to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from autotune.diagnosis.base_laws import BASE_LAWS, BaseLaw, has_other_law
from autotune.diagnosis.candidates import (
    FittedCandidate,
    Progress,
    ScreenedCandidate,
    again_explained,
    explained_beside,
    explains_rest,
    fall_in_repeats,
    least_fall,
)
from autotune.diagnosis.evidence.evidence import Evidence
from autotune.diagnosis.free_shape import with_free_shape
from autotune.diagnosis.refits import (
    fitted_again,
    refined,
    settled_in,
    unsettled,
    with_noise_of,
)
from autotune.diagnosis.screening import (
    more_to_explain,
)
from autotune.estimation.bias_corrected_fit import ModelFit
from autotune.estimation.data import TRAINING, VETO
from autotune.estimation.model_error import with_misfit_again
from autotune.estimation.problem import Problem
from autotune.models.drive_model import Packed
from autotune.models.table import EFFECTS

LEAST_AGAIN = 0.1
"""Of what a further effect explains: that must come again in repeats, or drift; the rest may be noise it swallows."""


@dataclass(frozen=True, slots=True)
class Found:
    """What a search came to.

    Attributes:
        problem, root: as they are after torque and motion were aligned to what was found.
        chosen: the model with all effects that were found; None where there are none.
        first: all candidates beside the root; `tried`: the best of them, fitted inside the twin.
        generic: gain of free functions of each coordinate.
        presliding: elements that the root has for a presliding of its own, as they were found.
        sliding: the problem where that contact slides, whatever its law; None where nothing depends on it.
        base: sentences on laws of the base that the root has and the model that was given has not.
        begin_again: the model from which to begin anew, as what was settled before the search rests on another base.
        beside: what that base was found beside.
        told_apart: rivals that err clearly more on other recordings.
        exchanged: of several effects, fits with another one in the place of one of them that have a name too.
        later: fits of further effects, beside those that were chosen then.
        spring: the chosen model with a spring where it has hardly a gap; None where it has none, or is chosen itself.
        unloaded: the chosen effects without a second mass among them, where that tells of it; else None.
        delayed: whether a dead time of some rows does as well as the lag among them.
        cut_short: its time was up: not all was asked, and what was found was not asked whether it is needed.
        without_twin: second masses by what they gain without one, where nothing was found for a name.
    """

    problem: Problem
    root: ModelFit
    chosen: FittedCandidate | None
    first: Sequence[ScreenedCandidate]
    tried: Sequence[FittedCandidate]
    generic: Mapping[str, float]
    presliding: FittedCandidate | None = None
    sliding: Problem | None = None
    base: tuple[str, ...] = ()
    begin_again: Packed | None = None
    beside: FittedCandidate | None = None
    told_apart: tuple[str, ...] = ()
    exchanged: Sequence[FittedCandidate] = ()
    spring: FittedCandidate | None = None
    unloaded: ModelFit | None = None
    delayed: bool = False
    cut_short: bool = False
    without_twin: Sequence[ScreenedCandidate] = ()
    later: Sequence[FittedCandidate] = ()

    @property
    def further(self) -> list[FittedCandidate]:
        """Fits of one effect more than the chosen ones, none of which was taken."""
        own = set(self.model_fit.effects)
        return [one for one in self.later if own == set(one.model_fit.effects) - {one.effect}]

    @property
    def model_fit(self) -> ModelFit:
        """The chosen model, or the root where nothing was found."""
        return self.root if self.chosen is None else self.chosen.model_fit


@dataclass(slots=True)
class SearchState:
    """A search in progress: `problem` and `root` change where torque and motion are aligned anew.

    `outdone` is the root with a law of the base, where an effect explains more than that; `beside` the fit with effects
    that the root's law was found beside; `seen` are the models that were fitted inside the twin, `first` and `tried`
    those of the first round, `later` those of the others; `further` all candidates of the last of those, with the
    effects that they are beside; `laws` those of the base that may be asked for, and `law_first` that one leads a
    further effect, or that none is asked for any more; `delayed` that a dead time of some rows does as well as the lag
    that was found; `kept` the search as it was when all of it belonged together last.
    """

    problem: Problem
    root: ModelFit
    nominal: Packed
    progress: Progress
    evidence: Evidence
    may_begin_again: bool = False
    begin_again: Packed | None = None
    outdone: ModelFit | None = None
    beside: FittedCandidate | None = None
    chosen: FittedCandidate | None = None
    seen: list[ModelFit] = field(default_factory=list)
    first: Sequence[ScreenedCandidate] = ()
    tried: Sequence[FittedCandidate] = ()
    later: list[FittedCandidate] = field(default_factory=list)
    further: tuple[tuple[str, ...], Sequence[ScreenedCandidate]] = ((), ())
    generic: Mapping[str, float] = field(default_factory=dict)
    unloaded: ModelFit | None = None
    laws: Sequence[BaseLaw] = BASE_LAWS
    law_first: bool = False
    delayed: bool = False
    kept: SearchState | None = None

    def keep(self, chosen: FittedCandidate | None = None) -> None:
        """Remembers the search as it is, `chosen` where one was, for the case that its time is up before it is done."""
        self.kept = replace(
            self,
            chosen=chosen or self.chosen,
            seen=[*self.seen],
            later=[*self.later],
            kept=None,
        )

    def borne_out(self, after: ModelFit | None, before: ModelFit | None = None) -> ModelFit | None:
        """A model with another law of the base, where recordings of this kind bear it out beside the root."""
        if after is None or not self.evidence.bears_out(self.problem, before or self.root, after):
            return None
        return after

    def begins_again(self) -> bool:
        """Whether all begins anew from the root."""
        if self.may_begin_again:
            self.begin_again = self.root.fitted.packed
        return self.may_begin_again

    def take_root(self, root: ModelFit) -> None:
        """Makes it the root: torque and motion aligned by it, the twin disturbed as much as the axis is by it."""
        again = self.evidence.aligned(self.problem, root)
        there = settled_in(again, root) if again is not self.problem else None
        if there is not None:  # else its twin is unstable there, and what it leaves is of the torque before
            self.problem, root = there
        self.problem, self.root = with_noise_of(self.problem, root)

    @property
    def model_fit(self) -> ModelFit:
        """The model with what is chosen so far."""
        return self.chosen.model_fit if self.chosen else self.root

    def worth_having(self, best: FittedCandidate, root: ModelFit | None = None) -> bool:
        """Whether a fit explains enough, by itself and beside what is chosen already, or beside a `root`."""
        problem, policy, before = self.problem, self.problem.policy, root or self.model_fit
        beside = explained_beside(problem, before, best.model_fit, TRAINING)
        worth = best.gain >= (policy.confirming_gain if self.may_be_presliding(best) else policy.least_gain)
        worth &= not self.evidence.only_at_rests(problem, before, best)
        worth &= self.evidence.in_sight(problem, before, best.model_fit)
        if self.evidence.repeats and (root is not None or self.chosen is None):
            left = problem.mean_square((root or self.root).fitted.error, TRAINING)
            worth &= best.training.fall >= policy.least_gain * left
        if self.evidence.repeats and problem.twin and not self.remembers(best):
            again = again_explained(problem, before, best.model_fit)
            worth &= again >= LEAST_AGAIN * min(beside.fall, fall_in_repeats(problem, before, best.model_fit))
        if root is None and self.chosen is not None:
            worth &= beside.fall >= least_fall(problem, self.chosen)
            worth &= not self.evidence.repeats or explains_rest(problem, self.chosen, best)
            if problem.has(VETO):
                worth &= explained_beside(problem, before, best.model_fit, VETO).fall > 0.0
        return worth

    def may_be_presliding(self, best: FittedCandidate) -> bool:
        """Whether what comes after rests and reversals may be what a base's own law of presliding leaves there.

        No two such laws are alike: where the base has another one than a bristle's, and no veto trajectory bears an
        effect out, it must explain as much of experiments held out as confirms one elsewhere. A dwell time of 10 % was
        named where nothing was planted but Bouc and Wen's law.
        """
        kind = EFFECTS[best.effect]
        of_contact = kind.needs_rests or kind.approximate
        return of_contact and not self.problem.has_veto and has_other_law(self.root.fitted.packed)

    def remembers(self, best: FittedCandidate) -> bool:
        """Whether an effect that has another past in every repeat explains them all: it need not come again.

        A memory that spans a part of the travel lowered the error by 70 % on experiments held out and all of it on the
        veto, and nothing of what repeats share. A contact that ages by a logarithm is older in every repeat. What
        swallows noise does not know it beforehand.
        """
        policy, kind = self.problem.policy, EFFECTS[best.effect]
        sure = best.share >= policy.named and best.veto is not None and best.gain >= policy.clear_gain
        return sure and (kind.approximate or kind.needs_rests)

    def moved(self, problem: Problem, best: FittedCandidate) -> FittedCandidate:
        """The best candidate as torque and motion are aligned now; so are its rivals, or only the alignment tells.

        All is as it was where its twin is unstable so, or the root's. Rivals whose twins are tell nothing.
        """
        problem = with_misfit_again(problem)
        own = best.model_fit.effects
        rivals = [item for item in self.tried if item.model_fit.effects != own]
        found = fitted_again(problem, self.root, [best, *rivals])
        root, (after, *moved) = found if found is not None else (self.root, [None])
        if after is None:
            return best
        self.problem, self.root, there = problem, root, iter(moved)
        again = [after if item.model_fit.effects == own else next(there) for item in self.tried]
        self.tried = [item for item in again if item is not None]
        return after

    def shaped(self, item: FittedCandidate) -> FittedCandidate | None:
        """A fit with the course of its effect free; None where that does not explain clearly more."""
        self.progress(f"another law of {item.effect}")
        shaped = with_free_shape(self.problem, self.root, self.nominal, item)
        if shaped is None:
            return None
        if not EFFECTS[item.effect].approximate:  # elements are its own law, however many
            freed = {item.effect: item.named, **item.freed}  # freed once more, it has not its own law
            shaped = replace(shaped, freed=freed)
        return (
            refined(self.problem, self.root, shaped, self.progress)
            if unsettled(self.problem, shaped)
            else shaped
        )

    def more_to_explain(self, model_fit: ModelFit) -> bool:
        """Whether anything is left beyond doubt: certain to one standard error, or drifting."""
        return more_to_explain(self.problem, self.evidence, model_fit)
