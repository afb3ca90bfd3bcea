"""Which run the drive should be running with: the newest that was kept and not rolled back since."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from autotune.core.axis import Axis
from autotune.core.errors import ConfigurationError
from autotune.core.ripple_parameters import moved
from autotune.models.drive_model import DriveModel
from autotune.models.model_file import read_model
from autotune.tuning.accepted import accepted_since
from autotune.tuning.commit import RELATIVE_RESOLUTION
from autotune.tuning.journal import ROLLBACK
from autotune.tuning.results import run_folders, run_results
from autotune.tuning.stage_prove import ENABLED


@dataclass(frozen=True, slots=True)
class Committed:
    """What the drive should be running with.

    Attributes:
        run: name of the run's folder that was committed.
        peak_error: on the benchmark, as re-measured after the commit [motion unit]; None if not known.
        parameters: feedforward parameters written.
        accepted: a later run that found nothing better; model and peak error are then its own. "" for none.
        alignment: what moves the zero of the ripple among them, as it was; empty where there is none.
    """

    run: str
    peak_error: float | None
    parameters: dict[str, float]
    accepted: str = ""
    alignment: Mapping[str, float] = field(default_factory=dict)

    @property
    def baseline(self) -> str:
        """The run that checks compare with."""
        return self.accepted or self.run

    def as_json(self) -> dict[str, str | float | None]:
        """As in check.json."""
        return {"run": self.run, "peak_error": self.peak_error, "accepted": self.accepted or None}


@dataclass(frozen=True, slots=True)
class InForce:
    """What is committed, its model, and whether the drive holds it. All None where nothing is."""

    committed: Committed | None = None
    model: DriveModel | None = None
    held: bool | None = None


def in_force(runs: Path, axis: Axis, held: Mapping[str, float]) -> InForce:
    """What is committed to the axis, given the drive's parameters.

    The newest kept run counts; after a rollback, the newest kept run that the drive agrees with. The model is
    that of a later run where drift was accepted since.
    """
    kept, rolled_back = _kept_runs(runs, axis)
    if rolled_back:
        kept = [(path, one) for path, one in kept if _agrees(one.parameters, held)]
    if not kept:
        return InForce()
    path, committed = kept[0]
    holds = _agrees(committed.parameters, held) and not moved(committed.alignment, held)
    accepted = accepted_since(runs, axis, committed.run)
    if accepted is not None:
        path = accepted.directory
        peak = max(accepted.peak_error, committed.peak_error or 0.0)
        committed = replace(committed, accepted=path.name, peak_error=peak)
    return InForce(committed, _model(runs, axis, path), holds)


def _kept_runs(runs: Path, axis: Axis) -> tuple[list[tuple[Path, Committed]], bool]:
    """Kept runs, newest first, and whether a rollback came after the newest of them."""
    kept: list[tuple[Path, Committed]] = []
    newest_kept = ""
    for directory, content in run_results(runs, axis.name, "run.json"):
        if content.get("outcome") == "kept" and content.get("fingerprint") == axis.fingerprint:
            kept.append((directory, _committed(directory, content)))
            newest_kept = newest_kept or directory.name
    rolled_back = any(
        directory.name > newest_kept and content.get("stage") == ROLLBACK and content.get("outcome") == "kept"
        for directory, content in run_results(runs, axis.name, "journal.json")
    )
    return kept, rolled_back


def _committed(directory: Path, content: Mapping[str, Any]) -> Committed:
    measured = content.get("committed") or content.get("after") or {}
    if (content.get("reduction") or {}).get("host"):
        measured = {}  # with what the host played beside the drive, which no check plays
    return Committed(
        directory.name,
        measured.get("peak_error"),
        dict(content.get("feedforward") or {}) | {ENABLED: 1.0},
        alignment=(content.get("in_drive") or {}).get("alignment") or {},
    )


def _agrees(wanted: Mapping[str, float], held: Mapping[str, float]) -> bool:
    shared = [name for name in wanted if name in held]
    return bool(shared) and all(
        abs(held[name] - wanted[name]) <= RELATIVE_RESOLUTION * max(abs(wanted[name]), 1e-6)
        for name in shared
    )


def _model(runs: Path, axis: Axis, kept: Path) -> DriveModel | None:
    """The model of the kept run, or of the newest run before it that has one."""
    for directory in run_folders(runs, axis.name):
        if directory.name > kept.name or not (directory / "model.toml").is_file():
            continue
        try:
            return read_model(directory / "model.toml")
        except ConfigurationError:
            continue
    return None
