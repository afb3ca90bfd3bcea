"""Stage `commit`: what was proved goes into the drive, all of it or what the drive can hold, and is measured again."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from autotune.control.reduction import Reduction, reduces
from autotune.core.errors import ConfigurationError
from autotune.core.ripple_parameters import is_ripple
from autotune.models.model_file import write_model
from autotune.tuning.commit import commit, feedforward_parameters
from autotune.tuning.findings import HOST_FILE, PlannedValues, Yardstick, save_findings
from autotune.tuning.holdings import export_step
from autotune.tuning.outcome import Outcome
from autotune.tuning.proof import TrackingError, no_worse
from autotune.tuning.run_state import RunState
from autotune.tuning.session import Session
from autotune.tuning.stage_prove import (
    ENABLED,
    Committed,
    committed_seconds,
    harm_in_words,
    holds_what_was_proved,
    measure_committed,
    measure_with_host,
)
from autotune.tuning.stage_reduce import (
    RIPPLE,
    Plan,
    announcement,
    holds_predicted,
    holds_reduced,
    is_worth_it,
    plan_commit,
    same_commutation,
    with_what_acted,
)
from autotune.tuning.stage_ripple import RipplePlan, enough, plan_ripple, removed

NOTHING = "Nothing is in the drive"


def commit_stage(session: Session, state: RunState, approve: Callable[[str], bool]) -> bool:
    """Writes what was proved, if it is worth it and approved; the outcome and its words are in `state`.

    Raises:
        ConfigurationError: nothing was proved.
    """
    findings = state.findings
    findings.need_proposed()
    if not findings.better or findings.yardstick is None:
        raise ConfigurationError(
            "nothing is proved that could be committed; run 'autotune run' with all stages"
        )
    same_commutation(session, findings.planned)
    held = feedforward_parameters(session.loop)
    changed = session.journal.state.changed
    plan = with_what_acted(plan_commit(session, findings, held, _ripple(session, state, held)), changed)
    findings.reduction, findings.ripple = plan.reduction, plan.ripple
    if not plan.values:
        return _host_only(session, state, plan.why)
    for sentence in _announced(session, plan):
        state.notes.append(sentence)
        session.reporter.say(sentence)
    if plan.reduction is not None and not _worth_it(session, plan.reduction, findings.yardstick):
        predicted = announcement(plan.reduction, session.axis.motion_unit)
        why = f"{predicted}, which is not worth writing (acceptance.improvement)"
        if plan.ripple is None:
            return _host_only(session, state, why)
        state.notes.append(f"of friction nothing is written: {why}")
        plan = replace(plan, values=dict(plan.ripple.values), reduction=None, host=None, again=frozenset())
        plan = with_what_acted(plan, changed)
        findings.reduction = None
    findings.held_before = {name: changed.get(name, held[name]) for name in plan.values if name in held}
    zero = dict(plan.ripple.settings) if plan.ripple is not None else {}
    planned = {name: value for name, value in plan.values.items() if name not in plan.again}
    findings.planned = PlannedValues(planned, plan.host is not None, zero, plan.reduction)
    if not approve(_question(plan, session)):
        save_findings(session, findings, state.whole)
        state.verdict = _not_approved(session, plan, findings.yardstick)
        return False
    return _written(session, state, plan, findings.yardstick)


def _ripple(session: Session, state: RunState, held: Mapping[str, float]) -> RipplePlan | None:
    """What the drive takes of the model's ripple; not in a plan of an earlier stage that has none."""
    findings = state.findings
    if findings.planned is not None and not any(map(is_ripple, findings.planned.values)):
        return None
    session.begin("commit", committed_seconds(session.motion, session.axis.benchmark))
    found = plan_ripple(session, findings.proposed_model or findings.model, held)
    if isinstance(found, RipplePlan):
        return found
    if found:
        state.notes.append(found)
        session.reporter.say(found)
    return None


def _announced(session: Session, plan: Plan) -> list[str]:
    """What goes into the drive, in words."""
    sentences = [announcement(plan.reduction, session.axis.motion_unit)] if plan.reduction is not None else []
    return [*sentences, plan.ripple.in_words()] if plan.ripple is not None else sentences


