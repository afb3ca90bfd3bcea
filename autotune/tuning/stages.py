"""The stages of a tuning run, one function each: what it does, and whether the run goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from autotune.control.reduction import reduces
from autotune.core.errors import GuardStop
from autotune.core.ripple_parameters import GAIN
from autotune.experiments.programmes import build
from autotune.experiments.runner import Programme
from autotune.experiments.sines import BenchmarkSine
from autotune.experiments.standstill import standing
from autotune.models.model_file import write_model
from autotune.recordings.files import read_recording
from autotune.tuning.ceiling_note import ceiling_note
from autotune.tuning.commit import feedforward_parameters
from autotune.tuning.findings import HOST_FILE, Yardstick, latest_run, load_findings, save_findings
from autotune.tuning.given_model import compared, not_proved, sentence
from autotune.tuning.holdings import nothing_kept
from autotune.tuning.hunting_note import hunting_note
from autotune.tuning.motion_plan import sweeps_of
from autotune.tuning.preparation import own_feedforward
from autotune.tuning.request import STAGES, Request
from autotune.tuning.resume import stages_left, take_up
from autotune.tuning.run_state import RunState
from autotune.tuning.session import Session
from autotune.tuning.shown_pages import adaptation_shown, diagnosis_shown, fit_shown, proof_shown
from autotune.tuning.stage_adapt import LEAST_SECONDS, adapt, window_seconds
from autotune.tuning.stage_commit import commit_stage, times_less
from autotune.tuning.stage_diagnose import diagnose_stage
from autotune.tuning.stage_identify import baseline, experiment, fit, start_of
from autotune.tuning.stage_model import adapt_model
from autotune.tuning.stage_prove import (
    Proved,
    committed_seconds,
    proof_seconds,
    prove_stage,
    with_host_seconds,
)
from autotune.tuning.stage_reduce import PREFIX, plan_retune
from autotune.tuning.stop_reasons import explained, loose
from autotune.tuning.torque_check import find_torque_semantics, must_be_found
from autotune.tuning.two_masses import refuse_loose_load, refuse_resonance, refuse_two_masses
from autotune.tuning.unfit_axes import NotTunable

SPARE_SECONDS = 6.0  # of machine time, for ways between windows
MOVING = ("experiment", "diagnose", "adapt", "prove", "commit")


def perform(request: Request, session: Session, state: RunState) -> None:
    """All that is asked for, in order; results are in the state."""
    wanted: tuple[str, ...] = STAGES if request.only is None else (request.only,)
    if request.only is not None:
        state.findings = load_findings(request.runs, session.axis, request.only)
    elif request.resume is not None:
        wanted = stages_left(take_up(session, state, request.resume))
    if request.only in MOVING:
        standing(session.loop, session.limits)
        _torque_semantics(session, state)
    for stage in wanted:
        session.journal.note(stage=stage)
        if not _watched(_STAGES[stage], request, session, state):
            break
        state.whole.append(stage)
        if stage != "check":  # which finds nothing, and would hide what an earlier run has found
            save_findings(session, state.findings, state.whole)
    if request.only is not None and not state.verdict:
        state.verdict = f"Stage '{request.only}' is done; nothing was applied."


def _watched(
    stage: Callable[[Request, Session, RunState], bool], request: Request, session: Session, state: RunState
) -> bool:
    """One stage; where the guard had to stop an axis that must not be tuned, that is what is said.

    Raises:
        NotTunable: so; not once something was written to the drive.
    """
    before = set(session.written)
    try:
        return stage(request, session, state)
    except GuardStop as stop:
        played = [path for name, path in session.written.items() if name not in before]
        if stage is _commit or not played:
            raise
        axis = session.axis
        words = explained(read_recording(played[-1]), axis, baseline=played[-1].stem == "baseline")
        if not words:
            raise
        raise NotTunable(words, str(stop)) from stop


def _check(request: Request, session: Session, state: RunState) -> bool:
    """Before anything moves: the axis stands inside its travel; all experiments fit into limits and machine time."""
    session.begin("check", 1.0)
    sine = BenchmarkSine(session.motion, 1, session.axis.benchmark.periods)
    programme = Programme((sine, *build("identification", session.axis)), session.limits, session.budget.left)
    programme.check(session.loop.period)
    if not feedforward_parameters(session.loop):
        state.notes.append(nothing_kept(session.axis.profile))
        session.reporter.say(state.notes[-1])
    place = standing(session.loop, session.limits)
    if request.only == "check":
        unit = session.axis.motion_unit
        state.verdict = (
            f"Checked, without moving: the axis stands at {place.position:.4g} {unit}, inside its travel of "
            f"{session.limits.position_min:g} to {session.limits.position_max:g} {unit}, and all experiments fit into "
            f"the limits and into {session.limits.machine_seconds:.0f} s of machine time."
        )
        return True
    _torque_semantics(session, state)
    return True


def _torque_semantics(session: Session, state: RunState) -> None:
    """Where the profile leaves open what the torque demand means, it is found before anything rests on it."""
    if must_be_found(session):
        state.notes.append(find_torque_semantics(session))


def _experiment(request: Request, session: Session, state: RunState) -> bool:
    state.findings.baseline = baseline(session)
    if words := loose(experiment(session), session.axis):
        raise NotTunable(words)
    return True


def _fit(request: Request, session: Session, state: RunState) -> bool:
    path = session.written.get("experiment") or _earlier(request, "recordings/experiment.parquet")
    state.identification = found = fit(session, read_recording(path))
    state.findings.start = start_of(found)
    session.show(lambda: fit_shown(session.axis, found, read_recording(path)))
    state.notes += found.notes
    return True


def _diagnose(request: Request, session: Session, state: RunState) -> bool:
    path = session.written.get("experiment") or _earlier(request, "recordings/experiment.parquet")
    recording = read_recording(path)
    found = state.identification or fit(session, recording)
    if found.model is None:  # `fit` refuses that
        return True
    reserve = _later_seconds(session) + LEAST_SECONDS + 2.0 * window_seconds(session.axis.benchmark.frequency)
    state.findings.diagnosed = diagnosed = diagnose_stage(
        session, recording, found.model, reserve, decide=request.decide
    )
    state.findings.model = diagnosed.model
    state.notes += diagnosed.notes
    if request.model is not None:
        state.findings.model = request.model
        state.findings.given = given = compared(recording, request.model, diagnosed)
        write_model(request.model, session.directory / "model.toml")
        state.notes.append(sentence(given))
    session.show(
        lambda: diagnosis_shown(session.axis, diagnosed, found.model, recording, state.findings.given)
    )
    kp = session.controller.kp if session.controller is not None else None
    alone = found.estimates
    refuse_loose_load(recording, kp)
    refuse_two_masses(found.joint, alone.get("high_speed"), alone.get("presliding"), diagnosed.effects, kp)
    refuse_resonance(diagnosed.model, kp)
    refuse_resonance(state.findings.model, kp)
    shaken, late = diagnosed.disturbance or 0.0, diagnosed.torque_late or 0.0
    if note := hunting_note(session, diagnosed.model or found.model, shaken, late):
        state.notes.append(note)
    return True


def _later_seconds(session: Session) -> float:
    """Machine time that proof and commit will take; also of what aligns ripple, and of a host beside the drive."""
    motion, benchmark = session.motion, session.axis.benchmark
    seconds = proof_seconds(motion, benchmark) + committed_seconds(motion, benchmark) + SPARE_SECONDS
    held = {name.removeprefix(PREFIX) for name in feedforward_parameters(session.loop)}
    if held and reduces(held):
        seconds += with_host_seconds(benchmark)
    return seconds + sum(sweep.duration for sweep in sweeps_of(session.axis, motion))


def _adapt(request: Request, session: Session, state: RunState) -> bool:
    findings, later = state.findings, _later_seconds(session)
    start = findings.need_start()
    more = window_seconds(session.axis.benchmark.frequency) if findings.model is not None else 0.0
    findings.adapted = adapt(session, start.parameters, start.stiffness_range, later + more)
    findings.proposed = findings.adapted.best.parameters
    adapted = findings.adapted
    session.show(lambda: adaptation_shown(session.axis, adapted, start.stiffness_range))
    if findings.model is None:
        return True
    findings.modelled = adapt_model(session, findings.model, findings.adapted.best, later)
    if request.model is not None and (why := not_proved(findings.modelled)):
        state.notes.append(f"The model that was given did not go to the proof: {why}.")
    if findings.modelled is not None and findings.modelled.chosen:
        findings.proposed_model = findings.modelled.best.model
        write_model(findings.proposed_model, session.directory / HOST_FILE)
    return True


def _prove(request: Request, session: Session, state: RunState) -> bool:
    findings = state.findings
    own = own_feedforward(session.journal.state.changed)
    law, least = findings.law(session.axis.cycle), session.axis.acceptance.improvement
    if request.gain is not None:
        least = request.gain
        law = plan_retune(session, findings, feedforward_parameters(session.loop)) or law
    with _own_ripple(session, own.pop(GAIN, 0.0) if request.gain is not None else 0.0):
        findings.proved = proved = prove_stage(session, law, own, least)
    session.show(lambda: proof_shown(session.axis, proved))
    findings.yardstick = Yardstick(proved.proof.before, proved.proof.after, proved.held_out_before)
    findings.better = proved.better
    if note := ceiling_note(request.runs, session.axis, proved.proof.after.peak_error):
        state.notes.append(note)
    if not proved.better:
        state.nothing_to_gain, state.refused = not proved.harmful, True
        state.verdict = f"Nothing was applied: {_not_better(session, proved)}."
    elif request.only is not None:
        state.verdict = _proved(session, proved)
    return proved.better


@contextmanager
def _own_ripple(session: Session, gain: float) -> Iterator[None]:
    """The ripple that the drive holds acts on both sides of a proof that is not about it; 0: it holds none."""
    if gain:
        session.loop.write_parameters({GAIN: gain})
    try:
        yield
    finally:
        if gain:
            session.loop.write_parameters({GAIN: 0.0})


def _not_better(session: Session, proved: Proved) -> str:
    before, after = proved.proof.before.peak_error, proved.proof.after.peak_error
    if proved.proof.better:
        return f"on the benchmark {session.milli(before)} would become {session.milli(after)}, but {proved.harmful}"
    return (
        f"the peak error would go from {session.milli(before)} to {session.milli(after)}, which is not better beyond "
        "doubt"
    )


def _proved(session: Session, proved: Proved) -> str:
    proof = proved.proof
    before, after = proof.before.peak_error, proof.after.peak_error
    low, high = (session.milli(edge) for edge in proof.interval)
    return (
        f"Proved, nothing written: the peak error on the benchmark goes from {session.milli(before)} to "
        f"{session.milli(after)} ({times_less(before, after)}; gain {low} to {high} with "
        f"{100 * session.axis.acceptance.confidence:g} % confidence), the rms error from "
        f"{session.milli(proof.before.rms_error)} to {session.milli(proof.after.rms_error)}, and a motion that it was "
        f"not adapted to gets no worse. 'autotune run' with --only commit writes it."
    )


def _commit(request: Request, session: Session, state: RunState) -> bool:
    return commit_stage(session, state, request.approve)


_STAGES: dict[str, Callable[[Request, Session, RunState], bool]] = {
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
