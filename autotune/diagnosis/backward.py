"""Of the effects that were found, backward: which of them are needed, and which may stand for another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from autotune.diagnosis.candidates import (
    FittedCandidate,
    Progress,
    ScreenedCandidate,
    error_left,
    explained_beside,
    explains_rest,
    falls_on_veto,
    gain_on_veto,
    least_fall,
)
from autotune.diagnosis.evidence.evidence import Evidence
from autotune.diagnosis.free_shape import like_a_motor
from autotune.diagnosis.refits import (
    RIVAL_COST,
    differ_by_chance,
    in_place_of,
    inside_twin,
    judged_again,
    negligible,
    refined,
    unsettled,
    with_contact,
    without_effect,
    without_insignificant_terms,
)
from autotune.diagnosis.ripple_orders import with_whole_orders
from autotune.diagnosis.screening import (
    at_its_best,
)
from autotune.diagnosis.search_state import SearchState
from autotune.diagnosis.transmission import (
    pressed_transmission,
    stiff_as_well,
)
from autotune.estimation.bias_corrected_fit import ModelFit, fit_inside_twin
from autotune.estimation.data import TRAINING, VETO
from autotune.estimation.problem import Problem
from autotune.models.table import EFFECTS, usual_rivals
from autotune.models.torque_saturation import TORQUE_SATURATION

MOTOR = TORQUE_SATURATION.name

SAME_DATA = 1e-6
"""Of the mean square of an error: by how much it may differ from what it was, by the order of sums."""
PLAINLY_NEEDED = 20.0
"""Times what is negligible: so much needs no fit without the effect to be seen."""
NO_CRUMB = 0.25
"""Of what all explain of the training: what one effect makes up at least where half of the veto's rest bears it out."""
AS_ANOTHER_LAW = 0.8
"""Of the veto's rest, with nothing excused: what bears out an effect that all have their name by. A viscosity of films
that was none explained 53 % of what a load dependence left, a true drop of friction 84 % beside a weight."""


