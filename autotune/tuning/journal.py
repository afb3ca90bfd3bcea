"""The journal of a run: what has been changed on the drive and not yet put back, on disk at every step.

A run that dies leaves its journal unfinished; the next start reads from it what was left where (see
`recover`). The order is always: write what will be changed, change it, write that it is done. Each note is
written twice, with a checksum and a count, so that one damaged file is no loss; where both are damaged,
nothing moves until a person has looked.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from datetime import datetime
from enum import StrEnum
from pathlib import Path
from typing import Any

from autotune.core.documents import numbers_of, texts_of
from autotune.core.durable import read_checked, read_json, write_checked
from autotune.core.errors import ConfigurationError
from autotune.tuning.results import run_folders

SCHEMA_VERSION = 2
WITHOUT_CHECKSUM = 1
FILE_NAME = "journal.json"
COPY_NAME = "journal.copy.json"
FILES = (COPY_NAME, FILE_NAME)
"""In the order in which they are written."""
ROLLBACK = "rollback"
"""The stage of a rollback; one that is kept ends what the runs before it have committed."""


class CommitPhase(StrEnum):
    """How far a commit has come; anything between NONE and KEPT is put back on the next start."""

    NONE = "none"
    WRITING = "writing"
    STORING = "storing"
    PROVING = "proving"
    KEPT = "kept"
    RESTORED = "restored"


NUMBERS = ("changed", "during", "found", "written")
"""Fields of a state that are values of parameters by name."""


@dataclass(frozen=True, slots=True)
class JournalState:
    """One moment of a run.

    Attributes:
        axis, fingerprint: of the axis file.
        started: local time, ISO 8601.
        process: process id of the run.
        stage: the stage under way.
        changed: parameters changed for the run's duration, with the values to put back.
        during: what they are changed to.
        found: what the drive held instead, where they could not be put back: a line has garbled it.
        backup: id of the backup that the commit rests on, or "".
        phase: how far the commit has come.
        written: what it writes to the drive; of a rollback, what was there before it.
        outcome: "" while the run is under way.
        identity: of the drive, as it tells it; empty before it was asked.
        recovered: what earlier runs left on that drive was put right before anything else was done.
        entry: counts the notes; of two copies the later one holds.
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
    during: Mapping[str, float] = field(default_factory=dict)
    found: Mapping[str, float] = field(default_factory=dict)
    identity: Mapping[str, int | str] = field(default_factory=dict)
    recovered: bool = False
    entry: int = 0

    @property
    def commit_open(self) -> bool:
        """A commit or a rollback has begun and has not come to its end."""
        return self.phase in (CommitPhase.WRITING, CommitPhase.STORING, CommitPhase.PROVING)

    @property
    def left_something(self) -> bool:
        """The drive may not be as it was before the run."""
        return bool(self.changed) or self.commit_open


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
        """Reads a journal, the later of its two copies that are sound.

        Raises:
            ConfigurationError: missing, or both damaged.
        """
        found: list[JournalState] = []
        troubles: list[ConfigurationError] = []
        for name in FILES:
            try:
                found.append(_read(directory / name))
            except ConfigurationError as error:
                troubles.append(error)
        if not found:
            raise troubles[-1]
        return cls(directory, max(found, key=lambda state: state.entry))

    def note(self, **changes: Any) -> None:
        """Changes fields of the state; they are on disk before this returns, and not in `state` otherwise.

        Raises:
            ConfigurationError: the disk does not take it.
        """
        state = replace(self.state, entry=self.state.entry + 1, **changes)
        content = {name: getattr(state, name) for name in JournalState.__dataclass_fields__}
        content |= {name: dict(content[name]) for name in (*NUMBERS, "identity")}
        content |= {"schema": SCHEMA_VERSION, "phase": state.phase.value}
        try:
            for name in FILES:
                write_checked(self.directory / name, content)
        except OSError as error:
            raise ConfigurationError(
                f"the journal {self.directory / FILE_NAME} cannot be written ({error.strerror}); make room or give "
                "write access there, then run again"
            ) from error
        self.state = state

    def close(self, outcome: str) -> None:
        """The run has come to its end and left nothing."""
        self.note(outcome=outcome, changed={}, during={}, found={})


@dataclass(frozen=True, slots=True)
class DamagedJournal:
    """A journal that nobody can read any more, and why."""

    directory: Path
    reason: str

    def set_aside(self) -> None:
        """A person has decided: the files stay to be looked at, under names that nothing reads."""
        for name in FILES:
            path = self.directory / name
            if path.exists():
                path.rename(path.with_suffix(".damaged"))


def journals(runs: Path, axis: str) -> list[Journal | DamagedJournal]:
    """All journals of an axis, newest first by the order in which the runs were made, whatever their clocks.

    A folder without any was cut off before the drive was touched, or a person has removed it.
    """
    found: list[Journal | DamagedJournal] = []
    for directory in run_folders(runs, axis):
        if not any((directory / name).exists() for name in FILES):
            continue
        try:
            journal = Journal.load(directory)
        except ConfigurationError as error:
            found.append(DamagedJournal(directory, str(error)))
            continue
        if journal.state.axis == axis:
            found.append(journal)
    return found


def unfinished(runs: Path, axis: str) -> list[Journal]:
    """Journals of runs on `axis` that did not end by themselves, newest first."""
    return [one for one in journals(runs, axis) if isinstance(one, Journal) and not one.state.outcome]


def _read(path: Path) -> JournalState:
    content = read_json(path, "journal")
    if content.get("schema") != WITHOUT_CHECKSUM:
        content = read_checked(path, "journal")
    schema = content.pop("schema", None)
    if schema not in (WITHOUT_CHECKSUM, SCHEMA_VERSION):
        raise ConfigurationError(
            f"journal {path} has the schema {schema!r}, known are 1 to {SCHEMA_VERSION}; use the autotune that wrote it"
        )
    try:
        return _state(content)
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigurationError(f"journal {path} is damaged: {error}") from error


def _state(content: dict[str, Any]) -> JournalState:
    """Checked value by value: recovery writes these numbers to a drive."""
    texts_of(content, "axis", "fingerprint", "started", "stage", "backup", "outcome")
    if not isinstance(content["process"], int):
        raise ValueError(f"process is {content['process']!r:.40}; it must be a whole number")
    if not isinstance(content.get("identity", {}), dict):
        raise ValueError(f"identity is {content['identity']!r:.40}; it must be a table")
    numbers = {name: numbers_of(content.get(name, {})) for name in NUMBERS}
    return JournalState(**{**content, **numbers, "phase": CommitPhase(content["phase"])})
