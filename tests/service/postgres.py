"""A PostgreSQL server for tests: the one that AUTOTUNE_TEST_DATABASE names, or one of our own where it is installed."""

from __future__ import annotations

import glob
import importlib.util
import os
import pwd
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import create_engine, make_url, text
from sqlalchemy.exc import OperationalError

PATIENCE = 60.0


def missing() -> str:
    """Why there is no server to test against; "" where there is one."""
    if importlib.util.find_spec("psycopg") is None:
        return "psycopg is not installed"
    if os.environ.get("AUTOTUNE_TEST_DATABASE"):
        return ""
    if _tool("initdb") is None:
        return "AUTOTUNE_TEST_DATABASE names no server, and PostgreSQL is not installed"
    if os.geteuid() == 0 and (_user() is None or shutil.which("setpriv") is None):
        return "PostgreSQL does not run as root, and there is no user postgres or no setpriv"
    return ""


@contextmanager
def server() -> Iterator[str]:
    """URL of a server on which databases can be made."""
    given = os.environ.get("AUTOTUNE_TEST_DATABASE", "")
    if given:
        yield given
        return
    folder = Path(tempfile.mkdtemp(prefix="autotune-pg-", dir="/tmp"))
    user = _user() if os.geteuid() == 0 else None
    if user is not None:
        os.chown(folder, user.pw_uid, user.pw_gid)
    data, log = folder / "data", folder / "log"
    process: subprocess.Popen[bytes] | None = None
    try:
        with log.open("wb") as out:
            subprocess.run(
                _as_user([_tool("initdb") or "", "-D", str(data), "-A", "trust", "-U", "autotune", "-N"]),
                stdout=out, stderr=out, check=True, cwd=folder,
            )  # fmt: skip
            process = subprocess.Popen(
                _as_user([_tool("postgres") or "", "-D", str(data), "-k", str(folder), "-c", "listen_addresses=",
                          "-c", "fsync=off"]),
                stdout=out, stderr=out, cwd=folder,
            )  # fmt: skip
        url = f"postgresql+psycopg://autotune@/postgres?host={folder}"
        _wait_for(url, log)
        yield url
    finally:
        if process is not None:
            process.terminate()
            process.wait(PATIENCE)
        shutil.rmtree(folder, ignore_errors=True)


@contextmanager
def database(url: str, name: str) -> Iterator[str]:
    """URL of an empty database of that name, dropped afterwards."""
    engine = create_engine(url, isolation_level="AUTOCOMMIT")
    try:
        with engine.connect() as connection:
            connection.execute(text(f'DROP DATABASE IF EXISTS "{name}" WITH (FORCE)'))
            connection.execute(text(f'CREATE DATABASE "{name}"'))
        yield make_url(url).set(database=name).render_as_string(hide_password=False)
        with engine.connect() as connection:
            connection.execute(text(f'DROP DATABASE IF EXISTS "{name}" WITH (FORCE)'))
    finally:
        engine.dispose()


def _as_user(command: list[str]) -> list[str]:
    """PostgreSQL refuses root; it ends with the test's process, however that ends."""
    user = _user()
    if os.geteuid() != 0 or user is None:
        return command
    identity = [f"--reuid={user.pw_uid}", f"--regid={user.pw_gid}", "--clear-groups", "--pdeathsig=TERM"]
    return ["setpriv", *identity, *command]


def _tool(name: str) -> str | None:
    found = sorted(glob.glob(f"/usr/lib/postgresql/*/bin/{name}"))
    return shutil.which(name) or (found[-1] if found else None)


def _user() -> pwd.struct_passwd | None:
    try:
        return pwd.getpwnam("postgres")
    except KeyError:
        return None


def _wait_for(url: str, log: Path) -> None:
    engine = create_engine(url)
    end = time.monotonic() + PATIENCE
    try:
        while True:
            try:
                engine.connect().close()
                return
            except OperationalError:
                if time.monotonic() > end:
                    raise RuntimeError(log.read_text()) from None
                time.sleep(0.05)
    finally:
        engine.dispose()
