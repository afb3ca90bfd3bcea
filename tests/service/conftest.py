"""A service with its own clock on simulated axes; nothing here waits for the wall clock."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from autotune.service import database
from autotune.service.database import open_database, sqlite_file
from autotune.service.manager import Manager, plans_of
from autotune.service.orders import Done, Order
from autotune.service.schedule import Schedule
from autotune.service.settings import Configuration, read_service
from autotune.service.store import Store
from tests.service import postgres

EXAMPLE = Path(__file__).resolve().parents[2] / "config" / "axes" / "edm-vertical.toml"
WIRE = "canopen+slcan:edm-vertical.tty?bitrate=1000000&node=5"
START = datetime(2026, 3, 1, 12, tzinfo=UTC)


@pytest.fixture(autouse=True, scope="session")
def without_waiting_for_the_history() -> Iterator[None]:
    """SQLite does not wait for the disk: no test cuts the power of the host."""
    durable = database._durable

    def hasty(connection: Any, record: Any) -> None:
        durable(connection, record)
        connection.execute("PRAGMA synchronous=OFF").close()

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(database, "_durable", hasty)
        yield


@cache
def empty_history() -> bytes:
    """A history as a service makes it on its first start; `test_database` makes them step by step."""
    with TemporaryDirectory() as folder:
        file = Path(folder, "history.sqlite")
        open_database(f"sqlite:///{file}", Path(folder), START).engine.dispose()
        return file.read_bytes()


@pytest.fixture(autouse=True)
def locks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Locks of their own, so that tests do not meet the services of this machine."""
    monkeypatch.setenv("AUTOTUNE_LOCKS", str(tmp_path / "locks"))


def write_axis(folder: Path, name: str = "edm-vertical", link: str = "sim://edm-vertical") -> Path:
    """An axis file like the example, with another link."""
    text = EXAMPLE.read_text().replace(WIRE, link).replace('name = "edm-vertical"', f'name = "{name}"')
    path = folder / f"{name}.toml"
    path.write_text(text)
    return path


def write_service(folder: Path, axes: list[str], extra: str = "", head: str = "") -> Path:
    """A service file for axes whose files are in the same folder."""
    blocks = "".join(f'[[axes]]\nfile = "{name}.toml"\n{extra}\n' for name in axes)
    path = folder / "service.toml"
    path.write_text(f'schema = 1\nruns = "{folder / "runs"}"\n{head}\n{blocks}')
    return path


def a_check(axis: str, at: datetime, level: float, state: str = "none") -> dict[str, Any]:
    """What a check leaves in its `check.json`."""
    peaks = {"peak_error": 5e-4, "raw_peak_error": 5e-4, "rms_error": 2e-4}
    return {
        "schema": 1, "axis": axis, "at": at.isoformat(), "verdict": "No drift.", "advice": "", "motion_unit": "rad",
        "committed": {}, "temperature": 25.0 + 50.0 * (level - 0.33), "position_noise": 1e-5,
        "friction": {"level": {"value": level, "standard_error": 1e-3, "unit": "N m"}},
        "drift": {"state": state, "beyond": False, "change": 0.0, "wants_tuning": False}, "tracking_error": peaks,
        "uncompensated": peaks | {"peak_error": 2e-3}, "missed": 0, "samples": 30000,
    }  # fmt: skip


def left_kept(runs: Path, job: str) -> Path:
    """The folder of a run whose drive has kept the parameters, and which came no further."""
    jobs = runs / ".service" / "jobs"
    jobs.mkdir(parents=True, exist_ok=True)
    (jobs / f"{job}.begun.json").write_text(json.dumps({"process": 4711, "at": "2026-03-01T12:00:00"}))
    left = runs / "20260301-120001-one"
    left.mkdir()
    journal = {
        "schema": 1, "axis": "one", "fingerprint": "f", "started": "2026-03-01T12:00:01", "process": 4711,
        "stage": "commit", "changed": {}, "backup": "b", "phase": "kept", "outcome": "",
        "written": {"feedforward.coulomb": 0.3, "feedforward.enabled": 1.0},
    }  # fmt: skip
    (left / "journal.json").write_text(json.dumps(journal))
    return left


