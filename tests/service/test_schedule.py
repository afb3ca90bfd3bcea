"""Schedules: cron in time zones, missed jobs once, clocks that jump, hours that come twice or never."""

from __future__ import annotations

from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from typing import Any
from zoneinfo import ZoneInfo

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from sqlalchemy.exc import OperationalError

from autotune.core.errors import ConfigurationError
from autotune.service import daemon, schedule
from autotune.service.cron import blacked_out, next_fire, parse_cron, spacing
from autotune.service.settings import Blackout

ZURICH = ZoneInfo("Europe/Zurich")


def test_weekdays_count_from_sunday_as_in_every_cron() -> None:
    sunday = next_fire(parse_cron("0 12 * * 0", ZURICH), datetime(2026, 3, 2, tzinfo=UTC))
    assert sunday is not None
    assert sunday.astimezone(ZURICH).strftime("%a %H:%M") == "Sun 12:00"
    workdays = parse_cron("0 12 * * 1-5", ZURICH)
    day = datetime(2026, 3, 6, 13, tzinfo=UTC)  # a Friday afternoon
    following = next_fire(workdays, day)
    assert following is not None
    assert following.astimezone(ZURICH).strftime("%a") == "Mon"


@pytest.mark.parametrize("text", ["", "* * * *", "61 * * * *", "* 25 * * *", "a b c d e", "0 0 31 2 x"])
def test_what_is_no_cron_expression_is_refused_in_words(text: str) -> None:
    with pytest.raises(ValueError, match="cron expression"):
        parse_cron(text, ZURICH)


@given(st.datetimes(datetime(2026, 1, 1), datetime(2027, 12, 31)), st.integers(0, 59), st.integers(0, 23))
@example(datetime(2026, 3, 29, 0, 0), 0, 0)  # the midnight after the change in spring
@settings(max_examples=200, deadline=None)
def test_the_next_time_is_always_later_and_at_most_a_day_and_an_hour_away(
    when: datetime, minute: int, hour: int
) -> None:
    now = when.replace(tzinfo=UTC)
    found = next_fire(parse_cron(f"{minute} {hour} * * *", ZURICH), now)
    assert found is not None
    assert timedelta(0) < found - now <= timedelta(hours=25)


def test_the_clock_change_costs_no_day_in_spring(world: Callable[..., Any]) -> None:
    assert _checks_over(world, datetime(2026, 3, 27, 12, tzinfo=UTC), days=4) == 4


def test_the_hour_that_comes_twice_in_autumn_gives_one_check(world: Callable[..., Any]) -> None:
    assert _checks_over(world, datetime(2026, 10, 23, 12, tzinfo=UTC), days=4) == 4


def _checks_over(world: Callable[..., Any], start: datetime, days: int) -> int:
    here = world(extra='check = "30 2 * * *"\ntime_zone = "Europe/Zurich"', now=start)
    for _ in range(days * 48):
        here.pass_time(minutes=30)
        here.manager.tick()
        here.finish()
    return len(here.launcher.started)


def test_after_ten_days_without_power_the_check_is_made_once(world: Callable[..., Any]) -> None:
    here = world(extra='check = "30 2 * * *"')
    here.close()
    here.pass_time(days=10)
    here.open()
    for _ in range(10):
        here.manager.tick()
        here.finish()
    assert len(here.launcher.started) == 1


@pytest.mark.parametrize("hours", [5, 30, -5, -30, 24 * 40])
def test_a_clock_that_jumps_loses_no_check_for_long_and_makes_none_twice(
    world: Callable[..., Any], hours: int
) -> None:
    here = world(extra='check = "30 2 * * *"')
    for _ in range(24):  # one ordinary day
        here.pass_time(hours=1)
        here.manager.tick()
        here.finish()
    assert len(here.launcher.started) == 1
    here.jump(hours=hours)
    here.manager.tick()
    here.finish()
    assert len(here.launcher.started) <= 2
    before = len(here.launcher.started)
    for _ in range(72):  # three true days
        here.pass_time(hours=1)
        here.manager.tick()
        here.finish()
    assert before + 2 <= len(here.launcher.started) <= before + 3
    assert any(event["kind"] == "clock" for event in here.store.list_events())


def test_a_clock_that_was_years_ahead_does_not_stop_the_checks(world: Callable[..., Any]) -> None:
    here = world(extra='check = "30 2 * * *"')
    here.jump(days=1500)
    here.manager.tick()
    here.finish()
    here.jump(days=-1500)
    for _ in range(48):
        here.pass_time(hours=1)
        here.manager.tick()
        here.finish()
    assert len(here.launcher.started) == 1 + 2


def test_a_blackout_goes_over_midnight_and_over_the_weekend() -> None:
    night = Blackout(days=("fri",), start="22:00", until="06:00")
    for text, inside in (("2026-03-06T23:00", True), ("2026-03-07T05:59", True), ("2026-03-07T06:00", False),
                         ("2026-03-06T21:59", False), ("2026-03-07T23:00", False)):  # fmt: skip
        local = datetime.fromisoformat(text).replace(tzinfo=ZURICH)
        assert (blacked_out([night], local, ZURICH) is not None) == inside, text


