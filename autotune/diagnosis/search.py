"""Which effects: forward, one beside the other, as long as each is worth it, then backward.

The best candidates are fitted inside the twin down the ranking; a further effect must explain enough of what
is explained already, or of what is left, and lower the error on the veto trajectory.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from autotune.diagnosis.backward import Backward
from autotune.diagnosis.base_laws import BASE_LAWS, with_base_shapes
from autotune.diagnosis.candidates import (
    FittedCandidate,
    Progress,
    ScreenedCandidate,
    again_explained,
    asked_for,
    error_left,
    explained_beside,
    explained_of_rest,
    fall_in_repeats,
    least_fall,
    plainer,
)
from autotune.diagnosis.contact_laws import EFFECT as MEMORY
from autotune.diagnosis.contact_laws import of_many, with_own_presliding, without_memory
from autotune.diagnosis.evidence import evidence_of
from autotune.diagnosis.evidence.evidence import Evidence, late_anew, without_long_lag
from autotune.diagnosis.evidence.time_driven import without_clocked, without_reading_waves
from autotune.diagnosis.free_shape import with_free_shape
from autotune.diagnosis.refits import (
    REFINED,
    RIVAL_COST,
    best_refined,
    fitted_again,
    gain_on_veto,
    in_place_of,
    in_quieter_twin,
    inside_twin,
    judged,
    looped_otherwise,
    refined,
    root_from,
    settled_in,
    taken_out,
    unsettled,
    with_contact,
    with_noise_of,
    with_own_noise,
    without_effect,
)
from autotune.diagnosis.screening import (
    NEAR_WORTH,
    at_its_best,
    generic_gains,
    more_to_explain,
    rank,
    rows_back,
    screen,
)
from autotune.diagnosis.transmission import (
    masses_led_on,
    other_contact_tried,
    other_transmission_tried,
    spring_in_place,
    without_needless_gap,
)
from autotune.estimation.bias_corrected_fit import LEVEL_GROUND, ModelFit, fit_inside_twin
from autotune.estimation.cross_validation import (
    beyond_presliding,
    evenly,
    gain_and_z,
    goes_with_place,
    held_out,
)
from autotune.estimation.data import TRAINING, VETO
from autotune.estimation.model_error import told_beside
from autotune.estimation.problem import Problem
from autotune.models import layout
from autotune.models.drive_model import Packed
from autotune.models.table import EFFECTS
from autotune.models.torque_lag import TORQUE_LAG
from autotune.models.transmission import has_load
from autotune.signals.chunks import beyond_chance

LAG = TORQUE_LAG.name
MOST_EFFECTS, MOST_FITS = 3, 4
"""Effects that are added, and candidates fitted inside the twin for each of them."""
WORTH_A_FIT_BESIDE, CLOSE_RIVAL = 0.6, 0.75
"""Of the best candidate's gain: what is fitted beside another effect, and beside one that can be named already."""
LOOPS_ANEW = 2
"""Times that a twin may be shaken or controlled otherwise before a second mass: one for each."""
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
        freed: effects whose course is free, as their law differs; whether their own law would have named them too.
        presliding: elements that the root has for a presliding of its own, as they were found.
        sliding: the problem where that contact slides, whatever its law; None where nothing depends on it.
        base: sentences on laws of the base that the root has and the model that was given has not.
        begin_again: the model from which to begin anew, as what was settled before the search rests on another base.
        beside: what that base was found beside.
        told_apart: rivals that err clearly more on other recordings.
        exchanged: of several effects, fits with another one in the place of one of them that have a name too.
        spring: the chosen model with a spring where it has hardly a gap; None where it has none.
        unloaded: the chosen effects without a second mass among them, where they have no name so; else None.
    """

    problem: Problem
    root: ModelFit
    chosen: FittedCandidate | None
    first: Sequence[ScreenedCandidate]
    tried: Sequence[FittedCandidate]
    generic: Mapping[str, float]
    freed: Mapping[str, bool] = field(default_factory=dict)
    presliding: FittedCandidate | None = None
    sliding: Problem | None = None
    base: tuple[str, ...] = ()
    begin_again: Packed | None = None
    beside: ModelFit | None = None
    told_apart: tuple[str, ...] = ()
    exchanged: Sequence[FittedCandidate] = ()
    spring: FittedCandidate | None = None
    unloaded: ModelFit | None = None


def search(
    problem: Problem,
    root: ModelFit,
    nominal: Packed,
    progress: Progress,
    may_begin_again: bool = False,
    beside: ModelFit | None = None,
) -> Found:
    """Adds the best candidate until nothing more is found, and drops what is not needed beside the others.

    Where the base turns out to have another law, a search that `may_begin_again` ends there: how torque and motion
    belong together, and how the twin is shaken, were found with another base. `beside`: what it was found beside then.
    """
    evidence = evidence_of(problem.data)
    return _Search(problem, root, nominal, progress, evidence, may_begin_again, beside=beside).found()


@dataclass(slots=True)
class _Search:
    """A search in progress: `problem` and `root` change where torque and motion are aligned anew.

    `outdone` is the root with a law of the base, where an effect explains more than that; `beside` a model with effects
    that the root's law was found beside; `seen` are the models that were fitted inside the twin, `first` and `tried`
    those of the first round, `later` those of the others.
    """

    problem: Problem
    root: ModelFit
    nominal: Packed
    progress: Progress
    evidence: Evidence
    may_begin_again: bool = False
    begin_again: Packed | None = None
    outdone: ModelFit | None = None
    beside: ModelFit | None = None
    chosen: FittedCandidate | None = None
    seen: list[ModelFit] = field(default_factory=list)
    first: Sequence[ScreenedCandidate] = ()
    tried: Sequence[FittedCandidate] = ()
    later: list[FittedCandidate] = field(default_factory=list)
    generic: Mapping[str, float] = field(default_factory=dict)
    freed: dict[str, bool] = field(default_factory=dict)
    unloaded: ModelFit | None = None

    def found(self) -> Found:
        self._shape_base()
        self.problem, self.root = rows_back(
            self.problem, self.evidence, self.root, self.nominal, self.progress
        )
        self._seek()
        if self.begin_again is None and self._other_law_beside():
            self._seek()
        if self.begin_again is not None:
            anew = Found(self.problem, self.root, None, (), (), {}, begin_again=self.begin_again)
            return replace(anew, beside=self.beside)
        self._tidy()
        if self._loaded_by_the_loop():
            self._seek_on()
            self._tidy()
        self._without_chains_lag()
        if self.chosen is not None:
            self.chosen, self.unloaded = self._backward.without_doubtful_load(self.chosen, self.first)
        self._drop_laws()
        self._try_look_alikes()
        seen = (self.problem, self.root, self.chosen, self.first, self.tried, self.generic)
        found = Found(*seen, self._still_freed(), exchanged=self._in_place(), unloaded=self.unloaded)
        found = self._where_it_slides(self._beside_own_presliding(found))
        if found.chosen is None:
            return found
        spring = spring_in_place(found.problem, found.root, self.nominal, found.chosen, self.seen)
        return replace(found, spring=spring)

    def _seek(self) -> None:
        """Adds effects to the root, one beside the other, as long as they explain enough."""
        self.chosen, self.seen, self.later, self.freed = None, [], [], {}
        self._seek_on()

    def _seek_on(self) -> None:
        """Adds effects beside what is chosen already."""
        there = len(self.chosen.model_fit.effects) if self.chosen is not None else 0
        for _ in range(MOST_EFFECTS - there):
            if self.chosen is not None and self.chosen.named and not self._more_to_explain(self._model_fit):
                break
            best = self._next(first=self.chosen is None)
            if best is None:
                break
            self._take(best)

    def _next(self, first: bool) -> FittedCandidate | None:
        """The best of a round, looked for again where the model as it is does half of that from elsewhere."""
        best = self._round(first)
        if best is not None and first and self._rooted_anew(best):
            best = self._round(first)
        for _ in range(LOOPS_ANEW):
            if best is None or not self._looped_anew(best):
                break
            best = self._round(first)
        return best

    def _shape_base(self) -> None:
        """What textbooks have in the base may have another shape there: that is asked before anything else."""
        if not self._more_to_explain(self.root):
            return
        shaped = self._borne_out(with_base_shapes(self.problem, self.root, self.nominal))
        if shaped is not None:
            self.progress("another law of the base")
            self._take_root(shaped)

    def _other_law(self, ranked: Sequence[ScreenedCandidate]) -> bool:
        """Whether an optional law of the base explains more than any effect: then the root has it.

        Memory is no effect beside the friction of many contacts, unless it goes on beyond them.
        """
        asked = self._more_to_explain(self.root)
        if not asked and not self.evidence.worth_fitting(self.problem, self.root, ranked):
            return False
        found = self._other_laws()
        gains = [gain_and_z(self.root.unseen, one.unseen)[0] if one is not None else 0.0 for one in found]
        best = self._plainest(found, max(range(len(found)), key=lambda i: gains[i]))
        other = found[best]
        if other is None:
            return False
        effects = [item for item in ranked if item.effect != MEMORY or not of_many(other.fitted.packed)]
        if gains[best] < max((item.gain for item in effects), default=0.0):
            self.outdone = other
            return False
        self.progress(BASE_LAWS[best].about)
        self._take_root(other)
        self._begins_again()
        return True

    def _other_laws(self) -> list[ModelFit | None]:
        """The root with each law of the base that data ask for, up to one that leaves nothing beyond doubt."""
        found: list[ModelFit | None] = []
        for law in BASE_LAWS:
            found.append(self._borne_out(law.added(self.problem, self.root)))
            last = found[-1]
            if last is not None and not self._more_to_explain(last):
                break
        return found

    def _plainest(self, found: Sequence[ModelFit | None], best: int) -> int:
        """The best of several laws of the base; or one with fewer parameters, where data do not ask for more."""
        other = found[best]
        plainer = [
            (one.fitted.cost, i)
            for i, one in enumerate(found)
            if one is not None
            and other is not None
            and len(one.free) < len(other.free)
            and not asked_for(self.problem, one, other)
        ]
        return min(plainer)[1] if plainer else best

    def _other_law_beside(self) -> bool:
        """Whether one does so beside what was found: then the root has it, and effects are looked for anew.

        Where what explained more could not be taken after all, or errs more inside the twin, it does.
        """
        other = self.outdone if self._outdone_after_all() else None
        found = self.chosen or self._best_refused()
        if other is None and found is not None:
            other = self._root_beside(found)
        if other is None or other.fitted.cost > LEVEL_GROUND * self.root.fitted.cost:
            return False
        self.progress("another law of the base")
        self._take_root(other)
        return not self._begins_again()

    def _outdone_after_all(self) -> bool:
        """Whether a law of the base that the best effect seemed to outdo explains more than what was found."""
        if self.outdone is None or self.chosen is None:
            return self.outdone is not None
        left = [error_left(self.problem, one) for one in (self.outdone, self.chosen.model_fit)]
        return left[0] < left[1]

    def _root_beside(self, chosen: FittedCandidate) -> ModelFit | None:
        """The root with a law of the base that the data ask for beside an effect; None where they do not.

        Training may be explained where the veto trajectory is not.
        """
        if not (chosen.share < REFINED or self._more_to_explain(chosen.model_fit)):
            return None
        before = chosen.model_fit
        found = [(law, self._borne_out(law.added(self.problem, before), before)) for law in BASE_LAWS]
        beside = [(law, after) for law, after in found if after is not None]
        if not beside:
            return None
        law, after = min(beside, key=lambda item: item[1].fitted.cost)
        self.beside = after
        starts = [taken_out(self.root, after, *after.effects)]
        if max(law.slots) < layout.BASE_PARAMETERS:
            p = self.root.fitted.packed.p.copy()
            p[list(law.slots)] = after.fitted.packed.p[list(law.slots)]
            starts.append(Packed(p, self.root.fitted.packed.on))
        free = [*self.root.free, *(one for one in after.free if one.slot in law.slots)]
        fits = [fit_inside_twin(self.problem, packed, free, 2, self.root.effects) for packed in starts]
        return min((one for one in fits if one is not None), key=lambda one: one.fitted.cost, default=None)

    def _best_refused(self) -> FittedCandidate | None:
        """The best of the first round that explains half of all, where none was taken."""
        half = [one for one in self.tried if one.share >= self.problem.policy.partly]
        return min(half, key=lambda one: error_left(self.problem, one.model_fit), default=None)

    def _borne_out(self, after: ModelFit | None, before: ModelFit | None = None) -> ModelFit | None:
        """A model with another law of the base, where recordings of this kind bear it out beside the root."""
        if after is None or not self.evidence.bears_out(self.problem, before or self.root, after):
            return None
        return after

    def _begins_again(self) -> bool:
        """Whether all begins anew from the root."""
        if self.may_begin_again:
            self.begin_again = self.root.fitted.packed
        return self.may_begin_again

    def _take_root(self, root: ModelFit) -> None:
        """Makes it the root: torque and motion aligned by it, the twin disturbed as much as the axis is by it."""
        again = self.evidence.aligned(self.problem, root)
        if again is not self.problem:
            self.problem = again
            root = fit_inside_twin(again, root.fitted.packed, list(root.free), 2, root.effects) or root
        self.problem, self.root = with_noise_of(self.problem, root)

    def _try_look_alikes(self) -> None:
        """Effects that may do as well as a single one that was found are fitted to their end, too.

        Where one trajectory is all there is, a candidate may have been passed over that explains it as well.
        """
        chosen = self.chosen
        if chosen is None or len(chosen.model_fit.effects) != 1:
            return
        for effect in self.evidence.look_alikes(self.problem, chosen.effect):
            self.progress(f"does {effect} do as well")
            item = at_its_best(self.problem, self.evidence, self.root, self.nominal, effect)
            fitted = inside_twin(self.problem, self.root, self.root, item) if item is not None else None
            if fitted is not None:
                fitted = with_contact(self.problem, self.root, fitted)
                better = [one for one in self.tried if one.effect == effect and one.gain > fitted.gain]
                if not better:
                    self.tried = [*(one for one in self.tried if one.effect != effect), fitted]

    def _drop_laws(self) -> None:
        """The base is the plain one again where it needs no other law beside what was found."""
        for law in BASE_LAWS:
            if self.chosen is None or not law.there(self.root.fitted.packed):
                continue
            less = law.removed(self.problem, self.chosen.model_fit)
            if less is None or asked_for(self.problem, less, self.chosen.model_fit):
                continue
            root = law.removed(self.problem, self.root)
            if root is not None:
                self.root, self.chosen = root, judged(self.problem, root, less, self.chosen.effect)

    def _rooted_anew(self, best: FittedCandidate) -> bool:
        """Whether the root was no minimum: a candidate that led its base away from there is no reason for a name."""
        root = root_from(self.problem, self.root, best.model_fit)
        if root is None:
            return False
        self.progress("fit of the model as it is, from elsewhere")
        self.root = root
        return True

    def _looped_anew(self, best: FittedCandidate) -> bool:
        """Whether a second mass made up for how the twin is shaken, or controlled: that is no reason for a name."""
        found = self._otherwise(self._model_fit, best.model_fit)
        if found is None:
            return False
        self.problem, before = found
        if self.chosen is None:
            self.root = before
        else:
            self.root, (self.chosen,) = fitted_again(self.problem, self.root, [self.chosen])
        return True

    def _otherwise(self, before: ModelFit, loaded: ModelFit) -> tuple[Problem, ModelFit] | None:
        """What stands for a second mass, by how the twin is shaken, controlled or late; None where nothing does."""
        late = late_anew(self.problem, before) if has_load(loaded.fitted.packed.on) else None
        found = looped_otherwise(self.problem, before, loaded, late)
        if found is None:
            return None
        self.progress("twins that are shaken or controlled otherwise")
        return found if found is not late else settled_in(without_long_lag(found[0]), found[1])

    def _loaded_by_the_loop(self) -> bool:
        """Whether a second mass beside others made up for how the twin is shaken, controlled or late.

        That was asked before the others were found, and what they explain was in the way.
        """
        chosen = self.chosen
        if chosen is None or len(chosen.model_fit.effects) < 2 or not self.evidence.repeats:
            return False
        loads = [effect for effect in chosen.model_fit.effects if EFFECTS[effect].in_transmission]
        less = without_effect(self.problem, self.root, chosen.model_fit, loads[0]) if loads else None
        found = self._otherwise(less.model_fit, chosen.model_fit) if less is not None else None
        if less is None or found is None:
            return False
        self.problem = found[0]
        bare = replace(less, model_fit=found[1])
        self.root, (self.chosen,) = fitted_again(self.problem, self.root, [bare])
        return True

    def _without_chains_lag(self) -> None:
        """Beside other effects a lag is needed only where the chain, asked again beside them, cannot be what is late.

        It was asked while they were missing, and what they explain may have bent the lag's way.
        """
        chosen = self.chosen
        if chosen is None or len(chosen.model_fit.effects) < 2 or LAG not in chosen.model_fit.effects:
            return
        less = without_effect(self.problem, self.root, chosen.model_fit, LAG)
        again = self.evidence.aligned(self.problem, less.model_fit) if less is not None else self.problem
        if less is None or again is self.problem:
            return
        root, (bare,) = fitted_again(again, self.root, [less])
        if bare.model_fit.fitted.cost <= LEVEL_GROUND * chosen.model_fit.fitted.cost:
            self.problem, self.root, self.chosen = again, root, bare

    def _beside_own_presliding(self, found: Found) -> Found:
        """The same with elements that are no memory in the root: what was found beside them keeps its name."""
        chosen = found.chosen
        own = with_own_presliding(self.problem, self.root, chosen.model_fit) if chosen is not None else None
        if own is None or chosen is None:
            return found
        climbs = self._remembered_beyond(own)
        if climbs is not None:
            remembers = judged(self.problem, climbs, chosen.model_fit, chosen.effect)
            return replace(found, root=climbs, chosen=remembers, presliding=chosen)
        others = tuple(effect for effect in chosen.model_fit.effects if effect != MEMORY)
        beside = (
            replace(chosen, effect=others[-1], model_fit=replace(chosen.model_fit, effects=others))
            if others
            else None
        )
        found = replace(
            found,
            root=own,
            chosen=beside if beside is not None and self._needed_beside(own, beside) else None,
            first=[item for item in self.first if item.effect != MEMORY],
            tried=[item for item in self.tried if item.effect != MEMORY],
            presliding=chosen,
        )
        return found if found.chosen is not None else self._begun_beside(found)

    def _begun_beside(self, found: Found) -> Found:
        """The search begun anew beside a presliding of its own, where something is left while that contact slides.

        What it leaves elsewhere is what no two laws of it have in common; an effect must hold where it slides.
        """
        own, problem = found.root, self.problem
        sliding = beyond_presliding(problem, own.fitted.packed)
        if sliding is None:
            return found
        there = replace(own, unseen=held_out(sliding, own.fitted.error, own.fitted.jacobian))
        generic = generic_gains(sliding, there)
        found = replace(found, generic=generic, sliding=sliding)
        structured = max(generic.values(), default=0.0) > problem.policy.generic_gain
        left = self.evidence.structure_left(sliding, own) if self.evidence.repeats else structured
        left = left or goes_with_place(sliding, own.fitted)
        if not left:
            return found
        again = _Search(problem, own, self.nominal, self.progress, self.evidence)
        best = again._round(first=True)
        if best is not None:
            again._take(best)
            again._tidy()
        beside = replace(found, first=again.first, tried=again.tried)
        if again.problem is not problem:  # aligned, or shaken, as the effect suggests
            sliding = beyond_presliding(again.problem, again.root.fitted.packed)
        if again.chosen is None or sliding is None:
            return beside
        chosen = again._while_sliding(sliding, again.chosen)
        if chosen is None:
            return beside
        found = replace(beside, problem=again.problem, root=again.root, sliding=sliding)
        return replace(found, chosen=chosen, freed=again._still_freed())

    def _where_it_slides(self, found: Found) -> Found:
        """What was found, by what it explains while the contact slides, where the base has another law of presliding.

        No two such laws are alike near a reversal, and what the law that was found leaves there is as much a part of
        what repeats as an effect is. An effect that explains half of all, and all that is left where any contact
        slides, is no worse for it.
        """
        chosen, root = found.chosen, found.root
        otherwise = any(law.there(root.fitted.packed) for law in BASE_LAWS)
        if chosen is None or chosen.named or not otherwise or found.sliding is not None:
            return found
        sliding = beyond_presliding(self.problem, root.fitted.packed)
        if sliding is None or not self._shares_with_repeats(sliding, chosen):
            return found
        part = judged(sliding, root, chosen.model_fit, chosen.effect)
        if part.share <= chosen.share:
            return found
        return replace(found, chosen=replace(part, gain=chosen.gain), sliding=sliding)

    def _shares_with_repeats(self, sliding: Problem, chosen: FittedCandidate) -> bool:
        """Whether repeats tell that something is left while the contact slides, of which half of all is explained."""
        if not self.evidence.repeats or chosen.share < self.problem.policy.partly:
            return False
        return self.evidence.structure_left(sliding, self.root)

    def _while_sliding(self, sliding: Problem, chosen: FittedCandidate) -> FittedCandidate | None:
        """An effect by what it explains while the contact slides; None where it hardly lowers what is left there.

        On the rows around it leaves what the law of presliding is not exactly, which no effect explains.
        """
        policy, root = self.problem.policy, self.root
        part = judged(sliding, root, chosen.model_fit, chosen.effect)
        least = policy.least_gain if self.evidence.repeats else policy.least_gain_single
        if part.training.fall < least * sliding.mean_square(root.fitted.error, TRAINING):
            return None
        return replace(part, gain=chosen.gain) if part.share >= policy.partly else None

    def _remembered_beyond(self, own: ModelFit) -> ModelFit | None:
        """The root with a presliding of its own, where elements that go on beyond it are a memory; else None.

        That contact lets go at once, so that what goes on may be a small part of all friction; it must be an effect by
        itself, as any other beside that root.
        """
        climbs = without_memory(self.problem, self.root, own)
        if climbs is None or not asked_for(self.problem, climbs, own):
            return None
        tail = judged(self.problem, climbs, replace(own, effects=(*own.effects, MEMORY)), MEMORY)
        fall = climbs.fitted.cost - own.fitted.cost
        gain, z = gain_and_z(climbs.unseen, own.unseen)
        item = ScreenedCandidate(MEMORY, own.fitted, fall, gain, z, evenly=evenly(climbs.unseen, own.unseen))
        stopped = self.evidence.stopped_by(self.problem, climbs, item)
        return climbs if tail.named and not stopped and self._worth_having(tail, climbs) else None

    def _needed_beside(self, own: ModelFit, chosen: FittedCandidate) -> bool:
        """Whether effects explain most of what another law of presliding leaves: that law explains the rest of all."""
        alone = judged(self.problem, own, chosen.model_fit, chosen.effect)
        return not self.evidence.repeats or alone.share >= self.problem.policy.partly

    @property
    def _model_fit(self) -> ModelFit:
        """The model with what is chosen so far."""
        return self.chosen.model_fit if self.chosen else self.root

    def _round(self, first: bool) -> FittedCandidate | None:
        """The candidate that explains most beside what is chosen, if it is worth having."""
        problem, model_fit = self.problem, self._model_fit
        worth = least_fall(problem, self.chosen) if self.chosen is not None else 0.0
        ranked = rank(problem, self.evidence, model_fit, self.nominal, self.progress, worth)
        if first and self._other_law(ranked):
            if self.begin_again is not None:
                return None
            problem, model_fit = self.problem, self.root
            ranked = rank(problem, self.evidence, model_fit, self.nominal, self.progress)
        if first:
            self.first, self.generic = ranked, generic_gains(problem, self.root)
        near = [item for item in ranked if first or item.fall >= NEAR_WORTH * worth or self._promises(item)]
        passing = self.evidence.worth_fitting(problem, model_fit, near)
        fits = self._fit_down(model_fit, passing)
        if first and not any(item.named for item in fits):
            fits = self._as_beside(fits)
        if not any(item.named for item in fits):
            fits += self._second_look(model_fit, ranked, passing)
        self.seen += [item.model_fit for item in fits]
        fits = without_needless_gap(problem, fits)
        if first:
            self.tried = fits
        else:
            self.later += fits
        if not first and self.evidence.repeats and fits:
            fits = best_refined(problem, self.root, fits, self.evidence.best(problem, fits), self.progress)
        return self._best(fits)

    def _as_beside(self, fits: list[FittedCandidate]) -> list[FittedCandidate]:
        """The fits, and what the root's law was found beside, fitted again from there, where that is better.

        In the root that law has taken the place of the effect, as far as it can: from there a screening looks for
        another one (dwell time beside a chain of contacts gained 5 % of what it explains).
        """
        if self.beside is None:
            return fits
        self.progress("what the law of the base was found beside")
        known = self.beside.fitted
        again = fit_inside_twin(self.problem, known.packed, list(known.free), 2, self.beside.effects)
        if again is None:
            return fits
        found = judged(self.problem, self.root, again, again.effects[-1])
        same = [one for one in fits if one.model_fit.effects == again.effects]
        if any(one.model_fit.fitted.cost < again.fitted.cost for one in same):
            return fits
        return [*(one for one in fits if one not in same), found]

    def _promises(self, item: ScreenedCandidate) -> bool:
        """Whether two masses, which are followed inside the twin only, would lower the error by their linear model."""
        in_transmission = EFFECTS[item.effect].in_transmission and self.problem.twin
        return in_transmission and item.gain >= self.problem.policy.clear_gain

    def _fit_down(self, model_fit: ModelFit, passing: Sequence[ScreenedCandidate]) -> list[FittedCandidate]:
        """Fits inside the twin down the ranking until one explains nearly everything, and its close rivals."""
        fits: list[FittedCandidate] = []
        for item in passing[:MOST_FITS]:
            done = any(r.named for r in fits)
            worth = WORTH_A_FIT_BESIDE if model_fit.effects else self.problem.policy.worth_refit
            least = CLOSE_RIVAL if done else worth
            if item.gain < least * passing[0].gain:
                break
            self.progress(f"refit inside the twin: {item.effect}")
            target = RIVAL_COST * min((r.model_fit.fitted.cost for r in fits), default=math.inf)
            fitted = inside_twin(self.problem, self.root, model_fit, item, target)
            if fitted is not None:
                fits.append(fitted)
        return fits

    def _second_look(
        self, model_fit: ModelFit, ranked: Sequence[ScreenedCandidate], passing: Sequence[ScreenedCandidate]
    ) -> list[FittedCandidate]:
        """The candidate that lowers the error most, though a linearised hold-out does not say so.

        An effect that only the fastest experiment shows cannot be predicted for it from the others; the veto
        trajectory tells then.
        """
        problem = self.problem
        left = [item for item in ranked if item not in passing]
        best = min(left, key=lambda item: item.fitted.cost, default=None)
        enough = (1.0 - problem.policy.clear_fall) * model_fit.fitted.cost
        if best is None or not problem.has_veto:
            return []
        if best.fitted.cost > enough:
            return self._loaded_on_veto(model_fit, left) if self.chosen is None else []
        self.progress(f"refit inside the twin: {best.effect}")
        fitted = inside_twin(problem, self.root, model_fit, best)
        if fitted is None:
            return []
        return [replace(fitted, gain=gain_on_veto(problem, model_fit, fitted.model_fit))]

    def _loaded_on_veto(
        self, model_fit: ModelFit, left: Sequence[ScreenedCandidate]
    ) -> list[FittedCandidate]:
        """Two masses that gain in too few experiments, where the veto trajectory bears their fit out beyond chance.

        Between two masses motion is not linear, and a screening ends a few steps from a start: what its linear model
        says of experiments held out scatters. Inside the twin it is a fit, and the veto trajectory was never fitted.
        """
        problem, policy = self.problem, self.problem.policy
        loads = [
            item
            for item in left
            if problem.twin and EFFECTS[item.effect].in_transmission and item.gain >= policy.least_gain
        ]
        if not loads:
            return []
        best = min(loads, key=lambda item: item.fitted.cost)
        self.progress(f"refit inside the twin: {best.effect}")
        fitted = inside_twin(problem, self.root, model_fit, best)
        if fitted is None or fitted.share < policy.partly:
            return []
        if gain_on_veto(problem, model_fit, fitted.model_fit) < policy.clear_gain:
            return []
        weight = problem.weight * problem.data.role(VETO)
        fall = weight * (model_fit.fitted.error**2 - fitted.model_fit.fitted.error**2)
        return [fitted] if beyond_chance(fall[weight > 0.0], policy.apart_z) else []

    def _best(self, fits: Sequence[FittedCandidate]) -> FittedCandidate | None:
        """The fit that explains most, if it is worth having beside what is chosen already.

        Where the fastest experiment alone shows an effect, its hold-out says nothing; the veto trajectory does.
        """
        problem = self.problem
        fits = [f for f in fits if f.training.fall > 0.0 and not self.evidence.of_the_chain(problem, f)]
        if not fits:
            return None
        best = self.evidence.best(problem, fits)
        best = plainer(problem, fits, best, self.evidence.alike(problem))
        if best.named and problem.has_veto and best.gain < problem.policy.least_gain:
            best = replace(best, gain=gain_on_veto(problem, self._model_fit, best.model_fit))
        return best if self._worth_having(best) else self._worth_by_its_course(best)

    def _worth_by_its_course(self, best: FittedCandidate) -> FittedCandidate | None:
        """A further effect that by its own law explains less than half of what the others leave, with its course free.

        Of an encoder that is tilted too the second wave makes more torque than the first. By its course it must explain
        as much of that as a name asks of all, on training and veto.
        """
        problem, before = self.problem, self._model_fit
        if self.chosen is None or not self.evidence.repeats:
            return None
        beside = explained_beside(problem, before, best.model_fit, TRAINING)
        if beside.fall < least_fall(problem, self.chosen) or beside.share >= problem.policy.partly:
            return None
        shaped = self._shaped(best)
        if shaped is None or not shaped.named:
            return None
        parts = explained_of_rest(problem, before, shaped.model_fit)
        told = all(part.share >= problem.policy.named for part in parts)
        return shaped if told and self._worth_having(shaped) else None

    def _worth_having(self, best: FittedCandidate, root: ModelFit | None = None) -> bool:
        """Whether a fit explains enough, by itself and beside what is chosen already, or beside a `root`."""
        problem, policy, before = self.problem, self.problem.policy, root or self._model_fit
        beside = explained_beside(problem, before, best.model_fit, TRAINING)
        worth = best.gain >= policy.least_gain
        worth &= not self.evidence.only_at_rests(problem, before, best)
        worth &= self.evidence.in_sight(problem, before, best.model_fit)
        if self.evidence.repeats and (root is not None or self.chosen is None):
            left = problem.mean_square((root or self.root).fitted.error, TRAINING)
            worth &= best.training.fall >= policy.least_gain * left
        if self.evidence.repeats and problem.twin and not self._remembers(best):
            again = again_explained(problem, before, best.model_fit)
            worth &= again >= LEAST_AGAIN * min(beside.fall, fall_in_repeats(problem, before, best.model_fit))
        if root is None and self.chosen is not None:
            worth &= beside.fall >= least_fall(problem, self.chosen)
            worth &= not self.evidence.repeats or beside.share >= policy.partly
            if problem.has(VETO):
                worth &= explained_beside(problem, before, best.model_fit, VETO).fall > 0.0
        return worth

    def _remembers(self, best: FittedCandidate) -> bool:
        """Whether an effect that has another past in every repeat explains them all: it need not come again.

        A memory that spans a part of the travel lowered the error by 70 % on experiments held out and all of it on the
        veto, and nothing of what repeats share. A contact that ages by a logarithm is older in every repeat. What
        swallows noise does not know it beforehand.
        """
        policy, kind = self.problem.policy, EFFECTS[best.effect]
        sure = best.share >= policy.named and best.veto is not None and best.gain >= policy.clear_gain
        return sure and (kind.approximate or kind.needs_rests)

    def _take(self, best: FittedCandidate) -> FittedCandidate:
        """Makes it the chosen model, at its best."""
        best = other_transmission_tried(self.problem, self.root, self.nominal, best, self.seen, self.progress)
        if self.evidence.repeats:
            self.problem, best = with_own_noise(self.problem, self.root, best)
        fitted = best.model_fit.fitted
        clockless = without_clocked(self.problem, fitted.packed, fitted.error)
        if clockless is not None:
            best = self._moved(clockless, best)
        true = without_reading_waves(self.problem, best.model_fit)
        if true is not None:
            best = self._moved(true, best)
        best = self._aligned(best)
        if not self.evidence.repeats:
            best = with_contact(self.problem, self.root, best)
        if self.evidence.repeats and unsettled(self.problem, best):
            best = self._shaken_less(best)
            best = refined(self.problem, self.root, best, self.progress)
            best = self._begun_anew(best)
            if unsettled(self.problem, best):
                best = masses_led_on(self.problem, self.root, best, self.progress)
            if best.share < REFINED:
                best = self._other_contact(best)
            best = self._late_beside(self._told_beside(best))
        if self.evidence.repeats and (best.plain_share < REFINED or self._more_to_explain(best.model_fit)):
            best = self._freed(best)
        if self.chosen is not None and self.evidence.repeats and self._more_to_explain(best.model_fit):
            best = self._first_exchanged(best)
        self.chosen = best
        self.seen.append(best.model_fit)
        return best

    def _other_contact(self, best: FittedCandidate) -> FittedCandidate:
        """The best candidate with another contact in its gap where that does clearly better, led on from there."""
        other = other_contact_tried(self.problem, self.root, best, self.progress)
        if other is best:
            return best
        other = refined(self.problem, self.root, other, self.progress)
        return masses_led_on(self.problem, self.root, other, self.progress)

    def _shaken_less(self, best: FittedCandidate) -> FittedCandidate:
        """The best candidate in twins that are shaken less, where these leave clearly less; led on, and as loud again.

        What it leaves is the least that is to be had then, and tells how much the axis is shaken.
        """
        before = self.problem
        self.problem, best = in_quieter_twin(before, self.root, best)
        if self.problem is before:
            return best
        self.progress("twins that are shaken less")
        best = masses_led_on(self.problem, self.root, best, self.progress)
        self.problem, best = with_own_noise(self.problem, self.root, best)
        return best

    def _told_beside(self, best: FittedCandidate) -> FittedCandidate:
        """The best candidate beside the law that is told by it, where it leaves less so."""
        before = self.problem, self.root, self.tried
        again = told_beside(self.problem, best.model_fit.fitted)
        if again is self.problem:
            return best
        self.progress("another law of the controller")
        moved = self._shaken_less(self._moved(again, best))
        moved = refined(self.problem, self.root, moved, self.progress)
        if moved.model_fit.fitted.cost < best.model_fit.fitted.cost:
            return moved
        self.problem, self.root, self.tried = before
        return best

    def _late_beside(self, best: FittedCandidate) -> FittedCandidate:
        """The best candidate in a loop that is as late as it is found to be beside it, where that leaves clearly less.

        A second mass moves in the twin, and how late its loop is rules what it does there.
        """
        loaded = self.problem.twin and self.problem.two_masses(best.model_fit.fitted.packed)
        found = late_anew(self.problem, best.model_fit) if loaded and best.share < REFINED else None
        least = self.problem.policy.clearly_less * best.model_fit.fitted.cost
        if found is None or found[1].fitted.cost >= least:
            return best
        self.progress("how late the loop is, anew")
        before = self.problem, self.root, self.tried
        moved = self._moved(without_long_lag(found[0]), replace(best, model_fit=found[1]))
        moved = refined(self.problem, self.root, moved, self.progress)
        if moved.model_fit.fitted.cost < least:
            return moved
        self.problem, self.root, self.tried = before
        return best

    def _aligned(self, best: FittedCandidate) -> FittedCandidate:
        """The best candidate with torque and motion aligned by it; as it was where the twin then leaves more.

        Beside a lag of the loop a shift takes what the lag's law has too much or too little along the measured motion:
        but rows that were written late delay no loop, and twins tell the one from the other.
        """
        again = self.evidence.aligned(self.problem, best.model_fit)
        if again is self.problem:
            return best
        before = self.problem, self.root, self.tried
        moved = self._moved(again, best)
        if not again.twin or moved.model_fit.fitted.cost <= LEVEL_GROUND * best.model_fit.fitted.cost:
            return moved
        self.problem, self.root, self.tried = before
        return best

    def _moved(self, problem: Problem, best: FittedCandidate) -> FittedCandidate:
        """The best candidate as torque and motion are aligned now; so are its rivals, or only the alignment tells."""
        rivals = [item for item in self.tried if item.named and item.effect != best.effect]
        self.problem = problem
        self.root, (best, *moved) = fitted_again(problem, self.root, [best, *rivals])
        self.tried = list({item.effect: item for item in (*self.tried, *moved)}.values())
        return best

    def _freed(self, chosen: FittedCandidate) -> FittedCandidate:
        """The model with the course of its last effect free, where its own law leaves a part unexplained.

        Others that came near it get the same chance: what is compared is each effect at its best.
        """
        best = self._shaped(chosen) or chosen
        if self.chosen is not None:
            return self._others_freed(best)
        for item in [one for one in self.tried if self._contends(chosen, one)]:
            shaped = self._shaped(item)
            if shaped is None or self.evidence.only_at_rests(self.problem, self.root, shaped):
                continue
            self.tried = [shaped if one is item else one for one in self.tried]
            if error_left(self.problem, shaped.model_fit) < error_left(self.problem, best.model_fit):
                best = shaped
        return best

    def _others_freed(self, chosen: FittedCandidate) -> FittedCandidate:
        """The same with the courses of those before it free, while together they explain less than a name asks.

        By itself none of them explained enough to tell its course, or what was missing hid it.
        """
        for effect in chosen.model_fit.effects:
            if chosen.named:
                break
            if effect == chosen.effect or effect in self.freed:
                continue
            shaped = self._shaped(replace(chosen, effect=effect))
            if shaped is not None:
                chosen = replace(shaped, effect=chosen.effect)
        return chosen

    def _first_exchanged(self, chosen: FittedCandidate) -> FittedCandidate:
        """The model with a rival of its first effect in the place of that, each with its own course, if it leaves less.

        The first was found while the others were missing, and what they explain may have been why it led: a weight for
        a buffer that is met on the way, beside contacts that age. A gap holds a spring, and leaves no more than it.
        """
        policy, first = self.problem.policy, chosen.model_fit.effects[0]
        gains = {item.effect: item.gain for item in self.tried}
        for item in self.tried:
            led = item.gain >= policy.rival_gain * gains.get(first, math.inf) and item.share >= policy.partly
            masses = EFFECTS[item.effect].in_transmission and EFFECTS[first].in_transmission
            if item.effect in chosen.model_fit.effects or masses or not led:
                continue
            self.progress(f"{item.effect} in the place of {first}")
            other = in_place_of(self.problem, self.root, chosen, first, item)
            other = (self._shaped(other) or other) if other is not None else None
            if other is None:
                continue
            left = [error_left(self.problem, one.model_fit) for one in (other, chosen)]
            if left[0] < left[1]:  # the one that it takes the place of stays a rival: a fit of the last round
                chosen = replace(other, effect=chosen.effect)
        return chosen

    def _contends(self, chosen: FittedCandidate, item: FittedCandidate) -> bool:
        """Whether another effect came near the chosen one by its own law.

        Where that can be named so, only one that can be too, and errs no more: an element of memory that hardly slides
        is a spring.
        """
        policy = self.problem.policy
        if item.effect == chosen.effect:
            return False
        if not chosen.named:
            return item.gain >= policy.rival_gain * chosen.gain and item.share >= policy.partly
        return item.named and self.evidence.comes_near(self.problem, self.root, chosen, item)

    def _shaped(self, item: FittedCandidate) -> FittedCandidate | None:
        self.progress(f"another law of {item.effect}")
        shaped = with_free_shape(self.problem, self.root, self.nominal, item)
        if shaped is None:
            return None
        if not EFFECTS[item.effect].approximate:  # elements are its own law, however many
            self.freed[item.effect] = item.named
        return (
            refined(self.problem, self.root, shaped, self.progress)
            if unsettled(self.problem, shaped)
            else shaped
        )

    def _still_freed(self) -> dict[str, bool]:
        return {effect: named for effect, named in self.freed.items() if effect in self._model_fit.effects}

    def _begun_anew(self, chosen: FittedCandidate) -> FittedCandidate:
        """Each effect looked for again beside the others, where together they do not explain what they should.

        The first of them took its shape while the second was missing: a wave over the travel for a tight spot. A
        single one is begun anew where it is a second mass, whose way downhill depends on where it begins; with a
        twin it has begun where that is best.
        """
        policy = self.problem.policy
        alone = len(chosen.model_fit.effects) < 2
        if alone and (self.problem.twin or not has_load(chosen.model_fit.fitted.packed.on)):
            return chosen
        for effect in chosen.model_fit.effects:
            if chosen.share >= REFINED if alone else chosen.named:
                break
            self.progress(f"another beginning for {effect}")
            again = self._from_best_start(chosen, effect, alone)
            left = error_left(self.problem, chosen.model_fit)
            if again is not None and error_left(self.problem, again.model_fit) < policy.clearly_less * left:
                chosen = replace(again, effect=chosen.effect, gain=chosen.gain)
        return chosen

    def _from_best_start(self, chosen: FittedCandidate, effect: str, alone: bool) -> FittedCandidate | None:
        """The chosen model with one effect screened anew beside the others."""
        problem, root, before = self.problem, self.root, self.root
        if not alone:
            rest = without_effect(problem, root, chosen.model_fit, effect)
            if rest is None:
                return None
            before = rest.model_fit
        screened = screen(problem, self.evidence, before, self.nominal, effect)
        if screened is None:
            return None
        return inside_twin(problem, root, before, screened, chosen.model_fit.fitted.cost, best_start=True)

    def _more_to_explain(self, model_fit: ModelFit) -> bool:
        """Whether anything is left beyond doubt: certain to one standard error, or drifting."""
        return more_to_explain(self.problem, self.evidence, model_fit)

    @property
    def _backward(self) -> Backward:
        return Backward(self.problem, self.root, self.evidence, self.progress)

    def _tidy(self) -> None:
        """Drops what is not needed beside the others, and refines what is left."""
        if self.chosen is not None:
            self.chosen = self._backward.tidied(self.chosen, self.seen)
            self.chosen = self._backward.without_stiff_load(self.chosen)

    def _in_place(self) -> list[FittedCandidate]:
        """What may stand for one of several effects."""
        return [] if self.chosen is None else self._backward.exchanged(self.chosen, self.later)
