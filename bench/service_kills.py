"""kill -9 of a service at work, at random moments in every stage of checks, runs, commits and rollbacks.

Each kill waits for a stage, or a phase of a commit, and strikes at a random moment of what that takes. One
axis commits by itself; the other's runs wait for approval, and the approved commit, which is short, is struck
several times, once in each phase, until it is through. Every third kill finds a job on both axes. A third of
the kills are the service alone (its workers must notice and bring the axis to rest), the others everything at
once, as a power cut of the host. The drives are simulated ones with a memory file in the worker, or with
--wire processes of their own behind slcan (`autotune sim`), as real ones would be; --commits strikes commits
only. After each kill the service is started again; asked is how long until /healthz answers, whether every job
that was confirmed is done, none of them twice, every confirmed row is there, and, whenever no job is open,
whether the drive holds what the history says; with --wire also whether heartbeats, reactions, mode, cycle and
PDOs are as before the first job. Ctrl-C ends the killing early; what was until then is judged.

    python -m bench.service_kills [--kills 100] [--seed 1] [--wire] [--commits] [--out FILE.json]
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
from functools import partial
from pathlib import Path
from typing import Any

from autotune.core.axis import read_axis
from autotune.tuning.committed import in_force
from autotune.tuning.links import open_link
from bench.service_aim import COMMIT, Target, Typical, moment, wait_for
from bench.service_rig import CLI, WIRE, Service, Start, write_axis, write_service
from tests.drivers.bus import settings

AUTOMATIC, ASKING = "edm-vertical", "edm-second"
SHARES = {
    "nothing": 0.04, "check:connect": 0.02, "check:look": 0.11, "check:telling": 0.02, "run:connect": 0.02,
    "run:experiment": 0.08, "run:fit": 0.09, "run:diagnose": 0.08, "run:adapt": 0.08, "run:prove": 0.06,
    "rollback:rollback": 0.04,
}  # fmt: skip
"""Share of the kills that wait for each stage; the rest are commits."""
BATCH = ("writing", "storing", "proving")
"""Every batch of an approved commit has these and one before, then one of the late phases ends it."""
TOGETHER = 0.33
MOST_ATTEMPTS = 6
LONGEST_WAIT = 900.0


@dataclass
class Story:
    """What was confirmed on the way, and where the kills struck."""

    confirmed: set[str] = field(default_factory=set)
    rows: set[str] = field(default_factory=set)
    struck: Counter[str] = field(default_factory=Counter)
    beside: int = 0
    everything: int = 0
    quiet: int = 0
    wrong: list[str] = field(default_factory=list)
    kills: list[dict[str, Any]] = field(default_factory=list)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--kills", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--wire", action="store_true", help="each drive is a process of its own")
    parser.add_argument("--commits", action="store_true", help="commits only")
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    folder = Path(tempfile.mkdtemp(prefix="autotune-kills-"))
    chance = random.Random(options.seed)
    wanted = plan(options.kills, chance, options.commits)
    drives: list[subprocess.Popen[str]] = []
    try:
        prepare(folder, options.wire, drives)
        found = Torture(folder, chance).run(wanted)
    finally:
        for drive in drives:
            drive.send_signal(signal.SIGINT)
            drive.wait(20.0)
        shutil.rmtree(folder, ignore_errors=True)
    print(json.dumps(found, indent=2))
    if options.out:
        options.out.write_text(json.dumps(found, indent=2))


def plan(kills: int, chance: random.Random, commits_only: bool) -> list[str]:
    """What each kill waits for; batches of commits stay together, all else is in random order."""
    groups = [] if commits_only else [[s] for s, share in SHARES.items() for _ in range(round(share * kills))]
    left, late = kills - len(groups), list(COMMIT[4:])
    while left > 0:
        kind = "run" if not commits_only and chance.random() < 0.15 else "commit"
        early = [] if kind == "run" else ["before", *BATCH]
        chance.shuffle(early)
        last = chance.choice(COMMIT if kind == "run" else late)
        groups.append([f"{kind}:{phase}" for phase in [*early, last]][-left:])
        left -= len(groups[-1])
    chance.shuffle(groups)
    return [stage for group in groups for stage in group]


def prepare(folder: Path, wire: bool, drives: list[subprocess.Popen[str]]) -> None:
    """Axes and service file; the drives' processes where they are ones of their own."""
    for name in (AUTOMATIC, ASKING):
        simulated = f"sim://edm-vertical?memory={folder / name}.json"
        axis = write_axis(folder, name, WIRE.replace("edm-vertical", name) if wire else simulated)
        if not wire:
            continue
        with (folder / f"{name}.log").open("w") as log:
            drives.append(
                subprocess.Popen([*CLI, "sim", str(axis)], stdout=subprocess.PIPE, stderr=log, text=True)
            )
        told = drives[-1].stdout
        if told is None or "is simulated at" not in told.readline():
            raise SystemExit((folder / f"{name}.log").read_text())
    write_service(folder, [AUTOMATIC, ASKING], more="[recordings]\nbudget_megabytes = 400")
    file = folder / "service.toml"
    before, _, _ = file.read_text().rpartition('"automatic"')  # the last axis's block is the last one
    file.write_text(f'{before}"ask"\n')


