"""The history on disk: durable, restored from its own backup, upgraded, and refused where it is newer."""

from __future__ import annotations

import os
import pickle
import sqlite3
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import pytest
from alembic.config import Config
from alembic.script import ScriptDirectory
from sqlalchemy import LargeBinary, create_engine, delete, insert, inspect, text
from sqlalchemy.exc import OperationalError

from autotune.core.errors import ConfigurationError, LinkError
from autotune.core.paths import config_directory
from autotune.service import daemon, database
from autotune.service.daemon import Upkeep
from autotune.service.database import REVISIONS, back_up, damage, migrate, open_database, revision_of
from autotune.service.schedule import DailyCheck, Due, Schedule
from autotune.service.settings import read_service
from autotune.service.store import Store
from autotune.service.tables import metadata, schedule
from tests.service.conftest import ON_BOTH

NOW = datetime(2026, 3, 1, 12, tzinfo=UTC)


def url_of(folder: Path) -> str:
    return f"sqlite:///{folder / 'history.sqlite'}"


def job(identifier: str, due: str | None = None) -> dict[str, object]:
    return {
        "id": identifier, "axis": "one", "kind": "check", "origin": "http", "state": "queued", "due": due,
        "created": "2026-03-01T12:00:00+00:00", "attempts": 0, "options": "{}",
    }  # fmt: skip


@pytest.fixture
def store(history_url: str, tmp_path: Path) -> Store:
    return Store(open_database(history_url or url_of(tmp_path), tmp_path / "backups", NOW).engine)


@ON_BOTH
def test_a_job_is_there_once_for_each_due_time(store: Store) -> None:
    assert store.add_job(job("a", "2026-03-01T03:00:00+00:00"))
    assert not store.add_job(job("b", "2026-03-01T03:00:00+00:00"))
    assert store.add_job(job("c"))
    assert [row["id"] for row in store.jobs_in("queued")] == ["a", "c"]
    store.close()


@ON_BOTH
def test_a_newer_proposal_replaces_an_open_one_and_is_decided_once(store: Store) -> None:
    for name in ("a", "b"):
        store.add_proposal(
            {"id": name, "axis": "one", "run": name, "created": f"2026-03-01T12:00:0{name == 'b':d}+00:00",
             "state": "open", "sentence": ""}
        )  # fmt: skip
    assert {row["id"]: row["state"] for row in store.list_proposals()} == {"a": "superseded", "b": "open"}
    assert store.decide_proposal("b", "approved", NOW)
    assert not store.decide_proposal("b", "rejected", NOW)
    store.close()


def test_the_migrations_make_exactly_the_tables(tmp_path: Path) -> None:
    made = create_engine(url_of(tmp_path))
    migrate(made, REVISIONS[-1])
    direct = create_engine("sqlite://")
    metadata.create_all(direct)
    for table in metadata.tables:
        columns = [
            {
                (column["name"], str(column["type"]), column["nullable"])
                for column in inspect(engine).get_columns(table)
            }
            for engine in (made, direct)
        ]
        assert columns[0] == columns[1], table
    made.dispose()
    direct.dispose()


def test_the_revisions_are_those_that_alembic_finds() -> None:
    config = Config()
    config.set_main_option("script_location", str(Path(database.__file__).parent / "migrations"))
    found = [script.revision for script in ScriptDirectory.from_config(config).walk_revisions()]
    assert tuple(reversed(found)) == REVISIONS


@ON_BOTH
def test_an_old_schema_is_upgraded_with_its_rows_after_a_backup(history_url: str, tmp_path: Path) -> None:
    url = history_url or url_of(tmp_path)
    engine = create_engine(url)
    migrate(engine, "0001")
    Store(engine).add_job(job("a"))
    engine.dispose()
    opened = open_database(url, tmp_path / "backups", NOW)
    assert revision_of(opened.engine) == REVISIONS[-1]
    assert Store(opened.engine).job("a") is not None
    assert len(list((tmp_path / "backups").glob("*.sqlite"))) == (0 if history_url else 1)
    opened.engine.dispose()


