"""What a killed run left behind, and how it is put right before anything else is done."""

from __future__ import annotations

from pathlib import Path

from autotune.core.loop import Loop
from autotune.service.backup import load_backup
from autotune.service.commit import put_back, verify, write_verified
from autotune.service.journal import CommitPhase, Journal, unfinished


def describe(journal: Journal) -> str:
    """One sentence on what the run left."""
    state = journal.state
    left = []
    if state.changed:
        left.append(f"{', '.join(state.changed)} changed for the run")
    if state.phase in (CommitPhase.WRITING, CommitPhase.STORING, CommitPhase.PROVING):
        left.append(f"a commit in phase '{state.phase.value}' on backup {state.backup}")
    what = " and ".join(left) or "nothing on the drive"
    return f"the run of {state.started} ended in stage '{state.stage}' without closing; it left {what}"


def recover(loop: Loop, runs: Path, own: Journal) -> list[str]:
    """Puts right what runs before `own` left on its axis, newest first; returns what was done, in words.

    The newest unfinished run decides: an older one's changes were put right, or overlaid, by it.

    Raises:
        AutotuneError: the drive could not be restored; the journals stay open.
    """
    done: list[str] = []
    for journal in unfinished(runs, own.state.axis):
        if journal.directory == own.directory:
            continue
        sentence = describe(journal)
        if journal.state.left_something:
            _restore(loop, runs, journal)
            sentence += "; put back"
        journal.note(outcome="aborted", changed={})
        done.append(sentence)
    return done


def _restore(loop: Loop, runs: Path, journal: Journal) -> None:
    if journal.state.phase in (CommitPhase.WRITING, CommitPhase.STORING, CommitPhase.PROVING):
        put_back(loop, load_backup(runs, journal.state.axis, journal.state.backup), journal)
    if journal.state.changed:
        write_verified(loop, journal.state.changed)
        verify(loop, journal.state.changed)
