"""The server on a real socket: many at once, silent ones, ones that never read, ones that send too much."""

from __future__ import annotations

import asyncio
import gc
import json
import socket
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import pytest

from autotune.service import access as guard
from autotune.service import server
from autotune.service.server import HttpServer, listen
from autotune.service.settings import Http

World = Any
TOKEN = "a-token-that-is-long-enough"
PATIENCE = 60.0


@pytest.fixture
def address(world: Callable[..., World], monkeypatch: pytest.MonkeyPatch) -> Iterator[tuple[World, str, int]]:
    """A service of two axes, and where it listens."""
    monkeypatch.setattr(guard, "SEND_SECONDS", 0.5)
    monkeypatch.setattr(guard, "BODY_SECONDS", 0.5)
    monkeypatch.setattr(server, "HEADER_SECONDS", 0.5)
    monkeypatch.setattr(server, "KEPT_SECONDS", 1)
    here = world(["one", "two"])
    here.manager.tick()
    http = Http(port=0, body_kilobytes=4)
    listening = listen(http)
    running = HttpServer(here.manager, http, TOKEN, listening)
    running.start()
    host, port = listening.getsockname()
    yield here, host, port
    running.close()


def get(host: str, port: int, path: str) -> Any:
    with urllib.request.urlopen(f"http://{host}:{port}{path}", timeout=PATIENCE) as answer:
        return json.loads(answer.read())


def talk(host: str, port: int, request: bytes) -> bytes:
    """Everything that comes back until the server closes, or nothing comes."""
    with socket.create_connection((host, port), timeout=PATIENCE) as connection:
        connection.sendall(request)
        found = b""
        while block := connection.recv(65536):
            found += block
        return found


def wait_for(seen: Callable[[], bool]) -> None:
    end = time.monotonic() + PATIENCE
    while not seen():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_hundred_requests_at_once_over_sockets(address: tuple[World, str, int]) -> None:
    _, host, port = address
    paths = ["/api/axes", "/api/jobs", "/healthz", "/api/axes/one/history"] * 25
    with ThreadPoolExecutor(100) as pool:
        answers = list(pool.map(lambda path: get(host, port, path), paths))
    assert len(answers) == 100
    assert all(answer["status"] == "ok" for answer in answers[2::4])


def test_a_client_that_never_reads_its_events_is_cut_and_delays_nobody(
    address: tuple[World, str, int],
) -> None:
    here, host, port = address
    with socket.socket() as lazy:
        lazy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        lazy.connect((host, port))
        lazy.sendall(b"GET /api/events HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n")
        wait_for(lambda: here.manager.feed.count == 1)
        longest = 0.0

        def told_and_read() -> bool:
            nonlocal longest
            for _ in range(50):
                here.manager.feed.tell({"event": "say", "sentence": "x" * 4000})
            began = time.monotonic()
            get(host, port, "/healthz")
            longest = max(longest, time.monotonic() - began)
            return bool(here.manager.feed.count == 0)

        wait_for(told_and_read)
        assert longest < 10.0


def test_one_that_connects_and_says_nothing_is_cut(address: tuple[World, str, int]) -> None:
    _, host, port = address
    assert talk(host, port, b"") == b""
    head = b"GET /healthz HTTP/1.1\r\nHost: 127"
    assert talk(host, port, head) == b""
    second = talk(host, port, head + b".0.0.1\r\n\r\n" + head)
    assert second.count(b"HTTP/1.1 200") == 1, "the first is answered, the second never ends"


def test_a_body_that_does_not_arrive_or_does_not_end_is_refused(address: tuple[World, str, int]) -> None:
    _, host, port = address
    head = (
        f"POST /api/axes/one/jobs HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer {TOKEN}\r\n".encode()
    )
    late = talk(host, port, head + b"Content-Length: 100\r\n\r\n{")
    assert late.startswith(b"HTTP/1.1 408")
    large = talk(host, port, head + b"Content-Length: 100000000\r\n\r\n{")
    assert large.startswith(b"HTTP/1.1 413")
    chunks = b"".join(b"400\r\n" + b"x" * 1024 + b"\r\n" for _ in range(8))
    endless = talk(host, port, head + b"Transfer-Encoding: chunked\r\n\r\n" + chunks)
    assert endless.startswith(b"HTTP/1.1 413")


