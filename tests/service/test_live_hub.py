"""Live traces of the service's axes: the last minute at once, notes never lost, nobody waited for."""

from __future__ import annotations

import asyncio
import io
import os
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fastapi.testclient import TestClient

from autotune.core.loop import ROW_FIELDS
from autotune.service import live_hub, live_pipe, live_routes
from autotune.service.api import make_api
from autotune.service.live_client import pass_on
from autotune.service.live_hub import AxisHub, LiveHubs
from autotune.view.messages import HEADER, NOTE, ROWS, encode_note, encode_rows, read_message
from autotune.view.pages import Page, Words
from autotune.view.teller import Teller
from tests.service.conftest import World


def rows(start: float, count: int = 1000) -> np.ndarray:
    """One second of an axis at 1 kHz."""
    block = np.zeros((count, len(ROW_FIELDS)))
    block[:, 0] = start + np.arange(count) * 1e-3
    return block


def give(hub: AxisHub, data: bytes) -> None:
    source = io.BytesIO(data)
    while (message := read_message(source)) is not None:
        hub.take(*message)


def received(data: bytes) -> tuple[list[dict[str, Any]], np.ndarray]:
    """Notes and rows that came."""
    teller = Teller()
    pass_on(io.BytesIO(data), teller)
    blocks = teller._queue.take(10**9)
    return list(teller._notes), np.concatenate(blocks) if blocks else np.empty((0, 1))


def test_who_attaches_gets_the_notes_and_the_last_minute() -> None:
    hub = AxisHub()
    give(hub, encode_note({"kind": "stage", "name": "old"}) + encode_note({"kind": "stage", "name": "look"}))
    give(hub, encode_note({"kind": "page", "page": {"name": "fit"}}))
    give(hub, encode_note({"kind": "page", "page": {"name": "proof"}}))
    for second in range(200):
        give(hub, encode_rows(rows(second)))
    follower = hub.follow()
    assert follower is not None
    notes, came = received(follower.take())
    assert [note.get("name") or note["page"]["name"] for note in notes] == ["look", "fit", "proof"]
    assert came[-1, 0] - came[0, 0] == pytest.approx(60.0, abs=1.1)  # a message holds a second
    assert (np.diff(came[:, 0]) > 0).all()
    give(hub, encode_rows(rows(200)))
    assert received(follower.take())[1][0, 0] == 200.0


def test_the_last_minute_is_that_of_the_axis_though_its_clock_starts_again() -> None:
    hub = AxisHub()
    for _ in range(3):
        for second in range(50):
            give(hub, encode_rows(rows(second)))
    follower = hub.follow()
    assert follower is not None
    assert len(received(follower.take())[1]) == pytest.approx(60_000, abs=2_500)


def test_a_follower_that_does_not_read_loses_rows_and_no_note_and_holds_up_nobody() -> None:
    hub = AxisHub()
    hung, reading = hub.follow(), hub.follow()
    assert hung is not None
    assert reading is not None
    came = 0
    for second in range(600):  # ten minutes
        give(hub, encode_note({"kind": "stage", "name": f"s{second}"}) + encode_rows(rows(second)))
        came += len(received(reading.take())[1])
    assert came == 600_000
    notes, left = received(hung.take())
    assert [note["name"] for note in notes] == [f"s{second}" for second in range(600)]
    assert left[-1, 0] == pytest.approx(599.999)
    assert left.nbytes <= live_hub.MOST_BYTES
    assert hub.bytes_kept <= live_hub.MOST_BYTES


def test_too_many_followers_are_refused_and_leaving_makes_room() -> None:
    hub = AxisHub()
    followers = [hub.follow() for _ in range(live_hub.MOST_FOLLOWERS)]
    assert hub.follow() is None
    assert followers[0] is not None
    hub.leave(followers[0])
    hub.leave(followers[0])
    assert hub.follow() is not None


def test_hubs_of_many_axes_are_bounded_and_those_in_use_stay() -> None:
    hubs = LiveHubs()
    used = hubs.of("used")
    used.follow()
    give(used, encode_rows(rows(0)))
    for number in range(50):
        hubs.of(f"axis-{number}")
    assert hubs.of("used") is used
    assert len(hubs._hubs) <= live_hub.MOST_AXES + 1


NONSENSE = [
    b"",
    b"nonsense",
    HEADER.pack(ROWS, 0, 12),
    HEADER.pack(ROWS, 7, 12) + bytes(7),
    HEADER.pack(NOTE, 99, 0) + b"{}",
]


@pytest.mark.parametrize("data", NONSENSE)
def test_a_worker_that_talks_nonsense_is_no_longer_heard(data: bytes) -> None:
    hubs = LiveHubs()
    hubs.listen("one", io.BytesIO(data)).join(10)
    assert hubs.of("one").bytes_kept == 0
    give(hubs.of("one"), HEADER.pack(NOTE, 3, 0) + b"[1]")
    give(hubs.of("one"), HEADER.pack(NOTE, 3, 0) + b"{]}")


def test_what_a_worker_tells_comes_through_its_pipe(monkeypatch: pytest.MonkeyPatch) -> None:
    read, write = os.pipe()
    monkeypatch.setenv(live_pipe.VARIABLE, str(write))
    hubs = LiveHubs()
    thread = hubs.listen("one", os.fdopen(read, "rb"))
    with live_pipe.told_to_service() as observers:
        assert live_pipe.VARIABLE not in os.environ  # no process of the job's own inherits it
        (observer,) = observers
        observer.stage("look")
        observer.programme(["legs"])(rows(0))
        observer.page(Page.of("verdict", "Verdict", [Words("Verdict", "kept")]))
    thread.join(10)
    follower = hubs.of("one").follow()
    assert follower is not None
    notes, came = received(follower.take())
    assert [note["kind"] for note in notes] == ["stage", "labels", "page"]
    assert len(came) == 1000


def test_without_a_pipe_nobody_looks_on(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(live_pipe.VARIABLE, raising=False)
    with live_pipe.told_to_service() as observers:
        assert observers == ()


def test_a_service_that_does_not_read_holds_up_no_worker(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_pipe, "LAST_SECONDS", 0.1)
    read, write = os.pipe()
    monkeypatch.setenv(live_pipe.VARIABLE, str(write))
    with live_pipe.told_to_service() as observers:
        watch = observers[0].programme(["a"])
        for second in range(300):
            watch(rows(second))
        assert observers[0]._queue.waiting <= 100_000
    os.close(read)


def test_over_http_the_last_minute_comes_at_once(world: Callable[..., World]) -> None:
    served = world()
    hub = served.manager.live.of("one")
    give(hub, encode_note({"kind": "stage", "name": "look"}))
    for second in range(60):
        give(hub, encode_rows(rows(second)))
    client = TestClient(make_api(served.manager))
    assert client.get("/api/axes/other/live").status_code == 404
    notes, came = received(asyncio.run(_first(hub, 60_000)))
    assert notes[0]["name"] == "look"
    assert len(came) == 60_000
    for _ in range(live_hub.MOST_FOLLOWERS):
        hub.follow()
    assert client.get("/api/axes/one/live").status_code == 503


async def _first(hub: AxisHub, wanted: int) -> bytes:
    """What the route sends until so many rows are there; the test's client cannot read what has no end."""
    follower = hub.follow()
    assert follower is not None
    data = b""
    async for piece in live_routes._messages(follower):
        data += piece
        if len(received(data)[1]) >= wanted:
            break
    return data
