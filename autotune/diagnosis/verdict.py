"""From a model and recordings to a verdict: what is missing, how sure, and what to do next.

What was found is gathered in `facts.Facts`; the verdict is the first row of `CASES` whose condition holds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

from autotune.core.time_limit import deadline, is_over, limited, while_time
from autotune.diagnosis.base_laws import told_of_base
from autotune.diagnosis.baseline import begin, notes_after
from autotune.diagnosis.candidates import (
    FittedCandidate,
    Progress,
    ScreenedCandidate,
    error_left,
    model_from,
    no_progress,
)
from autotune.diagnosis.compare import check_same_axis, stated
from autotune.diagnosis.confirmation import confirm_in_time, in_words, with_chosen
from autotune.diagnosis.contact_laws import of_many
from autotune.diagnosis.each_recording import Searched, of_each, own_recordings
from autotune.diagnosis.evidence.evidence import HoldoutResult
from autotune.diagnosis.evidence.time_driven import (
    all_lines,
    comes_and_goes,
)
from autotune.diagnosis.evidence.torque_path import LATE_RECORD, recorded_late
from autotune.diagnosis.facts import Facts, gathered
from autotune.diagnosis.search import LAG, search
from autotune.diagnosis.search_state import Found
from autotune.diagnosis.wording import (
    ALL_CONTACT,
    AMBIGUOUS,
    CONFIRMED,
    CUT_SHORT,
    DELAYED,
    DROWNED,
    HUNTS,
    HUNTS_ALIKE,
    MANY_CONTACTS,
    NAMED,
    NONE,
    OWN_PRESLIDING,
    PLAYED_ONCE,
    PRESLIDING_REST,
    RECORD_AGAIN,
    SUSPECTED,
    TOLD_WITHOUT,
    TORQUE_CONSTANT,
    UNKNOWN,
    Candidate,
    breathing_note,
    candidate_rows,
    left_note,
    line_note,
    missing_codes_note,
    moment_note,
    nearest,
    next_experiment,
    not_looked_for,
    nothing_note,
    offset_note,
    once_more,
    relaxed_note,
    sets_of_rivals,
    stranger_note,
    told_late,
    torque_path_notes,
    unknown_note,
    wander_note,
)
from autotune.estimation.bandwidth import prepared_both
from autotune.estimation.bias_corrected_fit import ModelFit, fit_inside_twin, unseen_error
from autotune.estimation.coordinates import variance_shares
from autotune.estimation.cross_validation import gain_and_z
from autotune.estimation.data import TRAINING, VETO, Prepared
from autotune.estimation.disturbance_estimate import with_counts
from autotune.estimation.model_error import with_misfit
from autotune.estimation.policy import POLICY, Policy
from autotune.estimation.problem import Problem
from autotune.models.drive_model import DriveModel
from autotune.models.effect import Kind
from autotune.models.table import usual_rivals
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
        recordings: those that were diagnosed; where each was by itself, the one that the model is fitted to.
        base: sentences on laws of the base that were found, which the model that was given has not.
        complete: all was asked; else its time was up, nothing is confirmed, and "none" is never said.
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
    problem: Problem | None = field(default=None, repr=False)
    model_fit: ModelFit | None = field(default=None, repr=False)
    root: ModelFit | None = field(default=None, repr=False)
    recordings: tuple[Recording, ...] = field(default=(), repr=False)
    base: tuple[str, ...] = ()
    complete: bool = True


def diagnose(
    recordings: Sequence[Recording],
    model: DriveModel,
    progress: Progress = no_progress,
    *,
    policy: Policy = POLICY,
    candidates: Sequence[Kind] | None = None,
    at_most: float = math.inf,
) -> Diagnosis:
    """What the model lacks, by the evidence of recordings.

    `candidates` are the effects that may be missing; all of the library where none are given. After `at_most` seconds
    of search no more is asked, and the verdict is on what was found until then.

    Raises:
        RecordingError, ConfigurationError: recordings that cannot be used, or of another axis.
        NotEnoughExcitation: nothing to fit, or a model that does not fit the axis at all.
    """
    until = deadline(at_most)
    check_same_axis(model, recordings)
    data, whole = prepared_both(recordings, policy)
    error_rms, relative_error = stated(whole, model, policy)

    def searched(data: Prepared, contrary: bool = False) -> Searched:
        return _searched(data, model, progress, policy, candidates, contrary, until)

    own = own_recordings(recordings, data)
    verdict = of_each(own, searched, judge, progress, until)
    if verdict is None:
        there = searched(data)
        verdict = _together(there, progress, until)
        if verdict.verdict == UNKNOWN and verdict.complete and _may_be_another_row(there):
            verdict = _of_either_row(verdict, there, lambda: searched(data, contrary=True), progress, until)
    if own and not verdict.recordings and verdict.confidence == CONFIRMED:
        notes = ("Suspected only: no recording tells enough by itself.", *verdict.notes)
        verdict = replace(verdict, confidence=SUSPECTED, notes=notes)
    if not verdict.complete:
        verdict = replace(
            verdict,
            notes=(CUT_SHORT.format(seconds=at_most), *verdict.notes),
            next_experiment=once_more(at_most),
        )
    return replace(
        verdict,
        error_rms=error_rms,
        relative_error=relative_error,
        recordings=verdict.recordings or tuple(recordings),
    )


def _together(searched: Searched, progress: Progress, until: float) -> Diagnosis:
    """What all recordings show with one base."""
    found, nominal, notes = searched
    progress("does another trajectory confirm it")
    found, chosen, carried = confirm_in_time(found, nominal, until)
    return judge(with_chosen(found, chosen), (*notes, *in_words(carried)), carried)


def _may_be_another_row(searched: Searched) -> bool:
    """Whether the model as it was told whether the torque was recorded a sample late, and may have told wrongly.

    It lacks what is missing: motor and load on a spring ring in a loop, and one mass in a loop that is a sample
    quicker makes up for a part of that.
    """
    found, _, notes = searched
    return found.problem.data.repeated and (LATE_RECORD in notes or recorded_late(found.problem) is not None)


def _of_either_row(
    verdict: Diagnosis, one: Searched, other: Callable[[], Searched], progress: Progress, until: float
) -> Diagnosis:
    """The verdict on one search or the `other`, by which the torque is of another row; not whole where there is no time
    for that one.
    """
    if is_over(until):
        return replace(verdict, complete=False)
    progress("the torque of another row")
    found = other()
    likelier = _likelier(verdict, one, found, progress, until)
    return replace(likelier, complete=likelier.complete and not found[0].cut_short)


def _likelier(
    verdict: Diagnosis, one: Searched, other: Searched, progress: Progress, until: float
) -> Diagnosis:
    """The verdict on the other search where it names what is missing and leaves clearly less; else as it was.

    Beside a torque that is taken as recorded a sample late, a lag of its loop undoes just that: it says that the row
    was right before.
    """
    told, late = (LATE_RECORD in notes for _, _, notes in (one, other))
    if told == late or (late and LAG in other[0].model_fit.effects):  # no loop runs in the other row
        return verdict
    left = [error_left(found.problem, found.model_fit) for found in (one[0], other[0])]
    if left[1] >= one[0].problem.policy.clearly_less * left[0]:
        return verdict
    again = _together(other, progress, until)
    return again if again.verdict in (NAMED, AMBIGUOUS) else verdict


def _searched(
    data: Prepared,
    model: DriveModel,
    progress: Progress,
    policy: Policy,
    candidates: Sequence[Kind] | None,
    contrary: bool = False,
    until: float = math.inf,
) -> Searched:
    """What a search comes to, begun again where the base turns out to have another law; with the model, and notes.

    `contrary`: see `begin`; `until`: see `search`.
    """
    earlier: Found | None = None
    said: tuple[str, ...] = ()
    base = model
    while True:
        with limited(until):
            problem, root, nominal, notes = begin(data, base, progress, policy=policy, contrary=contrary)
            problem = _told_of_chance(problem, root)
            if candidates is not None:
                problem = replace(problem, candidates=tuple(candidates))
            beside = earlier.beside if earlier is not None else None
            if earlier is not None and beside is not None and _leaves_more(problem, beside.model_fit):
                problem, root, notes = earlier.problem, earlier.root, said
        found = search(problem, root, nominal, progress, earlier is None, beside, until)
        if found.begin_again is None:
            break
        earlier, said = found, notes_after(notes, problem, found.problem)
        base = model_from(model, found.begin_again, found.root.free)
    told = told_of_base(found.root.fitted.packed, model.pack(), model.motion_unit, found.presliding is None)
    return replace(found, base=told), nominal, notes_after(notes, problem, found.problem)


def _told_of_chance(problem: Problem, root: ModelFit) -> Problem:
    """The problem with what counts and a law that is a little off make of a twin, where there is time to ask."""
    return while_time(lambda: with_misfit(with_counts(problem, root.fitted.packed)), problem)


def _leaves_more(problem: Problem, beside: ModelFit) -> bool:
    """Whether a search that begins again leaves more beside what was found than the one before it: as that, it goes on.

    What it begins with is told by a model that lacks what was found, as it was before.
    """
    again = while_time(
        lambda: fit_inside_twin(problem, beside.fitted.packed, list(beside.free), 2, beside.effects), None
    )
    return again is None or beside.fitted.cost < problem.policy.clearly_less * again.fitted.cost


@dataclass(frozen=True, slots=True)
class Case:
    """One row of the verdict: when it holds, what the verdict is then, and what is said."""

    name: str
    holds: Callable[[Facts], bool]
    verdict: str
    sentence: Callable[[Facts], str]


def _nearly_told(facts: Facts) -> ScreenedCandidate | None:
    """What may be what is unknown, and could not be named."""
    return facts.overlooked or facts.by_twin_only


def _said_nearly(facts: Facts, case: Case) -> ScreenedCandidate | None:
    """The same where the verdict's sentence is on it."""
    told = case.sentence is _unknown and not facts.drowned
    return _nearly_told(facts) if told else facts.overlooked


