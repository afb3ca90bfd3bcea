"""Taking hold of an axis: an open link, limits in the drive, its own feedforward off; all put back after."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from autotune.core.axis import Axis
from autotune.core.errors import AutotuneError, DriveError, DriveFault, Interrupted, LinkError
from autotune.core.friction_table import in_words
from autotune.core.loop import Loop, power_in_words
from autotune.core.ripple_parameters import GAIN as RIPPLE_GAIN
from autotune.core.ripple_parameters import is_ripple
from autotune.experiments.limits_guarded import PREFIX, limits_guarded, tighter
from autotune.experiments.runner import Budget
from autotune.models.torque_ripple import TORQUE_RIPPLE
from autotune.tuning.commit import verify, write_verified
from autotune.tuning.journal import CommitPhase, Journal
from autotune.tuning.observer import Observer
from autotune.tuning.progress import Reporter
from autotune.tuning.run_directory import Opening, axis_lock, discard_unused, make_run_directory
from autotune.tuning.session import Session, controller_of
from autotune.tuning.stage_prove import ENABLED

GAINS = frozenset(f"feedforward.{name}" for name in ("inertia", "viscous", "coulomb", "offset"))


@dataclass(frozen=True)
class SessionRequest:
    """What is needed to take hold of an axis.

    Attributes:
        open_loop: opens the axis's link.
        runs: folder of all runs.
        reporter: hears how it goes; `clock`: local time.
        observers: see every programme, stage and finding.
    """

    axis: Axis
    open_loop: Callable[[], Loop]
    runs: Path
    reporter: Reporter
    clock: Callable[[], datetime]
    observers: Sequence[Observer] = ()


@dataclass(frozen=True, slots=True)
class OwnRun:
    """A run under way: when it began, its folder and journal, and what opens the axis's link."""

    started: datetime
    directory: Path
    journal: Journal
    opening: Opening


def _not_applied(journal: Journal, whole: bool) -> Mapping[str, Any]:
    return {"outcome": "not_applied"}


@contextmanager
def own_run(
    request: SessionRequest, last_note: Callable[[Journal, bool], Mapping[str, Any]] = _not_applied
) -> Iterator[OwnRun]:
    """The axis, a folder and a journal for a run. The folder goes again where the axis was never reached.

    Args:
        last_note: what the journal says at the end where nothing is left to put right; asked with whether the block
            came to its end.

    Raises:
        ConfigurationError: another process has the axis, or the folder cannot be made.
    """
    axis = request.axis
    with axis_lock(request.runs, axis.name):
        started = request.clock()
        directory = make_run_directory(request.runs, axis.name, started)
        journal = Journal.begin(directory, axis.name, axis.fingerprint, started)
        opening, whole = Opening(request.open_loop), False
        try:
            yield OwnRun(started, directory, journal, opening)
            whole = True
        finally:
            if opening.failed(journal):
                discard_unused(directory)
            elif not journal.state.left_something:
                journal.note(**last_note(journal, whole))


@contextmanager
def connected(open_loop: Callable[[], Loop], journal: Journal, reporter: Reporter) -> Iterator[Loop]:
    """The open link; at the end it is verified that the drive is as it was, else the journal stays open.

    Raises:
        Interrupted: Ctrl-C or a signal, after the link was closed, with what the drive says of its power.
    """
    loop = open_loop()
    try:
        with _closing(loop, journal, reporter):
            journal.note(identity=dict(loop.identity))
            yield loop
    except KeyboardInterrupt as error:
        raise Interrupted(f"interrupted; {power_in_words(getattr(loop, 'power', None))}") from error


@contextmanager
def _closing(loop: Loop, journal: Journal, reporter: Reporter) -> Iterator[None]:
    try:
        yield
    except LinkError as error:
        error.add_note(
            "what this session has changed in the drive may still be so; the next start puts it back"
        )
        raise
    finally:
        try:
            if journal.state.changed:
                _as_before(loop, journal)
                journal.note(changed={}, during={}, found={})
        except AutotuneError as error:
            reporter.say(f"not everything could be put back ({error}); the next run will do it")
        finally:
            loop.close()


def _as_before(loop: Loop, journal: Journal) -> None:
    """What was changed for the run is as it was; it is written once more where a line has garbled it.

    Raises:
        AutotuneError: it is not; the journal knows what the drive holds instead.
    """
    before = journal.state.changed
    try:
        verify(loop, before)
    except DriveError:
        try:
            write_verified(loop, before)
        except AutotuneError:
            journal.note(found=loop.read_parameters(list(before)))
            raise


@contextmanager
def prepared(request: SessionRequest, loop: Loop, journal: Journal) -> Iterator[Session]:
    """Limits in the drive, its own feedforward off; both as before when the block ends."""
    faults = loop.faults()
    if faults:
        raise DriveFault(
            f"the drive of axis {request.axis.name} reports {'; '.join(faults)}; clear the cause and reset the "
            "drive, then run again"
        )
    parameters = loop.read_parameters()
    narrowed = tighter(request.axis.limits, {n: v for n, v in parameters.items() if n.startswith(PREFIX)})

    def note(before: Mapping[str, float]) -> None:
        during = {name: float(getattr(narrowed, name.removeprefix(PREFIX), 0.0)) for name in before}
        journal.note(changed={**journal.state.changed, **before}, during={**journal.state.during, **during})

    with (
        limits_guarded(loop, request.axis, note) as held,
        _own_feedforward_off(loop, parameters, note, journal),
    ):
        yield Session(
            axis=request.axis,
            loop=loop,
            limits=held.limits,
            controller=controller_of(parameters),
            identity=dict(loop.identity),
            runs=request.runs,
            directory=journal.directory,
            journal=journal,
            reporter=request.reporter,
            clock=request.clock,
            budget=Budget(held.limits.machine_seconds),
            observers=request.observers,
        )


@contextmanager
def _own_feedforward_off(
    loop: Loop, parameters: Mapping[str, float], note: Callable[[Mapping[str, float]], None], journal: Journal
) -> Iterator[None]:
    """The drive's own feedforward would hide what is measured; a commit of it leaves it as committed."""
    was = own_feedforward(parameters)
    if not was:
        yield
        return
    note(was)
    loop.write_parameters(dict.fromkeys(was, 0.0))
    try:
        yield
    finally:
        written = journal.state.written if journal.state.phase is CommitPhase.KEPT else {}
        if not any(name.startswith("feedforward.") for name in written):
            loop.write_parameters(was)


def acting_feedforward(parameters: Mapping[str, float]) -> tuple[str, ...]:
    """What of a feedforward acts in a drive that holds these parameters, by the names that people read."""
    on = own_feedforward(parameters)
    friction = set(on) - {RIPPLE_GAIN}
    held = [
        name.removeprefix("feedforward.")
        for name, value in parameters.items()
        if name.startswith("feedforward.") and value and name != ENABLED and not is_ripple(name)
    ]
    return (*(in_words(held) if friction else ()), *((TORQUE_RIPPLE.name,) if RIPPLE_GAIN in on else ()))


def own_feedforward(parameters: Mapping[str, float]) -> dict[str, float]:
    """What must be 0 for the drive's own feedforward to be off, with the values that it has now.

    Its switches, where it has them; else every gain of it.
    """
    names = {RIPPLE_GAIN} | ({ENABLED} if ENABLED in parameters else GAINS)
    return {name: value for name, value in parameters.items() if name in names and value}