@ON_BOTH
def test_a_newer_schema_is_refused_in_words_and_left_alone(history_url: str, tmp_path: Path) -> None:
    url = history_url or url_of(tmp_path)
    opened = open_database(url, tmp_path / "backups", NOW)
    with opened.engine.begin() as connection:
        connection.execute(text("UPDATE alembic_version SET version_num = '0999'"))
    opened.engine.dispose()
    with pytest.raises(ConfigurationError, match=r"0999.*newer than this program.*update autotune"):
        open_database(url, tmp_path / "backups", NOW)


@pytest.mark.parametrize("harm", ["header", "middle", "cut", "text", "empty-pages", "empty"])
def test_a_torn_file_is_replaced_by_its_backup_and_this_is_said(tmp_path: Path, harm: str) -> None:
    file = tmp_path / "history.sqlite"
    opened = open_database(url_of(tmp_path), tmp_path / "backups", NOW)
    store = Store(opened.engine)
    for number in range(200):
        store.add_job(job(f"job{number}") | {"options": "x" * 500})
    back_up(file, tmp_path / "backups", NOW, 7)
    store.close()
    content = bytearray(file.read_bytes())
    half = len(content) // 2
    if harm == "header":
        content[:100] = b"\xff" * 100
    elif harm == "middle":
        content[half - 6000 : half + 6000] = os.urandom(12000)
    elif harm == "cut":
        del content[half:]
    elif harm == "empty":
        content = bytearray()
    elif harm == "text":
        content = bytearray(b"this was a database once\n" * 100)
    else:
        content[4096:half] = bytes(half - 4096)
    file.write_bytes(bytes(content))
    again = open_database(url_of(tmp_path), tmp_path / "backups", NOW + timedelta(days=1))
    assert "TORN" in again.restored
    assert "history-20260301-120000.sqlite" in again.restored
    assert len(Store(again.engine).jobs_in("queued")) == 200
    assert list(tmp_path.glob("history.sqlite.torn-*"))
    again.engine.dispose()


def test_a_history_that_is_gone_comes_back_from_its_backup_and_this_is_said(tmp_path: Path) -> None:
    opened = open_database(url_of(tmp_path), tmp_path / "backups", NOW)
    Store(opened.engine).add_job(job("a"))
    opened.engine.dispose()
    back_up(tmp_path / "history.sqlite", tmp_path / "backups", NOW, 7)
    for path in tmp_path.glob("history.sqlite*"):
        path.unlink()
    (tmp_path / "history.sqlite-wal").write_bytes(b"a log of another file")
    again = open_database(url_of(tmp_path), tmp_path / "backups", NOW + timedelta(days=1))
    assert "IS GONE" in again.restored
    assert "history-20260301-120000.sqlite" in again.restored
    assert Store(again.engine).job("a") is not None
    again.engine.dispose()
    assert open_database(url_of(tmp_path), tmp_path / "backups", NOW + timedelta(days=1)).restored == ""


class Harm:
    """What runs where it is unpickled."""

    def __init__(self, proof: Path) -> None:
        self._proof = proof

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.mkdir, (str(self._proof),)


@ON_BOTH
def test_what_is_written_into_the_history_never_runs(history_url: str, tmp_path: Path) -> None:
    """The store of the schedule held pickles once: such a table is dropped unread, and one made later is not read."""
    url = history_url or url_of(tmp_path)
    engine = create_engine(url)
    migrate(engine, "0002")
    state = pickle.dumps(Harm(tmp_path / "ran"))
    for _ in range(2):
        with engine.begin() as connection:
            binary = LargeBinary().compile(dialect=engine.dialect)
            connection.execute(
                text(
                    f"CREATE TABLE apscheduler_jobs (id VARCHAR(191), next_run_time FLOAT, job_state {binary})"
                )
            )
            row = {"id": "one", "next": 0.0, "state": state}
            connection.execute(text("INSERT INTO apscheduler_jobs VALUES (:id, :next, :state)"), row)
        opened = open_database(url, tmp_path / "backups", NOW)
        if inspect(opened.engine).has_table("apscheduler_jobs"):  # put there after the migration
            with opened.engine.begin() as connection:
                values = {"axis": "one", "expression": "__import__('os')", "zone": "UTC", "next": state.hex()}
                connection.execute(insert(schedule).values(**{**values, "next": values["next"][:32]}))
        plan = DailyCheck("one", "30 3 * * *", ZoneInfo("UTC"))
        found = Schedule(opened.engine, [plan], NOW)
        assert found.process(NOW + timedelta(days=2)) == [
            Due("one", NOW.replace(hour=3, minute=30) + timedelta(days=2))
        ]
        with opened.engine.begin() as connection:
            connection.execute(delete(schedule))
        opened.engine.dispose()
    engine.dispose()
    assert not (tmp_path / "ran").exists()