def _unknown(facts: Facts) -> str:
    if facts.drowned:
        return DROWNED
    known = (facts.coordinate, facts.generic, facts.chosen, facts.tried)
    text = unknown_note(facts.problem, facts.evidence, *known, nearly=facts.overlooked is not None)
    told = _nearly_told(facts)
    if told is None or (facts.chosen is not None and not facts.evidence.needs_twin(facts.problem, told)):
        return text
    return f"{text} {nearest(facts.problem, facts.evidence, facts.root, told, facts.tried).capitalize()}"


def _so_far(facts: Facts) -> str:
    """What came nearest until the time was up; nothing where none explains half."""
    asked = [*facts.tried, *filter(None, [facts.chosen])]
    best = max(asked, key=lambda item: item.share, default=None)
    if best is None or best.share < facts.problem.policy.partly:
        return ""
    names = " and ".join(best.model_fit.effects).replace("_", " ")
    return f"{names.capitalize()} came nearest until then: {facts.evidence.explains(best)}."


def _outdone(facts: Facts) -> str:
    chosen = facts.chosen
    names = " and ".join(chosen.model_fit.effects).replace("_", " ") if chosen is not None else ""
    return (
        f"{facts.outdone.replace('_', ' ').capitalize()} explains far more of these data than {names}, "
        "but not beyond doubt; so nothing is named."
    )


