"""A job as an order and as a result, and what of it is on disk, so that a killed service knows how far it came."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from autotune.core.errors import ConfigurationError
from autotune.tuning.files import read_json, write_json
from autotune.tuning.journal import CommitPhase, Journal
from autotune.tuning.results import run_results

DONE = "done"
ENABLED = "feedforward.enabled"


@dataclass(frozen=True, slots=True)
class Order:
    """A job as the worker gets it. `options`: `only`, `to`, `proposal`, `automatic`, `drift`, `idle`,
    `effects`, `model`."""

    id: str
    axis: str
    kind: str
    file: str
    runs: str
    options: Mapping[str, Any] = field(default_factory=dict)

    def as_json(self) -> dict[str, Any]:
        return asdict(self) | {"options": dict(self.options)}


@dataclass(frozen=True, slots=True)
class Done:
    """How a job ended. `run`: name of the folder that it left; `asked`: what a person has to approve, or ""."""

    outcome: str
    exit_code: int
    sentence: str
    run: str = ""
    asked: str = ""

    def as_json(self) -> dict[str, Any]:
        return asdict(self)


def result_file(runs: Path, identifier: str) -> Path:
    """Where the worker writes how the job ended."""
    return runs / ".service" / "jobs" / f"{identifier}.json"


def write_begun(order: Order, process: int, now: datetime) -> None:
    """Notes, before anything is done, which process works on the job; what an attempt before it came to is past."""
    result = result_file(Path(order.runs), order.id)
    path = result.with_suffix(".begun.json")
    path.parent.mkdir(parents=True, exist_ok=True)
    result.unlink(missing_ok=True)
    write_json(path, {"process": process, "at": now.isoformat(timespec="seconds")})


def write_done(order: Order, done: Done) -> None:
    """Writes how the job ended, before anybody is told."""
    path = result_file(Path(order.runs), order.id)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_json(path, {"job": order.as_json(), **done.as_json()})


def read_done(runs: Path, identifier: str) -> Done | None:
    """How the job ended, if its worker came that far."""
    try:
        content = read_json(result_file(runs, identifier), "job")
        asked = content.get("asked", "")
        return Done(content["outcome"], content["exit_code"], content["sentence"], content["run"], asked)
    except (ConfigurationError, KeyError):
        return None


def salvage(runs: Path, axis: str, identifier: str) -> Done | None:
    """A run whose worker died after the drive had kept the parameters: it counts, and is completed on disk."""
    try:
        begun = read_json(result_file(runs, identifier).with_suffix(".begun.json"), "job")
    except ConfigurationError:
        return None
    for directory, content in run_results(runs, axis, "journal.json"):
        if content.get("process") != begun.get("process") or content.get("started", "") < begun["at"]:
            continue
        try:
            return _salvaged(directory, Journal.load(directory))
        except (ConfigurationError, KeyError, TypeError, ValueError):
            return None  # a damaged file; the job is done again
    return None


def _salvaged(directory: Path, journal: Journal) -> Done | None:
    state = journal.state
    if (directory / "check.json").is_file():
        content = read_json(directory / "check.json", "check")
        return Done(DONE, 0, content["verdict"], directory.name)
    if state.phase is not CommitPhase.KEPT:
        return None
    sentence = (
        "Kept: the drive holds the proved parameters; the run was cut off before its report was written."
    )
    if not (directory / "run.json").is_file():
        content = {
            "schema": 1, "outcome": "kept", "verdict": sentence, "axis": state.axis, "fingerprint": state.fingerprint,
            "started": state.started, "machine_seconds": 0.0, "run_directory": str(directory),
            "before": None, "after": None, "committed": None, "parameters": {},
            "feedforward": {name: value for name, value in state.written.items() if name != ENABLED},
        }  # fmt: skip
        write_json(directory / "run.json", content)
    if not state.changed:
        journal.note(outcome="kept")
    return Done("kept", 0, sentence, directory.name)
