"""Where a job of the service is at this very moment, read from its files, and waiting for a wanted moment.

The journal names stage and phase before each begins, so what is asked here is as fine as the transaction
itself. Reading it takes some 0.1 ms, so that also moments of a few milliseconds can be struck.

| moment | of a commit |
|---|---|
| before | planning and backup; nothing is written |
| writing | parameters are being written and read back |
| storing | the drive's memory is being written and read back |
| proving | the axis is measured with what the drive holds now |
| kept | the drive holds it; the run's folder does not say so yet |
| reporting | the folder says so, the job's result is not there yet |
| telling | the result is there; the history may have the row, or not yet |
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

COMMIT = ("before", "writing", "storing", "proving", "kept", "reporting", "telling")
LONG_STAGES = ("waiting", "experiment", "fit", "diagnose", "adapt")
ASK_EVERY = 0.25
AT_FIRST = {"before": 0.02, "writing": 0.005, "storing": 0.005, "kept": 0.05, "telling": 0.1}


@dataclass(frozen=True)
class Target:
    """A job that is waited for."""

    id: str
    axis: str
    kind: str


@dataclass
class Typical:
    """What each moment takes, learnt on the way [s]."""

    known: dict[str, float] = field(default_factory=dict)

    def learn(self, name: str, seconds: float) -> None:
        self.known[name] = 0.5 * (self.known.get(name, seconds) + seconds)

    def of(self, name: str) -> float:
        same = name.partition(":")[2]
        like = [value for key, value in self.known.items() if key.partition(":")[2] == same]
        return self.known.get(name, like[0] if like else AT_FIRST.get(same, 0.3))


def moment(runs: Path, job: Target, born: float) -> str:
    """`kind:moment` of a job under a service that was started at `born` (seconds of the epoch)."""
    return f"{job.kind}:{_moment(runs, job, born)}"


def _moment(runs: Path, job: Target, born: float) -> str:
    result = runs / ".service" / "jobs" / f"{job.id}.json"
    if result.exists():
        return "telling"
    begun = result.with_suffix(".begun.json")
    process = _read(begun).get("process")
    if process is None or begun.stat().st_mtime < born:
        return "waiting"
    mine = [name for name in os.listdir(runs) if name.startswith("2") and name.endswith(f"-{job.axis}")]
    directory = runs / max(mine, default="none")
    journal = _read(directory / "journal.json")
    return _of_journal(journal, directory) if journal.get("process") == process else "connect"


def _of_journal(journal: dict[str, Any], directory: Path) -> str:
    stage, phase = str(journal.get("stage")), str(journal.get("phase"))
    if stage in ("start", "connect", "rollback"):
        return "rollback" if stage == "rollback" else "connect"
    if phase in ("writing", "storing", "proving"):
        return phase
    if (directory / "run.json").exists() or (directory / "check.json").exists():
        return "reporting"
    if phase == "kept":
        return "kept"
    return "before" if stage == "commit" else stage


def _read(path: Path) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found


def wait_for(
    runs: Path, job: Target, wanted: str, born: float, typical: Typical, ended: Callable[[], bool]
) -> bool:
    """Until the job is in the wanted moment (True), or has ended without being seen there (False)."""
    seen, since, first, asked = "", 0.0, True, time.monotonic()
    while True:
        now, at = moment(runs, job, born), time.monotonic()
        if now != seen:
            if seen and not first:
                typical.learn(seen, at - since)
            first = not seen
            seen, since = now, at
        if now == wanted:
            return True
        if at - asked > ASK_EVERY:
            if ended():
                return False
            asked = time.monotonic()
        brief = wanted.partition(":")[2] in COMMIT and now.partition(":")[2] not in LONG_STAGES
        time.sleep(0.0001 if brief else 0.005)
