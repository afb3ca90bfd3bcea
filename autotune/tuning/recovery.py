"""What a killed run left behind, and how it is put right before anything else is done.

Nothing is written unless the drive that answers is the journal's, and holds what that run can have left:
each parameter as it was before, as it was being written, or as the run itself found it at its end. Else
somebody has been there in between, and a person decides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from autotune.core.errors import ConfigurationError, DriveError
from autotune.core.loop import Loop
from autotune.tuning.backup import Backup, backup_ids, load_backup
from autotune.tuning.commit import COARSEST, RELATIVE_RESOLUTION, SWITCHES, put_back, verify, write_verified
from autotune.tuning.journal import ROLLBACK, CommitPhase, DamagedJournal, Journal, journals
from autotune.tuning.kept_run import complete
from autotune.tuning.same_drive import differences, named


def describe(journal: Journal) -> str:
    """One sentence on what the run left."""
    state = journal.state
    left = ["a commit that was kept"] if state.phase is CommitPhase.KEPT else []
    if state.changed:
        left.append(f"{', '.join(state.changed)} changed for the run")
    if state.commit_open:
        left.append(f"a commit in phase '{state.phase.value}' on backup {state.backup}")
    what = " and ".join(left) or "nothing on the drive"
    return f"the run of {state.started} ended in stage '{state.stage}' without closing; it left {what}"


def recover(loop: Loop, runs: Path, own: Journal) -> list[str]:
    """Puts right what runs before `own` left on its drive, newest first; returns what was done, in words.

    What was left on another drive stays open until that drive is back.

    Raises:
        ConfigurationError: a journal is damaged; nothing was written.
        DriveError: the drive holds what no run of ours has left; nothing was written.
        AutotuneError: the drive could not be restored; the journals stay open.
    """
    damaged = damaged_journals(loop, runs, own)
    if damaged:
        raise ConfigurationError(_look(damaged[0], runs, own.state.axis))
    done = []
    for journal in open_journals(runs, own):
        sentence, wrong = put_right(loop, runs, journal)
        if wrong:
            raise DriveError(f"{sentence}; {_decide(journal, wrong)}")
        done.append(sentence)
    done += getattr(loop, "left", ())
    own.note(recovered=True)
    return done


def open_journals(runs: Path, own: Journal) -> list[Journal]:
    """Those before `own` that have not been closed, newest first."""
    return [
        journal
        for journal in journals(runs, own.state.axis)
        if isinstance(journal, Journal) and not journal.state.outcome and journal.directory != own.directory
    ]


def damaged_journals(loop: Loop, runs: Path, own: Journal) -> list[DamagedJournal]:
    """Those that nobody can read, newest first, as far as no later run has found this drive in order."""
    found: list[DamagedJournal] = []
    for journal in journals(runs, own.state.axis):
        if isinstance(journal, DamagedJournal):
            found.append(journal)
        elif journal.directory != own.directory and _cleared(journal, loop.identity):
            break
    return found


def _cleared(journal: Journal, identity: Mapping[str, int | str]) -> bool:
    state = journal.state
    return state.recovered and bool(state.identity) and not differences(state.identity, identity)


def put_right(loop: Loop, runs: Path, journal: Journal) -> tuple[str, list[str]]:
    """Puts right what one run left, and closes its journal; what was done, in words.

    Also returns what does not fit: where there is anything, nothing was written, and the journal stays open.
    """
    sentence = describe(journal)
    if not journal.state.left_something:
        _close(journal)
        return sentence, []
    backup = backup_of(runs, journal)
    meant = journal.state.identity or (backup.identity if backup else {})
    other = differences(meant, loop.identity)
    if other:
        return (
            f"{sentence}, on the drive with {named(meant)}. The drive here is another one ({'; '.join(other)}): "
            "nothing of that was written to it. It is put back when that drive is connected again; where it "
            f"will not be, delete the journal files (journal*.json) in {journal.directory}"
        ), []
    wrong = misfits(journal, backup, loop.read_parameters())
    if wrong:
        return sentence, wrong
    if backup is not None:
        put_back(loop, backup, journal)
    if journal.state.changed:
        write_verified(loop, journal.state.changed)
        verify(loop, journal.state.changed)
    _close(journal)
    return f"{sentence}; put back", []


def _close(journal: Journal) -> None:
    """A run that had kept its parameters counts as kept, and its record is completed; so does a finished rollback."""
    state = journal.state
    kept = state.phase is CommitPhase.KEPT
    if kept:
        complete(journal.directory, state)
    rolled_back = state.stage == ROLLBACK and state.phase is CommitPhase.RESTORED
    journal.close("kept" if kept or rolled_back else "aborted")


def misfits(journal: Journal, backup: Backup | None, held: Mapping[str, float]) -> list[str]:
    """Parameters that hold neither what was there before the run nor what it was writing, in words."""
    state = journal.state
    before = [state.changed, *([backup.parameters] if backup else [])]
    after = [state.during, state.found, *([state.written] if backup else [])]
    names = dict.fromkeys(name for values in before for name in values)
    wrong = []
    for name in names:
        old = [values[name] for values in before if name in values]
        new = [values[name] for values in after if name in values]
        if name in SWITCHES:
            new.append(0.0)  # off while the rest is written
        if name not in held:
            wrong.append(f"{name} is not there any more")
        elif not (_among(held[name], old, RELATIVE_RESOLUTION) or _among(held[name], new, COARSEST)):
            told = " or ".join(dict.fromkeys(f"{value:.9g}" for value in (*old, *new)))
            wrong.append(f"{name} is {held[name]:.9g} instead of {told}")
    return wrong


def _among(one: float, values: Sequence[float], resolution: float) -> bool:
    return any(abs(one - value) <= resolution * max(abs(value), 1e-6) for value in values)


def backup_of(runs: Path, journal: Journal) -> Backup | None:
    """What an open commit rests on. Raises ConfigurationError where it cannot be read."""
    state = journal.state
    return load_backup(runs, state.axis, state.backup) if state.commit_open else None


def _decide(journal: Journal, wrong: list[str]) -> str:
    """What a person may do about a drive that somebody else has written to."""
    state = journal.state
    if state.commit_open:
        back = f"'autotune rollback' of this axis with --to {state.backup} puts back what it held before"
    else:
        values = ", ".join(f"{name} = {value:.9g}" for name, value in state.changed.items())
        back = f"before the run it held {values}: set that by hand if you want it back"
    return (
        f"but the drive holds what no run has written ({'; '.join(wrong)}): somebody has changed it since. Nothing "
        f"was written and nothing moves. {back}; to keep what is there now, delete the journal files (journal*.json) "
        f"in {journal.directory}"
    )


def _look(damaged: DamagedJournal, runs: Path, axis: str) -> str:
    """What a person may do about a journal that cannot be read."""
    ids = backup_ids(runs, axis)
    back = (
        f"compare the drive's parameters with backup {runs / 'backups' / axis / ids[-1]}.json; 'autotune rollback' of "
        "this axis puts that back and settles the matter"
        if ids
        else "nothing was ever committed to this axis, so compare the drive's limits with those you have set"
    )
    return (
        f"{damaged.reason}. That run may have left a commit unproved or limits changed, and nobody can tell any more: "
        f"nothing was written and nothing moves. Look at it first: {back}; where the drive is right as it is, delete "
        f"the journal files (journal*.json) in {damaged.directory}"
    )
