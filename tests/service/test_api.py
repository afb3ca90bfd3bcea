"""The API: the token before anything else, limits, no path from a request, events, proposals."""

from __future__ import annotations

import asyncio
import json
import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy.exc import OperationalError
from starlette.testclient import TestClient

from autotune.service import access as guard
from autotune.service import background as behind
from autotune.service import studies
from autotune.service.access import AccessGuard, Rules
from autotune.service.api import make_api
from autotune.service.feed import MOST_WAITING, Feed

TOKEN = "a-token-that-is-long-enough"
AUTH = {"Authorization": f"Bearer {TOKEN}"}
World = Any


def rules(**changes: Any) -> Rules:
    values: dict[str, Any] = {
        "token": TOKEN, "reading_needs_token": False, "names": frozenset({"127.0.0.1"}), "most_bytes": 4096,
        "seconds": 30.0,
    }  # fmt: skip
    return Rules(**(values | changes))


@pytest.fixture
def served(world: Callable[..., World]) -> Iterator[tuple[World, TestClient]]:
    here = world(["one", "two"])
    with TestClient(AccessGuard(make_api(here.manager), rules()), base_url="http://127.0.0.1") as client:
        yield here, client


CHANGES = [
    ("POST", "/api/axes/one/jobs"), ("PUT", "/api/axes/one/idle"), ("POST", f"/api/jobs/{'0' * 32}/stop"),
    ("POST", f"/api/proposals/{'0' * 32}/approve"), ("POST", f"/api/proposals/{'0' * 32}/reject"),
    ("DELETE", "/api/axes/one"), ("PATCH", "/nowhere"), ("POST", "/healthz"),
]  # fmt: skip


@pytest.mark.parametrize(("method", "path"), CHANGES)
def test_a_change_without_the_token_is_refused_before_anything_else(
    served: tuple[World, TestClient], method: str, path: str
) -> None:
    here, client = served
    for body in (b"", b"{}", b"not json", b"x" * 10_000):
        assert client.request(method, path, content=body).status_code == 401, body
        for wrong in ("Bearer wrong", f"Basic {TOKEN}", f"bearer {TOKEN}x", "Bearer", TOKEN):
            answer = client.request(method, path, content=body, headers={"Authorization": wrong})
            assert answer.status_code == 403, (body, wrong)
    here.manager.tick()
    assert not here.launcher.started


def test_with_the_token_a_job_starts_is_seen_and_stopped(served: tuple[World, TestClient]) -> None:
    here, client = served
    answer = client.post("/api/axes/one/jobs", json={"kind": "check"}, headers=AUTH)
    assert answer.status_code == 202
    job = answer.json()["id"]
    assert client.post("/api/axes/one/jobs", json={"kind": "check"}, headers=AUTH).status_code == 409
    here.manager.tick()
    here.launcher.started[0].told.append({"event": "stage", "stage": "look", "seconds": 30.0})
    here.manager.tick()
    assert client.get(f"/api/jobs/{job}").json()["stage"] == "look"
    assert client.get("/api/axes/one").json()["state"] == "running"
    assert client.post(f"/api/jobs/{job}/stop", headers=AUTH).status_code == 202
    assert here.launcher.started[0].stopped
    here.finish("aborted", 130)
    assert client.post(f"/api/jobs/{job}/stop", headers=AUTH).status_code == 409


NESTED = [
    "[" * 90_000 + "]" * 90_000,
    '{"a":' * 30_000 + "1" + "}" * 30_000,
    '{"minutes": ' + "9" * 6000 + "}",
]


@pytest.mark.parametrize("body", NESTED)
@pytest.mark.parametrize(("method", "path"), [("POST", "/api/axes/one/jobs"), ("PUT", "/api/axes/one/idle")])
def test_bodies_made_to_break_a_parser_are_refused_in_words(
    world: Callable[..., World], method: str, path: str, body: str
) -> None:
    here = world(["one"])
    app = AccessGuard(make_api(here.manager), rules(most_bytes=262144))
    with TestClient(app, base_url="http://127.0.0.1") as client:
        answer = client.request(
            method, path, content=body, headers=AUTH | {"Content-Type": "application/json"}
        )
    assert answer.status_code in (400, 422)
    assert answer.json()["detail"]


