"""Opening the history: a torn or missing SQLite file is replaced by its newest sound backup, an old schema is
brought up to date (after a backup), a newer one is refused in words.

SQLite runs with write-ahead log and full synchronisation: what a transaction has confirmed survives
`kill -9` and a power cut.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from sqlalchemy import Engine, create_engine, event, inspect, make_url, text
from sqlalchemy.engine.interfaces import DBAPIConnection
from sqlalchemy.exc import ArgumentError, NoSuchModuleError, SQLAlchemyError
from sqlalchemy.pool import ConnectionPoolEntry

from autotune.core.errors import ConfigurationError, LinkError
from autotune.tuning.files import stamp_after

Say = Callable[[str], None]
REVISIONS = ("0001", "0002", "0003")
LEAST_FREE = 1_000_000  # bytes without which SQLite may not even open
"""In order; a test holds this to what Alembic finds in `migrations`."""
_MIGRATIONS = Path(__file__).parent / "migrations"


@dataclass(frozen=True, slots=True)
class Opened:
    """An open history; `restored` says in words where a backup had to take its place, else ""."""

    engine: Engine
    file: Path | None
    restored: str = ""


def open_database(url: str, backups: Path, now: datetime, keep: int = 7) -> Opened:
    """Opens, repairs and upgrades the history at `url`.

    Raises:
        ConfigurationError: not a URL, or a schema newer than this program.
        LinkError: the database cannot be reached.
    """
    file = sqlite_file(url)
    restored = restore_if_torn(file, backups, now) if file is not None else ""
    engine = _engine(url, file)
    try:
        _upgrade(engine, url, file, backups, now, keep)
    except SQLAlchemyError as error:
        engine.dispose()
        reason = str(getattr(error, "orig", None) or error).splitlines()[0]
        advice = "start its server, or correct history.url in the service file"
        if file is not None and shutil.disk_usage(file.parent).free < LEAST_FREE:
            advice = "the disk is full: make room on it"
        raise LinkError(f"the history database {shown(url)} cannot be reached: {reason}; {advice}") from error
    except BaseException:
        engine.dispose()
        raise
    return Opened(engine, file, restored)


def sqlite_file(url: str) -> Path | None:
    """The file of a SQLite URL; None for a server.

    Raises:
        ConfigurationError: not a database URL.
    """
    try:
        parsed = make_url(url)
    except ArgumentError:
        raise ConfigurationError(
            "history.url is not a database URL (its text is not repeated: it may hold a password); write for example "
            "'postgresql+psycopg://user:password@host/autotune', or leave it out for SQLite"
        ) from None
    if parsed.get_backend_name() != "sqlite":
        return None
    if not parsed.database or parsed.database == ":memory:":
        raise ConfigurationError(
            f"history.url {shown(url)!r} names no file, so the history would go with the process; write for example "
            "'sqlite:////var/lib/autotune/history.sqlite', or leave it out"
        )
    return Path(parsed.database)


def check_url(url: str) -> None:
    """Looks at a database URL without connecting.

    Raises:
        ConfigurationError: not a database URL, in memory only, or its driver is not installed.
    """
    if sqlite_file(url) is None:
        _engine(url, None).dispose()


def shown(url: str) -> str:
    """The URL without its password."""
    return make_url(url).render_as_string(hide_password=True)


def back_up(file: Path, backups: Path, now: datetime, keep: int) -> Path:
    """A sound copy of a SQLite history, while it is in use; the oldest beyond `keep` are removed."""
    backups.mkdir(parents=True, exist_ok=True)
    there = [path.name.removeprefix("history-") for path in backups.glob("history-*.sqlite")]
    target = backups / f"history-{stamp_after(there, now)}.sqlite"
    temporary = target.with_suffix(".part")
    temporary.unlink(missing_ok=True)
    with closing(sqlite3.connect(file)) as source, closing(sqlite3.connect(temporary)) as copy:
        source.backup(copy)
        copy.execute("PRAGMA journal_mode=DELETE")
    _sync(temporary)
    os.replace(temporary, target)
    for old in sorted(backups.glob("history-*.sqlite"))[:-keep]:
        old.unlink()
    return target


def restore_if_torn(file: Path, backups: Path, now: datetime) -> str:
    """Puts the newest sound backup in the place of a torn or missing file; says so, or "" where all is well."""
    there = file.exists()
    copies = sorted(backups.glob("history-*.sqlite"), reverse=True)
    if not there and not copies:
        return ""
    problem = damage(file) or (_emptied(file) if copies else "") if there else ""
    if there and not problem:
        return ""
    aside = _set_aside(file, now)
    found = (
        f"THE HISTORY {file.name} IS TORN ({problem}); it was set aside as {aside}"
        if there
        else f"THE HISTORY {file.name} IS GONE, though there are backups of it"
    )
    sound = next((copy for copy in copies if not damage(copy)), None)
    if sound is None:
        return (
            f"{found}; there is no sound backup, and a new one was begun. What runs and checks left in the runs folder "
            "is taken up again."
        )
    _put_in_place(sound, file)
    return (
        f"{found}; the backup {sound.name} was put in its place. What runs and checks left in the runs folder since "
        "then is taken up again."
    )


def _set_aside(file: Path, now: datetime) -> str:
    """Renames what there is of a history, its log included: a log of another file would be replayed into it."""
    aside = file.with_name(f"{file.name}.torn-{now:%Y%m%d-%H%M%S}")
    for suffix in ("", "-wal", "-shm"):
        part = file.with_name(file.name + suffix)
        if part.exists():
            os.replace(part, aside.with_name(aside.name + suffix))
    return aside.name


def _put_in_place(sound: Path, file: Path) -> None:
    """The copy appears whole or not at all."""
    temporary = file.with_name(f".{file.name}.part")
    shutil.copyfile(sound, temporary)
    _sync(temporary)
    os.replace(temporary, file)
    _sync(file.parent)


def damage(file: Path) -> str:
    """What is wrong with a SQLite file, in words; "" where it is sound."""
    try:
        with closing(sqlite3.connect(file, timeout=10.0)) as connection:
            answer = str(connection.execute("PRAGMA quick_check").fetchone()[0])
    except sqlite3.OperationalError:
        return ""  # locked, no rights, not a file: a matter of reaching it, not of what is in it
    except sqlite3.DatabaseError as error:
        return str(error)
    return "" if answer == "ok" else answer.splitlines()[0]


def _emptied(file: Path) -> str:
    """A file of no length is a database to SQLite, but not one that had a backup."""
    journal = file.with_name(file.name + "-wal")
    left = file.stat().st_size + (journal.stat().st_size if journal.exists() else 0)
    return "" if left else "it is empty"


def _engine(url: str, file: Path | None) -> Engine:
    try:
        if file is None:
            limits = {"connect_timeout": 5} if make_url(url).get_backend_name() == "postgresql" else {}
            return create_engine(url, pool_pre_ping=True, connect_args=limits)
        engine = create_engine(url, connect_args={"timeout": 15.0})
    except (NoSuchModuleError, ImportError) as error:
        raise ConfigurationError(
            f"history.url {shown(url)!r} needs a database driver that is not installed ({error}); install it, "
            "for PostgreSQL: pip install 'autotune[postgresql]'"
        ) from None
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigurationError(f"the folder {file.parent} cannot be made: {error.strerror}") from error
    event.listen(engine, "connect", _durable)
    return engine


def _durable(connection: DBAPIConnection, record: ConnectionPoolEntry) -> None:
    cursor = connection.cursor()
    for pragma in ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON"):
        cursor.execute(f"PRAGMA {pragma}")
    cursor.close()


def revision_of(engine: Engine) -> str | None:
    """The schema revision of a database; None where it is empty."""
    if not inspect(engine).has_table("alembic_version"):
        return None
    with engine.connect() as connection:
        found = connection.execute(text("SELECT version_num FROM alembic_version")).scalar()
    return str(found) if found is not None else None


def _upgrade(engine: Engine, url: str, file: Path | None, backups: Path, now: datetime, keep: int) -> None:
    present = revision_of(engine)
    if present == REVISIONS[-1]:
        return
    if present is not None and present not in REVISIONS:
        raise ConfigurationError(
            f"the history {shown(url)} has schema revision {present}, which is newer than this program (it knows up "
            f"to {REVISIONS[-1]}); update autotune, or name another history.url"
        )
    if present is not None and file is not None:
        back_up(file, backups, now, keep)
    migrate(engine, REVISIONS[-1])


def migrate(engine: Engine, revision: str) -> None:
    """Brings a database to a revision; Alembic is loaded only where there is something to do."""
    from alembic import command
    from alembic.config import Config

    config = Config()
    config.set_main_option("script_location", str(_MIGRATIONS))
    with engine.begin() as connection:
        config.attributes["connection"] = connection
        command.upgrade(config, revision)


def _sync(path: Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
