"""Back to what a drive held before a commit, with the same care as the commit itself."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime
from pathlib import Path

from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError, IdentityMismatch
from autotune.core.loop import Loop
from autotune.service.backup import Backup, backup_ids, load_backup, take_backup
from autotune.service.commit import feedforward_parameters, put_back
from autotune.service.journal import CommitPhase, Journal
from autotune.service.recover import recover
from autotune.service.run_directory import axis_lock, make_run_directory

SAME_DRIVE = ("vendor", "product", "serial")


def roll_back(
    axis: Axis, open_loop: Callable[[], Loop], runs: Path, now: datetime, identifier: str | None = None
) -> Backup:
    """Writes a backup to the drive and stores it; what was there is backed up first.

    Raises:
        ConfigurationError: no such backup. IdentityMismatch: the backup is of another drive.
        AutotuneError: the drive could not be written; the next start finishes it.
    """
    with axis_lock(runs, axis.name):
        ids = backup_ids(runs, axis.name)
        if not ids:
            raise ConfigurationError(
                f"there is no backup of axis {axis.name} in {runs}; nothing was committed"
            )
        backup = load_backup(runs, axis.name, identifier or ids[-1])
        journal = Journal.begin(make_run_directory(runs, axis.name, now), axis.name, axis.fingerprint, now)
        loop = open_loop()
        try:
            recover(loop, runs, journal)
            _refuse_other_drive(backup, loop)
            take_backup(runs, axis.name, loop.identity, feedforward_parameters(loop), now)
            journal.note(stage="rollback", backup=backup.id, phase=CommitPhase.STORING)
            put_back(loop, backup, journal)
        finally:
            loop.close()
            if not journal.state.left_something:
                journal.note(outcome="kept" if journal.state.phase is CommitPhase.RESTORED else "aborted")
    return backup


def _refuse_other_drive(backup: Backup, loop: Loop) -> None:
    other = [
        f"{name} is {loop.identity[name]} instead of {backup.identity[name]}"
        for name in SAME_DRIVE
        if name in backup.identity and name in loop.identity and loop.identity[name] != backup.identity[name]
    ]
    if other:
        raise IdentityMismatch(
            f"backup {backup.id} is of another drive ({'; '.join(other)}); choose another one with --to"
        )
