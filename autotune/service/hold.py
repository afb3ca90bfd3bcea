"""Taking hold of an axis: an open link, limits in the drive, its own feedforward off; all put back after."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from autotune.core.axis import Axis
from autotune.core.errors import AutotuneError, DriveFault
from autotune.core.loop import Loop
from autotune.experiments.limits_guarded import limits_guarded
from autotune.experiments.runner import Budget
from autotune.service.commit import verify
from autotune.service.journal import CommitPhase, Journal
from autotune.service.progress import Reporter
from autotune.service.session import LabelledWatch, Session, controller_of
from autotune.service.stage_prove import ENABLED

GAINS = frozenset(f"feedforward.{name}" for name in ("inertia", "viscous", "coulomb", "offset"))


@dataclass(frozen=True)
class Hold:
    """What is needed to take hold of an axis.

    Attributes:
        open_loop: opens the axis's link.
        runs: folder of all runs.
        reporter: hears how it goes; `clock`: local time.
        viewers: further watches on the samples.
    """

    axis: Axis
    open_loop: Callable[[], Loop]
    runs: Path
    reporter: Reporter
    clock: Callable[[], datetime]
    viewers: Sequence[LabelledWatch] = ()


@contextmanager
def connected(open_loop: Callable[[], Loop], journal: Journal, reporter: Reporter) -> Iterator[Loop]:
    """The open link; at the end it is verified that the drive is as it was, else the journal stays open."""
    loop = open_loop()
    try:
        yield loop
    finally:
        try:
            if journal.state.changed:
                verify(loop, journal.state.changed)
                journal.note(changed={})
        except AutotuneError as error:
            reporter.say(f"not everything could be put back ({error}); the next run will do it")
        finally:
            loop.close()


@contextmanager
def prepared(hold: Hold, loop: Loop, journal: Journal) -> Iterator[Session]:
    """Limits in the drive, its own feedforward off; both as before when the block ends."""
    faults = loop.faults()
    if faults:
        raise DriveFault(
            f"the drive of axis {hold.axis.name} reports {'; '.join(faults)}; clear the cause and reset the "
            "drive, then run again"
        )
    parameters = loop.read_parameters()

    def note(before: Mapping[str, float]) -> None:
        journal.note(changed={**journal.state.changed, **before})

    with limits_guarded(loop, hold.axis, note) as held, _own_feedforward_off(loop, parameters, note, journal):
        yield Session(
            axis=hold.axis,
            loop=loop,
            limits=held.limits,
            controller=controller_of(parameters),
            identity=dict(loop.identity),
            runs=hold.runs,
            directory=journal.directory,
            journal=journal,
            reporter=hold.reporter,
            clock=hold.clock,
            budget=Budget(held.limits.machine_seconds),
            viewers=hold.viewers,
        )


@contextmanager
def _own_feedforward_off(
    loop: Loop, parameters: Mapping[str, float], note: Callable[[Mapping[str, float]], None], journal: Journal
) -> Iterator[None]:
    """The drive's own feedforward would hide what is measured; a commit leaves it as committed."""
    was = own_feedforward(parameters)
    if not was:
        yield
        return
    note(was)
    loop.write_parameters(dict.fromkeys(was, 0.0))
    try:
        yield
    finally:
        if journal.state.phase is not CommitPhase.KEPT:
            loop.write_parameters(was)


def own_feedforward(parameters: Mapping[str, float]) -> dict[str, float]:
    """What must be 0 for the drive's own feedforward to be off, with the values that it has now.

    Its switch, where it has one; else every gain of it.
    """
    if ENABLED in parameters:
        return {ENABLED: parameters[ENABLED]} if parameters[ENABLED] else {}
    return {name: value for name, value in parameters.items() if name in GAINS and value}
