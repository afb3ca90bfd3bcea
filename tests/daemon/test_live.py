"""The service as a user has it: a process, its address, jobs through the command line, kill -9 in the middle."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

EXAMPLE = Path(__file__).resolve().parents[2] / "config" / "axes" / "edm-vertical.toml"
CLI = [sys.executable, "-m", "autotune.cli.main"]
PATIENCE = 120.0  # s; a loaded host is slow, a broken service never comes


@dataclass
class Live:
    """A service in a process of its own."""

    folder: Path
    process: subprocess.Popen[str] | None = None
    address: str = ""
    environment: dict[str, str] = field(default_factory=dict)

    def start(self) -> None:
        log = (self.folder / "log").open("a")
        self.process = subprocess.Popen(
            [*CLI, "serve", "service.toml"], cwd=self.folder, stdout=subprocess.PIPE, stderr=log, text=True,
            env=self.environment,
        )  # fmt: skip
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
        with urllib.request.urlopen(self.address + path, timeout=30.0) as answer:
            return json.loads(answer.read())

    def submit(self, kind: str) -> str:
        token = (self.folder / "runs" / ".service" / "token").read_text().strip()
        headers = {"Authorization": f"Bearer {token}", "Content-Type": "application/json"}
        body = json.dumps({"kind": kind}).encode()
        request = urllib.request.Request(f"{self.address}/api/axes/one/jobs", body, headers, method="POST")
        with urllib.request.urlopen(request, timeout=30.0) as answer:
            return str(json.loads(answer.read())["id"])

    def wait_for(self, seen: Callable[[], bool]) -> None:
        end = time.monotonic() + PATIENCE
        while not seen():
            assert time.monotonic() < end, (self.folder / "log").read_text()
            time.sleep(0.05)

    def call(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [*CLI, *arguments], cwd=self.folder, capture_output=True, text=True, timeout=PATIENCE, check=False,
            env=self.environment,
        )  # fmt: skip


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


def test_serve_check_starts_nothing(live: Live) -> None:
    done = live.call("serve", "--check", "service.toml")
    assert done.returncode == 0
    assert "axis one checked at" in done.stdout
    (live.folder / "service.toml").write_text("schema = 1\naxes = []\n")
    assert live.call("serve", "--check", "service.toml").returncode == 2
    assert not (live.folder / "runs").exists()
