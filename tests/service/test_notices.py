"""Notices: a webhook that fails is tried again, delays nobody, and what is lost is counted."""

from __future__ import annotations

import http.server
import json
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

from autotune.service import notices
from autotune.service.notices import Webhook
from autotune.service.settings import Notices


class Receiver:
    """A webhook that refuses the first `refusals` posts."""

    def __init__(self, refusals: int) -> None:
        self.refusals, self.got = refusals, list[dict[str, Any]]()
        outer = self

        class Handler(http.server.BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"]))
                outer.refusals -= 1
                self.send_response(503 if outer.refusals >= 0 else 204)
                self.end_headers()
                if outer.refusals < 0:
                    outer.got.append(json.loads(body))

            def log_message(self, *_: object) -> None:
                return

        self._server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.url = f"http://127.0.0.1:{self._server.server_port}/"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        self._server.shutdown()
        self._server.server_close()


@pytest.fixture
def receiver(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[int], Receiver]]:
    monkeypatch.setattr(notices, "LONGEST_PAUSE", 0.01)
    monkeypatch.setattr(notices, "GROWTH", 0.01)
    made: list[Receiver] = []

    def make(refusals: int) -> Receiver:
        made.append(Receiver(refusals))
        return made[-1]

    yield make
    for one in made:
        one.close()


def until(holds: Callable[[], bool]) -> None:
    end = time.monotonic() + 20.0
    while not holds() and time.monotonic() < end:
        time.sleep(0.01)
    assert holds()


def test_a_notice_is_tried_until_it_is_taken(receiver: Callable[[int], Receiver]) -> None:
    there = receiver(1)
    webhook = Webhook(Notices(webhook=there.url, attempts=3))
    webhook.tell({"kind": "change", "sentence": "worn"})
    until(lambda: there.got == [{"kind": "change", "sentence": "worn"}])
    assert webhook.lost == 0
    webhook.close()


def test_what_is_never_taken_is_counted_and_a_reload_changes_the_address(
    receiver: Callable[[int], Receiver],
) -> None:
    deaf, there = receiver(1000), receiver(0)
    webhook = Webhook(Notices(webhook=deaf.url, attempts=1))
    webhook.tell({"kind": "first"})
    until(lambda: webhook.lost == 1)
    webhook.change(Notices(webhook=there.url))
    webhook.tell({"kind": "second"})
    until(lambda: there.got == [{"kind": "second"}])
    assert webhook.lost == 1
    webhook.close()
