"""The heart of the service: what is due becomes a job, a job becomes a worker, its end becomes history.

`tick` does one round and never waits. Time, store and launcher are handed in, so that a year can pass in
minutes. Order of writing: a job is in the history before its worker starts; its result is on disk before
the worker tells it, and in the history before it counts as done. So whatever is cut off where, the next
start finds either a result to take up or a job to do again, never neither and never both.
"""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from functools import partial
from typing import Any

from sqlalchemy.exc import SQLAlchemyError

from autotune.service import housekeeping
from autotune.service.busy import axis_busy
from autotune.service.cron import blacked_out
from autotune.service.feed import Feed
from autotune.service.follow_up import FollowUp, Notify, new_id
from autotune.service.launcher import Launcher
from autotune.service.live_hub import LiveHubs
from autotune.service.orders import Done
from autotune.service.schedule import DailyCheck, Schedule
from autotune.service.settings import Configuration, WatchedAxis
from autotune.service.store import Row, Store, moment, text
from autotune.service.taking_up import absorb_check, absorb_run
from autotune.service.under_way import STOPPING, Running, cut_off, most_seconds, order_of

log = logging.getLogger("autotune.service")
MOST_DEATHS = 2
STOP_SECONDS = 30.0
JUMP_SECONDS = 90.0
BY_ITSELF = ("schedule", "drift")
RETRY_IDLE = timedelta(minutes=5)
RETRY_START = timedelta(minutes=1)


@dataclass
class Health:
    """What /healthz says; `problems` by their source. `recordings_bytes`: disk they took when last looked."""

    problems: dict[str, str] = field(default_factory=dict)
    restored: str = ""
    ticked: float = 0.0
    recordings_bytes: int = 0
    notices_lost: int = 0