def _its_course(facts: Facts) -> str:
    if not facts.freed:
        return ""
    names = " and ".join(sorted(facts.freed)).replace("_", " ")
    return f"Its law differs: the course of {names} was fitted freely, beside the law that the library has for it."


def _another_law(facts: Facts) -> str:
    chosen = facts.chosen
    if chosen is None:
        return ""
    if len(chosen.model_fit.effects) > 1:
        names = " and ".join(chosen.model_fit.effects).replace("_", " ")
        return (
            f"Another law, or something beside them: {names} together explain {100 * chosen.share:.0f} % of it. Each "
            "is needed beside the others, but they are not quite as the model has them: coefficients are approximate."
        )
    return (
        f"Its law differs: {chosen.effect.replace('_', ' ')} {facts.evidence.explains_part(chosen)}; the effect is "
        "there, but not quite as the model has it, so that its coefficients are approximate."
    )


def _presliding_rest(facts: Facts) -> str:
    return PRESLIDING_REST if facts.climbing else ""


def _once(facts: Facts) -> str:
    return moment_note(facts.problem.data, facts.once) if facts.once is not None else ""


def _breathing(facts: Facts) -> str:
    return breathing_note(facts.breathing) if facts.breathing is not None else ""


def _nothing(facts: Facts) -> str:
    return nothing_note(facts.problem, facts.evidence, facts.root, facts.first, facts.tried)


