"""A job under way: what its worker is asked, how long it may take, and what a strange end of it means."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from autotune.service.launcher import Handle
from autotune.service.orders import Done, Order, read_done, salvage
from autotune.service.settings import WatchedAxis
from autotune.service.store import Row

MOST_ATTEMPTS = 10
STOPPING = "stopping"
ALLOWANCE = {"check": 600.0, "run": 3600.0, "commit": 1200.0, "rollback": 600.0, "decide": 600.0}
"""What a job may take beside its machine time [s]: connecting, fits and writing, about ten times what they take on
a host of two cores that does nothing else. A job that takes longer hangs."""


@dataclass
class Running:
    """A job under way; `stage` and `fraction` as its worker last told. `until`: when its time is over."""

    job: Row
    axis: WatchedAxis
    handle: Handle
    stage: str = "start"
    fraction: float = 0.0
    stopping: float | None = None
    until: float = math.inf
    overdue: bool = False

    def hear(self, message: dict[str, Any]) -> None:
        """What its worker tells of its stage, and how far it is."""
        if message.get("event") == "stage":
            self.stage, self.fraction = str(message.get("stage", "")), 0.0
        elif message.get("event") == "progress":
            self.fraction = float(message.get("fraction", 0.0))

    def ended(self, done: Done, runs: Path) -> Done:
        """What its end is: too late, or as what it left on disk tells where the worker could not."""
        if self.overdue and done.outcome in ("aborted", "died"):
            done = self._too_late()
        if done.outcome == "died":
            kept = salvage(runs, self.axis.name, self.job["id"])
            done = replace(kept, sentence=f"{kept.sentence} {done.sentence}") if kept else done
        return done

    def _too_late(self) -> Done:
        limit, kind = most_seconds(self.job["kind"], self.axis), self.job["kind"]
        return Done(
            "fault", 5,
            f"Ended by the service: not done after {limit:.0f} s (limits.machine_seconds and {ALLOWANCE[kind]:.0f} s "
            f"for fits and writing), stage {self.stage}. Look at the drive and at the host's load; the next job puts "
            "back what this one had changed.",
        )  # fmt: skip


def most_seconds(kind: str, watched: WatchedAxis) -> float:
    """How long a job may take [s]: the axis's machine time, and what a slow host needs beside it."""
    return watched.axis.limits.machine_seconds + ALLOWANCE[kind]


def order_of(row: Row, watched: WatchedAxis, runs: Path) -> Order:
    """What the worker of a job is asked to do."""
    settings = watched.settings
    wished = json.loads(row["options"])
    options = wished | {
        "drift": settings.drift.model_dump(),
        "idle": settings.idle.model_dump(),
        "automatic": wished.get("commit", settings.commit) == "automatic",
        "gain": settings.drift.gain if row["origin"] == "drift" else None,
    }
    return Order(row["id"], watched.name, row["kind"], str(watched.file), str(runs), options)


def cut_off(row: Row, runs: Path) -> Done | None:
    """What a job came to that was cut off with its service; None where it is to be done again."""
    done = read_done(runs, row["id"])
    if done is None or done.outcome == "not_idle":
        done = salvage(runs, row["axis"], row["id"])
    if done is None and row["outcome"] == STOPPING:
        return Done("aborted", 130, "Stopped, and cut off with the service; it is not done again.")
    if done is None and row["attempts"] >= MOST_ATTEMPTS:
        return Done("died", 5, f"Given up after {row['attempts']} attempts.")
    return done