@dataclass(frozen=True, slots=True)
class Backward:
    """A search's steps back, by its problem, the root without effects and the evidence that the data allow."""

    problem: Problem
    root: ModelFit
    evidence: Evidence
    progress: Progress

    def tidied(self, chosen: FittedCandidate, seen: Sequence[ModelFit]) -> FittedCandidate:
        """The chosen model without what is not needed, what is left refined; `seen` as in `pruned`."""
        problem, root = self.problem, self.root
        chosen = self.pruned(chosen, seen)
        if unsettled(problem, chosen):
            chosen = refined(problem, root, chosen, self.progress)
        model_fit = without_insignificant_terms(problem, chosen.model_fit)
        if not negligible(problem, chosen, model_fit, PLAINLY_NEEDED):  # fitted again it went astray
            model_fit = chosen.model_fit
        model_fit = with_whole_orders(problem, model_fit)
        return chosen if model_fit is chosen.model_fit else judged_again(problem, root, chosen, model_fit)

    def pruned(self, chosen: FittedCandidate, seen: Sequence[ModelFit]) -> FittedCandidate:
        """Drops every effect without which training and veto are hardly worse, or without which the rest has a name.

        Where a model without it was `seen` to be far worse, with courses of the others as free as they are now, it is
        needed; unless nothing has a name with it: beside the second effect the first may have come into its own. And
        what was found before the others must be worth having beside them, as they were beside it: it may have stood for
        one of them, and now takes its crumbs. What the veto trajectory does not bear out goes, whatever has a name.
        """
        problem, current = self.problem, chosen
        for effect in chosen.model_fit.effects:
            if len(current.model_fit.effects) < 2:
                break
            rest = set(current.model_fit.effects) - {effect}
            known = [one for one in seen if set(one.effects) == rest and as_free(one, current.model_fit)]
            known = [one for one in known if self._of_these_data(one)]
            far = not any(negligible(problem, current, model_fit, PLAINLY_NEEDED) for model_fit in known)
            told = all(self.borne_out(one, current.model_fit) for one in known)
            if known and far and told and current.named:
                continue
            less = self._without(current, effect)
            if less is not None and (
                (less.named and not current.named)
                or negligible(problem, current, less.model_fit)
                or (less.named and not self.enters_beside(less, current))
                or differ_by_chance(problem, current.model_fit, less.model_fit)
                or not self.borne_out(less.model_fit, current.model_fit, current.named and not less.named)
            ):
                current = less
        return current

    def _of_these_data(self, model_fit: ModelFit) -> bool:
        """Whether a model was fitted to the torque as it is compared now, and not before that was moved."""
        error = self.problem.raw(model_fit.fitted.packed) - model_fit.correction.bias
        if error.shape != model_fit.fitted.error.shape:
            return False
        off = float(np.mean((error - model_fit.fitted.error) ** 2))
        return off < SAME_DATA * float(np.mean(error**2))

    def _without(self, chosen: FittedCandidate, effect: str) -> FittedCandidate | None:
        self.progress(f"is {effect} needed")
        less = without_effect(self.problem, self.root, chosen.model_fit, effect)
        return less.with_courses_of(chosen) if less is not None else None

    def enters_beside(self, less: FittedCandidate, current: FittedCandidate) -> bool:
        """Whether what the current model has more than `less` explains what is asked of a further effect."""
        beside = explained_beside(self.problem, less.model_fit, current.model_fit, TRAINING)
        if beside.fall < least_fall(self.problem, less):
            return False
        return not self.evidence.repeats or explains_rest(self.problem, less, current)

    def borne_out(self, less: ModelFit, model_fit: ModelFit, names: bool = False) -> bool:
        """Whether the veto trajectory, which was never fitted, bears out what a model has beyond `less`.

        Its error falls beyond chance, second by second; or, where a few seconds hold it all, what is explained there of
        the rest is enough for a name with nothing excused. Beside effects that leave a part, a free course takes up
        what is the twin's own wherever it was fitted; elsewhere that is put down to the measurement chain, and of next
        to nothing all is explained. What makes up a quarter of what all explain is no crumb: half of the rest is enough
        (a slip that comes a second sooner in two places hid 84 % of it from a comparison second by second). Where
        all have a name by it that the others have not (it `names`), it is borne out by what names an effect by another
        law: a drop of friction at low speed is a fourteenth of what it and a weight explain.
        """
        problem, policy = self.problem, self.problem.policy
        if not (self.evidence.repeats and problem.has_veto):
            return True
        beside = explained_beside(problem, less, model_fit, VETO)
        lost, all_lost = (one.fitted.cost - model_fit.fitted.cost for one in (less, self.root))
        enough = AS_ANOTHER_LAW if names else policy.named
        if lost > NO_CRUMB * all_lost:
            enough = policy.partly
        return beside.plain_share >= enough or falls_on_veto(problem, less, model_fit)

    def without_stiff_load(self, chosen: FittedCandidate) -> FittedCandidate:
        """The chosen model without its transmission where that tells only on which side torques press a contact."""
        between = pressed_transmission(chosen.model_fit)
        if not self.evidence.repeats or not between:
            return chosen
        less = self._without(chosen, between)
        if less is None or not stiff_as_well(self.problem, less.model_fit, chosen.model_fit):
            return chosen
        return less

    def without_doubtful_load(
        self, chosen: FittedCandidate, first: Sequence[ScreenedCandidate]
    ) -> tuple[FittedCandidate, ModelFit | None]:
        """What was found beside a second mass keeps its own standing where that mass is in doubt.

        Beside a true effect a second mass takes up what the twin's loop is not; together they would be nameless. Where
        the others have no name by themselves, or leave twice as much of the veto trajectory's error, what it explains
        beside them tells of it, and that model is given too: before they were found its gain was measured in what they
        explain, and no loop's rest is half of all that is left.
        """
        if len(chosen.model_fit.effects) < 2 or not _loads(chosen) or not self.evidence.repeats:
            return chosen, None
        less, unloaded = self._unloaded(chosen)
        if self.evidence.doubted(self.problem, self.root, chosen.model_fit, first, unloaded):
            return less or chosen, None
        return chosen, unloaded

    def unloaded(self, chosen: FittedCandidate) -> ModelFit | None:
        """What tells of a second mass among several effects, as in `without_doubtful_load`; None where nothing does."""
        return self._unloaded(chosen)[1] if len(chosen.model_fit.effects) > 1 and _loads(chosen) else None

    def _unloaded(self, chosen: FittedCandidate) -> tuple[FittedCandidate | None, ModelFit | None]:
        less = self._without(chosen, _loads(chosen)[0])
        return less, less.model_fit if less is not None and self._tells_of_load(chosen, less) else None

    def _tells_of_load(self, chosen: FittedCandidate, less: FittedCandidate) -> bool:
        """Whether a model without a second mass tells whether there is one: see `without_doubtful_load`."""
        if not less.named or not self.problem.has_veto:
            return not less.named
        return gain_on_veto(self.problem, less.model_fit, chosen.model_fit) >= self.problem.policy.partly

    def exchanged(
        self,
        chosen: FittedCandidate,
        later: Sequence[FittedCandidate],
        first: Sequence[FittedCandidate],
    ) -> list[FittedCandidate]:
        """Of several effects, what may stand for one of them beside the others: fitted to what is compared now.

        `later`: fits of the rounds in which the others were chosen. What has no name stands for none that has one; but
        for those of the `first` round, in which the others were missing.
        """
        again = []
        for item in (*(one for one in later if one.named or not chosen.named), *first):
            other = self.in_place(chosen, item)
            if other is not None and other.model_fit.fitted.cost <= RIVAL_COST * chosen.model_fit.fitted.cost:
                again.append(refined(self.problem, self.root, other, self.progress))
        return again

    def in_place(self, chosen: FittedCandidate, item: FittedCandidate) -> FittedCandidate | None:
        """A model with what was fitted in a round for one of several effects, beside all that were found since.

        None where it stands for none of them, errs far more, or the twin is unstable.
        """
        own, effects = chosen.model_fit.effects, item.model_fit.effects
        new = set(effects) - set(own)
        if len(own) < max(len(effects), 2) or len(new) != 1:
            return None
        item = replace(item, effect=new.pop())
        if len(effects) < len(own):
            replaced = next(effect for effect in own if effect not in effects)
            self.progress(f"{item.effect} in the place of {replaced}")
            return in_place_of(self.problem, self.root, chosen, replaced, item)
        far = item.model_fit.fitted.cost > RIVAL_COST * chosen.model_fit.fitted.cost
        if far and self._of_these_data(item.model_fit):
            return None
        self.progress(f"{item.effect} in the place of another")
        packed, free = item.model_fit.fitted.packed, list(item.model_fit.free)
        settled = fit_inside_twin(self.problem, packed, free, 2, effects)
        return None if settled is None else judged_again(self.problem, self.root, item, settled)


