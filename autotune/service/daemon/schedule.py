"""When an axis is looked at: APScheduler's jobs in its SQLAlchemy store, its clock handed in.

A job that was missed, by a power cut or a clock that jumped forward, is due once. Where the clock is put
back the times are reckoned anew from the new time; `too_soon` then keeps a job from running twice.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from zoneinfo import ZoneInfo

from apscheduler.jobstores.sqlalchemy import SQLAlchemyJobStore
from apscheduler.schedulers.base import BaseScheduler
from sqlalchemy import Engine

from autotune.service.daemon.cron import next_fire, parse_cron, spacing

CATCH_UP = 10_000


@dataclass(frozen=True, slots=True)
class Planned:
    """One axis's daily look: cron expression in a time zone."""

    axis: str
    expression: str
    zone: ZoneInfo


@dataclass(frozen=True, slots=True)
class Due:
    """A job that is due; `at` is when it should have begun (the last time, where several were missed)."""

    axis: str
    at: datetime


def never_called(axis: str) -> None:
    """What the store's jobs name as their function; the service takes them from the store itself."""


class _Scheduler(BaseScheduler):  # type: ignore[misc]
    """APScheduler without a thread of its own: it is asked."""

    def wakeup(self) -> None:
        return

    def shutdown(self, wait: bool = True) -> None:
        super().shutdown(wait)


class Schedule:
    """Times of all axes."""

    def __init__(self, engine: Engine, plans: Sequence[Planned], now: datetime) -> None:
        self._scheduler = _Scheduler(timezone=ZoneInfo("UTC"))
        self._scheduler.add_jobstore(SQLAlchemyJobStore(engine=engine))
        self._scheduler.start(paused=True)
        self._plans: dict[str, Planned] = {}
        self.replace(plans, now)

    def close(self) -> None:
        """Stops; the store keeps the times."""
        self._scheduler.shutdown()

    def replace(self, plans: Iterable[Planned], now: datetime) -> None:
        """Takes over a new configuration; unchanged plans keep their next time, missed ones stay due."""
        self._plans = {plan.axis: plan for plan in plans}
        present = {job.id: job for job in self._scheduler.get_jobs()}
        for gone in set(present) - set(self._plans):
            self._scheduler.remove_job(gone)
        for axis, plan in self._plans.items():
            mark = f"{plan.expression} {plan.zone.key}"
            if axis in present and present[axis].name == mark:
                continue
            trigger = parse_cron(plan.expression, plan.zone)
            self._scheduler.add_job(
                "autotune.service.daemon.schedule:never_called", trigger, args=[axis], id=axis, name=mark,
                next_run_time=next_fire(trigger, now), coalesce=True, misfire_grace_time=None,
                replace_existing=True,
            )  # fmt: skip

    def process(self, now: datetime) -> list[Due]:
        """What is due; each job once, however often it was missed. Its next time is stored."""
        found: list[Due] = []
        for job in self._scheduler.get_jobs():
            due = job.next_run_time
            if due is None or due > now:
                continue
            following = next_fire(job.trigger, due)
            for _ in range(CATCH_UP):
                if following is None or following > now:
                    break
                due, following = following, next_fire(job.trigger, following)
            found.append(Due(job.id, due))
            job.modify(
                next_run_time=following if following and following > now else next_fire(job.trigger, now)
            )
        return found

    def rebase(self, now: datetime) -> None:
        """The clock was put back: times are reckoned from the new one."""
        for job in self._scheduler.get_jobs():
            fresh = next_fire(job.trigger, now)
            if job.next_run_time is None or (fresh is not None and fresh < job.next_run_time):
                job.modify(next_run_time=fresh)

    def next_time(self, axis: str) -> datetime | None:
        """When the axis is looked at next."""
        job = self._scheduler.get_job(axis)
        found: datetime | None = job.next_run_time if job is not None else None
        return found

    def too_soon(self, axis: str, last: datetime | None, now: datetime) -> bool:
        """The last look was less than half a turn ago: an hour that comes twice, or a clock put back."""
        plan = self._plans.get(axis)
        if plan is None or last is None:
            return False
        turn = spacing(parse_cron(plan.expression, plan.zone), now)
        return abs(now - last) < min(turn / 2, timedelta(days=3))
