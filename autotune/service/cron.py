"""Cron expressions in a time zone, through APScheduler's trigger, and windows in which nothing starts."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Sequence
from datetime import UTC, datetime, time, timedelta
from typing import Protocol
from zoneinfo import ZoneInfo

from apscheduler.triggers.cron import CronTrigger

_WEEKDAYS = ("sun", "mon", "tue", "wed", "thu", "fri", "sat", "sun")
MINUTES_A_WEEK = 7 * 24 * 60
MOST_IN_A_CHANGE = 200
"""Times that an hour which comes twice may hold; two hours of minutes are fewer."""


class Window(Protocol):
    """A daily window; see `settings.Blackout`."""

    @property
    def days(self) -> Sequence[str]: ...

    @property
    def start(self) -> time: ...

    @property
    def until(self) -> time: ...


def parse_cron(expression: str, zone: ZoneInfo) -> CronTrigger:
    """A trigger from `minute hour day month weekday`; weekday 0 and 7 are Sunday, as in every cron.

    Raises:
        ValueError: not five fields, or a field that cannot be.
    """
    fields = expression.split()
    if len(fields) != 5:
        raise ValueError(
            f"cron expression {expression!r} has {len(fields)} fields; it needs five: minute hour day month "
            "weekday, for example '30 3 * * *' for 03:30 every day"
        )
    minute, hour, day, month, weekday = fields
    named = re.sub(r"(?<![/\w])[0-7](?!\w)", lambda digit: _WEEKDAYS[int(digit.group())], weekday)
    try:
        return CronTrigger(
            minute=minute, hour=hour, day=day, month=month, day_of_week=_split(named), timezone=zone
        )
    except (ValueError, TypeError, KeyError) as error:
        raise ValueError(f"cron expression {expression!r}: {error}") from None


def _split(weekdays: str) -> str:
    """`sun-thu` is `sun,mon-thu` for a trigger whose week begins on Monday."""
    return ",".join(
        f"sun,mon-{part[4:]}" if part.startswith("sun-") and part[4:] != "sun" else part
        for part in weekdays.split(",")
    )


def next_fire(trigger: CronTrigger, after: datetime) -> datetime | None:
    """First time to fire after `after` (strictly), as UTC; None where there is none.

    The fields are matched on the wall clock as if it never changed: in a zone the trigger passes over the midnight
    after a change, and stumbles over hours that come twice. A time that never comes is that much after the change,
    one that comes twice is the first.
    """
    limit = after.astimezone(UTC)
    fields = {field.name: str(field) for field in trigger.fields}
    unchanging = CronTrigger(**fields, timezone=UTC)
    wall = limit.astimezone(trigger.timezone).replace(tzinfo=UTC)
    for _ in range(MOST_IN_A_CHANGE):
        following: datetime | None = unchanging.get_next_fire_time(None, wall + timedelta(microseconds=1))
        if following is None:
            return None
        wall = following
        found = wall.replace(tzinfo=trigger.timezone, fold=0).astimezone(UTC)
        if found > limit:
            return found
    return None


def spacing(trigger: CronTrigger, at: datetime) -> timedelta:
    """Time between the fire before `at` and `at`; a week where that one is longer ago, or there is none."""

    def fires(minutes: int) -> bool:
        found = next_fire(trigger, at - timedelta(minutes=minutes))
        return found is not None and found < at

    minutes = bisect_left(range(MINUTES_A_WEEK), True, key=fires)
    before = next_fire(trigger, at - timedelta(minutes=minutes))
    return at - before if before is not None and before < at else timedelta(days=7)


def blacked_out(windows: Sequence[Window], now: datetime, zone: ZoneInfo) -> datetime | None:
    """When the window ends that `now` lies in; None outside of all windows."""
    local = now.astimezone(zone)
    ends = [end for window in windows if (end := _end(window, local)) is not None]
    return max(ends) if ends else None


def _end(window: Window, local: datetime) -> datetime | None:
    for back in (0, 1):
        day = local - timedelta(days=back)
        if ("mon", "tue", "wed", "thu", "fri", "sat", "sun")[day.weekday()] not in window.days:
            continue
        over_midnight = window.until <= window.start
        start = datetime.combine(day.date(), window.start, local.tzinfo)
        last = day.date() + timedelta(days=1) if over_midnight else day.date()
        end = datetime.combine(last, window.until, local.tzinfo)
        if start <= local < end:
            return end
    return None
