"""Eight axes in one service on two cores: is every check on time, and are cycles later than with one axis?

Every axis is a simulated drive in a process of its own that follows the wall clock, behind slcan, so that a
cycle that comes late is lost as it would be on a machine. Real drives do not share the host's cores, so the
simulators get a real-time priority above the loops' where the system permits it. All checks are due at the
same minute. Asked: each begins within BEGIN of when it was due and ends within END, and the share of lost
cycles is at most MORE above that of one axis alone.

    python -m bench.service_axes [--axes 8] [--cycle 0.004] [--out FILE.json]
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from bench.service_rig import CLI, Service, write_axis, write_service

BEGIN = 5.0  # s
END = 90.0  # s
MORE = 0.01
LINK = "canopen+slcan:{name}.tty?bitrate=1000000&node=5"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--axes", type=int, default=8)
    parser.add_argument("--cycle", type=float, default=0.004)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    one, many = (night(count, options.cycle) for count in (1, options.axes))
    found = {
        "cycle_s": options.cycle,
        "simulators_first": bool(_first()),
        "load_before": round(os.getloadavg()[2], 1),
        "one": one,
        "many": many,
        "on_time": many["latest_begin_s"] <= BEGIN and many["latest_end_s"] <= END,
        "more_lost": round(many["lost_share"]["worst"] - one["lost_share"]["worst"], 5),
        "more_lost_allowed": MORE,
    }
    print(json.dumps(found, indent=2))
    if options.out:
        options.out.write_text(json.dumps(found, indent=2))


def night(count: int, cycle: float) -> dict[str, Any]:
    """One night with so many axes."""
    folder = Path(tempfile.mkdtemp(prefix="autotune-axes-"))
    names = [f"axis-{number}" for number in range(1, count + 1)]
    service, drives = Service(folder), []
    try:
        for name in names:
            axis = write_axis(folder, name, LINK.format(name=name), cycle)
            drives.append(_drive(folder, axis))
        due = datetime.now(UTC).replace(second=0, microsecond=0) + timedelta(minutes=1 + (count > 4))
        write_service(folder, names, f"{due.minute} {due.hour} * * *")
        service.start()
        while datetime.now(UTC) < due + timedelta(seconds=2) or not service.jobs():
            time.sleep(0.2)
        jobs = service.wait_until_done(300.0)
        return _judged(folder, jobs, due, names)
    finally:
        service.end()
        for drive in drives:
            drive.send_signal(signal.SIGINT)
            drive.wait(20.0)
        shutil.rmtree(folder, ignore_errors=True)


def _first() -> list[str]:
    """What gives a simulator the processor before all others; nothing where that is not permitted."""
    allowed = subprocess.run(["chrt", "-f", "30", "true"], check=False, capture_output=True).returncode == 0
    return ["chrt", "-f", "30"] if allowed else []


def _drive(folder: Path, axis: Path) -> subprocess.Popen[str]:
    log = (folder / f"{axis.stem}.log").open("w")
    drive = subprocess.Popen(
        [*_first(), *CLI, "sim", str(axis), "--real-time"], stdout=subprocess.PIPE, stderr=log, text=True
    )
    log.close()
    if drive.stdout is None or "is simulated at" not in drive.stdout.readline():
        raise SystemExit((folder / f"{axis.stem}.log").read_text())
    return drive


def _judged(folder: Path, jobs: list[dict[str, Any]], due: datetime, names: list[str]) -> dict[str, Any]:
    checks = [json.loads(path.read_text()) for path in (folder / "runs").glob("2*/check.json")]
    lost = sorted(check["missed"] / (check["samples"] + check["missed"]) for check in checks)
    begun = [(datetime.fromisoformat(job["started"]) - due).total_seconds() for job in jobs]
    ended = [(datetime.fromisoformat(job["finished"]) - due).total_seconds() for job in jobs]
    return {
        "axes": len(names),
        "outcomes": sorted(f"{job['outcome']}" for job in jobs),
        "not_done": [job["sentence"] for job in jobs if job["outcome"] != "done"],
        "axes_checked": len({check["axis"] for check in checks}),
        "latest_begin_s": max(begun),
        "latest_end_s": max(ended),
        "lost_share": {"median": lost[len(lost) // 2], "worst": lost[-1]} if lost else {"worst": 1.0},
        "friction": sorted(round(check["friction"]["level"]["value"], 4) for check in checks),
    }


if __name__ == "__main__":
    main()