class Torture:
    """The service in a folder, killed and started again."""

    def __init__(self, folder: Path, chance: random.Random) -> None:
        self.folder, self.runs, self.chance = folder, folder / "runs", chance
        self.service, self.story, self.typical = Service(folder), Story(), Typical()
        self.born = 0.0
        self.before = {port: settings(port) for port in sorted(folder.glob("*.tty"))}

    def run(self, wanted: list[str]) -> dict[str, Any]:
        """All kills, then everything may end; returns what must hold."""
        self._start()
        try:
            try:
                for stage in wanted:
                    self._one(stage)
            except KeyboardInterrupt:
                print("no more kills", file=sys.stderr)
            if self.service.get("/healthz") is None:
                self._start()
            jobs = self._quiet()
            self.story.rows -= self._rows()
        finally:
            self.service.end()
        return judged(self.runs, self.service, jobs, self.story)

    def _start(self) -> Start:
        self.born = time.time()
        return self.service.start()

    def _one(self, stage: str) -> None:
        if any(job["attempts"] >= MOST_ATTEMPTS for job in self._open()):
            self._quiet()
        target = self._reach(stage)
        self.story.rows |= self._rows() if target is None else set()
        longest = self.typical.of(stage)
        delay = self.chance.uniform(0.0, longest)
        victims = self._victims()
        time.sleep(delay)
        if delay > 0.05:
            victims = self._victims()
        others = [one for one in self._targets if one != target]
        struck = moment(self.runs, target, self.born) if target else "nothing"
        beside = [moment(self.runs, one, self.born) for one in others]
        for process in victims:
            with suppress(ProcessLookupError):
                os.kill(process, signal.SIGKILL)
        self.service.end(signal.SIGKILL)
        self._note(
            stage,
            struck,
            [name for name in beside if not name.endswith(("waiting", "telling"))],
            len(victims) > 1,
        )

    def _note(self, stage: str, struck: str, beside: list[str], everything: bool) -> None:
        start, story = self._start(), self.story
        story.struck[struck] += 1
        story.beside += bool(beside)
        story.everything += everything
        kill = {
            "wanted": stage, "struck": struck, "beside": beside, "everything": everything,
            "healthy_after_s": round(start.wall, 2), "processor_s": round(start.processor, 2),
            "load": round(os.getloadavg()[0], 1),
        }  # fmt: skip
        story.kills.append(kill)
        print(f"{len(story.kills)} {json.dumps(kill)}", file=sys.stderr, flush=True)

    # How a kill comes to its stage

    def _reach(self, stage: str) -> Target | None:
        """A job that is in the stage now; None where nothing is to run."""
        self._targets: list[Target] = []
        if stage == "nothing":
            self._quiet()
            return None
        kind, end = stage.partition(":")[0], time.monotonic() + LONGEST_WAIT
        while time.monotonic() < end:
            target = self._job(kind)
            self._targets = [target]
            if self.chance.random() < TOGETHER:
                other = ASKING if target.axis == AUTOMATIC else AUTOMATIC
                beside = self._known(other, "check") or self._order(other, "check")
                self._targets += [beside] if beside else []
            self.story.rows |= self._rows()
            if wait_for(self.runs, target, stage, self.born, self.typical, partial(self._ended, target)):
                return target
        raise SystemExit(f"stage {stage} was not reached in {LONGEST_WAIT} s:\n{self._told()}")

    def _job(self, kind: str) -> Target:
        """An open job of the kind, ordered where there is none, after what must come before it."""
        for axis in (ASKING, AUTOMATIC):
            if (job := self._known(axis, kind)) is not None and (kind != "run" or axis == AUTOMATIC):
                return job
        if kind == "commit":
            return self._approved()
        if kind == "rollback" and self._last(AUTOMATIC) != "kept":
            self._through(AUTOMATIC, "run")
        if kind == "run" and self._last(AUTOMATIC) == "kept":
            self._through(AUTOMATIC, "rollback")
        return self._order(AUTOMATIC, kind) or self._job(kind)

    def _approved(self) -> Target:
        """A commit job: the open proposal is approved, after a run that makes one where there is none."""
        proposals = self.service.get("/api/proposals") or []
        waiting = [one["id"] for one in proposals if one["state"] == "open"]
        if not waiting:
            if self._last(ASKING) == "kept":
                self._through(ASKING, "rollback")
            self._through(ASKING, "run")
            return self._approved()
        identifier = self.service.post(f"/api/proposals/{waiting[0]}/approve", {})
        if identifier is None:
            raise SystemExit(f"a proposal could not be approved:\n{self._told()}")
        return self._confirmed(identifier, ASKING, "commit")

    def _through(self, axis: str, kind: str) -> None:
        """A job to its end without a kill; it may have been open already."""
        self._known(axis, kind) or self._order(axis, kind)
        self._quiet()

    def _order(self, axis: str, kind: str) -> Target | None:
        identifier = self.service.submit(axis, kind)
        return self._confirmed(identifier, axis, kind) if identifier else None

    def _confirmed(self, identifier: str, axis: str, kind: str) -> Target:
        self.story.confirmed.add(identifier)
        return Target(identifier, axis, kind)

    # What is there

    def _open(self) -> list[dict[str, Any]]:
        return [job for job in self.service.jobs() if job["state"] != "done"]

    def _known(self, axis: str, kind: str) -> Target | None:
        found = [job["id"] for job in self._open() if (job["axis"], job["kind"]) == (axis, kind)]
        return Target(found[0], axis, kind) if found else None

    def _last(self, axis: str) -> str:
        """`kept` where the newest job that changed the drive was a commit."""
        outcomes = [job["outcome"] for job in self.service.jobs() if job["axis"] == axis]
        return next((one for one in outcomes if one in ("kept", "restored")), "")

    def _ended(self, target: Target) -> bool:
        return any(job["id"] == target.id and job["state"] == "done" for job in self.service.jobs())

    def _told(self) -> str:
        return "\n".join(
            f"{job['axis']} {job['kind']} {job['state']} {job['outcome']} {job['sentence']}"
            for job in self.service.jobs()
        )

    def _rows(self) -> set[str]:
        """Ids of everything that the service has shown."""
        found = {job["id"] for job in self.service.jobs()}
        for axis in (AUTOMATIC, ASKING):
            history = self.service.get(f"/api/axes/{axis}/history?checks=1000") or {"checks": [], "runs": []}
            found |= {row["run"] for row in (*history["checks"], *history["runs"])}
        return found

    def _quiet(self) -> list[dict[str, Any]]:
        """Waits until no job is open; then the drives must hold what the history says, and be sound."""
        jobs = self.service.wait_until_done(LONGEST_WAIT)
        self.story.quiet += 1
        for name in (AUTOMATIC, ASKING):
            self.story.wrong += [f"{len(self.story.kills)} kills, {name}: {one}" for one in self._wrong(name)]
        return jobs

    def _wrong(self, name: str) -> list[str]:
        axis = read_axis(self.folder / f"{name}.toml")
        port = self.folder / f"{name}.tty"
        now = settings(port) if port in self.before else {}
        changed = [
            f"{text} is {now.get(text)} instead of {value}"
            for text, value in self.before.get(port, {}).items()
            if not text.startswith("2") and now.get(text) != value  # vendor objects hold what is committed
        ]
        loop = open_link(axis, self.folder, self.runs)
        try:
            held, faults = loop.read_parameters(), loop.faults()
        finally:
            loop.close()
        present = in_force(self.runs, axis, held)
        if present.committed is None and held.get("feedforward.enabled"):
            return [*faults, *changed, "the drive's feedforward is on, and nothing is committed"]
        wrong = ["the drive does not hold what is committed"] if present.held is False else []
        return [*faults, *changed, *wrong]

    def _victims(self) -> list[int]:
        """The service alone, or it and all its descendants (a worker may have one of its own for the link)."""
        if self.service.process is None:
            return []
        service = self.service.process.pid
        return [service, *(descendants(service) if self.chance.random() < 0.67 else [])]


