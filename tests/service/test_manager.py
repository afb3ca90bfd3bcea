"""The manager: one owner an axis, axes independent, nothing lost and nothing twice."""

from __future__ import annotations

import errno
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from autotune.service.orders import Done, Order, read_done, write_begun, write_done
from autotune.service.under_way import ALLOWANCE, most_seconds
from tests.service.conftest import ON_BOTH, START, left_kept

World = Any
pytestmark = ON_BOTH


def test_axes_do_not_wait_for_one_another(world: Callable[..., World]) -> None:
    here = world(["one", "two", "three"])
    for name in ("one", "two", "three"):
        here.manager.submit(name, "check", "http")
    here.manager.tick()
    assert [handle.order.axis for handle in here.launcher.started] == ["one", "two", "three"]
    here.launcher.started[1].ended = Done("done", 0, "", "")
    here.manager.tick()  # the first never answers; the others go on
    here.manager.submit("two", "check", "http")
    here.manager.tick()
    assert len(here.launcher.started) == 4


def test_one_axis_does_one_job_at_a_time(world: Callable[..., World]) -> None:
    here = world()
    here.manager.submit("one", "check", "http")
    here.manager.submit("one", "run", "http")
    here.manager.tick()
    here.manager.tick()
    assert len(here.launcher.started) == 1
    here.finish()
    assert [handle.order.kind for handle in here.launcher.started] == ["check", "run"]


def test_the_same_job_is_not_queued_twice(world: Callable[..., World]) -> None:
    here = world()
    assert here.manager.submit("one", "check", "http") is not None
    assert here.manager.submit("one", "check", "http") is None


def test_a_limit_on_jobs_at_once_is_kept(world: Callable[..., World]) -> None:
    here = world(["one", "two", "three"], head="at_once = 2")
    for name in ("one", "two", "three"):
        here.manager.submit(name, "check", "http")
    here.manager.tick()
    assert len(here.launcher.started) == 2


def test_a_job_cut_off_with_the_service_is_done_again(world: Callable[..., World]) -> None:
    here = world()
    job = here.manager.submit("one", "check", "http")
    here.manager.tick()
    here.close()
    here.open()
    here.manager.tick()
    here.manager.tick()
    assert [handle.order.id for handle in here.launcher.started] == [job["id"]] * 2
    here.finish()
    assert here.store.job(job["id"])["state"] == "done"
    assert here.store.job(job["id"])["attempts"] == 2


def test_a_job_whose_worker_had_ended_is_not_done_again(world: Callable[..., World]) -> None:
    here = world()
    job = here.manager.submit("one", "check", "http")
    here.manager.tick()
    order: Order = here.launcher.started[0].order
    write_done(order, Done("done", 0, "All is well.", ""))
    here.close()
    here.open()
    here.manager.tick()
    here.manager.tick()
    assert len(here.launcher.started) == 1
    row = here.store.job(job["id"])
    assert (row["state"], row["outcome"], row["sentence"]) == ("done", "done", "All is well.")


def test_a_run_that_was_kept_and_then_cut_off_counts_as_kept(world: Callable[..., World]) -> None:
    here = world()
    job = here.manager.submit("one", "run", "http")
    here.manager.tick()
    left = left_kept(here.configuration.runs, job["id"])
    here.close()
    here.open()
    here.manager.tick()
    row = here.store.job(job["id"])
    assert (row["outcome"], row["run"]) == ("kept", left.name)
    (run,) = here.store.list_runs("one")
    assert run["outcome"] == "kept"
    assert json.loads(run["content"])["feedforward"] == {"feedforward.coulomb": 0.3}
    assert len(here.launcher.started) == 1


@pytest.mark.parametrize("kept", [True, False])
def test_a_machine_that_was_not_idle_at_first_ends_no_later_attempt(
    world: Callable[..., World], kept: bool
) -> None:
    here = world()
    job = here.manager.submit("one", "run", "http")
    here.manager.tick()
    order: Order = here.launcher.started[0].order
    write_done(order, Done("not_idle", 3, "The machine is not idle."))
    left = left_kept(here.configuration.runs, job["id"]).name if kept else None
    here.close()
    here.open()
    here.manager.tick()
    row = here.store.job(job["id"])
    assert (row["outcome"], row["run"]) == ("kept" if kept else None, left)
    assert len(here.launcher.started) == (1 if kept else 2)


