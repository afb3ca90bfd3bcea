"""A tuning run: check, experiment, fit, adapt, prove, commit. Whatever happens, the axis ends at rest,
without power, with every changed setting restored, and the run's folder says what was done.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path

from autotune.core.errors import AutotuneError, ConfigurationError, NotEnoughExcitation
from autotune.core.recording_files import read_recording
from autotune.experiments.programmes import build
from autotune.experiments.runner import Programme
from autotune.experiments.sines import BenchmarkSine
from autotune.models.model_file import write_model
from autotune.service import summary
from autotune.service.accepted import accept
from autotune.service.commit import feedforward_parameters
from autotune.service.committed import InForce, in_force
from autotune.service.course import Course
from autotune.service.documents import Material, write_documents
from autotune.service.files import finite, write_json
from autotune.service.findings import HOST_FILE, Findings, latest_run, load_findings, save_findings
from autotune.service.hold import Hold, connected, own_feedforward, prepared
from autotune.service.journal import CommitPhase, Journal
from autotune.service.outcome import Outcome, RunResult
from autotune.service.recover import recover
from autotune.service.run_directory import axis_lock, make_run_directory
from autotune.service.session import Session
from autotune.service.stage_adapt import LEAST_SECONDS, adapt, window_seconds
from autotune.service.stage_commit import commit_stage
from autotune.service.stage_diagnose import diagnose_stage
from autotune.service.stage_identify import baseline, experiment, fit, start_of
from autotune.service.stage_model import adapt_model
from autotune.service.stage_prove import (
    ENABLED,
    committed_seconds,
    proof_seconds,
    prove_stage,
)
from autotune.service.stage_reduce import comparison, plan_retune
from autotune.service.torque_check import find_torque_semantics, must_be_found

STAGES = ("check", "experiment", "fit", "diagnose", "adapt", "prove", "commit")
SPARE_SECONDS = 10.0  # of machine time, for ways between windows


@dataclass(frozen=True)
class Request(Hold):
    """What is asked of a run.

    Attributes:
        only: a single stage, or None for all.
        gain: None for a tuning. For a re-tune after drift: what the drive will hold by itself is proved against
            what it holds now, and this share of the peak error must be gained; 0: whatever is better beyond doubt.
        approve: asked before anything is written to the drive for good.
    """

    only: str | None = None
    gain: float | None = None
    approve: Callable[[str], bool] = field(default=lambda sentence: True)


def tune(request: Request) -> RunResult:
    """Runs the stages; the result is also in `run.json`.

    Raises:
        AutotuneError, KeyboardInterrupt: after everything was restored; `run.json` says `aborted`.
    """
    if request.only is not None and request.only not in STAGES:
        raise ConfigurationError(f"--only is {request.only!r}; the stages are {', '.join(STAGES)}")
    axis = request.axis
    with axis_lock(request.runs, axis.name):
        started = request.clock()
        directory = make_run_directory(request.runs, axis.name, started)
        journal = Journal.begin(directory, axis.name, axis.fingerprint, started)
        course = Course()
        session: Session | None = None
        try:
            request.reporter.stage("connect", 3.0)
            with connected(request.open_loop, journal, request.reporter) as loop:
                course.notes += recover(loop, request.runs, journal)
                present = in_force(request.runs, axis, loop.read_parameters())
                with prepared(request, loop, journal) as session:
                    _stages(request, session, course)
            _accept(request, directory, present, course)
        except NotEnoughExcitation as error:
            course.outcome, course.verdict = _ending(error)
        except BaseException as error:
            course.outcome, course.verdict = _ending(error)
            if journal.state.phase is CommitPhase.KEPT:
                course.outcome = Outcome.KEPT
                course.verdict = f"Kept: the drive holds the proved parameters. {course.verdict}"
            _finish(request, journal, _result(request, directory, started, course, session), course, session)
            raise
        result = _result(request, directory, started, course, session)
        _finish(request, journal, result, course, session)
        return result


def _accept(request: Request, directory: Path, present: InForce, course: Course) -> None:
    """Where nothing can be gained, what was found becomes what checks compare with."""
    committed, proved = present.committed, course.findings.proved
    if request.only is not None or not course.nothing_to_gain or proved is None:
        return
    if committed is None or not present.held or not (directory / "model.toml").is_file():
        return
    accept(directory, request.axis, committed.run, proved.proof.before.peak_error)
    course.verdict += " What is committed stays; checks compare with what this run has found."


def _ending(error: BaseException) -> tuple[Outcome, str]:
    if isinstance(error, NotEnoughExcitation):
        return Outcome.NOT_APPLIED, f"Nothing was applied: {error}"
    if isinstance(error, KeyboardInterrupt):
        return Outcome.ABORTED, "Interrupted: the axis is at rest and without power."
    notes = "; ".join(getattr(error, "__notes__", []))
    return Outcome.ABORTED, f"The run was stopped: {error}" + (f" ({notes})" if notes else "")


def _stages(request: Request, session: Session, course: Course) -> None:
    wanted = STAGES if request.only is None else (request.only,)
    if request.only is not None:
        course.findings = load_findings(request.runs, session.axis, request.only)
    if request.only in ("experiment", "diagnose", "adapt", "prove", "commit"):
        _torque_semantics(session, course)
    for stage in wanted:
        session.journal.note(stage=stage)
        if not _STAGES[stage](request, session, course):
            break
        save_findings(session.directory, course.findings)
    if request.only is not None and not course.verdict:
        course.verdict = f"Stage '{request.only}' is done; nothing was applied."


def _check(request: Request, session: Session, course: Course) -> bool:
    """All experiments fit into the limits and the machine time, before anything moves."""
    session.begin("check", 1.0)
    sine = BenchmarkSine(session.motion, 1, session.axis.benchmark.periods)
    programme = Programme((sine, *build("identification", session.axis)), session.limits, session.budget.left)
    programme.check(session.loop.period)
    _torque_semantics(session, course)
    return True


def _torque_semantics(session: Session, course: Course) -> None:
    """Where the profile leaves open what the torque demand means, it is found before anything rests on it."""
    if must_be_found(session):
        course.notes.append(find_torque_semantics(session))


def _experiment(request: Request, session: Session, course: Course) -> bool:
    course.baseline = baseline(session)
    experiment(session)
    return True


def _fit(request: Request, session: Session, course: Course) -> bool:
    path = session.written.get("experiment") or _earlier(request, "recordings/experiment.parquet")
    course.identification = fit(session, read_recording(path))
    course.findings.start = start_of(course.identification)
    course.notes += course.identification.notes
    return True


def _diagnose(request: Request, session: Session, course: Course) -> bool:
    path = session.written.get("experiment") or _earlier(request, "recordings/experiment.parquet")
    recording = read_recording(path)
    found = course.identification or fit(session, recording)
    if found.model is None:  # `fit` refuses that
        return True
    reserve = _later_seconds(session) + LEAST_SECONDS + 2.0 * window_seconds(session)
    course.findings.diagnosed = told = diagnose_stage(session, recording, found.model, reserve)
    course.findings.model = told.model
    course.notes += told.notes
    return True


def _later_seconds(session: Session) -> float:
    """Machine time that proof and commit will take."""
    benchmark = session.axis.benchmark
    return proof_seconds(benchmark) + committed_seconds(benchmark) + SPARE_SECONDS


def _adapt(request: Request, session: Session, course: Course) -> bool:
    findings, later = course.findings, _later_seconds(session)
    start = findings.need_start()
    more = window_seconds(session) if findings.model is not None else 0.0
    findings.adapted = adapt(session, start.parameters, start.stiffness_range, later + more)
    findings.proposed = findings.adapted.best.parameters
    if findings.model is None:
        return True
    findings.modelled = adapt_model(session, findings.model, findings.adapted.best, later)
    if findings.modelled is not None and findings.modelled.chosen:
        findings.proposed_model = findings.modelled.best.model
        write_model(findings.proposed_model, session.directory / HOST_FILE)
    return True


def _prove(request: Request, session: Session, course: Course) -> bool:
    findings = course.findings
    own = own_feedforward(session.journal.state.changed)
    law, least = findings.law(session.axis.cycle), session.axis.acceptance.improvement
    if request.gain is not None:
        least = request.gain
        law = plan_retune(session, findings, feedforward_parameters(session.loop)) or law
    findings.proved = prove_stage(session, law, own, least)
    proof = findings.proved.proof
    findings.better = proof.better
    if not proof.better:
        course.nothing_to_gain = True
        course.verdict = (
            f"Nothing was applied: the peak error would go from {session.milli(proof.before.peak_error)} to "
            f"{session.milli(proof.after.peak_error)}, which is not better beyond doubt."
        )
    return proof.better


def _commit(request: Request, session: Session, course: Course) -> bool:
    return commit_stage(session, course, request.approve)


_STAGES: dict[str, Callable[[Request, Session, Course], bool]] = {
    "check": _check,
    "experiment": _experiment,
    "fit": _fit,
    "diagnose": _diagnose,
    "adapt": _adapt,
    "prove": _prove,
    "commit": _commit,
}


def _earlier(request: Request, name: str) -> Path:
    return latest_run(request.runs, request.axis, name) / name


def _result(
    request: Request, directory: Path, started: datetime, course: Course, session: Session | None
) -> RunResult:
    findings, found = course.findings, course.identification
    proof = findings.proved.proof if findings.proved else None
    return RunResult(
        outcome=course.outcome,
        verdict=course.verdict,
        axis=request.axis.name,
        fingerprint=request.axis.fingerprint,
        started=started.isoformat(timespec="seconds"),
        machine_seconds=round(session.budget.used, 3) if session else 0.0,
        run_directory=directory,
        before=proof.before if proof else course.baseline,
        after=proof.after if proof else None,
        improvement=summary.improvement(proof, request.axis.acceptance.confidence) if proof else None,
        parameters=summary.parameters(found, request.axis.motion_unit) if found else {},
        feedforward=_feedforward(findings),
        reduction=comparison(findings.reduction, findings.committed) if findings.reduction else {},
        adaptation=summary.adaptation(findings.adapted) if findings.adapted else {},
        diagnosis=summary.diagnosis(findings.diagnosed, findings.modelled) if findings.diagnosed else {},
        committed=findings.committed,
        notes=tuple(course.notes),
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
    request: Request, journal: Journal, result: RunResult, course: Course, session: Session | None
) -> None:
    """run.json, a closed journal where nothing is left to be put right, then what is there to look at."""
    write_json(result.run_directory / "run.json", finite(result.as_json()))
    if not journal.state.left_something:
        journal.note(outcome=result.outcome.value)
    material = Material(
        request.axis,
        result,
        course.findings,
        course.identification,
        session.limits if session else None,
        session.identity if session else {},
        tuple(session.written.values()) if session else (),
    )
    try:
        write_documents(material)
    except (AutotuneError, OSError) as error:
        request.reporter.say(f"the report could not be written: {error}")
