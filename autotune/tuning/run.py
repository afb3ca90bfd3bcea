"""A tuning run: check, experiment, fit, adapt, prove, commit. Whatever happens, the axis ends at rest,
without power, with every changed setting restored, and the run's folder says what was done.
"""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime
from pathlib import Path

from autotune.core.errors import AutotuneError, Interrupted, LinkError, NotEnoughExcitation
from autotune.tuning import summary
from autotune.tuning.accepted import accept
from autotune.tuning.committed import InForce, in_force
from autotune.tuning.documents import Material, without_documents
from autotune.tuning.ending import ending, is_beside, to_raise
from autotune.tuning.files import finite, write_json
from autotune.tuning.findings import Findings
from autotune.tuning.journal import CommitPhase, Journal
from autotune.tuning.observer import show
from autotune.tuning.outcome import Outcome, RunResult
from autotune.tuning.preparation import acting_feedforward, connected, prepared
from autotune.tuning.recovery import recover
from autotune.tuning.request import STAGES as STAGES
from autotune.tuning.request import Request as Request
from autotune.tuning.resume import last_whole
from autotune.tuning.run_directory import Opening, axis_lock, discard_unused, make_run_directory
from autotune.tuning.run_state import RunState
from autotune.tuning.session import Session
from autotune.tuning.shown_pages import verdict_shown
from autotune.tuning.stage_prove import ENABLED
from autotune.tuning.stage_reduce import comparison
from autotune.tuning.stages import perform


def tune(request: Request) -> RunResult:
    """Runs the stages; the result is also in `run.json`.

    Raises:
        AutotuneError, KeyboardInterrupt: after everything was restored; `run.json` says `aborted`. Where the drive
            was never reached, there is no folder.
    """
    request.refuse_nonsense()
    axis = request.axis
    with axis_lock(request.runs, axis.name):
        started = request.clock()
        directory = make_run_directory(request.runs, axis.name, started)
        journal = Journal.begin(directory, axis.name, axis.fingerprint, started)
        state, opening = RunState(), Opening(request.open_loop)
        session: Session | None = None
        try:
            request.reporter.stage("connect", 3.0)
            with connected(opening, journal, request.reporter) as loop:
                state.notes += recover(loop, request.runs, journal)
                parameters = loop.read_parameters()
                present, state.acting = (
                    in_force(request.runs, axis, parameters),
                    acting_feedforward(parameters),
                )
                with prepared(request, loop, journal) as session:
                    perform(request, session, state)
            _accept(request, directory, present, state)
        except NotEnoughExcitation as error:
            state.outcome, state.verdict = ending(error, kept=False)
            state.refused, state.guard = True, getattr(error, "stop", "")
        except BaseException as error:
            if opening.failed(journal):
                discard_unused(directory)
                raise
            kept = journal.state.phase is CommitPhase.KEPT
            state.outcome, state.verdict = ending(error, kept)
            if not kept and (resumable := _resumable(request, directory, error)):
                state.verdict = f"{state.verdict.rstrip('.')}. {resumable}"
                request.reporter.say(resumable)
            result = _result(request, directory, started, state, session)
            result = _finish(request, journal, result, state, session)
            if is_beside(error, kept):
                return result
            if kept:
                request.reporter.say(result.verdict)
                raise to_raise(error, result.verdict) from error
            raise
        result = _result(request, directory, started, state, session)
        return _finish(request, journal, result, state, session)


def _resumable(request: Request, directory: Path, error: BaseException) -> str:
    """How to go on after an interruption or a failure of link or host; "" where there is nothing to go on from."""
    last = last_whole(directory)
    if (
        request.only is not None
        or not last
        or not isinstance(error, (KeyboardInterrupt, Interrupted, LinkError))
    ):
        return ""
    return (
        f"What was measured up to stage '{last}' is kept: 'autotune run' with --resume {directory.name} goes on "
        "from there."
    )


def _accept(request: Request, directory: Path, present: InForce, state: RunState) -> None:
    """Where nothing can be gained, what was found becomes what checks compare with."""
    committed, proved = present.committed, state.findings.proved
    if request.only is not None or not state.nothing_to_gain or proved is None:
        return
    if committed is None or not present.held or not (directory / "model.toml").is_file():
        return
    accept(directory, request.axis, committed.run, proved.proof.before.peak_error)
    state.verdict += " What is committed stays; checks compare with what this run has found."


def _result(
    request: Request, directory: Path, started: datetime, state: RunState, session: Session | None
) -> RunResult:
    findings, found = state.findings, state.identification
    proof = findings.proved.proof if findings.proved else None
    return RunResult(
        outcome=state.outcome,
        verdict=state.verdict,
        axis=request.axis.name,
        fingerprint=request.axis.fingerprint,
        started=started.isoformat(timespec="seconds"),
        machine_seconds=round(session.budget.used, 3) if session else 0.0,
        run_directory=directory,
        in_drive=summary.in_drive(findings, state.outcome is Outcome.KEPT, state.acting),
        host_adds=summary.host_adds(findings),
        before=proof.before if proof else findings.baseline,
        after=proof.after if proof else None,
        improvement=summary.improvement(proof, request.axis.acceptance.confidence) if proof else None,
        parameters=summary.parameters(found, request.axis.motion_unit) if found else {},
        feedforward=_feedforward(findings),
        reduction=comparison(findings.reduction, findings.committed) if findings.reduction else {},
        adaptation=summary.adaptation(findings.adapted) if findings.adapted else {},
        diagnosis=summary.diagnosis(findings),
        given=summary.given(findings),
        committed=findings.committed,
        with_host=findings.with_host,
        held_out=summary.held_out(findings.proved, findings.held_out),
        only=request.only,
        refused=state.refused,
        guard=state.guard,
        notes=tuple(state.notes),
        stages=session.seconds if session else {},
        motion_unit=request.axis.motion_unit,
    )


def _feedforward(findings: Findings) -> dict[str, float]:
    """What is in the drive, rounded as it holds it, or would be, by name."""
    if findings.held:
        return findings.held
    if findings.planned is not None:
        return {name: value for name, value in findings.planned.values.items() if name != ENABLED}
    if findings.reduction is not None:
        return {f"feedforward.{name}": value for name, value in findings.reduction.values.items()}
    return findings.proposed.drive_parameters() if findings.proposed else {}


def _finish(
    request: Request, journal: Journal, result: RunResult, state: RunState, session: Session | None
) -> RunResult:
    """run.json, a closed journal where nothing is left to be put right, then what is there to look at.

    What cannot be written is said in the result, which is returned: it stays true without its files.
    """
    try:
        write_json(result.run_directory / "run.json", finite(result.as_json()))
        if not journal.state.left_something:
            journal.note(outcome=result.outcome.value)
    except (AutotuneError, OSError) as error:
        told = f"The record of this run in {result.run_directory} is not complete ({error})."
        request.reporter.say(told)
        return replace(result, verdict=f"{result.verdict} {told}")
    material = Material(
        request.axis,
        result,
        state.findings,
        state.identification,
        session.limits if session else None,
        session.identity if session else {},
        tuple(session.written.values()) if session else (),
    )
    show(request.observers, request.reporter, lambda: verdict_shown(result))
    told = without_documents(material)
    if told:
        request.reporter.say(told)
    return replace(result, verdict=" ".join(filter(None, (result.verdict, told))))