def test_a_number_in_a_query_that_is_none_is_422(served: tuple[World, TestClient]) -> None:
    for number in ("9" * 6000, "1e400", "-1", "0x10"):
        assert served[1].get("/api/jobs", params={"limit": number}).status_code == 422, number


def test_what_computes_for_minutes_needs_the_token(served: tuple[World, TestClient]) -> None:
    for what in ("compare", "diagnose", "diagnose/"):
        path = f"/api/recordings/{'0' * 32}/{what}"
        assert served[1].get(path).status_code == 401, what
        assert served[1].get(path, headers=AUTH).status_code == 404, what


def test_a_study_stands_behind_everything_else_and_is_given_no_secret(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("AUTOTUNE_TOKEN", TOKEN)
    shows = "import json, os; print(json.dumps([os.getpriority(0, 0), os.sched_getscheduler(0), dict(os.environ)]))"
    nice, policy, environment = json.loads(studies._run(["-c", shows]).stdout)
    assert (nice, policy) == (behind.NICE, os.SCHED_OTHER)
    assert "AUTOTUNE_TOKEN" not in environment
    assert "PATH" in environment


def test_the_service_proves_that_it_knows_the_token_without_saying_it(
    served: tuple[World, TestClient],
) -> None:
    client, nonce = served[1], "0123456789abcdef" * 4
    answer = client.get("/api/proof", headers={"Autotune-Nonce": nonce})
    assert answer.json() == {"proof": guard.proof_of(TOKEN, 0, nonce)}
    assert TOKEN not in answer.text
    for wrong in ("", "0" * 31, "0" * 129, "g" * 32):
        assert client.get("/api/proof", headers={"Autotune-Nonce": wrong}).status_code == 400
    assert client.get("/api/proof", headers={"Host": "evil.example"}).status_code == 403


def test_what_a_job_has_found_is_read_without_a_file(served: tuple[World, TestClient]) -> None:
    here, client = served
    job = here.manager.submit("one", "run", "http")["id"]
    assert client.get(f"/api/jobs/{job}/result").status_code == 409
    here.manager.tick()
    here.finish("kept", 0, left_run(here.configuration.runs, "one", "kept", better=True))
    assert client.get(f"/api/jobs/{job}/result").json()["outcome"] == "kept"
    other = here.manager.submit("one", "rollback", "http")["id"]
    here.manager.tick()
    here.finish("restored", 0)
    assert client.get(f"/api/jobs/{other}/result").status_code == 404


MISSING = (
    "/api/axes/three", "/api/axes/three/history", f"/api/jobs/{'0' * 32}", f"/api/recordings/{'0' * 32}",
    f"/api/axes/one/models/{'0' * 32}", f"/api/recordings/{'0' * 32}/compare",
)  # fmt: skip


def test_what_is_not_there_is_404(served: tuple[World, TestClient]) -> None:
    for path in MISSING:
        answer = served[1].get(path, headers=AUTH)
        assert answer.status_code == 404, path
        assert "there is no" in answer.json()["detail"] or "has no" in answer.json()["detail"], path


@pytest.mark.parametrize(
    "path", ["/api/axes/{}", "/api/recordings/{}", "/api/axes/one/models/{}", "/api/jobs/{}"]
)
def test_no_name_from_a_request_becomes_a_path(served: tuple[World, TestClient], path: str) -> None:
    for name in ("..%2f..%2fetc%2fpasswd", "%2e%2e", "a" * 200, "A B", "x%00y"):
        assert served[1].get(path.format(name)).status_code in (404, 422), name


WISHES: tuple[object, ...] = (
    {},
    {"kind": "reboot"},
    {"kind": "check", "file": "/etc/passwd"},
    {"kind": "rollback", "to": "../x"},
    {"kind": "check", "to": "20260301-120000-1"},
    {"kind": "check", "unattended": True},
    {"kind": "check", "commit": "automatic"},
    {"kind": "run", "commit": "perhaps"},
    {"kind": "run", "model": "this is no model"},
    {"kind": "check", "model": ""},
    {"kind": "decide", "effects": ["stribek"]},
    {"kind": "decide", "effects": "stribeck"},
    [],
    "check",
)


def test_a_wish_that_makes_no_sense_is_422(served: tuple[World, TestClient]) -> None:
    for wish in WISHES:
        assert served[1].post("/api/axes/one/jobs", json=wish, headers=AUTH).status_code == 422, wish


NO_NUMBERS = (
    '{"minutes": NaN}', '{"minutes": 1e400}', '{"minutes": -Infinity}', "[" * 3000, "\x00",
    '{"minutes": ' + "9" * 400 + "}", '{"minutes": ' + "9" * 3500 + "}", '{"a":' * 600, '{"minutes": "1"}',
)  # fmt: skip


def test_a_body_that_is_no_number_or_no_json_is_refused_in_json(served: tuple[World, TestClient]) -> None:
    headers = AUTH | {"Content-Type": "application/json"}
    for body in NO_NUMBERS:
        answer = served[1].put("/api/axes/one/idle", content=body, headers=headers)
        assert answer.status_code in (400, 422), body[:40]
        assert answer.json()["detail"], body[:40]


def test_a_history_that_cannot_be_read_is_503_in_words(
    served: tuple[World, TestClient], monkeypatch: pytest.MonkeyPatch
) -> None:
    here, client = served

    def torn(*whatever: object) -> None:
        raise OperationalError("SELECT", {}, Exception("disk I/O error"))

    monkeypatch.setattr(here.store, "list_jobs", torn)
    answer = client.get("/api/jobs")
    assert answer.status_code == 503
    assert "healthz" in answer.json()["detail"]


def test_a_large_body_is_refused(served: tuple[World, TestClient]) -> None:
    client = served[1]
    assert client.post("/api/axes/one/jobs", content=b"x" * 5000, headers=AUTH).status_code == 413

    def pieces() -> Iterator[bytes]:
        for _ in range(100):
            yield b"x" * 1000

    assert client.post("/api/axes/one/jobs", content=pieces(), headers=AUTH).status_code == 413


def test_another_host_name_is_refused_so_that_no_web_page_gets_through(
    served: tuple[World, TestClient],
) -> None:
    assert served[1].get("/api/axes", headers={"Host": "evil.example"}).status_code == 403
    assert served[1].get("/api/axes", headers={"Host": "127.0.0.1:8765"}).status_code == 200


def test_reading_needs_the_token_where_others_can_reach_the_service(world: Callable[..., World]) -> None:
    here = world()
    here.manager.tick()
    app = AccessGuard(make_api(here.manager), rules(reading_needs_token=True))
    with TestClient(app, base_url="http://127.0.0.1") as client:
        assert client.get("/api/axes").status_code == 401
        assert client.get("/healthz").status_code == 200
        assert client.get("/api/axes", headers=AUTH).status_code == 200


def test_a_hundred_requests_at_once_are_all_answered(served: tuple[World, TestClient]) -> None:
    client = served[1]
    with ThreadPoolExecutor(50) as pool:
        answers = list(pool.map(lambda _: client.get("/api/axes").status_code, range(100)))
    assert answers == [200] * 100


def test_events_of_a_job_end_with_the_job(served: tuple[World, TestClient]) -> None:
    here, client = served
    job = client.post("/api/axes/one/jobs", json={"kind": "check"}, headers=AUTH).json()["id"]
    here.manager.tick()
    here.finish()
    with client.stream("GET", f"/api/jobs/{job}/events") as answer:
        text = "".join(answer.iter_text())
    assert answer.headers["content-type"].startswith("text/event-stream")
    assert '"state": "done"' in text
    assert here.manager.feed.count == 0


def test_a_follower_that_never_reads_is_dropped_and_delays_nobody() -> None:
    feed = Feed()
    lazy, keen = feed.follow(), feed.follow()
    assert lazy is not None
    assert keen is not None
    for number in range(MOST_WAITING + 10):
        feed.tell({"event": "x", "number": number})
        keen.waiting.get_nowait()
    assert lazy.dropped
    assert not keen.dropped
    assert feed.count == 1


@pytest.mark.parametrize("path", ["/api/events", "/api/axes/one/live"])
def test_a_reader_who_is_gone_before_the_first_word_leaves_no_follower(
    served: tuple[World, TestClient], path: str
) -> None:
    here = served[0]
    scope = {
        "type": "http", "method": "GET", "path": path, "raw_path": path.encode(), "root_path": "", "scheme": "http",
        "query_string": b"", "headers": [(b"host", b"127.0.0.1")], "http_version": "1.1",
    }  # fmt: skip

    async def nothing() -> dict[str, Any]:
        await asyncio.Event().wait()
        return {}

    async def gone(message: Any) -> None:
        raise EOFError

    with pytest.raises(EOFError):
        asyncio.run(make_api(here.manager)(scope, nothing, gone))
    assert here.manager.feed.count == 0
    assert not here.manager.live.of("one").busy


def test_a_connection_that_takes_nothing_is_cut(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "SEND_SECONDS", 0.01)

    class Transport:
        aborted = False

        def abort(self) -> None:
            self.aborted = True

    class Cycle:
        def __init__(self) -> None:
            self.transport = Transport()

        async def send(self, message: Any) -> None:
            if message["type"] == "http.response.body":
                await asyncio.Event().wait()

    async def endless(scope: Any, receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})
        while True:
            await send({"type": "http.response.body", "body": b"x", "more_body": True})

    async def nothing() -> dict[str, Any]:
        return {"type": "http.disconnect"}

    cycle = Cycle()
    scope = {"type": "http", "method": "GET", "path": "/api/events", "headers": [(b"host", b"127.0.0.1")]}
    asyncio.run(AccessGuard(endless, rules())(scope, nothing, cycle.send))
    assert cycle.transport.aborted


