"""Several recordings, each searched by itself with a base of its own, and what the others say of what one names.

Recordings may be taken under other circumstances: another load, warmer, a neighbour that moves. Fitted together they
bend one base until neither is right: rivals are compared under that distortion, and everything reads "unknown". So
names are chosen on one recording, and carried to the others, where only the base is refitted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import AutotuneError
from autotune.core.time_limit import is_over
from autotune.diagnosis.candidates import Progress
from autotune.diagnosis.confirmation import (
    Elsewhere,
    confirm_by,
    confirm_in_time,
    hold_out,
    in_words,
    told_apart,
    with_chosen,
    without,
)
from autotune.diagnosis.evidence.evidence import MOST_UNEXPLAINED, HoldoutResult
from autotune.diagnosis.refits import with_effects
from autotune.diagnosis.search_state import Found
from autotune.diagnosis.wording import (
    AMBIGUOUS,
    CONFIRMED,
    NAMED,
    NONE,
    SUSPECTED,
    UNKNOWN,
    separating_experiment,
    unexplained,
)
from autotune.estimation.bandwidth import prepared_to_fit
from autotune.estimation.bias_corrected_fit import ModelFit, fit_inside_twin
from autotune.estimation.data import TRAINING, VETO, Prepared
from autotune.estimation.least_squares import covariance, standard_errors
from autotune.estimation.pieces import UNFITTED
from autotune.estimation.problem import Problem
from autotune.models.drive_model import Packed, surface_parameter
from autotune.models.reversal_memory import REVERSAL_MEMORY, contact, contact_remembers
from autotune.models.table import EFFECTS
from autotune.recordings.recording import Recording

if TYPE_CHECKING:
    from autotune.diagnosis.verdict import Diagnosis

ROUNDS = 2
"""Of a fit of the base beside effects that were carried."""
WORTH_SAYING = 0.05
"""Of a parameter: less of a difference is what models of both recordings err by, whatever their standard errors."""
ORDER = (NAMED, AMBIGUOUS, UNKNOWN, NONE)
"""Verdicts on recordings, those that tell most first."""
BASE = {
    "inertia": "inertia",
    "coulomb": "Coulomb friction",
    "viscous": "viscous friction",
    "offset": "offset",
}
"""Parameters of the base that are told where recordings differ by them, in words."""
ELEMENTS_TORQUE = REVERSAL_MEMORY.surface("torque_")
Searched = tuple[Found, Packed, tuple[str, ...]]
"""What a search comes to, with the model and what is to be said of it."""
Judge = Callable[[Found, tuple[str, ...], Sequence[HoldoutResult]], "Diagnosis"]


def own_recordings(recordings: Sequence[Recording], data: Prepared) -> list[tuple[int, list[Recording]]]:
    """Each recording that is searched by itself, by its number, with those that are never fitted; none where fewer than
    two are.

    A veto trajectory that not each of them has decides over all; curves over speed have one point in each recording, or
    some.
    """
    if data.steady:
        return []
    aside = [one for one in recordings if _unfitted(one)]
    own = [(number, [one, *aside]) for number, one in enumerate(recordings, 1) if not _unfitted(one)]
    each_has = all(any(part.experiment == VETO for part in one.segments()) for _, (one, *_) in own)
    if len(own) < 2 or (bool(np.any(data.role(VETO))) and not each_has):
        return []
    return own


def _unfitted(recording: Recording) -> bool:
    return all(part.experiment in UNFITTED for part in recording.segments())


@dataclass(frozen=True, slots=True)
class _Alone:
    """What one recording shows by itself; `number`: from 1; `carried`: what its own veto says, where it has one."""

    number: int
    found: Found
    nominal: Packed
    notes: tuple[str, ...]
    carried: Sequence[HoldoutResult]
    verdict: Diagnosis


def of_each(
    own: Sequence[tuple[int, list[Recording]]],
    searched: Callable[[Prepared], Searched],
    judge: Judge,
    progress: Progress,
    until: float = math.inf,
) -> Diagnosis | None:
    """What recordings show that are searched one by one, each with its own base, and what the others say of it.

    None where they are diagnosed together: one by one they tell nothing, or a veto trajectory tells of all of them.
    After the deadline `until` no further one is begun, nor is one carried to the others.
    """
    alone: list[_Alone] = []
    silent: list[str] = []
    whole = True
    for number, part in own:
        if alone and is_over(until):
            silent.append(f"Recording {number} was not searched: there was no time left.")
            whole = False
            continue
        progress(f"recording {number} by itself")
        try:
            found, nominal, notes = searched(prepared_to_fit(part))
        except AutotuneError as reason:
            silent.append(f"Recording {number} tells too little by itself: {reason}.")
            continue
        found, chosen, carried = confirm_in_time(found, nominal, until)
        verdict = judge(with_chosen(found, chosen), (*notes, *in_words(carried)), carried)
        verdict, found = replace(verdict, recordings=tuple(part)), replace(found, chosen=chosen)
        alone.append(_Alone(number, found, nominal, notes, carried, verdict))
    if not alone:
        return None
    to_ask = not whole or (len(alone) > 1 and any(one.verdict.effects for one in alone))
    if to_ask and is_over(until):
        alone = [_cut_short(one, judge) for one in alone]
    alone.sort(key=lambda one: ORDER.index(one.verdict.verdict))
    best: Diagnosis | None = None
    for one in alone:
        if best is not None and not one.verdict.effects:
            break
        if best is not None and is_over(until):
            whole = False
            break
        told = _told(one, [other for other in alone if other is not one], judge, progress)
        if best is None or (told.effects and not best.effects) or told.confidence == CONFIRMED:
            best = told
        if best.confidence == CONFIRMED:
            break
    if best is None:
        return None
    best = replace(best, notes=(*silent, *best.notes), complete=best.complete and whole)
    return _unless_contradicted(best, [one.verdict for one in alone])


def _cut_short(one: _Alone, judge: Judge) -> _Alone:
    """What a recording shows by itself, where there is no time to ask what the others do."""
    if not one.verdict.complete:
        return one
    found = replace(one.found, cut_short=True)
    verdict = judge(found, (*one.notes, *in_words(one.carried)), one.carried)
    return replace(one, found=found, verdict=replace(verdict, recordings=one.verdict.recordings))


def _unless_contradicted(best: Diagnosis, alone: Sequence[Diagnosis]) -> Diagnosis:
    """The verdict; ambiguous where no recording confirms it, and one by itself names something else altogether.

    It is one of the two or neither; which of them was asked first says nothing.
    """
    others = [effects for effects in map(_shown, alone) if effects and not set(effects) & set(best.effects)]
    if best.verdict != NAMED or best.confidence == CONFIRMED or not others:
        return best
    rivals = tuple(dict.fromkeys((*best.effects, *(effect for effects in others for effect in effects))))
    own_axis = best.problem is not None and bool(best.problem.data.metadata.fingerprint)
    ask = separating_experiment(rivals, own_axis)
    return replace(best, verdict=AMBIGUOUS, confusable=(rivals,), next_experiment=ask)


def _shown(alone: Diagnosis) -> tuple[str, ...]:
    """Effects of which a recording by itself shows one or all: what it names, or cannot tell apart."""
    rivals = alone.confusable if alone.verdict == AMBIGUOUS else ()
    named = alone.effects if alone.verdict in (NAMED, AMBIGUOUS) else ()
    return tuple(dict.fromkeys((*named, *(effect for effects in rivals for effect in effects))))


def _told(one: _Alone, others: Sequence[_Alone], judge: Judge, progress: Progress) -> Diagnosis:
    """The verdict on one recording after what it names was carried to the others, where only their base is refitted."""
    searched = f"Each recording was searched by itself, with a base of its own: {_each([one, *others])}."
    bases = [OwnBase(other.number, other.found) for other in others]
    if not others or not one.verdict.effects or one.found.cut_short:
        bases = [] if one.found.cut_short else bases
        return _with_bases(replace(one.verdict, notes=(searched, *one.verdict.notes)), one, bases)
    progress("do the other recordings confirm it")
    carriers, found = [base.elsewhere() for base in bases], one.found
    if one.verdict.verdict == AMBIGUOUS:
        found = told_apart(found, one.verdict.confusable[0], carriers)
    shown = {effect for other in others for effect in other.verdict.effects}
    by_itself, chosen = one.verdict.confidence == CONFIRMED, found.chosen
    if by_itself and chosen is not None:  # by its own veto: not undone, but doubted
        carried = hold_out(found.problem, found.root, chosen, carriers, shown)
    else:
        chosen, carried = confirm_by(found, one.nominal, carriers, shown)
    refuted = [item.effect for item in carried if item.refuted]
    carried = [*one.carried, *carried]
    said = (searched, *one.notes, *in_words(carried))
    verdict = judge(with_chosen(found, chosen), said, carried)
    held = {item.effect for item in carried if item.lowers} | shown
    if chosen is not None and not by_itself and verdict.verdict == NAMED and held & set(verdict.effects):
        verdict = _without_unheld(one, replace(found, chosen=chosen), said, carried, held, judge) or verdict
    if verdict.confidence == CONFIRMED and verdict.model_fit is not None:
        doubt = "" if by_itself else _doubt(one, others, bases, verdict.model_fit)
        if by_itself and refuted:
            doubt = f"another recording refutes {' and '.join(refuted).replace('_', ' ')}"
        if doubt:
            notes = (f"Suspected only: {doubt}.", *verdict.notes)
            verdict = replace(verdict, confidence=SUSPECTED, notes=notes)
    return replace(_with_bases(verdict, one, bases), recordings=one.verdict.recordings)


def _without_unheld(
    one: _Alone,
    found: Found,
    said: tuple[str, ...],
    carried: Sequence[HoldoutResult],
    held: Collection[str],
    judge: Judge,
) -> Diagnosis | None:
    """The verdict without names that no other recording shows, beside one that they do; None where it is none."""
    chosen = found.chosen
    unheld = [] if chosen is None else [one for one in chosen.model_fit.effects if one not in held]
    less = without(found.problem, found.root, chosen, unheld) if chosen is not None and unheld else None
    if less is None:
        return None
    names = " and ".join(unheld).replace("_", " ")
    said = (f"Recording {one.number} alone shows {names}, which is not named.", *said)
    verdict = judge(with_chosen(found, less), said, carried)
    return verdict if verdict.verdict == NAMED else None


def _doubt(one: _Alone, others: Sequence[_Alone], bases: Sequence[OwnBase], model_fit: ModelFit) -> str:
    """What speaks against calling effects confirmed that were found in one recording; empty where nothing does."""
    shown = {effect for each in (one, *others) for effect in each.verdict.effects}
    if not shown & set(model_fit.effects):
        return f"no recording by itself shows {' and '.join(model_fit.effects).replace('_', ' ')} first"
    for other in others:
        names = _shown(other.verdict)
        if names and not set(names) & set(model_fit.effects):
            between = " or " if other.verdict.verdict == AMBIGUOUS else " and "
            return f"recording {other.number} by itself shows {between.join(sorted(names)).replace('_', ' ')}"
    doubts = [much_unexplained(one.found.problem, model_fit, one.number)]
    doubts += [base.doubt(model_fit) for base in bases]
    return next(filter(None, doubts), "")


def _each(alone: Sequence[_Alone]) -> str:
    """What each recording says by itself, in the order of their numbers."""
    said = []
    for one in sorted(alone, key=lambda one: one.number):
        names = " and ".join(one.verdict.effects).replace("_", " ")
        said.append(
            f"recording {one.number} {f'shows {names}' if names else f'alone says {one.verdict.verdict!r}'}"
        )
    return ", ".join(said)


def _with_bases(verdict: Diagnosis, one: _Alone, bases: Sequence[OwnBase]) -> Diagnosis:
    """The verdict with a sentence on each recording whose base is another one."""
    if verdict.model_fit is None:
        return verdict
    own, said = (one.number, one.found.problem, verdict.model_fit), []
    for base in bases:
        settled = base.fit_of(verdict.model_fit)
        if settled is not None:
            pair = sorted([own, (base.number, base.problem, settled)], key=lambda fitted: fitted[0])
            said.append(base_in_words(*pair))
    return replace(verdict, notes=(*filter(None, said), *verdict.notes))


class OwnBase:
    """Another recording by its own base: what was found elsewhere is carried to it, and only the base is refitted."""

    def __init__(self, number: int, found: Found) -> None:
        self.number, self.problem, self.root = number, found.problem, found.root
        self._known: list[tuple[ModelFit, ModelFit | None]] = []

    def elsewhere(self) -> Elsewhere:
        return Elsewhere(self._error_of, own_base=True, beside=self._error_beside)

    def fit_of(self, model_fit: ModelFit) -> ModelFit | None:
        """The base beside a model's effects; None where the twin is unstable with them."""
        for known, found in self._known:
            if known is model_fit:
                return found
        settled: ModelFit | None = self.root
        if model_fit.effects:
            settled = self._fitted(self.root.fitted.packed, model_fit)
            if settled is not None and levels_above(model_fit.effects):
                settled = self._fitted(settled.fitted.packed, model_fit)
        self._known.append((model_fit, settled))
        return settled

    def _fitted(self, start: Packed, model_fit: ModelFit, anew: Collection[str] = ()) -> ModelFit | None:
        """The base from a start, beside a model's effects; levels of friction in proportion to the friction there.

        Effects that are found `anew` begin so, and have values of their own there.
        """
        own, effects = model_fit.fitted.packed, model_fit.effects
        packed = with_effects(start, own, effects)
        here, there = (contact(one.p, one.on)[0] for one in (start, own))
        for level, base in levels_above(effects):
            if there > 0.0:
                packed.p[level] = start.p[base] + (own.p[level] - own.p[base]) * here / there
        free = list(self.root.free)
        if anew:
            slots = {parameter.slot for name in anew for parameter in EFFECTS[name].parameters}
            slots -= {one.slot for one in free}
            free += [one for one in model_fit.free if one.slot in slots]
        return fit_inside_twin(self.problem, packed, free, ROUNDS, effects)

    def _error_of(self, model_fit: ModelFit) -> Floats | None:
        return self._weighted(self.fit_of(model_fit))

    def _error_beside(self, model_fit: ModelFit, anew: Collection[str]) -> Floats | None:
        settled = self.fit_of(model_fit)
        if settled is None:
            return None
        return self._weighted(self._fitted(settled.fitted.packed, model_fit, anew))

    def _weighted(self, settled: ModelFit | None) -> Floats | None:
        weight = self.problem.training
        return None if settled is None else (settled.fitted.error * np.sqrt(weight))[weight > 0]

    def doubt(self, model_fit: ModelFit) -> str:
        """What this recording says against the effects of a model that was found elsewhere; empty if nothing."""
        settled = self.fit_of(model_fit)
        if settled is None:
            return f"with these effects recording {self.number} cannot be simulated"
        least = self.problem.policy.least_gain
        before, after = (self.problem.mean_square(one.fitted.error, TRAINING) for one in (self.root, settled))
        if after >= (1.0 - least) * before:
            return (
                f"recording {self.number}, with only the base refitted, errs no less with them than without"
            )
        return much_unexplained(self.problem, settled, self.number)


