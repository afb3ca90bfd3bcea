"""Gains into the drive: proved in turn with today's ones, committed as a transaction, measured again, or put back.

The proof is the feedforward's: windows of the benchmark and of a held-out motion, today's and proposed gains in turn,
under the guard. Proposed gains are in volatile memory only until they are proved; the journal names them before they
are written, so that a killed run is put right by the next start.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

from autotune.control.gains.loop import Gains
from autotune.core.errors import AutotuneError, ConfigurationError
from autotune.experiments.standstill import standing
from autotune.recordings.recording import Recording, concatenate
from autotune.tuning.commit import commit, verify
from autotune.tuning.journal import CommitPhase, Journal
from autotune.tuning.preparation import SessionRequest, connected, own_run, prepared
from autotune.tuning.proof import HeldOutError, Proof, prove
from autotune.tuning.recovery import recover
from autotune.tuning.session import Session, controller_of
from autotune.tuning.stage_prove import (
    AFTER,
    BEFORE,
    committed_seconds,
    harm_in_words,
    held_out_label,
    holds_what_was_proved,
    measure_committed,
    proof_seconds,
    windows_of,
)
from autotune.tuning.stage_prove import (
    _windows as windows_to_play,
)

STAGE = "gains"


@dataclass(frozen=True)
class GainsRequest(SessionRequest):
    """What is asked: the gains to write; `approve` is asked before anything is written for good."""

    gains: Gains = field(default_factory=lambda: Gains(0.0, 0.0))
    approve: Callable[[str], bool] = field(default=lambda sentence: True)


@dataclass(frozen=True, slots=True)
class Applied:
    """Whether the gains are in the drive, and why or why not; the proof where it was played."""

    kept: bool
    sentence: str
    proof: Proof | None = None


def written_as(gains: Gains, held: Mapping[str, float]) -> dict[str, float]:
    """The drive's parameters that these gains are.

    Raises:
        ConfigurationError: the drive's profile maps no such gains.
    """
    if gains.structure != "pid" or gains.notch is not None:
        raise ConfigurationError(
            "only the gains of a PID controller without a notch can be written; set the others at the drive by hand"
        )
    wanted = {"controller.kp": gains.kp, "controller.kd": gains.kd, "controller.ki": gains.ki}
    missing = sorted(set(wanted) - set(held))
    if missing:
        raise ConfigurationError(
            f"the profile of this drive does not map {', '.join(missing)}: the gains are advice only; set them by hand"
        )
    if gains.derivative_filter != held.get("controller.derivative_filter", gains.derivative_filter):
        wanted["controller.derivative_filter"] = gains.derivative_filter
    return {name: float(value) for name, value in wanted.items()}


def apply_gains(request: GainsRequest) -> Applied:
    """Proves the gains on the axis and keeps them if they are better beyond doubt.

    Raises:
        AutotuneError, KeyboardInterrupt: after everything was put back; the axis is at rest.
    """
    with own_run(request, _outcome) as run:
        request.reporter.stage("connect", 3.0)
        with connected(run.opening, run.journal, request.reporter) as loop:
            recover(loop, request.runs, run.journal)
            with prepared(request, loop, run.journal) as session:
                return _proved_and_kept(request, session)


def _outcome(journal: Journal, whole: bool) -> Mapping[str, str]:
    """What was written stays, however the run ends after that."""
    return {"outcome": "kept" if journal.state.phase is CommitPhase.KEPT else "not_applied"}


def _proved_and_kept(request: GainsRequest, session: Session) -> Applied:
    loop = session.loop
    wanted = written_as(request.gains, loop.read_parameters())
    old = loop.read_parameters(list(wanted))
    standing(loop, session.limits)
    proof, held_out, doubt = _prove(session, old, wanted)
    before, after = proof.before.peak_error, proof.after.peak_error
    figures = (
        f"peak error on the benchmark {session.milli(before)} with today's gains, {session.milli(after)} with the "
        "proposed ones"
    )
    if doubt:
        return Applied(False, f"Nothing was written: {doubt}.", proof)
    if not request.approve(f"Proved: {figures}. Write the gains to the drive for good?"):
        return Applied(False, f"Nothing was written, it was not approved; proved: {figures}.", proof)
    session.begin("commit", committed_seconds(session.motion, session.axis.benchmark))

    def proves() -> bool:
        nonlocal doubt
        with _told(session, wanted):
            measured = measure_committed(session)
        if not holds_what_was_proved(proof.before, proof.after, measured.benchmark):
            doubt = f"once written, the peak error was {session.milli(measured.benchmark.peak_error)}, not as proved"
        else:
            doubt = harm_in_words(session, held_out, measured.held_out)
        return not doubt

    kept = commit(loop, wanted, session.journal, session.runs, session.clock(), proves)
    if not kept:
        return Applied(False, f"Everything was put back: {doubt}.", proof)
    return Applied(True, f"Kept: {figures}; 'autotune rollback' puts the old gains back.", proof)


def _prove(
    session: Session, old: Mapping[str, float], new: Mapping[str, float]
) -> tuple[Proof, HeldOutError, str]:
    """Windows with old and new gains in turn; why the new ones must not be kept, or ""."""
    benchmark, axis = session.axis.benchmark, session.axis
    session.begin(STAGE, proof_seconds(session.motion, benchmark))
    parts: list[Recording] = []
    for repeat in range(benchmark.repeats):
        before, _ = session.play(f"gains-{repeat}-before", windows_to_play(session, BEFORE, repeat, None))
        with _in_force(session, old, new):
            after, _ = session.play(f"gains-{repeat}-after", windows_to_play(session, AFTER, repeat, None))
        parts += [before, after]
    rows = concatenate([_without_controller(part) for part in parts])
    proof = prove(
        windows_of(rows, BEFORE),
        windows_of(rows, AFTER),
        benchmark.frequency,
        axis.acceptance.improvement,
        axis.acceptance.confidence,
    )
    unknown = [HeldOutError.of(windows_of(rows, held_out_label(label))) for label in (BEFORE, AFTER)]
    doubt = harm_in_words(session, unknown[0], unknown[1]).replace("the feedforward", "the gains")
    if not proof.better:
        doubt = (
            f"the peak error would go from {session.milli(proof.before.peak_error)} to "
            f"{session.milli(proof.after.peak_error)}, which is not better beyond doubt"
        )
    return proof, unknown[0], doubt


def _without_controller(recording: Recording) -> Recording:
    """Windows with different gains stand in one recording only where it names none."""
    return replace(recording, metadata=replace(recording.metadata, controller=None))


@contextmanager
def _in_force(session: Session, old: Mapping[str, float], new: Mapping[str, float]) -> Iterator[None]:
    """The new gains in volatile memory while the block lasts; journalled before, the old ones verified after."""
    journal, loop = session.journal, session.loop
    changed, during = dict(journal.state.changed), dict(journal.state.during)
    journal.note(changed={**changed, **old}, during={**during, **new})
    try:
        loop.write_parameters(dict(new))
        with _told(session, new):
            yield
    finally:
        try:
            loop.write_parameters(dict(old))
            verify(loop, old)
            journal.note(changed=changed, during=during)
        except AutotuneError as error:
            session.reporter.say(f"the gains could not be put back ({error}); the next start will do it")
            raise


@contextmanager
def _told(session: Session, held: Mapping[str, float]) -> Iterator[None]:
    """What is recorded meanwhile names the gains that made it."""
    before = session.controller
    session.controller = controller_of({**session.loop.read_parameters(), **held})
    try:
        yield
    finally:
        session.controller = before
