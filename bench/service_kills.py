"""kill -9 of a service at work, at random moments in every stage of checks, runs and commits.

Each kill has a stage that it waits for; then it strikes at a random moment of what that stage takes. Half of
them are the service alone (its worker must notice and bring the axis to rest), half are everything at once, as
a power cut of the host. The drive is a simulated one with a memory file in the worker, or with --wire a process
of its own behind slcan (`autotune sim`), as a real one would be. After each kill the service is started again;
asked is how long until /healthz answers, and in the end whether every job that was confirmed was done, none of
them twice, every confirmed row is there, and the drive holds what the history says. Ctrl-C ends the killing
early; what was confirmed until then is judged.

    python -m bench.service_kills [--kills 100] [--seed 1] [--wire] [--out FILE.json]
"""

from __future__ import annotations

import argparse
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from autotune.core.axis import read_axis
from autotune.core.loop import Loop
from autotune.service.committed import in_force
from autotune.service.links import open_link
from bench.service_rig import CLI, WIRE, Service, write_axis, write_service

AXIS = "edm-vertical"
STAGES = {
    "nothing": 0.03, "check:connect": 0.04, "check:look": 0.16, "run:connect": 0.05, "run:check": 0.04,
    "run:experiment": 0.12, "run:fit": 0.12, "run:diagnose": 0.1, "run:adapt": 0.12, "run:prove": 0.1,
    "run:commit": 0.12,
}  # fmt: skip
"""Share of the kills that wait for each stage."""
MOST_ATTEMPTS = 6
LONGEST_WAIT = 900.0


@dataclass
class Story:
    """What was confirmed on the way, and where the kills struck."""

    confirmed: list[str] = field(default_factory=list)
    rows: set[str] = field(default_factory=set)
    struck: Counter[str] = field(default_factory=Counter)
    phases: Counter[str] = field(default_factory=Counter)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--wire", action="store_true", help="the drive is a process of its own")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="autotune-kills-"))
    drive: subprocess.Popen[str] | None = None
    try:
        drive = _prepare(folder, options.wire)
        found = torture(folder, options.kills, random.Random(options.seed))
    finally:
        if drive is not None:
            drive.send_signal(signal.SIGINT)
            drive.wait(20.0)
        shutil.rmtree(folder, ignore_errors=True)
    print(json.dumps(found, indent=2))
    if options.out:
        options.out.write_text(json.dumps(found, indent=2))


def _prepare(folder: Path, wire: bool) -> subprocess.Popen[str] | None:
    """Axis and service file; the drive's process where it is one of its own."""
    axis = write_axis(folder, AXIS, WIRE if wire else f"sim://edm-vertical?memory={folder / 'memory.json'}")
    write_service(folder, [AXIS], more="[recordings]\nbudget_megabytes = 400")
    if not wire:
        return None
    log = (folder / "drive.log").open("w")
    drive = subprocess.Popen([*CLI, "sim", str(axis)], stdout=subprocess.PIPE, stderr=log, text=True)
    log.close()
    if drive.stdout is None or "is simulated at" not in drive.stdout.readline():
        raise SystemExit((folder / "drive.log").read_text())
    return drive


def torture(folder: Path, kills: int, chance: random.Random) -> dict[str, Any]:
    """Kills and restarts, then lets everything end; returns what must hold."""
    service, story = Service(folder), Story()
    wanted = [stage for stage, share in STAGES.items() for _ in range(round(share * kills))]
    chance.shuffle(wanted)
    typical = dict.fromkeys(STAGES, 0.5)
    service.start()
    try:
        try:
            for stage in wanted:
                _wait_for(service, stage, story, typical)
                time.sleep(chance.uniform(0.0, typical[stage]))
                _note(service, folder, story)
                _kill(service, everything=chance.random() < 0.5)
                service.start()
                print(f"{len(service.starts) - 1} kills: {dict(story.struck)}", file=sys.stderr, flush=True)
        except KeyboardInterrupt:
            print("no more kills", file=sys.stderr)
        if service.get("/healthz") is None:
            service.start()
        jobs = service.wait_until_done(LONGEST_WAIT)
        story.rows -= _rows(service)
    finally:
        service.end()
    return _judged(folder, service, jobs, story) | {"kills": story.struck.total()}


def _wait_for(service: Service, stage: str, story: Story, typical: dict[str, float]) -> None:
    """Until a job is in the stage; orders one where none is open. Learns what stages take on the way."""
    kind = stage.partition(":")[0]
    if any(job["attempts"] >= MOST_ATTEMPTS for job in service.jobs() if job["state"] != "done"):
        service.wait_until_done(LONGEST_WAIT)
    if kind == "nothing":
        service.wait_until_done(LONGEST_WAIT)
        return
    end = time.monotonic() + LONGEST_WAIT
    seen, since = "", time.monotonic()
    while time.monotonic() < end:
        jobs = [job for job in service.jobs() if job["state"] != "done"]
        if all(job["kind"] != kind for job in jobs):
            _order(service, kind, story)
        now = _stage(jobs)
        if now != seen:
            if seen in typical and since > 0.0:
                typical[seen] = 0.5 * (typical[seen] + time.monotonic() - since)
            seen, since = now, time.monotonic()
        if now == stage:
            return
        time.sleep(0.01)
    told = "\n".join(
        f"{job['kind']} {job['state']} {job['outcome']} {job['sentence']}" for job in service.jobs()
    )
    raise SystemExit(f"stage {stage} was not reached in {LONGEST_WAIT} s; jobs, newest first:\n{told}")


