"""A hostile user of the same machine (uid 65534): gets no token, no file, no motion and no code.

The lock folder is sticky and open to all, as /run/lock is. What the user tries runs in processes of its own.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from autotune.core.errors import ConfigurationError
from autotune.service.client import ServiceClient
from autotune.service.lock_file import lock_folder
from autotune.service.ownership import take
from autotune.service.service_file import service_file, token_of
from autotune.service.settings import read_service
from tests.service.conftest import write_axis
from tests.service.test_live import CLI, PATIENCE

pytestmark = pytest.mark.skipif(os.geteuid() != 0, reason="dropping privileges to uid 65534 needs root")
NOBODY = 65534
CAN = "can:can0"

BECOME = f"""
import encodings.idna, fcntl, http.server, json, os, sqlite3, sys, urllib.request
os.setgroups([]); os.setresgid({NOBODY}, {NOBODY}, {NOBODY}); os.setresuid({NOBODY}, {NOBODY}, {NOBODY})
"""

ATTACKS = """
site, address, service = sys.argv[1], sys.argv[2], int(sys.argv[3])
got = []

def attempt(name, act):
    try:
        act()
    except (OSError, sqlite3.Error):
        return
    got.append(name)

def post(method, path, body):
    request = urllib.request.Request(address + path, body, {"Content-Type": "application/json"}, method=method)
    urllib.request.urlopen(request, timeout=30).close()  # 401 and 403 are OSError

attempt("saw the axis file", lambda: open(site + "/one.toml").close())
attempt("heard that it is well", lambda: urllib.request.urlopen(address + "/healthz", timeout=30).close())
for folder, folders, files in os.walk(site + "/runs"):
    attempt(f"wrote into {folder}", lambda: open(folder + "/planted", "w").close())
    for name in files:
        attempt(f"read {folder}/{name}", lambda: open(f"{folder}/{name}").close())
for name in ("token", "port", "lock", "history.sqlite", "history.sqlite-wal"):
    attempt(f"read {name}", lambda: open(f"{site}/runs/.service/{name}").close())
attempt("listed the runs", lambda: os.listdir(site + "/runs"))
state = site + "/runs/.service"
attempt("queued a job", lambda: sqlite3.connect(state + "/history.sqlite").execute("DELETE FROM jobs"))
attempt("exchanged the history", lambda: os.rename(state + "/history.sqlite", state + "/x"))
for name in os.listdir(site + "/locks"):
    lock = f"{site}/locks/{name}"
    attempt("wrote the lock", lambda: open(lock, "r+").close())
    attempt("removed the lock", lambda: os.unlink(lock))
    attempt("renamed the lock", lambda: os.rename(lock, lock + "x"))
    attempt("opened the lock to all", lambda: os.chmod(lock, 0o666))
for name in ("service.toml", "one.toml"):
    attempt(f"wrote {name}", lambda: open(f"{site}/{name}", "a").close())
    attempt(f"exchanged {name}", lambda: os.rename(f"{site}/{name}", f"{site}/x"))
attempt("started a job", lambda: post("POST", "/api/axes/one/jobs", b'{"kind": "check"}'))
attempt("called it idle", lambda: post("PUT", "/api/axes/one/idle", b'{"minutes": 60}'))
attempt("computed", lambda: post("GET", f"/api/recordings/{'0' * 32}/diagnose", None))
attempt("signalled the service", lambda: os.kill(service, 15))
attempt("looked at its memory", lambda: open(f"/proc/{service}/mem", "rb").read(1))
attempt("read its environment", lambda: open(f"/proc/{service}/environ", "rb").read(1))
print(json.dumps(got))
"""

PLANT = """
kind, path, target = sys.argv[1:]
if kind == "file":
    os.close(os.open(path, os.O_CREAT | os.O_WRONLY, 0o666)); os.chmod(path, 0o666)
elif kind == "symlink":
    os.symlink(target, path)
elif kind == "pipe":
    os.mkfifo(path, 0o666)
elif kind == "hard link":
    os.link(target, path)
"""

HOLD = """
path, port = sys.argv[1], int(sys.argv[2])
descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o666)
fcntl.flock(descriptor, fcntl.LOCK_EX)
note = {"process": 1, "what": "\\x1b[2Jautotune serve", "token_file": "/etc/shadow"}
note["address"] = f"http://127.0.0.1:{port}"
os.write(descriptor, json.dumps(note, ensure_ascii=False).encode())

class Thief(http.server.BaseHTTPRequestHandler):
    def do_GET(self):
        print(json.dumps(self.headers.items()), flush=True)
        body = b'{"proof": "0", "held": true, "detail": "\\x1b[2J", "state": "done"}'
        self.send_response(200)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)
    do_POST = do_PUT = do_GET
    def log_message(self, *arguments):
        pass

server = http.server.ThreadingHTTPServer(("127.0.0.1", port), Thief)
print("ready", flush=True)
server.serve_forever()
"""


def as_nobody(code: str, *arguments: str) -> subprocess.Popen[str]:
    """Python that has become the hostile user for good; it starts as root, in whose home the interpreter may be."""
    return subprocess.Popen(
        [sys.executable, "-I", "-c", BECOME + code, *arguments], cwd="/", stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, text=True, env={"PATH": os.environ["PATH"]},
    )  # fmt: skip


@pytest.fixture
def site(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder that everybody may look into, with a sticky folder of locks in it, and an ordinary umask."""
    folder = Path(tempfile.mkdtemp(prefix="autotune-hostile-"))
    folder.chmod(0o755)
    (folder / "locks").mkdir()
    (folder / "locks").chmod(0o1777)
    monkeypatch.setenv("AUTOTUNE_LOCKS", str(folder / "locks"))
    monkeypatch.delenv("AUTOTUNE_SERVICE", raising=False)
    monkeypatch.chdir(folder)
    before = os.umask(0o022)
    yield folder
    os.umask(before)
    shutil.rmtree(folder)


