"""kill -9 at random moments of a service at work: in checks, in runs, in commits.

The drive is a process of its own (`autotune sim`), as a real one would be, or with --in-process a simulated
one with a memory file. After each kill the service is started again; asked is how long until /healthz
answers, and in the end whether every job that was confirmed was done, none of them twice, every confirmed
row is there, and the drive holds what the history says.

    python -m bench.service_kills [--kills 100] [--seed 1] [--out FILE.json]
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from autotune.core.axis import read_axis
from autotune.core.paths import config_directory
from autotune.service.committed import in_force

CLI = [sys.executable, "-m", "autotune.cli.main"]
WIRE = "canopen+slcan:edm-vertical.tty?bitrate=1000000&node=5"


@dataclass
class Bench:
    """One service on one simulated axis."""

    folder: Path
    port: int = 0
    process: subprocess.Popen[bytes] | None = None
    started: list[float] = field(default_factory=list)

    def __post_init__(self) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        axis = (config_directory() / "axes" / "edm-vertical.toml").read_text()
        memory = self.folder / "memory.json"
        (self.folder / "axis.toml").write_text(axis.replace(WIRE, f"sim://edm-vertical?memory={memory}"))
        (self.folder / "service.toml").write_text(
            f'schema = 1\nruns = "{self.folder / "runs"}"\n[http]\nport = {self.port}\n'
            '[recordings]\nbudget_megabytes = 400\n[[axes]]\nfile = "axis.toml"\ncheck = "0 0 1 1 *"\n'
        )

    def start(self) -> float:
        """Starts the service; returns seconds until it is healthy."""
        log = (self.folder / "log").open("ab")
        began = time.monotonic()
        self.process = subprocess.Popen(
            [*CLI, "serve", str(self.folder / "service.toml")], stdout=log, stderr=log,
            env={**os.environ, "AUTOTUNE_LOCKS": str(self.folder / "locks")},
        )  # fmt: skip
        log.close()
        while time.monotonic() - began < 60.0:
            if (answer := self.get("/healthz")) is not None and answer.get("status") == "ok":
                self.started.append(time.monotonic() - began)
                return self.started[-1]
            if self.process.poll() is not None:
                break
            time.sleep(0.02)
        raise SystemExit(f"the service did not start:\n{(self.folder / 'log').read_text()[-3000:]}")

    def kill(self) -> None:
        if self.process is not None:
            self.process.send_signal(signal.SIGKILL)
            self.process.wait()

    def end(self) -> None:
        if self.process is not None:
            self.process.send_signal(signal.SIGTERM)
            self.process.wait(60.0)

    def get(self, path: str) -> Any:
        try:
            with urllib.request.urlopen(f"http://127.0.0.1:{self.port}{path}", timeout=5.0) as answer:
                return json.loads(answer.read())
        except (OSError, urllib.error.URLError, ValueError):
            return None

    def submit(self, kind: str) -> str | None:
        """A job's id once the service has confirmed it; None where it refused or was gone."""
        token = (self.folder / "runs" / ".service" / "token").read_text().strip()
        request = urllib.request.Request(
            f"http://127.0.0.1:{self.port}/api/axes/edm-vertical/jobs", json.dumps({"kind": kind}).encode(),
            {"Content-Type": "application/json", "Authorization": f"Bearer {token}"}, method="POST",
        )  # fmt: skip
        try:
            with urllib.request.urlopen(request, timeout=5.0) as answer:
                return str(json.loads(answer.read())["id"])
        except (OSError, urllib.error.URLError, ValueError):
            return None

    def wait_until_done(self, seconds: float) -> list[dict[str, Any]]:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            jobs = self.get("/api/jobs?limit=1000")
            if jobs is not None and all(job["state"] == "done" for job in jobs):
                return list(jobs)
            time.sleep(0.3)
        raise SystemExit("the jobs did not end")


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--longest", type=float, default=15.0, help="seconds between start and kill, at most")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="autotune-kills-"))
    try:
        found = torture(folder, options.kills, random.Random(options.seed), options.longest)
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    print(json.dumps(found, indent=2))
    if options.out:
        options.out.write_text(json.dumps(found, indent=2))


def torture(folder: Path, kills: int, chance: random.Random, longest: float = 15.0) -> dict[str, Any]:
    """Kills and restarts, then lets everything end; returns what must hold."""
    bench = Bench(folder)
    confirmed: list[str] = []
    rows: set[str] = set()
    stages: dict[str, int] = {}
    bench.start()
    try:
        for _ in range(kills):
            for kind in ("run", "check") if chance.random() < 0.6 else ("check",):
                if (job := bench.submit(kind)) is not None:
                    confirmed.append(job)
            time.sleep(chance.uniform(0.0, longest))
            stage = _stage(bench)
            stages[stage] = stages.get(stage, 0) + 1
            rows |= _rows(bench)
            bench.kill()
            bench.start()
        jobs = bench.wait_until_done(300.0)
        left = _rows(bench)
    finally:
        bench.end()
    return _judged(folder, bench, jobs, confirmed, rows - left) | {"kills": kills, "killed_in_stage": stages}


def _judged(
    folder: Path, bench: Bench, jobs: list[dict[str, Any]], confirmed: list[str], missing: set[str]
) -> dict[str, Any]:
    done = {job["id"]: job for job in jobs}
    outcomes: dict[str, int] = {}
    for job in jobs:
        outcomes[f"{job['kind']} {job['outcome']}"] = outcomes.get(f"{job['kind']} {job['outcome']}", 0) + 1
    memory = folder / "memory.json"
    held = json.loads(memory.read_text()) if memory.exists() else {}
    present = in_force(folder / "runs", read_axis(folder / "axis.toml"), held)
    return {
        "jobs_confirmed": len(confirmed),
        "jobs_lost": sum(job not in done for job in confirmed),
        "jobs_done_twice": _twice(folder / "runs", jobs),
        "rows_missing": sorted(missing),
        "outcomes": outcomes,
        "drive_holds_what_history_says": present.held
        if present.committed
        else not held.get("feedforward.enabled"),
        "open_journals": _open_journals(folder / "runs"),
        "healthy_after_s": {
            "longest": round(max(bench.started), 2),
            "median": round(sorted(bench.started)[len(bench.started) // 2], 2),
        },
    }


def _twice(runs: Path, jobs: list[dict[str, Any]]) -> int:
    """Completed results beyond one for each job that left one."""
    checks = len(list(runs.glob("2*/check.json")))
    wanted = sum(job["kind"] == "check" and job["outcome"] == "done" for job in jobs)
    kept = sum(json.loads(path.read_text())["outcome"] == "kept" for path in runs.glob("2*/run.json"))
    wanted_kept = sum(job["kind"] == "run" and job["outcome"] == "kept" for job in jobs)
    return max(checks - wanted, 0) + max(kept - wanted_kept, 0)


def _open_journals(runs: Path) -> int:
    return sum(not json.loads(path.read_text()).get("outcome") for path in runs.glob("2*/journal.json"))


def _rows(bench: Bench) -> set[str]:
    """Ids of everything that the service has shown."""
    jobs = bench.get("/api/jobs?limit=1000") or []
    history = bench.get("/api/axes/edm-vertical/history?checks=1000") or {"checks": [], "runs": []}
    return {job["id"] for job in jobs} | {row["run"] for row in (*history["checks"], *history["runs"])}


def _stage(bench: Bench) -> str:
    running = bench.get("/api/jobs?state=running") or []
    return f"{running[0]['kind']}:{running[0]['stage']}" if running else "no job"


if __name__ == "__main__":
    main()