def test_a_torn_file_without_a_backup_begins_anew_and_this_is_said(tmp_path: Path) -> None:
    (tmp_path / "history.sqlite").write_bytes(b"\0" * 8192)
    opened = open_database(url_of(tmp_path), tmp_path / "backups", NOW)
    assert "no sound backup" in opened.restored
    opened.engine.dispose()


def test_a_torn_backup_is_passed_over(tmp_path: Path) -> None:
    opened = open_database(url_of(tmp_path), tmp_path / "backups", NOW)
    opened.engine.dispose()
    back_up(tmp_path / "history.sqlite", tmp_path / "backups", NOW, 7)
    (tmp_path / "backups" / "history-20260302-120000.sqlite").write_bytes(b"torn")
    (tmp_path / "history.sqlite").write_bytes(b"torn")
    again = open_database(url_of(tmp_path), tmp_path / "backups", NOW + timedelta(days=2))
    assert "history-20260301-120000" in again.restored
    again.engine.dispose()


def test_only_so_many_backups_are_kept(tmp_path: Path) -> None:
    opened = open_database(url_of(tmp_path), tmp_path / "backups", NOW)
    for day in range(5):
        back_up(tmp_path / "history.sqlite", tmp_path / "backups", NOW + timedelta(days=day), 3)
    opened.engine.dispose()
    kept = sorted(path.name for path in (tmp_path / "backups").iterdir())
    assert kept == [f"history-2026030{day}-120000.sqlite" for day in (3, 4, 5)]
    assert all(not damage(tmp_path / "backups" / name) for name in kept)


def test_a_database_that_cannot_be_reached_is_named_without_its_password(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    with pytest.raises(LinkError, match="cannot be reached"):
        open_database(f"sqlite:////{tmp_path}/folder", tmp_path / "backups", NOW)
    with pytest.raises(ConfigurationError, match="not a database URL"):
        open_database("no url", tmp_path / "backups", NOW)
    with pytest.raises((ConfigurationError, LinkError)) as refused:
        open_database("postgresql+psycopg://me:secret@127.0.0.1:1/none", tmp_path / "backups", NOW)
    assert "secret" not in str(refused.value)


def test_a_full_disk_at_the_start_is_a_problem_and_is_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    configuration = read_service(config_directory() / "service.toml")
    opened = open_database(f"sqlite:///{tmp_path / 'history.sqlite'}", tmp_path / "backups", NOW)
    upkeep = Upkeep(opened, Store(opened.engine))

    def full(*_: object) -> int:
        raise OperationalError("insert", {}, Exception("database or disk is full"))

    with monkeypatch.context() as disk:
        disk.setattr(daemon, "absorb", full)
        assert "full" in upkeep.take_up(configuration)
    monkeypatch.setattr(daemon, "absorb", lambda *_: 3)
    assert upkeep.take_up(configuration) == ""
    opened.engine.dispose()


WRITER = """
import sys
from datetime import UTC, datetime
from pathlib import Path
from autotune.service.database import open_database
from autotune.service.store import Store
folder = Path(sys.argv[1])
store = Store(open_database(f"sqlite:///{folder / 'history.sqlite'}", folder / "backups", datetime.now(UTC)).engine)
number = 0
while True:
    store.add_event(f"event{number}", "one", datetime.now(UTC), "test", "")
    print(number, flush=True)
    number += 1
"""


def test_what_was_confirmed_survives_kill_9(tmp_path: Path) -> None:
    writer = subprocess.Popen(
        [sys.executable, "-c", WRITER, str(tmp_path)], stdout=subprocess.PIPE, text=True
    )
    assert writer.stdout is not None
    confirmed = [int(writer.stdout.readline()) for _ in range(40)]
    writer.kill()
    rest = writer.stdout.read().split()
    writer.wait()
    writer.stdout.close()
    with sqlite3.connect(tmp_path / "history.sqlite") as connection:
        there = {key for (key,) in connection.execute("SELECT key FROM events")}
    connection.close()
    wanted = {f"event{number}" for number in (*confirmed, *map(int, rest[:-1]))}
    assert wanted <= there