def _loads(chosen: FittedCandidate) -> list[str]:
    return [effect for effect in chosen.model_fit.effects if EFFECTS[effect].in_transmission]


def as_free(less: ModelFit, model_fit: ModelFit) -> bool:
    """Whether all is free in a model with fewer effects that is free of these effects in another.

    An effect by its own law may explain far less than with a free course: the second is not told by the first.
    """
    slots = {parameter.slot for name in less.effects for parameter in EFFECTS[name].parameters}
    known = {one.slot for one in less.free}
    return all(one.slot in known for one in model_fit.free if one.slot in slots)


def try_look_alikes(state: SearchState) -> None:
    """Effects that may do as well as a single one that was found are fitted to their end, too.

    Where one trajectory is all there is, a candidate may have been passed over that explains it as well.
    """
    chosen = state.chosen
    if chosen is None or len(chosen.model_fit.effects) != 1:
        return
    for effect in state.evidence.look_alikes(state.problem, chosen.effect):
        state.progress(f"does {effect} do as well")
        item = at_its_best(state.problem, state.evidence, state.root, state.nominal, effect)
        fitted = inside_twin(state.problem, state.root, state.root, item) if item is not None else None
        if fitted is not None:
            fitted = with_contact(state.problem, state.root, fitted)
            better = [one for one in state.tried if one.effect == effect and one.gain > fitted.gain]
            if not better:
                state.tried = [*(one for one in state.tried if one.effect != effect), fitted]


def try_motor(state: SearchState) -> None:
    """A motor that falls short in the place of friction that a load presses, if it leaves less; else a rival of it.

    It is followed to its end, its course as free, where a free course over the motor's torque does as well along the
    recorded motion. What the fastest experiment shows alone gains nothing while that is held out, so that nothing else
    may have followed it.
    """
    problem, chosen = state.problem, state.chosen
    sought = any(kind.name == MOTOR for kind in problem.candidates)
    if chosen is None or not sought or not state.evidence.repeats or MOTOR in chosen.model_fit.effects:
        return
    alike = state.evidence.alike(problem)
    pressed = [
        one
        for one in chosen.model_fit.effects
        if like_a_motor(problem, state.root, chosen.model_fit, alike, one)
    ]
    other = _motor_in_place(state, chosen, pressed[0]) if pressed else None
    if other is None:
        return
    better = other.named and error_left(problem, other.model_fit) < error_left(problem, chosen.model_fit)
    state.chosen = other if better else chosen
    if len(chosen.model_fit.effects) > 1:
        state.later.append(replace(chosen, effect=pressed[0]) if better else other)
    else:
        own = [one for one in state.tried if one.effect not in (chosen.effect, MOTOR)]
        state.tried = [*own, chosen, other]


