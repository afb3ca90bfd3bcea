"""Back to what a drive held before a commit, with the same care as the commit itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path

from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError, IdentityMismatch
from autotune.core.loop import Loop
from autotune.core.ripple_parameters import alignment_of
from autotune.tuning.backup import Backup, backup_ids, load_backup, take_backup
from autotune.tuning.commit import must_be_aligned, parameters_beside, put_back
from autotune.tuning.journal import ROLLBACK, CommitPhase, DamagedJournal, Journal
from autotune.tuning.recovery import backup_of, damaged_journals, describe, open_journals, put_right
from autotune.tuning.run_directory import axis_lock, make_run_directory
from autotune.tuning.same_drive import differences


def roll_back(
    axis: Axis,
    open_loop: Callable[[], Loop],
    runs: Path,
    now: datetime,
    identifier: str | None = None,
    tell: Callable[[str], None] = lambda sentence: None,
) -> Backup:
    """Writes a backup to the drive and stores it; what was there is backed up first.

    A rollback is a person's word: afterwards journals that are damaged, that rest on a damaged backup, or that the
    drive does not fit, are closed. `identifier`: the newest backup of this drive where it is None. `tell`: hears what
    was put right.

    Raises:
        ConfigurationError: no such backup. IdentityMismatch: the backup is of another drive.
        AutotuneError: the drive could not be written; the next start finishes it.
    """
    with axis_lock(runs, axis.name):
        _must_be_there(runs, axis, identifier)
        journal = Journal.begin(make_run_directory(runs, axis.name, now), axis.name, axis.fingerprint, now)
        loop = open_loop()
        try:
            journal.note(identity=dict(loop.identity))
            backup = _chosen(runs, axis, identifier, loop.identity)
            doubtful = _recovered(loop, runs, journal, tell)
            must_be_aligned(loop, backup)
            present = parameters_beside(loop, backup.parameters)
            zero = alignment_of(loop.read_parameters())
            take_backup(runs, axis.name, loop.identity, present, now, zero)
            journal.note(stage=ROLLBACK, backup=backup.id, phase=CommitPhase.STORING, written=present)
            put_back(loop, backup, journal)
            _settle(doubtful, tell)
            journal.note(recovered=True)
        finally:
            try:
                loop.close()
            finally:
                if not journal.state.left_something:
                    journal.note(outcome="kept" if journal.state.phase is CommitPhase.RESTORED else "aborted")
    return backup


def _must_be_there(runs: Path, axis: Axis, identifier: str | None) -> None:
    """Before the drive is touched. Raises ConfigurationError."""
    if not backup_ids(runs, axis.name):
        raise ConfigurationError(f"there is no backup of axis {axis.name} in {runs}; nothing was committed")
    if identifier is not None:
        load_backup(runs, axis.name, identifier)


def _chosen(runs: Path, axis: Axis, identifier: str | None, identity: Mapping[str, int | str]) -> Backup:
    """The backup asked for, or the newest of this drive."""
    other: list[str] = []
    for one in [identifier] if identifier else reversed(backup_ids(runs, axis.name)):
        backup = load_backup(runs, axis.name, one)
        wrong = differences(backup.identity, identity)
        if not wrong:
            return backup
        other = other or [backup.id, *wrong]
    raise IdentityMismatch(
        f"backup {other[0]} is of another drive ({'; '.join(other[1:])}); nothing was written. Choose another one with "
        f"--to, or connect the drive that it is of. There are: {', '.join(backup_ids(runs, axis.name)[-5:])}"
    )


def _recovered(
    loop: Loop, runs: Path, own: Journal, tell: Callable[[str], None]
) -> list[Journal | DamagedJournal]:
    """Puts right what fits; what a person's word is needed for is returned."""
    doubtful: list[Journal | DamagedJournal] = list(damaged_journals(loop, runs, own))
    for journal in open_journals(runs, own):
        try:
            backup_of(runs, journal)
        except ConfigurationError as error:
            tell(f"{describe(journal)}, which cannot be put back: {error}")
            if not differences(journal.state.identity, loop.identity):
                doubtful.append(journal)
            continue
        sentence, wrong = put_right(loop, runs, journal)
        tell(f"{sentence}; the drive has been changed since ({'; '.join(wrong)})" if wrong else sentence)
        if wrong:
            doubtful.append(journal)
    return doubtful


def _settle(doubtful: list[Journal | DamagedJournal], tell: Callable[[str], None]) -> None:
    for journal in doubtful:
        if isinstance(journal, DamagedJournal):
            journal.set_aside()
            tell(f"the damaged journal in {journal.directory} is settled by this rollback and set aside")
        else:
            left = ", ".join(f"{name} = {value:.9g}" for name, value in journal.state.changed.items())
            if left:
                tell(f"not put back; before that run the drive held {left}")
            journal.note(outcome="aborted", phase=CommitPhase.RESTORED, changed={}, during={})
