"""The journal of a run: what has been changed on the drive and not yet put back, on disk at every step.

A run that dies leaves its journal unfinished; the next start reads from it what was left where (see
`recover`). The order is always: write what will be changed, change it, write that it is done.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

from autotune.core.errors import ConfigurationError
from autotune.service.files import read_json, write_json
from autotune.service.results import run_folders

SCHEMA_VERSION = 1
FILE_NAME = "journal.json"


class CommitPhase(StrEnum):
    """How far a commit has come; anything between NONE and KEPT is put back on the next start."""

    NONE = "none"
    WRITING = "writing"
    STORING = "storing"
    PROVING = "proving"
    KEPT = "kept"
    RESTORED = "restored"


@dataclass(frozen=True, slots=True)
class JournalState:
    """One moment of a run.

    Attributes:
        axis, fingerprint: of the axis file.
        started: local time, ISO 8601.
        process: process id of the run.
        stage: the stage under way.
        changed: parameters changed for the run's duration, with the values to put back.
        backup: id of the backup that the commit rests on, or "".
        phase: how far the commit has come.
        written: what it writes to the drive.
        outcome: "" while the run is under way.
    """

    axis: str
    fingerprint: str
    started: str
    process: int
    stage: str = "start"
    changed: Mapping[str, float] = field(default_factory=dict)
    backup: str = ""
    phase: CommitPhase = CommitPhase.NONE
    written: Mapping[str, float] = field(default_factory=dict)
    outcome: str = ""

    @property
    def left_something(self) -> bool:
        """The drive may not be as it was before the run."""
        open_commit = self.phase in (CommitPhase.WRITING, CommitPhase.STORING, CommitPhase.PROVING)
        return bool(self.changed) or open_commit


class Journal:
    """Keeps a `JournalState` on disk."""

    def __init__(self, directory: Path, state: JournalState) -> None:
        self.directory = directory
        self.state = state

    @classmethod
    def begin(cls, directory: Path, axis: str, fingerprint: str, now: datetime) -> Journal:
        """Starts a journal in an existing directory."""
        journal = cls(
            directory, JournalState(axis, fingerprint, now.isoformat(timespec="seconds"), os.getpid())
        )
        journal.note()
        return journal

    @classmethod
    def load(cls, directory: Path) -> Journal:
        """Reads a journal.

        Raises:
            ConfigurationError: missing or damaged.
        """
        content = read_json(directory / FILE_NAME, "journal")
        content.pop("schema", None)
        content["phase"] = CommitPhase(content["phase"])
        return cls(directory, JournalState(**content))

    def note(self, **changes: Any) -> None:
        """Changes fields of the state and writes it before returning."""
        self.state = replace(self.state, **changes)
        content = {name: getattr(self.state, name) for name in JournalState.__dataclass_fields__}
        content |= {
            "changed": dict(self.state.changed),
            "written": dict(self.state.written),
            "phase": self.state.phase.value,
        }
        write_json(self.directory / FILE_NAME, {"schema": SCHEMA_VERSION, **content})


def unfinished(runs: Path, axis: str) -> list[Journal]:
    """Journals of runs on `axis` that did not end by themselves, newest first.

    A damaged journal is skipped: writing is atomic, so only a foreign hand can have damaged it.
    """
    found: list[Journal] = []
    for directory in run_folders(runs, axis):
        try:
            journal = Journal.load(directory)
        except (ConfigurationError, KeyError, TypeError, ValueError):
            continue
        if journal.state.axis == axis and not journal.state.outcome:
            found.append(journal)
    return found