def test_a_check_waits_for_the_end_of_the_blackout(world: Callable[..., Any]) -> None:
    here = world(extra='check = "0 3 * * *"\nblackout = [{ start = "02:00", until = "05:00" }]')
    for _ in range(15):  # 12:00 to 03:00
        here.pass_time(hours=1)
        here.manager.tick()
    (job,) = here.store.jobs_in("queued")
    assert "blackout until" in here.manager.waits_for(job["id"])
    here.pass_time(hours=2, minutes=1)
    here.manager.tick()
    assert len(here.launcher.started) == 1


def test_a_check_waits_until_the_machine_is_called_idle(world: Callable[..., Any]) -> None:
    here = world(extra='check = "0 3 * * *"\nidle = { by = "http" }')
    here.pass_time(hours=16)
    here.manager.tick()
    assert not here.launcher.started
    here.manager.permit("one", 30)
    here.manager.tick()
    assert len(here.launcher.started) == 1


def test_a_clock_put_back_makes_no_permission_last_longer(world: Callable[..., Any]) -> None:
    here = world(extra='check = "0 3 * * *"\nidle = { by = "http" }')
    here.manager.tick()
    here.manager.permit("one", 30)
    here.jump(hours=-5)
    here.manager.tick()
    assert here.store.permitted_until("one") is None
    here.pass_time(hours=20)
    here.manager.tick()
    assert not here.launcher.started


def test_what_a_person_asks_for_does_not_wait_for_idle_or_blackout(world: Callable[..., Any]) -> None:
    here = world(extra='idle = { by = "http" }\nblackout = [{ start = "00:00", until = "23:59" }]')
    here.manager.submit("one", "check", "http")
    here.manager.tick()
    assert len(here.launcher.started) == 1


@pytest.mark.parametrize(
    ("expression", "at", "hours"),
    [
        ("0 */6 * * *", datetime(2026, 3, 1), 6),
        ("0 8,9,17 * * *", datetime(2026, 3, 2, 9), 1),
        ("0 8,9,17 * * *", datetime(2026, 3, 2, 8), 15),
        ("0 22 * * 1-5", datetime(2026, 3, 5, 22), 24),  # a Thursday
        ("0 22 * * 1-5", datetime(2026, 3, 2, 22), 72),
        ("0 3 1 * *", datetime(2026, 3, 1, 3), 7 * 24),
    ],
)
def test_spacing_is_what_lies_before_a_planned_time(expression: str, at: datetime, hours: int) -> None:
    zone = ZoneInfo("UTC")
    assert spacing(parse_cron(expression, zone), at.replace(tzinfo=zone)) == timedelta(hours=hours)


@pytest.mark.parametrize(("expression", "checks"), [("0 22 * * 1-5", 5), ("0 8,9,17 * * *", 21)])
def test_times_at_uneven_distances_are_all_kept(
    world: Callable[..., Any], expression: str, checks: int
) -> None:
    here = world(extra=f'check = "{expression}"\ntime_zone = "UTC"')
    for _ in range(7 * 24):
        here.pass_time(hours=1)
        here.manager.tick()
        here.finish()
    assert len(here.launcher.started) == checks


def test_a_new_expression_counts_at_once_and_an_old_one_keeps_its_time(world: Callable[..., Any]) -> None:
    here = world(["one", "two"], extra='check = "0 3 * * *"')
    before = here.manager.next_check("two")
    text = (here.folder / "service.toml").read_text()
    (here.folder / "service.toml").write_text(text.replace("0 3 * * *", "0 5 * * *", 1))
    from autotune.service.settings import read_service

    here.manager.reload(read_service(here.folder / "service.toml"))
    assert here.manager.next_check("two") == before
    assert here.manager.next_check("one").hour == 5


@pytest.mark.parametrize(
    "error", [OperationalError("DELETE", {}, Exception("database is locked")), OSError(28, "No space left")]
)
def test_a_configuration_that_the_history_does_not_take_changes_nothing(
    world: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    here = world(["one"], extra='check = "0 3 * * *"')
    before = here.manager.configuration, here.manager.next_check("one")
    file = here.folder / "service.toml"
    file.write_text(file.read_text().replace("0 3 * * *", "0 5 * * *"))

    def refuse(statement: object) -> None:
        raise error

    with monkeypatch.context() as patched:
        patched.setattr(schedule, "delete", refuse)
        daemon._reload(here.manager)
    assert (here.manager.configuration, here.manager.next_check("one")) == before
    here.manager.tick()
    daemon._reload(here.manager)
    assert here.manager.next_check("one").hour == 5


def test_a_service_file_with_a_bad_cron_or_zone_names_it(world: Callable[..., Any]) -> None:
    with pytest.raises(ConfigurationError, match=r"Europe/Zuerich"):
        world(extra='time_zone = "Europe/Zuerich"')