def levels_above(effects: Sequence[str]) -> list[tuple[int, int]]:
    """Slots of parameters that are levels on top of one of the base, each with that one's.

    Under another load or warmer the break-away torque is another one, as Coulomb friction is; their ratio stays. It is
    that of the whole contact, of which the bristle may carry next to nothing beside its elements.
    """
    parameters = [parameter for name in effects for parameter in EFFECTS[name].parameters]
    return [(one.slot, one.above) for one in parameters if one.above >= 0]


def much_unexplained(problem: Problem, model_fit: ModelFit, number: int) -> str:
    """Says so where a recording keeps too much of its torque to confirm anything; empty else."""
    share = unexplained(problem, model_fit)
    if share <= MOST_UNEXPLAINED:
        return ""
    return f"recording {number} keeps {100 * share:.0f} % of the torque's variance unexplained"


def base_in_words(first: tuple[int, Problem, ModelFit], other: tuple[int, Problem, ModelFit]) -> str:
    """By which parameters two recordings come to a different base, beyond their standard errors and what models err by;
    empty where by none.

    Each by its number, with its problem and the fit to it.
    """
    number, problem, model_fit = first
    metadata, apart = problem.data.metadata, problem.policy.apart_z
    bases = _base(problem, model_fit), _base(*other[1:])
    told = []
    for name, words in BASE.items():
        if any(name not in base for base in bases):
            continue
        (one, error), (two, its_error) = (base[name] for base in bases)
        least = max(apart * math.hypot(error, its_error), WORTH_SAYING * max(abs(one), abs(two)))
        if abs(one - two) > least:
            unit = surface_parameter(name).unit_for(metadata.motion_unit, metadata.torque_unit)
            told.append(f"{words} {_with_error(one, error)} and {_with_error(two, its_error)} {unit}")
    if not told:
        return ""
    return f"Recordings {number} and {other[0]} come to a different base: {', '.join(told)}."


def _with_error(value: float, error: float) -> str:
    return f"{value:.3g} ± {error:.1g}"


def _base(problem: Problem, model_fit: ModelFit) -> dict[str, tuple[float, float]]:
    """Parameters of the base and their standard errors, by name; Coulomb friction with the contact's own elements.

    One recording's contact may be a bristle, and another one's many of which the bristle is a small part.
    """
    packed, free = model_fit.fitted.packed, model_fit.free
    errors = standard_errors(model_fit.fitted, problem.training)
    base = {
        one.name: (float(packed.p[one.slot]), float(error))
        for one, error in zip(free, errors, strict=True)
        if one.name in BASE
    }
    if "coulomb" in base and contact_remembers(packed.p, packed.on):
        of_contact = [one.name == "coulomb" or one.name.startswith(ELEMENTS_TORQUE) for one in free]
        level, spread = np.array(of_contact, dtype=np.float64), covariance(model_fit.fitted, problem.training)
        error = math.sqrt(max(float(level @ spread @ level), 0.0))
        base["coulomb"] = contact(packed.p, packed.on)[0], error
    return base