@dataclass
class FakeHandle:
    """A job that ends when the test says so."""

    order: Order
    ended: Done | None = None
    told: list[dict[str, Any]] = field(default_factory=list)
    stopped: bool = False
    killed: bool = False

    def messages(self) -> list[dict[str, Any]]:
        told, self.told = self.told, []
        return told

    def done(self) -> Done | None:
        return self.ended

    def stop(self) -> None:
        self.stopped = True

    def kill(self) -> None:
        self.killed = True

    def let_go(self) -> None:
        self.stopped = True


@dataclass
class FakeLauncher:
    """Starts nothing, remembers everything."""

    started: list[FakeHandle] = field(default_factory=list)

    def start(self, order: Order) -> FakeHandle:
        handle = FakeHandle(order)
        self.started.append(handle)
        return handle


@dataclass
class World:
    """A manager with the clock in the test's hand."""

    folder: Path
    axes: list[str]
    extra: str = ""
    head: str = ""
    url: str = ""
    now: datetime = START
    steady: float = 1000.0
    notices: list[Mapping[str, Any]] = field(default_factory=list)
    launcher: Any = field(default_factory=FakeLauncher)

    def __post_init__(self) -> None:
        for name in self.axes:
            write_axis(self.folder, name)
        self.open()

    def open(self) -> None:
        """Starts the service, also again after `close`."""
        head = f'{self.head}\n[history]\nurl = "{self.url}"' if self.url else self.head
        self.configuration: Configuration = read_service(
            write_service(self.folder, self.axes, self.extra, head)
        )
        file = sqlite_file(self.configuration.history_url)
        if file is not None and not file.exists():
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(empty_history())
        opened = open_database(self.configuration.history_url, self.configuration.state / "backups", self.now)
        self.store = Store(opened.engine)
        self.schedule = Schedule(opened.engine, plans_of(self.configuration), self.now)
        self.manager = Manager(
            self.configuration, self.store, self.schedule, self.launcher, self.notices.append,
            lambda: self.now, lambda: self.steady,
        )  # fmt: skip

    def close(self) -> None:
        self.schedule.close()
        self.store.close()

    def pass_time(self, **span: float) -> None:
        """Time goes by as it should, on both clocks."""
        self.now += timedelta(**span)
        self.steady += timedelta(**span).total_seconds()

    def jump(self, **span: float) -> None:
        """Only the wall clock is put forward or back."""
        self.now += timedelta(**span)

    def finish(self, outcome: str = "done", code: int = 0, run: str = "", asked: str = "") -> None:
        """All started jobs end."""
        for handle in self.launcher.started:
            if handle.ended is None:
                handle.ended = Done(outcome, code, "It ended.", run, asked)
        self.manager.tick()


@pytest.fixture(scope="session")
def database_server() -> Iterator[str]:
    """URL of a PostgreSQL server."""
    if reason := postgres.missing():
        pytest.skip(reason)
    with postgres.server() as url:
        yield url


@pytest.fixture
def history_url(request: pytest.FixtureRequest, worker_id: str) -> Iterator[str]:
    """Where the history is: SQLite in the test's folder (""), or with the parameter `server` a database of its own."""
    if getattr(request, "param", "") != "server":
        yield ""
        return
    with postgres.database(request.getfixturevalue("database_server"), f"autotune-{worker_id}") as url:
        yield url


ON_BOTH = pytest.mark.parametrize("history_url", ["sqlite", "server"], indirect=True)


@pytest.fixture
def world(tmp_path: Path, history_url: str) -> Iterator[Callable[..., World]]:
    made: list[World] = []

    def make(axes: list[str] | None = None, **options: Any) -> World:
        made.append(World(tmp_path, axes or ["one"], url=history_url, **options))
        return made[-1]

    yield make
    for one in made:
        one.close()