def test_an_attempt_that_begins_takes_away_what_the_one_before_came_to(
    tmp_path: Path, history_url: str
) -> None:
    order = Order("a" * 32, "one", "run", "one.toml", str(tmp_path))
    write_done(order, Done("not_idle", 3, "The machine is not idle."))
    write_begun(order, 4711, START)
    assert read_done(tmp_path, order.id) is None


def test_what_ended_the_worker_of_a_kept_run_is_told_with_it(world: Callable[..., World]) -> None:
    here = world()
    job = here.manager.submit("one", "run", "http")
    here.manager.tick()
    left = left_kept(here.configuration.runs, job["id"])
    here.launcher.started[0].ended = Done("died", 5, "Unexpected TypeError, a defect of autotune: so it is")
    here.manager.tick()
    row = here.store.job(job["id"])
    assert (row["outcome"], row["run"]) == ("kept", left.name)
    assert row["sentence"].startswith("Kept: ")
    assert row["sentence"].endswith("a defect of autotune: so it is")


@pytest.mark.parametrize(("origin", "gain"), [("drift", 0.05), ("http", None)])
def test_drift_that_nothing_can_be_gained_from_is_told_once_in_a_notice(
    world: Callable[..., World], origin: str, gain: float | None
) -> None:
    here = world(extra="[axes.drift]\ngain = 0.05")
    here.manager.submit("one", "run", origin)
    here.manager.tick()
    assert here.launcher.started[-1].order.options["gain"] == gain
    left = here.configuration.runs / "20260301-120001-one"
    left.mkdir(parents=True)
    (left / "accepted.json").write_text("{}")
    here.finish("not_applied", 3, left.name)
    assert [notice["kind"] for notice in here.notices] == (["accepted"] if origin == "drift" else [])
    assert [event["kind"] for event in here.store.list_events("one")] == ["accepted"]


def test_a_worker_that_dies_is_tried_once_more_then_given_up(world: Callable[..., World]) -> None:
    here = world()
    job = here.manager.submit("one", "check", "http")
    here.manager.tick()
    here.finish("died", 5)
    here.finish("died", 5)
    here.manager.tick()
    assert len(here.launcher.started) == 2
    assert here.store.job(job["id"])["outcome"] == "died"
    assert any("ended" in str(notice["sentence"]) for notice in here.notices)


def test_stopping_a_running_job_asks_its_worker_and_then_insists(world: Callable[..., World]) -> None:
    here = world()
    job = here.manager.submit("one", "check", "http")
    here.manager.tick()
    assert here.manager.stop(job["id"])
    handle = here.launcher.started[0]
    assert handle.stopped
    assert not handle.killed
    here.pass_time(seconds=31)
    here.manager.tick()
    assert handle.killed


def test_a_job_that_never_ends_is_ended_and_said(world: Callable[..., World]) -> None:
    here = world()
    here.manager.submit("one", "check", "http")
    here.manager.tick()
    handle = here.launcher.started[0]
    limit = most_seconds("check", here.configuration.axes[0])
    assert limit == here.configuration.axes[0].axis.limits.machine_seconds + ALLOWANCE["check"]
    here.pass_time(seconds=limit - 1)
    here.manager.tick()
    assert not handle.stopped
    here.jump(days=-3)  # the wall clock has no say in it
    here.pass_time(seconds=2)
    here.manager.tick()
    assert handle.stopped
    here.pass_time(seconds=31)
    here.manager.tick()
    assert handle.killed
    here.finish("died", 5)
    (job,) = here.store.list_jobs()
    assert (job["state"], job["outcome"], job["exit_code"]) == ("done", "fault", 5)
    assert f"not done after {limit:.0f} s" in job["sentence"]
    assert any(notice["kind"] == "fault" for notice in here.notices)


