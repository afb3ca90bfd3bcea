"""Fixed parameters into the drive, as a transaction: all of them, proved, or everything as it was.

Backup → write → read back → store → re-measure → keep. The journal names the phase before it begins,
so that a commit cut anywhere is recognised and put back on the next start. Doubt means back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from datetime import datetime
from pathlib import Path

from autotune.core.errors import AutotuneError, ConfigurationError, DriveError
from autotune.core.loop import Loop
from autotune.core.ripple_parameters import GAIN, alignment_of, is_ripple, moved
from autotune.tuning.backup import Backup, take_backup
from autotune.tuning.journal import CommitPhase, Journal

RELATIVE_RESOLUTION = 1e-4
SWITCHES = ("feedforward.enabled", GAIN)
"""What is off while the rest is written."""
COARSEST = 0.02  # a drive whose parameters have whole steps may hold this much beside what is wanted


def feedforward_parameters(loop: Loop) -> dict[str, float]:
    """What the drive's own feedforward holds now; empty where it has none."""
    return parameters_beside(loop, ["feedforward.enabled"])


def parameters_beside(loop: Loop, names: Iterable[str]) -> dict[str, float]:
    """What the drive holds now in the groups (`feedforward.`, `controller.`) that the names belong to."""
    groups = {name.partition(".")[0] for name in names}
    return {name: value for name, value in loop.read_parameters().items() if name.partition(".")[0] in groups}


def commit(
    loop: Loop,
    values: Mapping[str, float],
    journal: Journal,
    store: Path,
    now: datetime,
    proves: Callable[[], bool],
) -> bool:
    """Writes `values`, stores them, and keeps them if `proves` says so afterwards.

    Args:
        loop: at rest.
        values: complete set of feedforward parameters, or of the controller's gains, SI.
        journal: of this run; what it has changed for the run's duration is backed up with its old value.
        store: folder below which backups are kept.
        now: local time, for the backup's id.
        proves: re-measures the axis with the parameters in force.

    Returns:
        True where the parameters were kept, False where everything was put back.

    Raises:
        ConfigurationError: the drive does not know a parameter; nothing has been written then.
        AutotuneError: whatever ended it, after everything was put back as far as the link allows.
    """
    present = parameters_beside(loop, values)
    present |= {name: value for name, value in journal.state.changed.items() if name in present}
    unknown = sorted(set(values) - set(present))
    if unknown:
        raise ConfigurationError(
            f"the drive cannot hold {', '.join(unknown)}; it holds {', '.join(present) or 'none'}"
        )
    zero = alignment_of(loop.read_parameters())
    backup = take_backup(store, journal.state.axis, loop.identity, present, now, zero)
    journal.note(
        identity=dict(loop.identity), backup=backup.id, phase=CommitPhase.WRITING, written=dict(values)
    )
    try:
        values = write_verified(loop, values)
        journal.note(phase=CommitPhase.STORING, written=values)
        store_as_before(loop, journal)
        verify(loop, values)
        journal.note(phase=CommitPhase.PROVING)
        kept = proves()
        if kept:
            committed = {name: value for name, value in journal.state.changed.items() if name not in values}
            journal.note(phase=CommitPhase.KEPT, changed=committed)
    except BaseException:
        put_back(loop, backup, journal)
        raise
    if not kept:
        put_back(loop, backup, journal)
    return kept


def write_verified(loop: Loop, values: Mapping[str, float]) -> dict[str, float]:
    """Writes with the block switched off, and switches it as asked only when all else is right.

    Returns what the drive holds then: `values`, rounded to its resolution.

    Raises:
        DriveError: it holds something else.
    """
    switches = {name: values[name] for name in SWITCHES if name in values}
    for name in switches:
        if loop.read_parameters([name])[name]:
            loop.write_parameters({name: 0.0})
    rest = {name: value for name, value in values.items() if name not in switches}
    loop.write_parameters(rest)
    verify(loop, rest, COARSEST)
    loop.write_parameters(switches)
    return verify(loop, values, COARSEST)


def store_as_before(loop: Loop, journal: Journal) -> None:
    """Stores with the limits, and what else is not part of the commit, as they were before the run.

    What a run narrows or switches off for its own duration must not survive it.
    """
    groups = {name.partition(".")[0] for name in journal.state.written}
    before = {n: v for n, v in journal.state.changed.items() if n.partition(".")[0] not in groups}
    if not before:
        loop.store()
        return
    narrowed = loop.read_parameters(list(before))
    loop.write_parameters(before)
    try:
        loop.store()
    finally:
        loop.write_parameters(narrowed)


def verify(
    loop: Loop, values: Mapping[str, float], resolution: float = RELATIVE_RESOLUTION
) -> dict[str, float]:
    """Reads back; what the drive holds.

    Raises:
        DriveError: the drive holds something else than was written.
    """
    held = loop.read_parameters(list(values))
    wrong = [
        f"{name} is {held.get(name)!r} instead of {value!r}"
        for name, value in values.items()
        if name not in held or abs(held[name] - value) > resolution * max(abs(value), 1e-6)
    ]
    if wrong:
        raise DriveError(
            f"the drive does not hold what was written: {'; '.join(wrong)}. Nothing is kept; check the "
            "drive's firmware version against the profile"
        )
    return held


def must_be_aligned(loop: Loop, backup: Backup) -> None:
    """Ripple acts from the drive's commutation: where that has moved, what was held before acts at the wrong places.

    Raises:
        ConfigurationError: the backup holds ripple, and the commutation is not what it was then.
    """
    holds = any(value for name, value in backup.parameters.items() if is_ripple(name) and name != GAIN)
    if not (backup.alignment and holds and backup.parameters.get(GAIN)):
        return
    changed = moved(backup.alignment, loop.read_parameters(list(backup.alignment)))
    if changed:
        raise ConfigurationError(
            f"backup {backup.id} holds torque over position that was aligned with another commutation "
            f"({'; '.join(changed)}): it would act at the wrong places. Nothing of it was written. Set the commutation "
            "back, or run 'autotune run' anew, which aligns it"
        )


def put_back(loop: Loop, backup: Backup, journal: Journal) -> None:
    """Writes and stores the backup, then closes the transaction in the journal.

    Raises:
        DriveError: the drive could not be restored now, or the journal cannot say that it was; it stays open
            for the next start. ConfigurationError: see `must_be_aligned`.
    """
    must_be_aligned(loop, backup)
    try:
        write_verified(loop, backup.parameters)
        if journal.state.phase is not CommitPhase.WRITING:
            store_as_before(loop, journal)
    except AutotuneError as error:
        raise DriveError(
            f"backup {backup.id} of axis {backup.axis} could not be put back ({error}); the next "
            "'autotune run' or 'autotune rollback' of this axis will do it: do not run the machine before"
        ) from error
    try:
        journal.note(phase=CommitPhase.RESTORED)
    except ConfigurationError as error:
        raise DriveError(
            f"backup {backup.id} of axis {backup.axis} was put back, but {error}. The next start puts it back once more"
        ) from error