@pytest.mark.parametrize(
    "request_line",
    [
        b"GARBAGE",
        b"\x16\x03\x01\x02\x00\x01\x00",
        b"GET /healthz HTTP/1.1\r\nHost: a\r\nHost: b",
    ],
)
def test_what_is_no_http_gets_400_and_no_more(address: tuple[World, str, int], request_line: bytes) -> None:
    _, host, port = address
    assert talk(host, port, request_line + b"\r\n\r\n").startswith(b"HTTP/1.1 400")
    assert get(host, port, "/healthz")["status"] == "ok"


@pytest.mark.parametrize(
    "path", ["/../../etc/passwd", "/api/axes/../../../etc/passwd", "//etc/passwd", "/%2e%2e/%2e%2e/x"]
)
def test_no_path_leads_to_the_file_system(address: tuple[World, str, int], path: str) -> None:
    _, host, port = address
    answer = talk(host, port, f"GET {path} HTTP/1.1\r\nHost: 127.0.0.1\r\nConnection: close\r\n\r\n".encode())
    assert answer.split()[1] in (b"404", b"422")
    assert b"root:" not in answer


def test_every_change_in_the_openapi_needs_the_token(address: tuple[World, str, int]) -> None:
    here, host, port = address
    described = get(host, port, "/openapi.json")["paths"]
    changes = [
        (method.upper(), path)
        for path, methods in described.items()
        for method in methods
        if method not in ("get", "head", "options")
    ]
    assert len(changes) >= 5
    for method, path in changes:
        url = f"http://{host}:{port}{path.format(axis='one', job='0' * 32, recording='0' * 32, proposal='0' * 32)}"
        for token, status in (("", 401), ("Bearer wrong", 403), (f"Basic {TOKEN}", 403)):
            for body in (b"", b'{"kind": "check"}', b"not json"):
                request = urllib.request.Request(
                    url, body, {"Authorization": token} if token else {}, method=method
                )
                with pytest.raises(urllib.error.HTTPError) as refused:
                    urllib.request.urlopen(request, timeout=PATIENCE)
                assert refused.value.code == status, (method, path, token)
                refused.value.close()
    here.manager.tick()
    assert not here.launcher.started
    assert get(host, port, "/api/jobs") == []


def test_a_connection_that_has_ended_leaves_nothing_in_memory(
    address: tuple[World, str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A timer for each request kept its connection for half a minute: 160 MB beside pages that ask all the time."""
    monkeypatch.setattr(server, "HEADER_SECONDS", 3600.0)
    _, host, port = address

    def kept() -> int:
        gc.collect()
        return sum(isinstance(one, server._Protocol) for one in gc.get_objects())

    before = kept()
    for _ in range(100):
        get(host, port, "/healthz")
    wait_for(lambda: kept() <= before + 3)
    assert kept() <= before + 3, "of a hundred"


def test_one_that_asks_again_and_again_on_one_connection_has_one_timer(
    address: tuple[World, str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "HEADER_SECONDS", 3600.0)
    _, host, port = address
    with socket.create_connection((host, port), timeout=PATIENCE) as connection:
        ahead = b"GET /healthz HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 50
        connection.sendall(ahead)
        found = b""
        while found.count(b"HTTP/1.1 200") < 50:
            found += connection.recv(65536)
        gc.collect()
        timers = [one for one in gc.get_objects() if isinstance(one, asyncio.TimerHandle)]
        ours = [one for one in timers if "_cut_if_still" in repr(one) and not one.cancelled()]
    assert len(ours) <= 1, "of fifty requests"
