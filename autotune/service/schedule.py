"""When an axis is looked at: cron expressions from the service file, the next times in the history; the clock is
handed in.

A job that was missed, by a power cut or a clock that jumped forward, is due once. Where the clock is put
back the times are reckoned anew from the new time; `too_soon` then keeps a job from running twice.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from zoneinfo import ZoneInfo

from apscheduler.triggers.cron import CronTrigger
from sqlalchemy import Engine, RowMapping, delete, insert, select, update

from autotune.service.cron import next_fire, parse_cron, spacing
from autotune.service.store import text
from autotune.service.tables import schedule

CATCH_UP = 10_000


@dataclass(frozen=True, slots=True)
class DailyCheck:
    """One axis's daily look: cron expression in a time zone."""

    axis: str
    expression: str
    zone: ZoneInfo

    @property
    def trigger(self) -> CronTrigger:
        """The expression, parsed."""
        return parse_cron(self.expression, self.zone)


@dataclass(frozen=True, slots=True)
class Due:
    """A job that is due; `at` is when it should have begun (the last time, where several were missed)."""

    axis: str
    at: datetime


class Schedule:
    """Times of all axes. What is stored of one is its axis, cron expression, time zone and next time, as text."""

    def __init__(self, engine: Engine, plans: Sequence[DailyCheck], now: datetime) -> None:
        self._engine = engine
        self._plans: dict[str, DailyCheck] = {}
        self._next: dict[str, datetime | None] = {}
        self.replace(plans, now)

    def close(self) -> None:
        """Nothing is open; the database keeps the times."""

    def replace(self, plans: Iterable[DailyCheck], now: datetime) -> None:
        """Takes over a new configuration; unchanged plans keep their next time, missed ones stay due.

        Where it cannot be stored, the old one stays in force.
        """
        named = {plan.axis: plan for plan in plans}
        present = self._stored()
        times: dict[str, datetime | None] = {}
        for axis, plan in named.items():
            row = present.get(axis)
            if row is not None and (row["expression"], row["zone"]) == (plan.expression, plan.zone.key):
                times[axis] = _moment(row["next"])
            times[axis] = times.get(axis) or next_fire(plan.trigger, now)
        with self._engine.begin() as connection:
            connection.execute(delete(schedule))
            for axis, plan in named.items():
                connection.execute(insert(schedule).values(**_row(plan, times[axis])))
        self._plans, self._next = named, times

    def process(self, now: datetime) -> list[Due]:
        """What is due; each job once, however often it was missed. Its next time is stored."""
        found: list[Due] = []
        for axis, due in list(self._next.items()):
            if due is None or due > now:
                continue
            trigger = self._plans[axis].trigger
            following = next_fire(trigger, due)
            for _ in range(CATCH_UP):
                if following is None or following > now:
                    break
                due, following = following, next_fire(trigger, following)
            found.append(Due(axis, due))
            self._set(axis, following if following and following > now else next_fire(trigger, now))
        return found

    def rebase(self, now: datetime) -> None:
        """The clock was put back: times are reckoned from the new one."""
        for axis, plan in self._plans.items():
            planned, fresh = self._next[axis], next_fire(plan.trigger, now)
            if planned is None or (fresh is not None and fresh < planned):
                self._set(axis, fresh)

    def next_time(self, axis: str) -> datetime | None:
        """When the axis is looked at next."""
        return self._next.get(axis)

    def too_soon(self, due: Due, last: datetime | None, now: datetime) -> bool:
        """The last look was less than half a turn ago: an hour that comes twice, or a clock put back.

        The turn is what lies between the planned time before this one and this one.
        """
        plan = self._plans.get(due.axis)
        if plan is None or last is None:
            return False
        turn = spacing(plan.trigger, due.at)
        return abs(now - last) < min(turn / 2, timedelta(days=3))

    def _set(self, axis: str, moment: datetime | None) -> None:
        with self._engine.begin() as connection:
            mine = schedule.c.axis == axis
            connection.execute(update(schedule).where(mine).values(next=_text(moment)))
        self._next[axis] = moment

    def _stored(self) -> dict[str, RowMapping]:
        with self._engine.connect() as connection:
            return {str(row["axis"]): row for row in connection.execute(select(schedule)).mappings()}


def _row(plan: DailyCheck, following: datetime | None) -> dict[str, str | None]:
    return {
        "axis": plan.axis,
        "expression": plan.expression,
        "zone": plan.zone.key,
        "next": _text(following),
    }


def _text(moment: datetime | None) -> str | None:
    return text(moment) if moment is not None else None


def _moment(stored: object) -> datetime | None:
    """A stored time; what is none is reckoned anew."""
    try:
        found = datetime.fromisoformat(str(stored))
    except ValueError:
        return None
    return found if found.tzinfo is not None else None