def _order(service: Service, kind: str, story: Story) -> None:
    """A job of the kind; before a run, what an earlier one has committed is rolled back, or nothing would be gained."""
    settled = [job["outcome"] for job in service.jobs() if job["outcome"] in ("kept", "restored")]
    for one in ["rollback", kind] if kind == "run" and settled[:1] == ["kept"] else [kind]:
        if (job := service.submit(AXIS, one)) is not None:
            story.confirmed.append(job)


def _note(service: Service, folder: Path, story: Story) -> None:
    """Where the kill strikes, and what the service has shown until then."""
    stage = _stage([job for job in service.jobs() if job["state"] == "running"])
    story.struck[stage] += 1
    story.rows |= _rows(service)
    if stage == "run:commit":
        newest = max((folder / "runs").glob("2*/journal.json"))
        story.phases[str(json.loads(newest.read_text()).get("phase") or "before")] += 1


def _stage(jobs: list[dict[str, Any]]) -> str:
    running = [job for job in jobs if job["state"] == "running"]
    return f"{running[0]['kind']}:{running[0]['stage']}" if running else "nothing"


def _kill(service: Service, everything: bool) -> None:
    """The service alone, or with all its descendants (the worker may have one of its own for the link)."""
    processes = _descendants(service.process.pid) if service.process and everything else []
    service.end(signal.SIGKILL)
    for process in processes:
        with suppress(ProcessLookupError):
            os.kill(process, signal.SIGKILL)


def _descendants(process: int) -> list[int]:
    found: list[int] = []
    for task in Path(f"/proc/{process}/task").glob("*/children"):
        for child in map(int, task.read_text().split()):
            found += [child, *_descendants(child)]
    return found


def _judged(folder: Path, service: Service, jobs: list[dict[str, Any]], story: Story) -> dict[str, Any]:
    done = {job["id"] for job in jobs}
    runs = folder / "runs"
    axis = read_axis(folder / f"{AXIS}.toml")
    loop = open_link(axis, folder)
    try:
        held = loop.read_parameters()
        at_rest = _without_power(loop)
    finally:
        loop.close()
    present = in_force(runs, axis, held)
    return {
        "killed_in": dict(sorted(story.struck.items())),
        "killed_in_commit_phase": dict(story.phases),
        "jobs_confirmed": len(story.confirmed),
        "jobs_lost": sum(job not in done for job in story.confirmed),
        "jobs_done_twice": _twice(runs, jobs),
        "rows_missing": sorted(story.rows),
        "outcomes": dict(Counter(f"{job['kind']} {job['outcome']}" for job in jobs)),
        "drive_holds_what_history_says": present.held
        if present.committed
        else not held.get("feedforward.enabled"),
        "drive_faults": at_rest,
        "open_journals": sum(
            not json.loads(path.read_text()).get("outcome") for path in runs.glob("2*/journal.json")
        ),
        "restarts": len(service.starts),
        "healthy_after_s": _spread([start.wall for start in service.starts]),
        "processor_s": _spread([start.processor for start in service.starts]),
        "load": round(os.getloadavg()[0], 1),
    }


def _without_power(loop: Loop) -> list[str]:
    return list(loop.faults())


def _spread(values: list[float]) -> dict[str, float]:
    ordered = sorted(values)
    return {"median": round(ordered[len(ordered) // 2], 2), "longest": round(ordered[-1], 2)}


def _twice(runs: Path, jobs: list[dict[str, Any]]) -> int:
    """Completed results beyond one for each job that left one."""
    checks = len(list(runs.glob("2*/check.json")))
    wanted = sum(job["kind"] == "check" and job["outcome"] == "done" for job in jobs)
    kept = sum(json.loads(path.read_text())["outcome"] == "kept" for path in runs.glob("2*/run.json"))
    wanted_kept = sum(job["kind"] == "run" and job["outcome"] == "kept" for job in jobs)
    return max(checks - wanted, 0) + max(kept - wanted_kept, 0)


def _rows(service: Service) -> set[str]:
    """Ids of everything that the service has shown."""
    history = service.get(f"/api/axes/{AXIS}/history?checks=1000") or {"checks": [], "runs": []}
    return {job["id"] for job in service.jobs()} | {
        row["run"] for row in (*history["checks"], *history["runs"])
    }


if __name__ == "__main__":
    main()
