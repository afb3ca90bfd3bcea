"""How long reads of the API take while a tuning runs, with a year's history behind them.

One axis is tuned (a simulated drive in the worker process, which takes a whole core), another has a history
of 365 checks. Each endpoint is read in turn, one request after the other, until the tuning has ended.

With `--pages`, so many of the service's pages are open in a browser beside it; with `--hung`, the browser is then
suspended for so many seconds, as a tab that hangs.

    python -m bench.service_reads [--pages 3] [--hung 30] [--out FILE.json]
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import tempfile
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import numpy as np

from bench.service_rig import Service, write_axis, write_service

CHECKS = 365
PATHS = (
    "/healthz", "/api/axes", "/api/axes/worn", "/api/axes/worn/history", "/api/axes/worn/checks?limit=1000",
    "/api/jobs", "/api/history/events", "/api/proposals", "/api/axes/tuned/models",
    "/api/axes/tuned/recordings", "/metrics", "/openapi.json",
)  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path)
    parser.add_argument("--pages", type=int, default=0)
    parser.add_argument("--hung", type=float, default=0.0)
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="autotune-reads-"))
    service = Service(folder)
    try:
        for name in ("tuned", "worn"):
            write_axis(folder, name, f"sim://edm-vertical?memory={folder / name}.json")
        write_service(folder, ["tuned", "worn"])
        _past(folder, CHECKS)
        service.start()
        alone = read_for(service, lambda n: n < 20)
        with opened(service, folder, options.pages) as process:
            service.submit("tuned", "run")
            hung = suspended(service, process, options.hung) if process and options.hung else {}
            busy = read_for(
                service, lambda n: n < 20 or any(job["state"] != "done" for job in service.jobs())
            )
        (job,) = service.jobs()
        peak = memory(service.process.pid) if service.process else 0
    finally:
        service.end()
        shutil.rmtree(folder, ignore_errors=True)
    found = {
        "run": job["outcome"], "load": round(os.getloadavg()[0], 1), "pages": options.pages,
        "server_peak_mb": round(peak / 1e6), "idle": judged(alone), "tuning": judged(busy), **hung,
    }  # fmt: skip
    print(json.dumps(found, indent=2))
    if options.out:
        options.out.write_text(json.dumps(found, indent=2))


@contextmanager
def opened(service: Service, folder: Path, pages: int) -> Iterator[int]:
    """So many tabs on the service, one of them the workbench; the browser's process, 0 without any."""
    if not pages:
        yield 0
        return
    from tests.workbench.browser import browser

    (folder / "browser").mkdir()
    with browser(folder / "browser") as driver:
        for number in range(pages):
            if number:
                driver.switch_to.new_window("window")  # a tab in the background asks nothing
            driver.get(service.address + ("/workbench" if number == 1 else "/"))
        yield int(driver.service.process.pid)


def suspended(service: Service, process: int, seconds: float) -> dict[str, Any]:
    """Reads while the browser is stopped, and then goes on."""
    tree = [process, *below(process)]
    for one in tree:
        os.kill(one, signal.SIGSTOP)
    before, end = memory(service.process.pid, "VmRSS") if service.process else 0, time.monotonic() + seconds
    try:
        times = read_for(service, lambda n: time.monotonic() < end)
    finally:
        for one in tree:
            os.kill(one, signal.SIGCONT)
    after = memory(service.process.pid, "VmRSS") if service.process else 0
    return {"hung": judged(times) | {"seconds": seconds, "memory_grew_mb": round((after - before) / 1e6, 1)}}


def below(process: int) -> list[int]:
    """All processes that come from one."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if int(fields[1]) == process:
            child = int(path.parent.name)
            found += [child, *below(child)]
    return found


def memory(process: int, name: str = "VmHWM") -> int:
    """Bytes that a process has, or has had at most."""
    text = Path(f"/proc/{process}/status").read_text()
    return int(next(line for line in text.splitlines() if line.startswith(name)).split()[1]) * 1024


def read_for(service: Service, going: Any) -> dict[str, list[float]]:
    """Times of reads [s] by path, round after round while `going(round)`."""
    times: dict[str, list[float]] = {path: [] for path in PATHS}
    turn = 0
    while going(turn):
        turn += 1
        for path in PATHS:
            began = time.perf_counter()
            with urllib.request.urlopen(service.address + path, timeout=30.0) as answer:
                answer.read()
            times[path].append(time.perf_counter() - began)
    return times


def judged(times: dict[str, list[float]]) -> dict[str, Any]:
    """Milliseconds: of all reads, and the 99th percentile of each path."""
    every = 1e3 * np.concatenate([np.array(values) for values in times.values()])
    return {
        "reads": len(every),
        "median_ms": round(float(np.median(every)), 1),
        "p99_ms": round(float(np.quantile(every, 0.99)), 1),
        "longest_ms": round(float(every.max()), 1),
        "p99_ms_by_path": {
            path: round(1e3 * float(np.quantile(values, 0.99)), 1) for path, values in times.items()
        },
    }


def _past(folder: Path, checks: int) -> None:
    """Check results of a year, as files: the service takes them up on its start."""
    random = np.random.default_rng(1)
    start = datetime(2025, 1, 1, 3, 30, tzinfo=UTC)
    for day in range(checks):
        at = start + timedelta(days=day)
        level = 0.33 * (1.0 + 0.4 * np.clip((day - 100) / 100, 0, 1)) * (1.0 + random.normal(0.0, 0.005))
        level *= 0.7 if day > 250 else 1.0
        temperature = 25.0 - 8.0 * np.cos(2 * np.pi * day / 365) + random.normal(0.0, 1.5)
        run = folder / "runs" / f"{at:%Y%m%d-%H%M%S}-worn"
        run.mkdir(parents=True)
        (run / "check.json").write_text(json.dumps(_check(at, float(level), float(temperature))))


def _check(at: datetime, level: float, temperature: float) -> dict[str, Any]:
    peaks = {"peak_error": 5e-4, "raw_peak_error": 5e-4, "rms_error": 2e-4}
    return {
        "schema": 1, "axis": "worn", "at": at.isoformat(), "verdict": "No drift.", "advice": "",
        "motion_unit": "rad", "committed": {"run": "20250101-000000-worn"}, "temperature": temperature,
        "friction": {"level": {"value": level, "standard_error": 1e-3, "unit": "N m"}}, "position_noise": 1e-5,
        "drift": {"state": "none", "beyond": False, "change": 0.0}, "tracking_error": peaks,
        "uncompensated": peaks | {"peak_error": 2e-3}, "missed": 0, "samples": 30000,
    }  # fmt: skip


if __name__ == "__main__":
    main()
