"""The service as a user has it: a process, its address, jobs through the command line, kill -9 in the middle."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from tests.support.commands import called
from tests.support.forked import AUTOTUNE, Program

EXAMPLE = Path(__file__).resolve().parents[2] / "config" / "axes" / "edm-vertical.toml"
CLI = [sys.executable, "-m", "autotune.cli.main"]
PATIENCE = 120.0  # s; a loaded host is slow, a broken service never comes


@dataclass
class Live:
    """A service in a process of its own."""

    folder: Path
    process: Program | None = None
    address: str = ""
    environment: dict[str, str] = field(default_factory=dict)

    def start(self) -> None:
        log = (self.folder / "log").open("a")
        self.process = Program(
            AUTOTUNE, "serve", "service.toml", cwd=self.folder, stderr=log, env=self.environment
        )
        log.close()
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().strip()
        assert self.address.startswith("http://127.0.0.1:"), (self.folder / "log").read_text()

    def end(self, number: int) -> None:
        if self.process is not None and self.process.poll() is None:
            self.process.send_signal(number)
        if self.process is not None:
            self.process.communicate(timeout=PATIENCE)

    def get(self, path: str) -> Any:
        return json.loads(self.read(path))

    def read(self, path: str) -> bytes:
        with urllib.request.urlopen(self.address + path, timeout=30.0) as answer:
            return bytes(answer.read())

    def submit(self, kind: str, axis: str = "one") -> str:
        token = (self.folder / "runs" / ".service" / "token").read_text().strip()
        headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
        body = json.dumps({"kind": kind}).encode()
        request = urllib.request.Request(f"{self.address}/api/axes/{axis}/jobs", body, headers, method="POST")
        with urllib.request.urlopen(request, timeout=30.0) as answer:
            return str(json.loads(answer.read())["id"])

    def wait_for(self, seen: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE
        while not seen():
            assert time.monotonic() < end, (self.folder / "log").read_text()
            time.sleep(0.05)

    def call(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """The command line beside it, which finds it by the locks of the environment."""
        return called(*arguments, folder=self.folder)


@pytest.fixture
def live(tmp_path: Path) -> Any:
    text = EXAMPLE.read_text().replace('name = "edm-vertical"', 'name = "one"')
    wire = "canopen+slcan:edm-vertical.tty?bitrate=1000000&node=5"
    (tmp_path / "one.toml").write_text(text.replace(wire, "sim://edm-vertical?memory=drive.json"))
    (tmp_path / "service.toml").write_text('schema = 1\n[http]\nport = 0\n[[axes]]\nfile = "one.toml"\n')
    here = Live(tmp_path, environment={**os.environ, "AUTOTUNE_LOCKS": str(tmp_path / "locks")})
    yield here
    here.end(signal.SIGTERM)


@pytest.mark.slow
def test_the_command_line_lets_the_service_do_it_and_says_so(live: Live) -> None:
    live.start()
    done = live.call("check", "one.toml", "--json")
    assert done.returncode == 0, done.stderr
    assert f"owned by the service at {live.address}" in done.stderr
    content = json.loads(done.stdout)
    assert content["friction"]["level"]["value"] == pytest.approx(0.333, abs=0.01)
    assert content["machine_seconds"] <= 60.0
    assert len(json.loads(live.call("history", "one.toml", "--json").stdout)["checks"]) == 1
    refused = live.call("record", "one.toml", "benchmark", "--yes", "--out", "x.csv")
    assert refused.returncode == 2
    assert "stop the service" in refused.stderr
    live.end(signal.SIGTERM)
    assert live.process is not None
    assert live.process.returncode == 0


@pytest.mark.slow
@pytest.mark.long
def test_kill_9_in_the_middle_of_a_job_loses_nothing_and_does_nothing_twice(live: Live) -> None:
    live.start()
    job = live.submit("check")
    live.wait_for(lambda: live.get(f"/api/jobs/{job}")["stage"] == "look")
    live.end(signal.SIGKILL)
    live.start()
    live.wait_for(lambda: live.get(f"/api/jobs/{job}")["state"] == "done")
    row = live.get(f"/api/jobs/{job}")
    assert row["outcome"] == "done"
    assert len(list((live.folder / "runs").glob("2*/check.json"))) == 1
    journals = [json.loads(path.read_text()) for path in (live.folder / "runs").glob("2*/journal.json")]
    assert all(journal["outcome"] for journal in journals)
    assert not any(journal["changed"] for journal in journals)


@dataclass
class Listener:
    """A real HTTP server that notices are posted to; it refuses the first one."""

    heard: list[dict[str, Any]] = field(default_factory=list)
    refused: int = 0

    def __enter__(self) -> str:
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                if outer.refused == 0:
                    outer.refused += 1
                    self.send_error(500)
                    return
                outer.heard.append(json.loads(body))
                self.send_response(204)
                self.end_headers()

            def log_message(self, format: str, *arguments: Any) -> None:
                return

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        threading.Thread(target=self._server.serve_forever, daemon=True).start()
        return f"http://127.0.0.1:{self._server.server_port}/notices"

    def __exit__(self, *whatever: object) -> None:
        self._server.shutdown()
        self._server.server_close()


@pytest.mark.slow
@pytest.mark.long
def test_reloading_drops_no_job_and_a_dead_drive_is_told_and_delays_nobody(live: Live) -> None:
    (live.folder / "dead.toml").write_text(
        EXAMPLE.read_text()
        .replace('name = "edm-vertical"', 'name = "dead"')
        .replace("edm-vertical.tty", "dead.tty")
    )
    service = live.folder / "service.toml"
    listener = Listener()
    with listener as url:
        only_one = (
            f'schema = 1\n[http]\nport = 0\n[notices]\nwebhook = "{url}"\n[[axes]]\nfile = "one.toml"\n'
        )
        service.write_text(only_one)
        live.start()
        job = live.submit("check")
        live.wait_for(lambda: live.get(f"/api/jobs/{job}")["state"] == "running")
        service.write_text(only_one + '[[axes]]\nfile = "dead.toml"\n')
        assert live.process is not None
        live.process.send_signal(signal.SIGHUP)
        live.wait_for(lambda: len(live.get("/api/axes")) == 2)
        dead = live.submit("check", "dead")
        live.wait_for(lambda: live.get(f"/api/jobs/{job}")["state"] == "done")
        row = live.get(f"/api/jobs/{job}")
        assert (row["outcome"], row["attempts"]) == ("done", 1)
        live.wait_for(lambda: live.get(f"/api/jobs/{dead}")["state"] == "done")
        assert live.get(f"/api/jobs/{dead}")["outcome"] == "fault"
        live.wait_for(lambda: bool(listener.heard))
        assert listener.refused == 1
        assert listener.heard[0]["axis"] == "dead"
        assert set(listener.heard[0]) == {"kind", "axis", "at", "sentence"}
        service.write_text("schema = 1\naxes = [{}]\n")
        live.process.send_signal(signal.SIGHUP)
        live.wait_for(lambda: "configuration not taken over" in (live.folder / "log").read_text())
        assert len(live.get("/api/axes")) == 2
        live.end(signal.SIGTERM)


@pytest.mark.slow
def test_a_torn_history_is_restored_on_the_start_and_this_is_said_loudly(live: Live) -> None:
    live.start()
    job = live.submit("check")
    live.wait_for(lambda: live.get(f"/api/jobs/{job}")["state"] == "done")
    live.end(signal.SIGTERM)
    history = live.folder / "runs" / ".service" / "history.sqlite"
    history.write_bytes(b"\xff" * 100 + history.read_bytes()[100:])
    live.start()
    health = live.get("/healthz")
    assert health["status"] == "ok"
    assert "TORN" in health["restored"]
    assert "autotune_history_restored 1.0" in live.read("/metrics").decode()
    assert len(live.get("/api/axes/one/checks")) == 1
    assert any(event["kind"] == "restored" for event in live.get("/api/history/events"))


def starved(row: dict[str, Any]) -> bool:
    """The machine had no time for a wire in real time: drive or program has ended the motion and says so."""
    words = row["sentence"] or ""
    return row["outcome"] == "fault" and ("this host was late" in words or "This host is busy" in words)


@pytest.mark.slow(8)
def test_kill_9_with_the_drive_behind_a_wire_loses_no_job(live: Live) -> None:
    axis = live.folder / "one.toml"
    axis.write_text(EXAMPLE.read_text().replace('name = "edm-vertical"', 'name = "one"'))
    drive = Program(AUTOTUNE, "sim", str(axis), env=live.environment)
    try:
        assert drive.stdout is not None
        assert "is simulated at" in drive.stdout.readline()
        live.start()
        job = live.submit("check")
        live.wait_for(lambda: live.get(f"/api/jobs/{job}")["stage"] == "look")
        live.end(signal.SIGKILL)
        live.start()
        live.wait_for(lambda: live.get(f"/api/jobs/{job}")["state"] == "done")
        row = live.get(f"/api/jobs/{job}")
        if not starved(row):
            assert row["outcome"] == "done", row["sentence"]
            (check,) = live.get("/api/axes/one/checks")
            assert check["level"] == pytest.approx(0.333, abs=0.01)
    finally:
        live.end(signal.SIGTERM)
        drive.send_signal(signal.SIGINT)
        drive.communicate(timeout=PATIENCE)


def test_serve_check_starts_nothing(live: Live) -> None:
    done = live.call("serve", "--check", "service.toml")
    assert done.returncode == 0
    assert "axis one checked at" in done.stdout
    (live.folder / "service.toml").write_text("schema = 1\naxes = []\n")
    assert live.call("serve", "--check", "service.toml").returncode == 2
    assert not (live.folder / "runs").exists()