def _motor_in_place(state: SearchState, chosen: FittedCandidate, effect: str) -> FittedCandidate | None:
    """A motor that falls short beside all effects but one, by its own law or a course; None where it does not fit."""
    state.progress(f"a motor that saturates in the place of {effect}")
    problem, root, before = state.problem, state.root, state.root
    if len(chosen.model_fit.effects) > 1:
        rest = without_effect(problem, root, chosen.model_fit, effect)
        if rest is None:
            return None
        before = rest.model_fit
    item = at_its_best(problem, state.evidence, before, state.nominal, MOTOR)
    other = inside_twin(problem, root, before, item) if item is not None else None
    if other is None:
        return None
    other = other.with_courses_of(chosen)
    other = state.shaped(other) or (
        refined(problem, root, other, state.progress) if unsettled(problem, other) else other
    )
    if problem.has_veto and other.gain < problem.policy.least_gain:
        other = replace(other, gain=gain_on_veto(problem, before, other.model_fit))
    return other


def backward_of(state: SearchState) -> Backward:
    return Backward(state.problem, state.root, state.evidence, state.progress)


def tidy(state: SearchState) -> None:
    """Drops what is not needed beside the others, and refines what is left."""
    if state.chosen is not None:
        state.chosen = backward_of(state).tidied(state.chosen, state.seen)
        state.chosen = backward_of(state).without_stiff_load(state.chosen)


def in_place(state: SearchState) -> list[FittedCandidate]:
    """What may stand for one of several effects, each at its best.

    What the chosen ones explain of the error of another may be no more than its course: beside others it was judged by
    its own law, while theirs are free. With a free course it is chosen where it leaves less, and what was chosen may
    stand for it.
    """
    if state.chosen is None:
        return []
    chosen, again = _or_alike_by_its_course(state, state.chosen)
    for item in backward_of(state).exchanged(chosen, state.later, _like_the_first(state, chosen)):
        lost = set(chosen.model_fit.effects) - set(item.model_fit.effects)
        if len(lost) == 1 and state.evidence.explains_rest_of(state.problem, chosen, item):
            shaped = state.shaped(item)
            if shaped is not None and shaped.named and _leaves_less(state, shaped, chosen):
                chosen, item = shaped, replace(chosen, effect=lost.pop())
        again.append(item)
    state.chosen = chosen
    return again


def _or_alike_by_its_course(
    state: SearchState, chosen: FittedCandidate
) -> tuple[FittedCandidate, list[FittedCandidate]]:
    """What looks like the first of several effects in its place, where that has a free course and leaves a part; and
    what was chosen, where it is another one that leaves less, each with its course free.

    By its own law it may err too much to be a rival of a free course. A motor that saturates by a course of its own
    left 1.6 times the noise beside a ripple; in its place friction that the load presses left 1.8 times as much by its
    own law and, by the root of squares that it was, 0.45 times.
    """
    first = chosen.model_fit.effects[0]
    asked = chosen.named and first in chosen.freed and state.evidence.repeats
    if not asked or not state.more_to_explain(chosen.model_fit):
        return chosen, []
    for item in _like_the_first(state, chosen):
        other = backward_of(state).in_place(chosen, item)
        shaped = state.shaped(other) if other is not None else None
        if shaped is not None and shaped.named and _leaves_less(state, shaped, chosen):
            return shaped, [replace(chosen, effect=first)]
    return chosen, []


def _like_the_first(state: SearchState, chosen: FittedCandidate) -> list[FittedCandidate]:
    """What looks like the first of several effects, and came near it while the others were missing.

    A weight over a part of a turn stays the rival of a spring when a drift is found beside it.
    """
    first, policy = chosen.model_fit.effects[0], state.problem.policy
    known = next((one for one in state.tried if one.effect == first), None)
    if known is None or len(chosen.model_fit.effects) < 2:
        return []
    alike = set(usual_rivals(first)) - set(chosen.model_fit.effects)
    least = policy.rival_gain * known.gain
    return [one for one in state.tried if one.effect in alike and one.gain >= least]


def _leaves_less(state: SearchState, one: FittedCandidate, other: FittedCandidate) -> bool:
    return error_left(state.problem, one.model_fit) < error_left(state.problem, other.model_fit)
