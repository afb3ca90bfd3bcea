"""`service.toml`: which axes are looked after, when, and what may be done. Checked as a whole.

Paths of axis files are relative to the service file; `runs` is relative to the working directory, as it
is for every other command, so that service and command line see the same runs.
"""

from __future__ import annotations

import hashlib
import re
from contextlib import suppress
from dataclasses import dataclass
from datetime import time
from pathlib import Path
from typing import Annotated, Literal
from zoneinfo import ZoneInfo, available_timezones

from pydantic import Field, field_validator, model_validator

from autotune import __version__
from autotune.core.axis import Axis, read_axis
from autotune.core.configuration import Strict, read_toml, validate
from autotune.core.errors import AutotuneError, ConfigurationError
from autotune.monitoring.drift import DriftSettings
from autotune.service.cron import parse_cron
from autotune.service.ownership import key_of

Day = Literal["mon", "tue", "wed", "thu", "fri", "sat", "sun"]
DAYS: tuple[Day, ...] = ("mon", "tue", "wed", "thu", "fri", "sat", "sun")
SEEN = "plannable"
LOOPBACK = ("127.0.0.1", "localhost", "::1")


class Http(Strict):
    """Where the API listens, and what a request may take."""

    host: str = "127.0.0.1"
    port: Annotated[int, Field(ge=0, le=65535)] = 8765
    body_kilobytes: Annotated[int, Field(ge=1, le=100_000)] = 256
    seconds: Annotated[float, Field(gt=0, le=600)] = 30.0
    names: tuple[str, ...] = ()

    @property
    def loopback(self) -> bool:
        """Only this machine can reach it."""
        return self.host in LOOPBACK


class History(Strict):
    """Where history is kept; `url` empty: SQLite in the runs folder. `backups`: how many of it."""

    url: str = ""
    backups: Annotated[int, Field(ge=1, le=1000)] = 7


class Recordings(Strict):
    """Disk that recordings, reports and traces may take; below `least_free_megabytes` no job starts."""

    budget_megabytes: Annotated[int, Field(ge=50)] = 2000
    least_free_megabytes: Annotated[int, Field(ge=1)] = 200


class Notices(Strict):
    """A webhook that is told what a person should know."""

    webhook: Annotated[str, Field(pattern=r"^(https?://\S+)?$")] = ""
    seconds: Annotated[float, Field(gt=0, le=60)] = 5.0
    attempts: Annotated[int, Field(ge=1, le=100)] = 10


class Blackout(Strict):
    """When nothing may start by itself; `until` before `start` goes over midnight."""

    days: tuple[Day, ...] = DAYS
    start: time
    until: time

    @field_validator("start", "until", mode="before")
    @classmethod
    def _clock(cls, value: object) -> object:
        if isinstance(value, str) and re.fullmatch(r"([01]\d|2[0-3]):[0-5]\d", value):
            return time.fromisoformat(value)
        if isinstance(value, time):
            return value
        raise ValueError(f"must be a time like 06:30, not {value!r}")


class Idle(Strict):
    """Who says that the machine is idle: nobody is asked, an HTTP request, or an input of the drive.

    `input` is a parameter of the drive's profile; it says idle where value & `mask` is not 0.
    """

    by: Literal["always", "http", "input"] = "always"
    input: str = ""
    mask: Annotated[int, Field(ge=1)] = 1

    @model_validator(mode="after")
    def _named(self) -> Idle:
        if (self.by == "input") != bool(self.input):
            raise ValueError("idle.input names the drive's input where idle.by is 'input', and only there")
        return self


class Watched(Strict):
    """One axis: when it is looked at, and what follows."""

    file: str
    check: Annotated[str, Field(max_length=256)] = "30 3 * * *"
    time_zone: str = "UTC"
    retune: Literal["drift", "never"] = "drift"
    commit: Literal["automatic", "ask"] = "ask"
    blackout: tuple[Blackout, ...] = ()
    idle: Idle = Idle()
    drift: DriftSettings = DriftSettings()

    @field_validator("time_zone")
    @classmethod
    def _zone(cls, value: str) -> str:
        if value not in available_timezones():
            raise ValueError(f"there is no time zone {value!r}; write for example 'Europe/Zurich'")
        return value

    @model_validator(mode="after")
    def _cron(self) -> Watched:
        parse_cron(self.check, ZoneInfo(self.time_zone))
        return self