@pytest.mark.slow
def test_a_running_service_gives_nothing_away(site: Path) -> None:
    write_axis(site, "one", "sim://edm-vertical")
    (site / "service.toml").write_text('schema = 1\n[http]\nport = 0\n[[axes]]\nfile = "one.toml"\n')
    with (site / "log").open("w") as log:
        service = subprocess.Popen(
            [*CLI, "serve", "service.toml"], stdout=subprocess.PIPE, stderr=log, text=True
        )
    try:
        assert service.stdout is not None
        address = service.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:"), (site / "log").read_text()
        assert list((site / "locks").iterdir())
        attacker = as_nobody(ATTACKS, str(site), address, str(service.pid))
        output, _ = attacker.communicate(timeout=PATIENCE)
        assert json.loads(output) == ["saw the axis file", "heard that it is well"]  # so the attempts do work
        token = token_of(site / "runs" / ".service")
        assert token not in (site / "log").read_text()
        for shown in ("cmdline", "environ"):
            assert token.encode() not in Path(f"/proc/{service.pid}/{shown}").read_bytes()
        client = ServiceClient(read_service("service.toml", planned=False))
        assert client.holds("one")
        assert client.history("one")["events"] == []
    finally:
        service.send_signal(signal.SIGTERM)
        service.communicate(timeout=PATIENCE)


def lock_path() -> Path:
    held = take(CAN, "one", "test")
    (path,) = lock_folder().iterdir()
    held.release()
    return path


@pytest.mark.parametrize("kind", ["file", "symlink", "pipe", "hard link"])
def test_a_planted_lock_is_replaced_and_what_it_points_to_is_left_alone(site: Path, kind: str) -> None:
    path, precious = lock_path(), site / "precious"
    precious.write_text("root's")
    precious.chmod(0o644)
    planted = as_nobody(PLANT, kind, str(path), str(precious))
    planted.communicate(timeout=PATIENCE)
    if planted.returncode:
        pytest.skip(f"this kernel lets nobody plant a {kind}")
    held = take(CAN, "one", "autotune run")
    found = path.lstat()
    assert (found.st_uid, found.st_mode & 0o777, found.st_nlink) == (0, 0o644, 1)
    assert precious.read_text() == "root's"
    assert precious.stat().st_mode & 0o777 == 0o644
    held.release()


def test_who_holds_the_lock_is_named_and_gets_neither_the_token_nor_the_terminal(site: Path) -> None:
    """It holds the drive's lock, says it is the service, and listens on the service's port."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    write_axis(site, "one", "canopen+socketcan://can0?node=5")
    (site / "service.toml").write_text(f'schema = 1\n[http]\nport = {port}\n[[axes]]\nfile = "one.toml"\n')
    path = lock_path()
    token = token_of(site / "runs" / ".service")
    thief = as_nobody(HOLD, str(path), str(port))
    try:
        assert thief.stdout is not None
        assert thief.stdout.readline() == "ready\n"
        with pytest.raises(
            ConfigurationError, match=rf"another program \(process {thief.pid}, user nobody\)"
        ):
            take(CAN, "one", "autotune run")
        for command in (["check", "one.toml", "--yes"], ["rollback", "one.toml"]):
            done = subprocess.run(
                [*CLI, *command], capture_output=True, text=True, timeout=PATIENCE, check=False,
                env={**os.environ, "AUTOTUNE_TOKEN": ""},
            )  # fmt: skip
            assert done.returncode == 2, done.stderr
            assert "does not know the token" in done.stderr
            assert "\x1b" not in done.stdout + done.stderr
    finally:
        thief.kill()
        heard, _ = thief.communicate(timeout=PATIENCE)
    assert heard
    assert token not in heard
    assert "authorization" not in heard.lower()


@pytest.mark.parametrize("owner", ["file", "folder"])
def test_a_service_file_of_the_hostile_user_is_not_used_unnamed(
    site: Path, owner: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where root works in a folder of somebody else: the file would say where the token goes."""
    folder: Any = site / "theirs"
    (folder / "config").mkdir(parents=True)
    file = folder / "config" / "service.toml"
    file.touch()
    os.chown(file if owner == "file" else file.parent, NOBODY, NOBODY)
    monkeypatch.chdir(folder)
    with pytest.raises(ConfigurationError, match="belongs to nobody"):
        service_file()


PLANTED = ("json", "pickle", "socket", "struct", "multiprocessing", "numpy", "autotune")


@pytest.mark.slow
@pytest.mark.parametrize("what", ["import", "wire"])
def test_modules_planted_in_the_working_directory_do_not_run(site: Path, what: str) -> None:
    """A folder that others may write to, such as /tmp, is a usual place to work in."""
    for name in PLANTED:
        (site / f"{name}.py").write_text(f"open({str(site / 'ran')!r}, 'w').close()\n")
    if what == "import":
        columns = {"time": np.arange(500) * 1e-3, "position": np.zeros(500), "torque": np.zeros(500)}
        savemat(site / "a.mat", columns)
        arguments = ["data", "import", "a.mat", "--format", "mat", "--out", "a.parquet"]
    else:
        write_axis(site, "one", "canopen+slcan:nobody.tty?bitrate=1000000&node=5")
        arguments = ["link", "one.toml"]
    program = shutil.which("autotune", path=Path(sys.executable).parent)
    assert program is not None
    subprocess.run(
        [program, *arguments], capture_output=True, timeout=PATIENCE, check=False,
        env=dict(os.environ, PYTHONPATH=os.pathsep.join(filter(None, sys.path))),
    )  # fmt: skip
    assert not (site / "ran").exists()