def _contrary(facts: Facts) -> str:
    chosen = facts.chosen
    name = chosen.effect.replace("_", " ") if chosen is not None else ""
    return (
        f"{name.capitalize()} explains most, but it would go on beyond the bounds of its law, and of "
        f"'{facts.unlike}' it leaves more than a tenth of what comes again: it has another law, or stands for "
        f"something else, and nothing is named. Look for {name} at the machine first."
    )


def _stranger(facts: Facts) -> str:
    found = facts.proportion
    return stranger_note(found.effect, found.times, found.error) if found is not None else ""


def _relaxes(facts: Facts) -> str:
    found, chosen = facts.relaxed, facts.chosen
    if found is None or chosen is None:
        return ""
    others = [one for one in chosen.model_fit.effects if one != found.effect]
    return relaxed_note(found.effect, others, found.held, found.seconds)


def _unlike(facts: Facts) -> str:
    if not facts.unlike:
        return ""
    return (
        f"Of '{facts.unlike}' more than a tenth of what comes again is left, beyond doubt: the effect has another law, "
        "or it is another one that it resembles, or there is another effect beside it."
    )


def _hunts(facts: Facts) -> str:
    return HUNTS.format(hertz=facts.hunts)


def _noise_or_not(facts: Facts) -> str:
    return (
        f"{_nothing(facts)} Nothing in these data tells whether that is noise: record the same motion twice."
    )


def _as_well(facts: Facts) -> str:
    """Of rivals that by their own law leave clearly more: how many times as much; that alone speaks against none."""
    problem, chosen = facts.problem, facts.chosen
    if chosen is None:
        return ""
    left, said = error_left(problem, chosen.model_fit), []
    for one in facts.tried:
        times = math.sqrt(error_left(problem, one.model_fit) / max(left, 1e-300))
        if one.effect in facts.rivals and times**2 * problem.policy.clearly_less > 1.0:
            name = one.effect.replace("_", " ").capitalize()
            said.append(
                f"{name} leaves {times:.1f} times as much by its own law, and may do as well by another."
            )
    return " ".join(said)


def _alike(facts: Facts) -> bool:
    return bool(facts.rivals) and (facts.accepted or facts.law_differs)