def descendants(process: int) -> list[int]:
    """All processes below one."""
    found: list[int] = []
    for task in Path(f"/proc/{process}/task").glob("*/children"):
        with suppress(OSError):
            for child in map(int, task.read_text().split()):
                found += [child, *descendants(child)]
    return found


def judged(runs: Path, service: Service, jobs: list[dict[str, Any]], story: Story) -> dict[str, Any]:
    """The figures that the kills are judged by."""
    done = {job["id"] for job in jobs}
    slowest = max(story.kills, key=lambda kill: kill["healthy_after_s"], default=None)
    return {
        "kills": len(story.kills),
        "of_everything": story.everything,
        "with_jobs_on_both_axes": story.beside,
        "struck": dict(sorted(story.struck.items())),
        "jobs_confirmed": len(story.confirmed),
        "jobs_lost": len(story.confirmed - done),
        "jobs_done_twice": _twice(runs, jobs),
        "rows_missing": sorted(story.rows),
        "outcomes": dict(Counter(f"{job['kind']} {job['outcome']}" for job in jobs)),
        "drives_looked_at": story.quiet,
        "drives_wrong": story.wrong,
        "open_journals": sum(
            not json.loads(path.read_text()).get("outcome") for path in runs.glob("2*/journal.json")
        ),
        "healthy_after_s": _spread([start.wall for start in service.starts[1:]]),
        "healthy_slowest": slowest,
        "processor_s": _spread([start.processor for start in service.starts[1:]]),
        "load": _spread([kill["load"] for kill in story.kills]),
        "every_kill": story.kills,
    }


def _spread(values: list[float]) -> dict[str, float]:
    ordered = sorted(values) or [0.0]
    return {"median": round(ordered[len(ordered) // 2], 2), "longest": round(ordered[-1], 2)}


def _twice(runs: Path, jobs: list[dict[str, Any]]) -> int:
    """Completed results beyond one for each job that left one."""
    checks = len(list(runs.glob("2*/check.json")))
    wanted = sum(job["kind"] == "check" and job["outcome"] == "done" for job in jobs)
    results = [json.loads(path.read_text()) for path in runs.glob("2*/run.json")]
    kept = sum(result["outcome"] == "kept" for result in results)
    wanted_kept = sum(job["kind"] in ("run", "commit") and job["outcome"] == "kept" for job in jobs)
    return int(max(checks - wanted, 0) + max(kept - wanted_kept, 0))


if __name__ == "__main__":
    main()