class Manager:
    """Owns the jobs of all axes. Every public method may be called from any thread."""

    def __init__(
        self,
        configuration: Configuration,
        store: Store,
        schedule: Schedule,
        launcher: Launcher,
        notify: Notify,
        wall: Callable[[], datetime],
        steady: Callable[[], float],
        live: LiveHubs | None = None,
    ) -> None:
        self.configuration = configuration
        self.store = store
        self.feed = Feed()
        self.live = live or LiveHubs()
        self.health = Health()
        self._schedule, self._launcher = schedule, launcher
        self._follow_up = FollowUp(store, configuration.runs, self.feed, notify, self.submit)
        self._wall, self._steady = wall, steady
        self._lock = threading.RLock()
        self._running: dict[str, Running] = {}
        self._waiting: dict[str, str] = {}
        self._not_before: dict[str, datetime] = {}
        self._offset: float | None = None
        self._accepting = True
        self._count = 0
        self.owns: Callable[[str], bool] = lambda axis: True

    # What others ask

    @property
    def running(self) -> dict[str, Running]:
        """Jobs under way, by id."""
        with self._lock:
            return dict(self._running)

    def waits_for(self, job: str) -> str:
        """Why a queued job has not begun, in words."""
        return self._waiting.get(job, "")

    def next_check(self, axis: str) -> datetime | None:
        """When the axis is looked at next."""
        with self._lock:
            return self._schedule.next_time(axis)

    def now(self) -> datetime:
        """The service's time, UTC."""
        return self._wall().astimezone(UTC)

    def seconds_since_tick(self) -> float:
        """How long ago the last round was [s]."""
        return self._steady() - self.health.ticked

    def set_problem(self, source: str, problem: str) -> None:
        """A present problem of the service, logged once; "" where it is over."""
        if problem and self.health.problems.get(source) != problem:
            log.error("%s", problem)
        if problem:
            self.health.problems[source] = problem
        else:
            self.health.problems.pop(source, None)

    def problems(self) -> dict[str, str]:
        """Present problems by their source, a full disk among them."""
        full = self._full()
        return dict(self.health.problems) | ({"disk": full + ": no job starts"} if full else {})

    def _full(self) -> str:
        """What is wrong with the room on the disk; "" where there is enough."""
        least = self.configuration.service.recordings.least_free_megabytes
        scarce = housekeeping.free(self.configuration.runs) < least * housekeeping.MEGABYTE
        return f"less than {least} MB are free on the disk" if scarce else ""

    def say_restored(self, sentence: str) -> None:
        """The history was torn; everybody is told."""
        self.health.restored = sentence
        log.error("%s", sentence)
        self._follow_up.event("restored", "*", self.now(), sentence, notice=True)

    def permit(self, axis: str, minutes: float) -> None:
        """The machine is idle for so many minutes."""
        self.store.permit(axis, self.now() + timedelta(minutes=minutes))

    def submit(self, axis: str, kind: str, origin: str, options: Mapping[str, Any] | None = None,
               due: datetime | None = None) -> Row | None:  # fmt: skip
        """Queues a job; None where the same is queued or running already, or was done for that due time."""
        with self._lock:
            open_jobs = self.store.jobs_in("queued", "running")
            if any(job["axis"] == axis and job["kind"] == kind for job in open_jobs):
                return None
            row = {
                "id": self._new_id(), "axis": axis, "kind": kind, "origin": origin, "state": "queued",
                "due": text(due) if due else None, "created": text(self.now()), "attempts": 0,
                "options": json.dumps(dict(options or {})),
            }  # fmt: skip
            if not self.store.add_job(row):
                return None
            self.feed.tell({"event": "queued", "job": row["id"], "axis": axis, "kind": kind})
            return self.store.job(str(row["id"]))

    def approve(self, identifier: str) -> Row | None:
        """Queues the commit of an open proposal; None where it is not open any more, or a commit is under way.

        The job is in the history before the proposal counts as approved: a kill in between loses nothing.
        """
        with self._lock:
            proposal = self.store.proposal(identifier)
            if proposal is None or proposal["state"] != "open":
                return None
            job = self.submit(proposal["axis"], "commit", "http", {"proposal": proposal["run"]})
            if job is not None and not self.store.decide_proposal(identifier, "approved", self.now()):
                self.stop(job["id"])
                return None
            return job

    def _new_id(self) -> str:
        self._count = (self._count + 1) % 0x1000000
        return new_id(self.now(), self._count)

    def stop(self, identifier: str) -> bool:
        """Stops a job: a queued one is cancelled, a running one comes to rest. False where it has ended."""
        with self._lock:
            running = self._running.get(identifier)
            if running is not None:
                self.store.change_job(identifier, outcome=STOPPING)
                running.stopping = running.stopping or self._steady()
                running.handle.stop()
                return True
            row = self.store.job(identifier)
            if row is None or row["state"] != "queued":
                return False
            self._finish(row, Done("cancelled", 130, "Cancelled before it began."))
            return True

    # The round

    def tick(self) -> None:
        """One round: clock, schedule, running jobs, queued jobs."""
        with self._lock:
            try:
                now = self.now()
                self._watch_clock(now)
                self._settle_orphans(now)
                self._collect(now)
                if self._accepting:
                    self._enqueue_due(now)
                    self._dispatch(now)
                self.health.problems.pop("history", None)
            except (SQLAlchemyError, OSError) as error:
                self.set_problem("history", f"the history cannot be used: {str(error).splitlines()[0]}")
            self.health.ticked = self._steady()

    def reload(self, configuration: Configuration) -> None:
        """Takes over a new configuration; running jobs go on with the old one."""
        with self._lock:
            self._schedule.replace(plans_of(configuration), self.now())
            self.configuration = configuration

    def shut_down(self) -> None:
        """Lets running jobs come to rest; they are done again on the next start."""
        with self._lock:
            self._accepting = False
            for running in self._running.values():
                running.handle.let_go()

    @property
    def idle(self) -> bool:
        """No worker is alive."""
        with self._lock:
            return all(running.handle.done() is not None for running in self._running.values())

    # Clock and schedule

    def _watch_clock(self, now: datetime) -> None:
        offset = now.timestamp() - self._steady()
        before, self._offset = self._offset, offset
        if before is None or abs(offset - before) < JUMP_SECONDS:
            return
        jump = offset - before
        word = "forward" if jump > 0 else "back"
        self._follow_up.event("clock", "*", now, f"The clock was put {word} by {abs(jump) / 3600:.1f} h.")
        if jump < 0:
            self._schedule.rebase(now)
            self._not_before.clear()
            self.store.withdraw_permissions()  # they would last longer than was meant

    def _enqueue_due(self, now: datetime) -> None:
        for due in self._schedule.process(now):
            if self.configuration.axis(due.axis) is None:
                continue
            last = self.store.last_job(due.axis, "check", "schedule")
            if self._schedule.too_soon(due, moment(last["created"]) if last else None, now):
                continue
            self.submit(due.axis, "check", "schedule", due=due.at)

    # Jobs that a service before this one left running

    def _settle_orphans(self, now: datetime) -> None:
        for row in self.store.jobs_in("running"):
            later = self._not_before.get(row["id"], now)
            if row["id"] in self._running or now < later or axis_busy(self.configuration.runs, row["axis"]):
                continue
            self._apart(row, partial(self._settle, row, now))

    def _settle(self, row: Row, now: datetime) -> None:
        done = cut_off(row, self.configuration.runs)
        if done is not None:
            self._finish(row, done)
            return
        self.store.change_job(row["id"], state="queued")
        self._follow_up.event(
            "again", row["axis"], now, f"The {row['kind']} was cut off with the service; it is done again.",
            f"{row['id']}:{row['attempts']}",
        )  # fmt: skip

    def _apart(self, row: Row, act: Callable[[], None]) -> None:
        """Does something for one job; a defect that it meets is said, holds up no other, and is not met at once again.

        It counts as over when the same goes well, or when another job of the axis has ended.
        """
        source = f"{_jobs_of(row['axis'])}{row['id']}"
        try:
            act()
            self.set_problem(source, "")
        except (SQLAlchemyError, OSError):
            raise
        except Exception as error:  # noqa: BLE001 - the last line of defence of all other axes
            self._not_before[row["id"]] = self.now() + RETRY_IDLE
            self.set_problem(source, f"a defect of autotune, {type(error).__name__}: {error}")

    # Workers

    def _collect(self, now: datetime) -> None:
        for identifier, running in list(self._running.items()):
            self._apart(running.job, partial(self._look_after, identifier, running, now))

    def _look_after(self, identifier: str, running: Running, now: datetime) -> None:
        for message in running.handle.messages():
            running.hear(message)
            self.feed.tell({**message, "job": identifier, "axis": running.axis.name})
        done = running.handle.done()
        if done is None:
            self._press(running)
            return
        del self._running[identifier]
        done = running.ended(done, self.configuration.runs)
        if done.outcome == "died" and running.job["attempts"] < MOST_DEATHS and running.stopping is None:
            self.store.change_job(identifier, state="queued")
        elif done.outcome == "not_idle":
            self.store.change_job(identifier, state="queued")
            self._not_before[identifier] = now + RETRY_IDLE
            self._waiting[identifier] = done.sentence
        else:
            self._finish(running.job, done)

    def _press(self, running: Running) -> None:
        """A worker whose time is over is asked to end; one that does not end when asked to is ended."""
        if running.stopping is None and self._steady() > running.until:
            running.overdue = True
            self.stop(running.job["id"])
        if running.stopping is not None and self._steady() - running.stopping > STOP_SECONDS:
            running.handle.kill()

    def _dispatch(self, now: datetime) -> None:
        for row in self.store.jobs_in("queued"):
            self._apart(row, partial(self._begin, row, now))

    def _begin(self, row: Row, now: datetime) -> None:
        limit = self.configuration.service.at_once or 10_000
        watched = self.configuration.axis(row["axis"])
        if watched is None:
            self._finish(row, Done("refused", 2, f"Axis {row['axis']} is not in the service file any more."))
            return
        reason = self._obstacle(row, watched, now)
        if not reason and len(self._running) >= limit:
            reason = f"{limit} jobs are running already"
        if reason:
            self._waiting[row["id"]] = reason
            return
        self._waiting.pop(row["id"], None)
        self._start(row, watched, now)

    def _obstacle(self, row: Row, watched: WatchedAxis, now: datetime) -> str:
        """Why the job cannot begin now; "" where it can."""
        for other in self._running.values():
            if other.axis.bus == watched.bus:
                return f"the link is in use by job {other.job['id']} of axis {other.axis.name}"
        later = self._not_before.get(row["id"])
        if later is not None and now < later:
            return self._waiting.get(row["id"], f"until {text(later)}")
        if row["origin"] in BY_ITSELF:
            end = blacked_out(watched.settings.blackout, now, watched.zone)
            if end is not None:
                return f"blackout until {end:%Y-%m-%d %H:%M}"
            if watched.settings.idle.by == "http" and not self._permitted(watched.name, now):
                return "the machine has not been called idle (PUT /api/axes/NAME/idle)"
        if not self.owns(watched.name) or axis_busy(self.configuration.runs, watched.name):
            return "another program has the axis"
        return self._full()

    def _permitted(self, axis: str, now: datetime) -> bool:
        until = self.store.permitted_until(axis)
        return until is not None and now < until

    def _start(self, row: Row, watched: WatchedAxis, now: datetime) -> None:
        """Starts the worker; one that the host has no room for is no attempt, and is tried again later."""
        order = order_of(row, watched, self.configuration.runs)
        self.store.change_job(row["id"], state="running", started=text(now), attempts=row["attempts"] + 1)
        started = self.store.job(row["id"]) or row
        until = self._steady() + most_seconds(row["kind"], watched)
        try:
            handle = self._launcher.start(order)
        except OSError as error:
            self.store.change_job(row["id"], state="queued", started=row["started"], attempts=row["attempts"])
            self._not_before[row["id"]] = now + RETRY_START
            self._waiting[row["id"]] = f"its process cannot be started: {error.strerror or error}"
            log.warning("axis %s: %s waits: %s", watched.name, row["kind"], self._waiting[row["id"]])
            return
        self._running[row["id"]] = Running(started, watched, handle, until=until)
        self.feed.tell({"event": "started", "job": row["id"], "axis": watched.name, "kind": row["kind"]})

    # Ends

    def _finish(self, row: Row, done: Done) -> None:
        """History first, then the job's state, then whoever listens; then what follows from it."""
        directory = self.configuration.runs / done.run if done.run else None
        if directory is not None:
            absorb_check(self.store, directory)
            absorb_run(self.store, directory)
        now = self.now()
        self._follow_up.propose(row, done, now)
        self.store.change_job(
            row["id"], state="done", finished=text(now), outcome=done.outcome, exit_code=done.exit_code,
            sentence=done.sentence, run=done.run or None,
        )  # fmt: skip
        self._not_before.pop(row["id"], None)
        self._waiting.pop(row["id"], None)
        log.info("axis %s: %s %s: %s", row["axis"], row["kind"], done.outcome, done.sentence)
        message = {
            "event": "done",
            "job": row["id"],
            "axis": row["axis"],
            "kind": row["kind"],
            **done.as_json(),
        }
        self.feed.tell(message)
        self._follow_up.after(row, done, self.configuration.axis(row["axis"]), now)
        for source in [one for one in self.health.problems if one.startswith(_jobs_of(row["axis"]))]:
            self.set_problem(source, "")


def _jobs_of(axis: str) -> str:
    """What the sources of problems with an axis's jobs begin with."""
    return f"axis {axis}, job "


def plans_of(configuration: Configuration) -> list[DailyCheck]:
    """When each axis is to be looked at."""
    return [DailyCheck(one.name, one.settings.check, one.zone) for one in configuration.axes]