def test_an_answer_that_does_not_come_is_504() -> None:
    async def never(scope: Any, receive: Any, send: Any) -> None:
        await asyncio.Event().wait()

    client = TestClient(AccessGuard(never, rules(seconds=0.01)), base_url="http://127.0.0.1")
    assert client.get("/api/axes").status_code == 504


def test_the_machine_is_called_idle(served: tuple[World, TestClient]) -> None:
    client = served[1]
    assert client.put("/api/axes/one/idle", json={"minutes": 30}, headers=AUTH).json()["idle_until"]
    assert client.put("/api/axes/one/idle", json={"minutes": 0}, headers=AUTH).json()["idle_until"] is None
    assert client.put("/api/axes/one/idle", json={"minutes": -1}, headers=AUTH).status_code == 422


def left_run(runs: Path, axis: str, outcome: str, better: bool, number: int = 1) -> str:
    """A run folder as a run leaves it."""
    folder = runs / f"2026030{number}-120000-{axis}"
    folder.mkdir(parents=True)
    peaks = {"peak_error": 2e-3, "raw_peak_error": 2e-3, "rms_error": 1e-3}
    content = {
        "axis": axis, "outcome": outcome, "verdict": "Proved, but not written: it was not approved.",
        "started": "2026-03-01T12:00:00+00:00", "machine_seconds": 200.0, "before": peaks,
        "after": peaks | {"peak_error": 5e-4}, "committed": None, "improvement": {"better": better},
        "parameters": {"coulomb": {"value": 0.33, "standard_error": 0.01, "unit": "N m"}},
    }  # fmt: skip
    (folder / "run.json").write_text(json.dumps(content))
    (folder / "model.toml").write_text("schema = 1\n")
    (folder / "recordings").mkdir()
    (folder / "recordings" / "proof.parquet").write_bytes(b"PAR1")
    return folder.name


