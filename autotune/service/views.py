"""What the API shows, as data: axes, jobs, models and recordings by id. No name from a request becomes a path."""

from __future__ import annotations

import hashlib
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, Field

from autotune.models.table import EFFECTS
from autotune.service.manager import Manager
from autotune.service.settings import WatchedAxis
from autotune.service.store import Row, job_view, text
from autotune.tuning.results import run_folders


class Problem(BaseModel):
    """Every refusal."""

    detail: str


class Job(BaseModel):
    """A job and how far it is."""

    id: str
    axis: str
    kind: str
    state: str
    origin: str
    created: str
    due: str | None = None
    started: str | None = None
    finished: str | None = None
    attempts: int = 0
    outcome: str | None = None
    exit_code: int | None = None
    sentence: str | None = None
    run: str | None = None
    stage: str | None = None
    fraction: float | None = None
    waits_for: str | None = None


class AxisView(BaseModel):
    """An axis and its state. `held`: the service has its link, no other program."""

    name: str
    fingerprint: str
    motion_unit: str
    link: str
    state: str
    held: bool
    job: Job | None = None
    next_check: str | None = None
    idle_until: str | None = None
    last_check: dict[str, Any] | None = None


class HistoryView(BaseModel):
    """Checks, runs, events of an axis, and what the trend says. `sentences` are for people."""

    axis: str
    sentences: list[str]
    changes: list[dict[str, Any]]
    temperature_coefficient: float | None
    checks: list[dict[str, Any]]
    runs: list[dict[str, Any]]
    parameters: dict[str, list[dict[str, Any]]]
    events: list[dict[str, Any]]


class FileView(BaseModel):
    """A model or a recording."""

    id: str
    axis: str
    run: str
    name: str
    bytes: int


class ModelView(FileView):
    """A model with its text."""

    toml: str


class Proposal(BaseModel):
    """A proved commit that waits, or waited, for a person."""

    id: str
    axis: str
    run: str
    created: str
    state: str
    decided: str | None = None
    sentence: str


MOST_MODEL = 200_000
"""Characters of a model; one with every effect has about ten thousand."""


def _known_effect(name: str) -> str:
    if name not in EFFECTS:
        raise ValueError(f"there is no effect {name[:40]!r}; there are {', '.join(EFFECTS)}")
    return name


EffectName = Annotated[str, AfterValidator(_known_effect)]


class _Wish(BaseModel):
    model_config = {"extra": "forbid"}


class StartCheck(_Wish):
    """A gentle look."""

    kind: Literal["check"]


class StartRun(_Wish):
    """A tuning run. `commit`: is a person asked before anything is kept; without it as the service file says.

    `model`: TOML of one that goes to the proof in place of the diagnosed one.
    """

    kind: Literal["run"]
    commit: Literal["automatic", "ask"] | None = None
    model: str | None = Field(None, max_length=MOST_MODEL)


class StartRollback(_Wish):
    """What the drive held before. `to`: backup id; without it the newest."""

    kind: Literal["rollback"]
    to: str | None = Field(default=None, pattern=r"^[0-9]{8}-[0-9]{6}-[0-9]{1,3}$")


class StartDecide(_Wish):
    """A minute of motion at most that tells effects apart: those that a diagnosis leaves in doubt; none: any."""

    kind: Literal["decide"]
    effects: list[EffectName] = Field(default_factory=list, max_length=len(EFFECTS))


Start = Annotated[StartCheck | StartRun | StartRollback | StartDecide, Field(discriminator="kind")]


class IdleFor(BaseModel):
    """The machine is idle for so many minutes from now; 0: it is not."""

    model_config = {"extra": "forbid"}

    minutes: float = Field(ge=0, le=7 * 24 * 60, strict=True)


def view_job(manager: Manager, row: Row) -> dict[str, Any]:
    """A job as the API shows it."""
    shown = {name: value for name, value in job_view(row).items() if name in Job.model_fields}
    running = manager.running.get(row["id"])
    if running is not None:
        shown |= {"stage": running.stage, "fraction": running.fraction}
    if row["state"] == "queued":
        shown["waits_for"] = manager.waits_for(row["id"]) or None
    return shown


def view_axis(manager: Manager, watched: WatchedAxis) -> dict[str, Any]:
    """An axis as the API shows it."""
    axis = watched.axis
    mine = [job for job in manager.store.jobs_in("running", "queued") if job["axis"] == axis.name]
    last = manager.store.last_check(axis.name)
    until = manager.store.permitted_until(axis.name)
    next_check = manager.next_check(axis.name)
    return {
        "name": axis.name,
        "fingerprint": axis.fingerprint,
        "motion_unit": axis.motion_unit,
        "link": axis.link,
        "state": mine[0]["state"] if mine else "idle",
        "held": manager.owns(axis.name),
        "job": view_job(manager, mine[0]) if mine else None,
        "next_check": text(next_check) if next_check else None,
        "idle_until": text(until) if until and until > manager.now() else None,
        "last_check": view_check(last) if last else None,
    }


def view_check(row: Row) -> dict[str, Any]:
    """A check without its full content."""
    return {name: value for name, value in row.items() if name != "content"}


def models(runs: Path, axis: str) -> list[tuple[dict[str, Any], Path]]:
    """Models of an axis with their files, newest first."""
    found = [folder / "model.toml" for folder in run_folders(runs, axis)]
    return [(_file(path, axis, path.parent.name), path) for path in found if path.is_file()]


def recordings(runs: Path, axis: str) -> list[tuple[dict[str, Any], Path]]:
    """Recordings of an axis with their files, newest first."""
    folders = run_folders(runs, axis)
    found = [path for folder in folders for path in sorted(folder.glob("recordings/*.parquet"), reverse=True)]
    return [(_file(path, axis, path.parent.parent.name), path) for path in found]


def reports(runs: Path, axis: str) -> list[tuple[dict[str, Any], Path]]:
    """Reports of an axis's runs with their files, newest first."""
    found = [folder / "report.html" for folder in run_folders(runs, axis)]
    return [(_file(path, axis, path.parent.name), path) for path in found if path.is_file()]


def _file(path: Path, axis: str, run: str) -> dict[str, Any]:
    try:
        size = path.stat().st_size
    except OSError:
        size = 0
    identifier = hashlib.sha256(f"{run}/{path.name}".encode()).hexdigest()[:32]
    return {"id": identifier, "axis": axis, "run": run, "name": path.stem, "bytes": size}


def by_id(found: list[tuple[dict[str, Any], Path]], identifier: str) -> tuple[dict[str, Any], Path] | None:
    """The one with that id."""
    return next(((view, path) for view, path in found if view["id"] == identifier), None)


def stamp(moment: datetime | None) -> str | None:
    """A time as text, or None."""
    return text(moment) if moment else None
