"""A service in a process of its own for the benchmarks: started, asked over HTTP, ended or killed."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from autotune.core.paths import config_directory

CLI = [sys.executable, "-m", "autotune.cli.main"]
WIRE = "canopen+slcan:edm-vertical.tty?bitrate=1000000&node=5"
START_SECONDS = 120.0


def write_axis(folder: Path, name: str, link: str, cycle: float = 0.001) -> Path:
    """The example axis under another name, on another link."""
    text = (config_directory() / "axes" / "edm-vertical.toml").read_text()
    text = text.replace(WIRE, link).replace('name = "edm-vertical"', f'name = "{name}"')
    path = folder / f"{name}.toml"
    path.write_text(text.replace("cycle = 0.001", f"cycle = {cycle}"))
    return path


def write_service(folder: Path, axes: list[str], check: str = "0 0 1 1 *", more: str = "") -> None:
    """The service file of these axes; `check`: cron expression in UTC."""
    blocks = "".join(
        f'[[axes]]\nfile = "{name}.toml"\ncheck = "{check}"\ncommit = "automatic"\n' for name in axes
    )
    (folder / "service.toml").write_text(
        f'schema = 1\nruns = "{folder / "runs"}"\n[http]\nport = 0\n{more}\n{blocks}'
    )


@dataclass(frozen=True, slots=True)
class Start:
    """From the start of the process until /healthz says ok: by the clock, and processor time of it [s]."""

    wall: float
    processor: float


@dataclass
class Service:
    """`autotune serve` on `folder/service.toml`."""

    folder: Path
    process: subprocess.Popen[str] | None = None
    address: str = ""
    starts: list[Start] = field(default_factory=list)

    def start(self) -> Start:
        """Starts it and waits until it is healthy."""
        began = time.monotonic()
        with (self.folder / "log").open("a") as log:
            self.process = subprocess.Popen(
                [*CLI, "serve", str(self.folder / "service.toml")], stdout=subprocess.PIPE, stderr=log, text=True,
                env={**os.environ, "AUTOTUNE_LOCKS": str(self.folder / "locks")},
            )  # fmt: skip
        self.address = self.process.stdout.readline().strip() if self.process.stdout else ""
        while self.address and time.monotonic() - began < START_SECONDS:
            if (answer := self.get("/healthz")) is not None and answer.get("status") == "ok":
                self.starts.append(Start(time.monotonic() - began, _processor(self.process.pid)))
                return self.starts[-1]
            time.sleep(0.01)
        raise SystemExit(f"the service did not start:\n{(self.folder / 'log').read_text()[-3000:]}")

    def end(self, number: signal.Signals = signal.SIGTERM) -> None:
        """Ends it with a signal, and waits."""
        if self.process is None:
            return
        self.process.send_signal(number)
        self.process.wait(90.0)
        if self.process.stdout is not None:
            self.process.stdout.close()

    @property
    def token(self) -> str:
        return (self.folder / "runs" / ".service" / "token").read_text().strip()

    def get(self, path: str) -> Any:
        """The JSON at a path; None where it does not answer."""
        try:
            with urllib.request.urlopen(self.address + path, timeout=30.0) as answer:
                return json.loads(answer.read())
        except (OSError, urllib.error.URLError, ValueError):
            return None

    def submit(self, axis: str, kind: str) -> str | None:
        """A job's id once the service has confirmed it; None where it refused or was gone."""
        return self.post(f"/api/axes/{axis}/jobs", {"kind": kind})

    def post(self, path: str, content: dict[str, Any]) -> str | None:
        """The id in the answer; None where it refused or was gone."""
        request = urllib.request.Request(
            self.address + path, json.dumps(content).encode(),
            {"Content-Type": "application/json", "Authorization": f"Bearer {self.token}"}, method="POST",
        )  # fmt: skip
        try:
            with urllib.request.urlopen(request, timeout=30.0) as answer:
                return str(json.loads(answer.read())["id"])
        except (OSError, urllib.error.URLError, ValueError):
            return None

    def jobs(self) -> list[dict[str, Any]]:
        """All jobs, newest first."""
        return list(self.get("/api/jobs?limit=1000") or [])

    def wait_until_done(self, seconds: float) -> list[dict[str, Any]]:
        """Waits until no job is open."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            jobs = self.get("/api/jobs?limit=1000")
            if jobs is not None and all(job["state"] == "done" for job in jobs):
                return list(jobs)
            time.sleep(0.3)
        raise SystemExit(f"the jobs did not end:\n{(self.folder / 'log').read_text()[-3000:]}")


def _processor(process: int) -> float:
    """Processor time that a process has used [s]."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