def test_a_proved_commit_waits_for_a_person_and_is_decided_once(served: tuple[World, TestClient]) -> None:
    here, client = served
    here.manager.submit("one", "run", "http")
    here.manager.tick()
    run = left_run(here.configuration.runs, "one", "not_applied", better=True)
    here.finish("not_applied", 3, run, "Write it?")
    (proposal,) = client.get("/api/proposals").json()
    assert proposal["state"] == "open"
    assert proposal["sentence"].endswith("peak error from 2.00 to 0.50 mrad. Write it?")
    answer = client.post(f"/api/proposals/{proposal['id']}/approve", headers=AUTH)
    assert answer.status_code == 202
    assert client.post(f"/api/proposals/{proposal['id']}/reject", headers=AUTH).status_code == 409
    here.manager.tick()
    order = here.launcher.started[-1].order
    assert (order.kind, order.options["proposal"]) == ("commit", run)


def test_a_proposal_is_there_before_its_run_counts_as_done(
    served: tuple[World, TestClient], monkeypatch: pytest.MonkeyPatch
) -> None:
    here, client = served
    job = here.manager.submit("one", "run", "http")
    here.manager.tick()
    run = left_run(here.configuration.runs, "one", "not_applied", better=True)
    with monkeypatch.context() as cut:
        cut.setattr(here.store, "change_job", lambda *_, **__: 1 / 0)
        here.finish("not_applied", 3, run, "Write it?")
    assert [one["state"] for one in client.get("/api/proposals").json()] == ["open"]
    jobs = here.configuration.runs / ".service" / "jobs"
    jobs.mkdir(parents=True)
    result = {"outcome": "not_applied", "exit_code": 3, "sentence": "s", "run": run, "asked": "Write it?"}
    (jobs / f"{job['id']}.json").write_text(json.dumps(result))
    here.pass_time(minutes=6)
    here.manager.tick()
    assert here.store.job(job["id"])["state"] == "done"
    assert sorted(one["state"] for one in client.get("/api/proposals").json()) == ["open", "superseded"]
    assert len(here.notices) == 1