CASES: tuple[Case, ...] = (
    Case("a limit cycle smooths its friction away", lambda f: f.hunts > 0.0 and not f.alike, UNKNOWN, _hunts),
    Case("a disturbance in time hides it", lambda f: f.drowned, UNKNOWN, _unknown),
    Case("a free function explains more than any physics", lambda f: f.structured, UNKNOWN, _unknown),
    Case("what is not named explains far more", lambda f: bool(f.outdone), UNKNOWN, _outdone),
    Case("it stands for something else", lambda f: bool(f.unlike) and f.edge, UNKNOWN, _contrary),
    Case("its parts are not in its law's proportion", lambda f: f.proportion is not None, UNKNOWN, _stranger),
    Case("its torque does not hold at rest", lambda f: f.relaxed is not None, UNKNOWN, _relaxes),
    Case("other effects do as well", _alike, AMBIGUOUS, _as_well),
    Case("an effect explains it", lambda f: f.accepted, NAMED, _its_course),
    Case("an effect explains most, by another law", lambda f: f.law_differs, NAMED, _another_law),
    Case(
        "several effects explain it, each by a course of its own",
        lambda f: bool(f.contested),
        AMBIGUOUS,
        _its_course,
    ),
    Case("its time was up", lambda f: f.cut_short, UNKNOWN, _so_far),
    Case("friction rises and falls with the clock", lambda f: f.breathing is not None, UNKNOWN, _breathing),
    Case("a force was there once", lambda f: f.once is not None, UNKNOWN, _once),
    Case(
        "a force in step with the clock comes and goes",
        lambda f: comes_and_goes(f.line),
        UNKNOWN,
        lambda f: "",
    ),
    Case("the encoder leaves codes out", lambda f: bool(f.gaps), UNKNOWN, lambda f: ""),
    Case("only the law of presliding differs", lambda f: f.own_law, NONE, _presliding_rest),
    Case("an effect explains too little", lambda f: f.chosen is not None and f.left, UNKNOWN, _unknown),
    Case("another trajectory refutes it", lambda f: bool(f.carried), UNKNOWN, _unknown),
    Case("what is left is no noise", lambda f: f.left or f.climbing, UNKNOWN, _unknown),
    Case("too much is unexplained to say that nothing is missing", lambda f: f.loud, UNKNOWN, _noise_or_not),
    Case("nothing is missing", lambda f: True, NONE, _nothing),
)


def judge(found: Found, notes: tuple[str, ...], carried: Sequence[HoldoutResult]) -> Diagnosis:
    """The verdict on what a search has found; `notes` are what was to be said before."""
    facts = gathered(found, carried)
    case = next(case for case in CASES if case.holds(facts))
    effects: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()
    confidence = None
    if facts.chosen is not None and case.verdict in (NAMED, AMBIGUOUS):
        effects = facts.chosen.model_fit.effects
        doubts = _doubts(facts, effects) if case.verdict == NAMED else ()
        sure = case.verdict == NAMED and not doubts
        sure = sure and not (facts.all_contact or facts.delayed or facts.cut_short)  # said by themselves
        confidence = CONFIRMED if sure else SUSPECTED
    confusable = _confusable(facts, case.verdict, effects, confidence, found)
    lines = [line_note(one) for one in all_lines(facts.problem.data, facts.line)]
    lines.append(wander_note(facts.problem.data))
    path = torque_path_notes(facts.problem.data, facts.problem.controller)
    codes = missing_codes_note(facts.problem.data)
    bent = [TOLD_WITHOUT] * (case.verdict == UNKNOWN and told_late(facts.problem.data))
    said = [*path, *bent, *lines, codes, case.sentence(facts)]
    said += [f"Suspected only: {', and '.join(doubts)}."] * bool(doubts)
    said += (
        [_unlike(facts)] * bool(effects)
        + [ALL_CONTACT] * (bool(effects) and facts.all_contact)
        + [DELAYED] * (bool(effects) and facts.delayed)
        + [HUNTS_ALIKE.format(hertz=facts.hunts)] * (bool(effects) and facts.alike)
        + [MANY_CONTACTS if of_many(found.root.fitted.packed) else OWN_PRESLIDING]
        * (found.presliding is not None)
        + list(facts.base)
        + [offset_note(facts.root.fitted.packed, facts.problem.data.metadata)]
        * (case.verdict in (NONE, UNKNOWN))
        + list(not_looked_for(facts.problem, facts.evidence, _said_nearly(facts, case)))
    )
    chosen = None if facts.drowned else facts.chosen
    final = chosen.model_fit if chosen is not None and effects else facts.root
    problem, root = facts.problem, facts.root
    if case.verdict == NAMED and facts.evidence.repeats:
        said.append(left_note(problem, final, found.further))
    return Diagnosis(
        case.verdict,
        effects,
        confidence,
        candidate_rows(problem, facts.evidence, root, found.first, _as_chosen(found), effects),
        confusable,
        variance_shares(problem.data, root.fitted.error, problem.training > 0),
        facts.evidence.noise_rms(problem, final),
        _asked(facts, case, effects, confusable, confidence, chosen),
        problem.twin,
        unseen_error(problem, final, sharp=not facts.cut_short),
        notes=(*notes, *filter(None, said), TORQUE_CONSTANT),
        problem=problem,
        model_fit=final,
        root=root,
        base=facts.base,
        complete=not facts.cut_short,
    )