def test_a_job_that_was_kept_in_its_last_second_counts_as_kept(world: Callable[..., World]) -> None:
    here = world()
    here.manager.submit("one", "run", "http")
    here.manager.tick()
    here.pass_time(seconds=most_seconds("run", here.configuration.axes[0]) + 1)
    here.manager.tick()
    here.finish("kept", 0)
    assert here.store.list_jobs()[0]["outcome"] == "kept"


def test_a_job_that_a_person_stopped_does_not_begin_again_after_a_kill(world: Callable[..., World]) -> None:
    here = world()
    job = here.manager.submit("one", "run", "http")
    here.manager.tick()
    assert here.manager.stop(job["id"])
    here.close()
    here.open()
    here.manager.tick()
    here.manager.tick()
    assert len(here.launcher.started) == 1
    assert here.store.job(job["id"])["outcome"] == "aborted"


def test_a_defect_met_by_one_job_holds_up_no_other(
    world: Callable[..., World], monkeypatch: pytest.MonkeyPatch
) -> None:
    here = world(["one", "two"])
    for name in ("one", "two"):
        here.manager.submit(name, "check", "http")
    start = here.launcher.start

    def broken(order: Order) -> Any:
        if order.axis == "one":
            raise KeyError("a defect")
        return start(order)

    monkeypatch.setattr(here.launcher, "start", broken)
    here.manager.tick()
    assert [handle.order.axis for handle in here.launcher.started] == ["two"]
    assert "defect" in str(here.manager.problems())


def test_a_host_that_has_no_room_for_a_worker_is_asked_again_later_and_it_is_no_attempt(
    world: Callable[..., World], monkeypatch: pytest.MonkeyPatch
) -> None:
    here = world()
    job = here.manager.submit("one", "check", "http")
    asked: list[Order] = []

    def crowded(order: Order) -> None:
        asked.append(order)
        raise OSError(errno.EAGAIN, "Resource temporarily unavailable")

    with monkeypatch.context() as patched:
        patched.setattr(here.launcher, "start", crowded)
        for _ in range(100):
            here.manager.tick()
            here.pass_time(seconds=0.25)
    assert len(asked) == 1
    assert not here.manager.health.problems
    row = here.store.job(job["id"])
    assert (row["state"], row["attempts"]) == ("queued", 0)
    assert "Resource temporarily unavailable" in here.manager.waits_for(job["id"])
    here.pass_time(minutes=2)
    here.manager.tick()
    assert here.store.job(job["id"])["attempts"] == 1
    assert len(here.launcher.started) == 1


def meet(monkeypatch: pytest.MonkeyPatch, where: Any, name: str) -> list[Any]:
    """A defect in a method for as long as the test does not undo it; its calls."""
    calls: list[Any] = []

    def broken(*given: Any) -> None:
        calls.append(given)
        raise KeyError("a defect")

    monkeypatch.setattr(where, name, broken)
    return calls


def test_a_defect_that_has_passed_is_no_problem_any_more(
    world: Callable[..., World], monkeypatch: pytest.MonkeyPatch
) -> None:
    here = world()
    here.manager.submit("one", "check", "http")
    with monkeypatch.context() as patched:
        meet(patched, here.launcher, "start")
        here.manager.tick()
    assert "defect" in str(here.manager.problems())
    for _ in range(3):
        here.pass_time(minutes=6)
        here.manager.tick()
    assert len(here.launcher.started) == 1
    assert not here.manager.health.problems


def test_a_defect_at_the_end_of_a_job_is_not_met_again_and_again(
    world: Callable[..., World], monkeypatch: pytest.MonkeyPatch
) -> None:
    here = world()
    job = here.manager.submit("one", "check", "http")
    here.manager.tick()
    write_done(here.launcher.started[0].order, Done("done", 0, "It ended."))
    with monkeypatch.context() as patched:
        calls = meet(patched, here.manager._follow_up, "propose")
        here.finish()
        for _ in range(10):
            here.pass_time(seconds=1)
            here.manager.tick()
    assert len(calls) == 1
    assert here.manager.health.problems
    here.pass_time(minutes=6)
    here.manager.tick()
    assert here.store.job(job["id"])["state"] == "done"
    assert not here.manager.health.problems