def _host_only(session: Session, state: RunState, why: str) -> bool:
    """Proved, and nothing of it is in the drive: said first, with what the drive does by itself."""
    state.outcome, state.nothing_to_gain = Outcome.HOST_ONLY, True
    yardstick, milli = state.findings.yardstick, session.milli
    gain = ""
    if yardstick is not None:
        before, after = yardstick.before.peak_error, yardstick.after.peak_error
        gain = (
            f" The drive by itself still has {milli(before)} on the benchmark; {milli(after)} was proved with the "
            "feedforward played by the host."
        )
    drive = f"Nothing new is in the drive, which keeps {', '.join(state.acting)}" if state.acting else NOTHING
    state.verdict = (
        f"{drive}: {why}.{gain} The host has to play the feedforward as torque offset, "
        f"all the time, or it is lost. {export_step(session.directory)}"
    )
    return False


def _written(session: Session, state: RunState, plan: Plan, yardstick: Yardstick) -> bool:
    findings = state.findings
    session.begin("commit", committed_seconds(session.motion, session.axis.benchmark))
    findings.committed = findings.with_host = None
    doubt = ""

    def proves() -> bool:
        nonlocal doubt
        measured = measure_committed(session)
        findings.committed, findings.held_out = measured.benchmark, measured.held_out
        if plan.host is not None:
            findings.with_host = measure_with_host(session, plan.host)
        if plan.ripple is not None:
            findings.ripple_removed = removed(session, plan.ripple)
        doubt = _ripple_doubt(plan, findings.ripple_removed) or _doubt(
            session, plan, yardstick, measured, findings.with_host
        )
        return not doubt

    kept = commit(session.loop, plan.values, session.journal, session.runs, session.clock(), proves)
    state.outcome = Outcome.KEPT if kept else Outcome.ROLLED_BACK
    state.nothing_to_gain = not kept and plan.reduction is not None
    if kept:
        findings.held = session.loop.read_parameters(
            [name for name in plan.values if name not in {ENABLED, *plan.again}]
        )
        if plan.ripple is not None and findings.proposed_model is not None:
            write_model(findings.proposed_model.without_effect(RIPPLE), session.directory / HOST_FILE)
        state.verdict = _kept(session, state, yardstick)
    else:
        state.verdict = f"Everything was put back: {doubt}."
    return kept


def _ripple_doubt(plan: Plan, share: float | None) -> str:
    """Why the ripple that was written must not be kept; "" where it may."""
    if plan.ripple is None or share is None or enough(share, plan.ripple):
        return ""
    return (
        f"of the torque ripple {100 * share:.0f} % were gone with what was written, where "
        f"{100 * (1.0 - plan.ripple.alignment.left):.0f} % were predicted"
    )


def _doubt(
    session: Session, plan: Plan, yardstick: Yardstick, measured: Committed, with_host: TrackingError | None
) -> str:
    """Why what was measured after writing must not be kept; "" where it may."""
    before, after, alone = yardstick.before, yardstick.after, measured.benchmark
    milli, least = session.milli, session.axis.acceptance.improvement
    reduction = plan.reduction
    if harmful := harm_in_words(session, yardstick.held_out, measured.held_out):
        return f"with the parameters in the drive, {harmful}"
    if with_host is not None:
        if not holds_what_was_proved(before, after, with_host):
            return f"with the host beside the drive the peak error was {milli(with_host.peak_error)}, not as proved"
        if not no_worse(before, alone, session.axis.position_resolution):
            return f"the drive by itself gave {milli(alone.peak_error)}, worse than {milli(before.peak_error)} before"
        return ""
    if plan.only_ripple:
        if not no_worse(before, alone, session.axis.position_resolution):
            return (
                f"with the ripple compensated the drive gave {milli(alone.peak_error)}, worse than "
                f"{milli(before.peak_error)} before"
            )
        return ""
    if reduction is not None:
        enough = reduces(reduction.values) or holds_predicted(before, alone, reduction)
        if enough and holds_reduced(before, alone, least):
            return ""
        return (
            f"reduced to what this drive holds, the feedforward gave {milli(alone.peak_error)} (predicted "
            f"{milli(reduction.predicted_peak)}), which is not better than {milli(before.peak_error)} before by what "
            "acceptance.improvement asks for. The host has to play the feedforward"
        )
    if not holds_what_was_proved(before, after, alone):
        return f"with the parameters in the drive the peak error was {milli(alone.peak_error)}, not as proved"
    return ""


