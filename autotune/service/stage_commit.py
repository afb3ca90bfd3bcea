"""Stage `commit`: what was proved goes into the drive, all of it or what the drive can hold, and is measured again."""

from __future__ import annotations

from collections.abc import Callable

from autotune.control.reduction import Reduction, reduces
from autotune.core.errors import ConfigurationError
from autotune.service.commit import commit, feedforward_parameters
from autotune.service.course import Course
from autotune.service.findings import HOST_FILE, Planned, save_findings
from autotune.service.outcome import Outcome
from autotune.service.session import Session
from autotune.service.stage_prove import ENABLED, holds_what_was_proved, measure_committed
from autotune.service.stage_reduce import (
    Plan,
    announcement,
    holds_predicted,
    holds_reduced,
    is_worth_it,
    plan_commit,
)


def commit_stage(session: Session, course: Course, approve: Callable[[str], bool]) -> bool:
    """Writes what was proved, if it is worth it and approved; the outcome and its words are in the course.

    Raises:
        ConfigurationError: nothing was proved.
    """
    findings = course.findings
    findings.need_proposed()
    if not findings.better:
        raise ConfigurationError(
            "nothing is proved that could be committed; run 'autotune run' with all stages"
        )
    plan = plan_commit(session, findings, feedforward_parameters(session.loop))
    findings.reduction = plan.reduction
    if not plan.values:
        course.verdict = "Proved, but this drive cannot hold a feedforward; the host has to play it."
        return False
    if plan.reduction is not None:
        course.notes.append(announcement(plan.reduction, session.axis.motion_unit))
        session.reporter.say(course.notes[-1])
        if not _worth_it(session, course, plan.reduction):
            return False
    findings.planned = Planned(dict(plan.values), plan.host is not None)
    if not approve(_question(plan, session)):
        save_findings(session.directory, findings)
        course.verdict = "Proved, but not written: it was not approved."
        return False
    return _written(session, course, plan)


def _written(session: Session, course: Course, plan: Plan) -> bool:
    findings = course.findings
    session.begin("commit", 12.0)
    findings.committed = None

    def proves() -> bool:
        findings.committed = measure_committed(session, plan.host)
        if findings.proved is None:
            return True
        if plan.reduction is not None and plan.host is None:
            least, before = session.axis.acceptance.improvement, findings.proved.proof.before
            enough = reduces(plan.reduction.values) or holds_predicted(
                before, findings.committed, plan.reduction
            )
            return enough and holds_reduced(before, findings.committed, least)
        return holds_what_was_proved(findings.proved.proof, findings.committed)

    kept = commit(session.loop, plan.values, session.journal, session.runs, session.clock(), proves)
    course.outcome = Outcome.KEPT if kept else Outcome.ROLLED_BACK
    course.nothing_to_gain = not kept and plan.reduction is not None
    if kept:
        findings.held = session.loop.read_parameters([name for name in plan.values if name != ENABLED])
    course.verdict = _verdict(session, course, kept)
    return kept


def _worth_it(session: Session, course: Course, reduction: Reduction) -> bool:
    """Whether what the drive can hold is predicted to help at all."""
    proved = course.findings.proved
    least = session.axis.acceptance.improvement
    if proved is None or reduction.host or is_worth_it(reduction, proved.proof.before, least):
        return True
    course.nothing_to_gain = True
    course.verdict = (
        f"Proved, but not written: {announcement(reduction, session.axis.motion_unit)}, which is not better than "
        f"{session.milli(proved.proof.before.peak_error)} as it is now by what acceptance.improvement asks for. "
        "The host has to play the feedforward."
    )
    return False


def _question(plan: Plan, session: Session) -> str:
    if plan.reduction is None:
        return "Write the proved parameters to the drive for good?"
    told = announcement(plan.reduction, session.axis.motion_unit)
    return f"{told[0].upper()}{told[1:]}. Write it to the drive for good?"


def _verdict(session: Session, course: Course, kept: bool) -> str:
    findings, milli = course.findings, session.milli
    committed, proved, reduction = findings.committed, findings.proved, findings.reduction
    shown = milli(committed.peak_error) if committed else "an unknown value"
    if not kept and reduction is not None and proved is not None:
        return (
            f"Everything was put back: reduced to what this drive holds, the feedforward gave {shown} (predicted "
            f"{milli(reduction.predicted_peak)}), which is not better than {milli(proved.proof.before.peak_error)} "
            "before by what acceptance.improvement asks for. The host has to play the feedforward."
        )
    if not kept:
        return (
            f"Everything was put back: with the parameters in the drive the peak error was {shown}, which is not "
            "what had been proved."
        )
    if proved is None:
        return f"Kept: the drive runs with the committed parameters; peak error {shown}."
    before, after = proved.proof.before.peak_error, proved.proof.after.peak_error
    if reduction is not None and not reduces(reduction.values):
        return (
            f"Kept: the peak error on the benchmark fell from {milli(before)} to {milli(after)}, "
            f"{before / after:.1f} times less, beyond doubt, with the feedforward of the diagnosed model "
            f"({', '.join(reduction.lost)}) played by the host. The drive holds the LuGre part of it: by itself "
            f"it gives {shown} (predicted {milli(reduction.predicted_peak)}); the rest is lost where "
            f"the host does not play {HOST_FILE}."
        )
    if reduction is not None and committed is not None:
        with_host = f" with {', '.join(reduction.host)} from the host" if reduction.host else ""
        return (
            f"Kept, reduced to what this drive holds: the peak error on the benchmark fell from "
            f"{milli(before)} to {shown}{with_host} (predicted {milli(reduction.predicted_peak)}; "
            f"the full feedforward gives {milli(after)})."
        )
    return (
        f"Kept: the peak error on the benchmark fell from {milli(before)} to {milli(after)}, "
        f"{before / after:.1f} times less, beyond doubt; with the drive's own feedforward it is {shown}."
    )