def test_a_defect_in_what_follows_from_a_job_is_over_when_the_next_has_ended(
    world: Callable[..., World], monkeypatch: pytest.MonkeyPatch
) -> None:
    here = world(["one", "two"])
    with monkeypatch.context() as patched:
        meet(patched, here.manager._follow_up, "after")
        here.manager.submit("one", "check", "http")
        here.manager.tick()
        here.finish()
    for axis, over in (("two", False), ("one", True)):
        here.manager.submit(axis, "check", "http")
        here.manager.tick()
        here.finish()
        assert (not here.manager.health.problems) == over


def test_stopping_a_queued_job_cancels_it(world: Callable[..., World]) -> None:
    here = world()
    here.manager.submit("one", "check", "http")
    here.manager.tick()
    waiting = here.manager.submit("one", "run", "http")
    assert here.manager.stop(waiting["id"])
    here.finish()
    here.manager.tick()
    assert len(here.launcher.started) == 1
    assert here.store.job(waiting["id"])["outcome"] == "cancelled"
    assert not here.manager.stop(waiting["id"])


def test_a_machine_that_is_not_idle_is_asked_again_later(world: Callable[..., World]) -> None:
    here = world()
    here.manager.submit("one", "check", "schedule")
    here.manager.tick()
    here.finish("not_idle", 3)
    here.manager.tick()
    assert len(here.launcher.started) == 1
    here.pass_time(minutes=6)
    here.manager.tick()
    assert len(here.launcher.started) == 2


def test_an_axis_that_is_no_longer_configured_refuses_its_jobs(world: Callable[..., World]) -> None:
    here = world(["one", "two"])
    job = here.manager.submit("two", "check", "http")
    here.axes = ["one"]
    here.close()
    here.open()
    here.manager.tick()
    assert here.store.job(job["id"])["outcome"] == "refused"


def test_a_full_disk_stops_new_jobs_and_says_so(
    world: Callable[..., World], monkeypatch: pytest.MonkeyPatch
) -> None:
    here = world()
    monkeypatch.setattr("autotune.service.housekeeping.free", lambda runs: 1_000_000)
    job = here.manager.submit("one", "check", "http")
    here.manager.tick()
    assert not here.launcher.started
    assert "MB are free" in here.manager.waits_for(job["id"])


def test_a_history_that_cannot_be_written_is_a_problem_and_not_the_end(
    world: Callable[..., World], monkeypatch: pytest.MonkeyPatch
) -> None:
    here = world()

    def full(*states: str) -> list[dict[str, Any]]:
        raise OSError(28, "No space left on device")

    here.manager.submit("one", "check", "http")
    with monkeypatch.context() as patched:
        patched.setattr(here.store, "jobs_in", full)
        here.manager.tick()
        assert "history" in here.manager.health.problems
    here.manager.tick()
    assert not here.manager.health.problems
    assert len(here.launcher.started) == 1


def test_jobs_on_one_serial_link_take_turns(tmp_path: Path, world: Callable[..., World]) -> None:
    here = world(["one", "two"])
    here.close()
    for name, node in (("one", 5), ("two", 6)):
        path = tmp_path / f"{name}.toml"
        link = f"canopen+slcan:///dev/ttyACM0?bitrate=1000000&node={node}"
        path.write_text(path.read_text().replace("sim://edm-vertical", link))
        here.folder = tmp_path
    here.open()
    here.manager.submit("one", "check", "http")
    here.manager.submit("two", "check", "http")
    here.manager.tick()
    assert len(here.launcher.started) == 1
    here.finish()
    assert len(here.launcher.started) == 2


def test_a_result_on_disk_is_read_back_as_it_was(tmp_path: Path, history_url: str) -> None:
    order = Order("a" * 32, "one", "check", "one.toml", str(tmp_path))
    assert read_done(tmp_path, order.id) is None
    ended = Done("not_applied", 3, "Better.", "20260301-120000-one", "Write it?")
    write_done(order, ended)
    assert read_done(tmp_path, order.id) == ended