def _asked(
    facts: Facts,
    case: Case,
    effects: tuple[str, ...],
    confusable: Sequence[Sequence[str]],
    confidence: str | None,
    chosen: FittedCandidate | None,
) -> str | None:
    """What to record next, in words; None where nothing is asked, or not yet, as the search was cut short."""
    if facts.cut_short:
        return None
    if case.sentence is _once:
        return RECORD_AGAIN
    problem = facts.problem
    own_axis = bool(problem.data.metadata.fingerprint)
    kinds, has_veto = _kinds(problem), problem.has(VETO)
    return next_experiment(case.verdict, effects, confusable, confidence, chosen, own_axis, kinds, has_veto)


def _doubts(facts: Facts, effects: tuple[str, ...]) -> tuple[str, ...]:
    """Why a name is not confirmed, in words."""
    played_once = facts.evidence.repeats and facts.problem.has(VETO)
    not_borne_out = PLAYED_ONCE if played_once else "no trajectory that was not fitted bears it out"
    reasons = {
        "no twin bears it out": not facts.problem.twin and facts.evidence.repeats,
        not_borne_out: not facts.evidence.confirms(facts.problem, effects, facts.carried)
        and (facts.problem.twin or not facts.evidence.repeats),
        "the veto trajectory hardly shows it": facts.veto_silent,
        f"the experiment '{facts.unlike}' is not explained as the others are": bool(facts.unlike),
        "less is explained than a name needs to be certain": facts.little_told,
        "of several effects one explains less of what the others leave than a name needs": (
            not facts.cut_short and facts.shared_out
        ),
    }
    return tuple(reason for reason, holds in reasons.items() if holds)


def _kinds(problem: Problem) -> int:
    """How many motions were fitted that were played more than once."""
    return len({block.name for block in problem.data.blocks if block.role == TRAINING and block.repeats > 1})


def _as_chosen(found: Found) -> list[FittedCandidate]:
    """The candidates that were fitted, the one that is found by itself as it is at last.

    It may have been fitted beside another one only, which was not needed in the end.
    """
    chosen = found.chosen
    if chosen is None or len(chosen.model_fit.effects) > 1:
        return list(found.tried)
    if all(item.effect != chosen.effect for item in found.tried):
        chosen = replace(chosen, gain=gain_and_z(found.root.unseen, chosen.model_fit.unseen)[0])
    return list({item.effect: item for item in (*found.tried, chosen)}.values())


def _confusable(
    facts: Facts, verdict: str, effects: tuple[str, ...], confidence: str | None, found: Found
) -> tuple[tuple[str, ...], ...]:
    """Effects that these data cannot tell from those that are named: a set for each of these, itself first."""
    if verdict == AMBIGUOUS:
        rivals = tuple(dict.fromkeys([*facts.rivals, *facts.contested]))
        return ((*_contested(effects, rivals, found.exchanged), *rivals),)
    if confidence != SUSPECTED:
        return ()
    return sets_of_rivals(facts.problem.policy, effects, found.first, facts.carried)


def _contested(
    effects: tuple[str, ...], rivals: tuple[str, ...], exchanged: Sequence[FittedCandidate]
) -> tuple[str, ...]:
    """Of the effects those in whose place a rival was fitted, or that look like one; all where nothing tells which."""
    if len(effects) < 2:
        return effects
    others = [item.model_fit.effects for item in exchanged if item.effect in rivals]
    if not others:
        alike = tuple(effect for effect in effects if set(usual_rivals(effect)) & set(rivals))
        return alike if alike or not rivals else effects
    return tuple(effect for effect in effects if any(effect not in one for one in others))