def test_an_approval_that_is_cut_off_has_its_commit_queued(
    served: tuple[World, TestClient], monkeypatch: pytest.MonkeyPatch
) -> None:
    here, client = served
    here.manager.submit("one", "run", "http")
    here.manager.tick()
    here.finish(
        "not_applied", 3, left_run(here.configuration.runs, "one", "not_applied", better=True), "Write?"
    )
    (proposal,) = client.get("/api/proposals").json()
    with monkeypatch.context() as cut:
        cut.setattr(here.store, "decide_proposal", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            client.post(f"/api/proposals/{proposal['id']}/approve", headers=AUTH)
    assert [job["kind"] for job in here.store.jobs_in("queued")] == ["commit"]
    again = client.post(f"/api/proposals/{proposal['id']}/approve", headers=AUTH)
    assert (again.status_code, "waiting or running" in again.text) == (409, True)


@pytest.mark.parametrize("better", [False, True])
def test_a_run_that_asked_nobody_makes_no_proposal(served: tuple[World, TestClient], better: bool) -> None:
    here, client = served
    here.manager.submit("one", "run", "http")
    here.manager.tick()
    here.finish("not_applied", 3, left_run(here.configuration.runs, "one", "not_applied", better=better))
    assert client.get("/api/proposals").json() == []


def test_models_and_recordings_are_listed_and_read_by_id(served: tuple[World, TestClient]) -> None:
    here, client = served
    run = left_run(here.configuration.runs, "one", "kept", better=True)
    (model,) = client.get("/api/axes/one/models").json()
    assert model["run"] == run
    assert client.get(f"/api/axes/one/models/{model['id']}").json()["toml"] == "schema = 1\n"
    assert client.get(f"/api/axes/two/models/{model['id']}").status_code == 404
    (recording,) = client.get("/api/axes/one/recordings").json()
    assert client.get(f"/api/recordings/{recording['id']}").content == b"PAR1"


def test_history_is_data_and_sentences(served: tuple[World, TestClient]) -> None:
    found = served[1].get("/api/axes/one/history").json()
    assert found["sentences"]
    assert found["checks"] == []


def test_metrics_can_be_scraped(served: tuple[World, TestClient]) -> None:
    text = served[1].get("/metrics").text
    assert 'autotune_job_running{axis="one"} 0.0' in text
    assert "autotune_disk_free_bytes" in text


@pytest.mark.parametrize("path", ["/healthz", "/metrics"])
def test_monitoring_may_ask_for_the_head_only(served: tuple[World, TestClient], path: str) -> None:
    here, client = served
    here.manager.tick()
    assert client.head(path).status_code == 200
    here.manager.set_problem("history", "the history cannot be used")
    assert client.head("/healthz").status_code == 503


def test_health_tells_a_problem(served: tuple[World, TestClient]) -> None:
    here, client = served
    here.manager.tick()
    assert client.get("/healthz").json()["status"] == "ok"
    here.pass_time(seconds=60)
    answer = client.get("/healthz")
    assert answer.status_code == 503
    assert "no round" in answer.json()["problems"]["rounds"]
    here.manager.tick()
    here.manager.set_problem("upkeep", "the disk is full")
    assert client.get("/healthz").status_code == 503