def _worth_it(session: Session, reduction: Reduction, yardstick: Yardstick) -> bool:
    """Whether what the drive can hold is predicted to help at all."""
    least = session.axis.acceptance.improvement
    return bool(reduction.host) or is_worth_it(reduction, yardstick.before, least)


def _question(plan: Plan, session: Session) -> str:
    sentence = "; ".join(_announced(session, plan))
    if not sentence:
        return "Write the proved parameters to the drive for good?"
    return f"{sentence[0].upper()}{sentence[1:]}. Write it to the drive for good?"


def _not_approved(session: Session, plan: Plan, yardstick: Yardstick) -> str:
    """True also where it is approved later: the commit is a run of its own then."""
    before, after = yardstick.before.peak_error, yardstick.after.peak_error
    if plan.reduction is not None:
        after = plan.reduction.predicted_peak
    return (
        "Proved; nothing is written, as it was not approved while the run lasted. With what would be written the "
        f"peak error on the benchmark goes from {session.milli(before)} to {session.milli(after)}, "
        f"{times_less(before, after)}."
    )


def _kept(session: Session, state: RunState, yardstick: Yardstick) -> str:
    """What the drive does by itself comes first; what needs a host after it, and as such."""
    findings, milli = state.findings, session.milli
    reduction, alone = findings.reduction, findings.committed
    before, after = yardstick.before.peak_error, yardstick.after.peak_error
    if alone is None:
        return "Kept: the drive runs with the committed parameters."
    sentence = (
        f"Kept: with its own feedforward the drive's peak error on the benchmark is {milli(alone.peak_error)}; before "
        f"it was {milli(before)}, {times_less(before, alone.peak_error)}, as measured after writing."
    )
    if findings.ripple is not None and findings.ripple_removed is not None:
        sentence += (
            f" The drive takes {100 * findings.ripple_removed:.0f} % of the torque ripple away, as measured on one "
            "turn forward and backward."
        )
        if all(map(is_ripple, findings.held)):
            before_run = [name for name in state.acting if name != RIPPLE]
            holds = f"keeps {', '.join(before_run)} as before" if before_run else "holds nothing else of it"
            return (
                f"{sentence} Of the feedforward it {holds}; friction and inertia ({milli(after)} on the "
                f"benchmark) have to come from a host, which plays {HOST_FILE}. {export_step(session.directory)}"
            )
    if reduction is None:
        return f"{sentence} Proved beyond doubt was {milli(after)}, with the same feedforward played by the host."
    if findings.with_host is not None:
        return (
            f"{sentence} With {', '.join(reduction.host)} from the host, which has to play it all the time, "
            f"{milli(findings.with_host.peak_error)} was measured, {times_less(before, findings.with_host.peak_error)}."
        )
    predicted = f"Predicted was {milli(reduction.predicted_peak)}"
    if not reduces(reduction.values) and not reduction.lost:
        return f"{sentence} Proved beyond doubt was {milli(after)}, with the whole feedforward played by the host."
    if not reduces(reduction.values):
        whose = "diagnosed" if findings.given is None else "given"
        return (
            f"{sentence} {predicted}. The feedforward of the {whose} model ({', '.join(reduction.lost)}) gives "
            f"{milli(after)}, {times_less(before, after)}, only while a host plays {HOST_FILE}."
        )
    return (
        f"{sentence} {predicted}: this drive holds part of the feedforward; all of it gives {milli(after)}."
    )


def times_less(before: float, after: float) -> str:
    """How many times smaller the second is, in words."""
    if not 0.0 < after < before:
        return "no less"
    return f"{before / after:.1f} times less"