class Service(Strict):
    """The whole file."""

    schema_version: Annotated[Literal[1], Field(alias="schema")] = 1
    runs: str = "runs"
    at_once: Annotated[int, Field(ge=1, le=100)] | None = None
    http: Http = Http()
    history: History = History()
    recordings: Recordings = Recordings()
    notices: Notices = Notices()
    axes: Annotated[tuple[Watched, ...], Field(min_length=1)]


@dataclass(frozen=True, slots=True)
class WatchedAxis:
    """An axis with its file read. `key` names the drive on its link, `bus` what jobs share."""

    settings: Watched
    axis: Axis
    file: Path
    key: str
    bus: str

    @property
    def name(self) -> str:
        return self.axis.name

    @property
    def zone(self) -> ZoneInfo:
        return ZoneInfo(self.settings.time_zone)


@dataclass(frozen=True, slots=True)
class Configuration:
    """A service file with all that it names."""

    service: Service
    axes: tuple[WatchedAxis, ...]
    file: Path

    @property
    def runs(self) -> Path:
        return Path(self.service.runs).absolute()

    @property
    def state(self) -> Path:
        """Folder of history, token and jobs."""
        return self.runs / ".service"

    @property
    def history_url(self) -> str:
        return self.service.history.url or f"sqlite:///{self.state / 'history.sqlite'}"

    def axis(self, name: str) -> WatchedAxis | None:
        return next((one for one in self.axes if one.name == name), None)


def read_service(path: str | Path, planned: bool = True) -> Configuration:
    """Reads a service file and every axis file that it names; each axis must be checkable in a minute.

    Args:
        path: of the service file.
        planned: look at that last point too, which takes a second where it is not remembered.

    Raises:
        ConfigurationError: anything wrong in any of them, all problems together.
    """
    path = Path(path)
    service = validate(Service, read_toml(path, "service file"), f"service file {path}")
    seen = Path(service.runs).absolute() / ".service" / SEEN
    axes: list[WatchedAxis] = []
    problems: list[str] = []
    for watched in service.axes:
        try:
            axes.append(_watched(watched, path.resolve().parent, seen if planned else None))
        except AutotuneError as error:
            problems.append(str(error))
    problems += _twice(axes) + _url_problems(service.history.url)
    if problems:
        raise ConfigurationError(f"service file {path}: " + "; ".join(problems))
    return Configuration(service, tuple(axes), path)


def _url_problems(url: str) -> list[str]:
    if not url:
        return []
    from autotune.service.database import check_url

    try:
        check_url(url)
    except ConfigurationError as error:
        return [str(error)]
    return []


def _watched(watched: Watched, directory: Path, seen: Path | None) -> WatchedAxis:
    file = (directory / watched.file).resolve()
    axis = read_axis(file)
    if seen is not None:
        _checkable(axis, seen)
    key = key_of(axis, file)
    return WatchedAxis(watched, axis, file, key.drive, key.bus)


def _checkable(axis: Axis, seen: Path) -> None:
    """Plans the axis's check, unless that is remembered: planning takes a second to load.

    Raises:
        ConfigurationError: a check of the axis cannot be made within a minute, or its travel is too small.
    """
    if (seen / _mark(axis)).is_file():
        return
    from autotune.monitoring.check_plan import plan_check

    plan_check(axis)


def remember_checkable(configuration: Configuration) -> None:
    """Remembers that these axes can be checked, so that the next start answers early; a full disk forgets it."""
    seen = configuration.state / SEEN
    with suppress(OSError):
        seen.mkdir(parents=True, exist_ok=True)
        for one in configuration.axes:
            (seen / _mark(one.axis)).touch()


def _mark(axis: Axis) -> str:
    return hashlib.sha256(f"{__version__} {axis!r}".encode()).hexdigest()


def _twice(axes: list[WatchedAxis]) -> list[str]:
    """Two axes with one name, or two on one node, in words."""
    problems = []
    for index, one in enumerate(axes):
        for other in axes[:index]:
            if one.name == other.name:
                problems.append(
                    f"axis {one.name!r} is there twice ({other.file} and {one.file}); name one anew"
                )
            elif one.key == other.key:
                problems.append(
                    f"axes {other.name!r} and {one.name!r} are on the same node of the same link "
                    f"({one.axis.link}); one drive has one owner: correct the link of one of them"
                )
    return problems
