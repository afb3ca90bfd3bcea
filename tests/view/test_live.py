"""The live view: whatever a viewer does, the run goes on, and nothing is left behind."""

from __future__ import annotations

import contextlib
import io
import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from autotune.core.errors import ConfigurationError
from autotune.core.loop import ROW_FIELDS
from autotune.view import messages, viewer_server
from autotune.view.live import LiveSettings, LiveView
from autotune.view.pages import Page, Words

WIDTH = len(ROW_FIELDS)


def rows(start: int, count: int = 50, label: int = 0) -> np.ndarray:
    time = (np.arange(count) + start) * 1e-3
    block = np.zeros((count, WIDTH))
    block[:, 0] = time
    block[:, 1] = np.sin(time)
    block[:, 3] = np.cos(time)
    block[:, 8] = np.nan
    block[:, ROW_FIELDS.index("label")] = label
    return block


def eventually(condition: Callable[[], bool], seconds: float = 60.0) -> bool:
    """Waits for what must happen; the time is only there to end a test that has failed."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True


def exists(pid: int) -> bool:
    """Whether the process runs (a zombie that nobody waits for does not)."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    return False


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind((viewer_server.HOST, 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def view() -> Iterator[LiveView]:
    live = LiveView(LiveSettings(port=free_port(), window=False, web=False, flush_s=0.4, patience_s=1.0))
    live.start()
    try:
        yield live
    finally:
        live.close()


# The queue


@given(st.lists(st.one_of(st.integers(1, 40), st.just(None)), max_size=80), st.integers(50, 200))
def test_queue_keeps_the_newest_in_order_and_counts_the_rest(steps: list[int | None], limit: int) -> None:
    queue = messages.RowQueue(limit)
    put, taken = 0, []
    for step in steps:
        if step is None:
            taken += [float(v) for block in queue.take(30) for v in block[:, 0]]
        else:
            queue.put(np.arange(put, put + step, dtype=float).reshape(-1, 1))
            put += step
        assert queue.waiting <= limit
    taken += [float(v) for block in queue.take(10**6) for v in block[:, 0]]
    assert taken == sorted(taken)
    assert len(taken) + queue.dropped == put
    assert queue.waiting == 0
    if put and taken:
        assert taken[-1] == put - 1


def test_messages_survive_the_pipe() -> None:
    first, second = rows(0, 3), rows(3, 2)
    data = messages.encode_rows(first) + messages.encode_note({"kind": "stage", "name": "ä"})
    inbox = messages.Inbox(io.BytesIO(data + messages.encode_rows(second) + b"R\x05"), 100)
    inbox.start()
    assert inbox.ended.wait(10)
    np.testing.assert_array_equal(np.concatenate(inbox.rows.take(10)), np.concatenate([first, second]))
    assert list(inbox.notes) == [{"kind": "stage", "name": "ä"}]


def test_inbox_ends_on_what_is_no_message() -> None:
    for data in (
        b"X" + bytes(6),
        b"R" + bytes([255] * 6),
        b"",
        b"N\x03\x00\x00\x00\x00\x00{}",
        b"R" + bytes(6),
    ):
        inbox = messages.Inbox(io.BytesIO(data), 100)
        inbox.start()
        assert inbox.ended.wait(10)
        assert not inbox.notes


def test_writer_gives_up_on_a_reader_that_does_not_read() -> None:
    read, write = os.pipe()
    os.set_blocking(write, False)
    try:
        assert not messages.write_all(write, bytes(1_000_000), 0.1)
        os.close(read)
        with pytest.raises(OSError, match="pipe"):
            messages.write_all(write, b"x", 0.1)
    finally:
        os.close(write)


# The server


def test_a_taken_port_is_refused_with_a_sentence() -> None:
    with socket.socket() as taken:
        taken.bind((viewer_server.HOST, 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(ConfigurationError, match=f"port {port} of 127.0.0.1 is taken"):
            LiveView(LiveSettings(port=port, window=False)).start()
        assert viewer_server.choose_port(None, port) != port


def test_another_program_on_the_port_is_not_taken_for_the_server(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(viewer_server, "START_SECONDS", 2.0)
    with socket.socket() as taken:
        taken.bind((viewer_server.HOST, 0))
        taken.listen()
        server = viewer_server.ViewerServer(taken.getsockname()[1], None)
        with pytest.raises(ConfigurationError, match="the viewer's server does not start"):
            server.start()
        assert not server.alive()


def test_only_what_the_server_keeps_makes_it_too_large(monkeypatch: pytest.MonkeyPatch) -> None:
    server = viewer_server.ViewerServer(free_port(), free_port(), memory_mb=2)
    server.start()
    try:
        page = f"http://{viewer_server.HOST}:{server.web_port}/re_viewer_bg.wasm"
        with urllib.request.urlopen(page, timeout=60) as viewer:
            assert len(viewer.read()) > 20e6  # far beyond 3 × 2 MB, and a file's, which costs nothing
        assert not server.too_large()
        kept = viewer_server.own_memory_mb(server.pid)
        monkeypatch.setattr(viewer_server, "own_memory_mb", lambda pid: kept + 10.0)
        assert server.too_large()
    finally:
        server.kill()


def test_a_missing_viewer_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setenv("PATH", "")
    with pytest.raises(ConfigurationError, match="not installed"):
        viewer_server.rerun_binary()


def test_a_streamer_that_does_not_start_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    live = LiveView(LiveSettings(port=free_port(), web=False, window=False, memory_mb=-1))
    with pytest.raises(ConfigurationError, match="the live view does not start"):
        live.start()
    live.close()


def test_windows_need_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    assert viewer_server.open_window("rerun+http://127.0.0.1:1/proxy") is None


# The view


def test_rows_and_notes_reach_the_server(view: LiveView) -> None:
    view.programme(["approach", "benchmark"])
    view.stage("identify")
    for block in range(40):
        view.watch(rows(50 * block, label=block // 20))
    view.programme(["benchmark"])
    view.watch(rows(0))  # the drive's clock starts again
    view.parameters({"stiffness": (39.5, 0.8, "N m/rad"), "offset": (0.05, None, "N m")})
    view.page(Page.of("verdict", "Verdict", [Words("Verdict", "# Kept")]))
    assert eventually(lambda: view.status.get("sent") == 2050)
    assert view.dropped == 0
    assert view.status["healthy"]
    assert view.url.startswith("rerun+http://127.0.0.1:")
    streamer, server = view._process.pid, view.status["server_pid"]
    view.close()
    view.close()
    assert not exists(streamer)
    assert not exists(server)


def test_the_server_listens_on_this_host_only(view: LiveView) -> None:
    port = int(view.url.rpartition(":")[2].partition("/")[0])
    table = Path("/proc/net/tcp").read_text() + Path("/proc/net/tcp6").read_text()
    listening = [line.split()[1] for line in table.splitlines() if line.split()[3] == "0A"]
    assert [a for a in listening if a.endswith(f":{port:04X}")] == [f"0100007F:{port:04X}"]


def test_a_stuck_server_neither_slows_the_run_nor_grows_its_memory(view: LiveView) -> None:
    view.watch(rows(0))
    assert eventually(lambda: view.status.get("sent") == 50)
    stuck = view.status["server_pid"]
    os.kill(stuck, signal.SIGSTOP)
    memory = resident_mb()
    taken = []
    for block in range(1, 1201):  # 60 s of a drive at 1 kHz
        data = rows(50 * block)
        began = time.perf_counter()
        view.watch(data)
        taken.append(time.perf_counter() - began)
    # the median is beyond what a loaded host does to single calls; a blocking call takes 10⁵ µs
    assert np.median(taken) < 50e-6
    assert resident_mb() - memory < 40
    assert eventually(lambda: view.status.get("restarts", 0) >= 1 and view.status["healthy"])
    assert not exists(stuck)
    view.watch(rows(70_000))
    # a row is sent or counted as lost: none disappears silently
    assert eventually(lambda: view.status["sent"] + view.dropped == 60_100)


def test_a_killed_server_is_replaced_on_its_port(view: LiveView) -> None:
    url = view.url
    killed = view.status["server_pid"]
    os.kill(killed, signal.SIGKILL)
    assert eventually(lambda: view.status.get("server_pid") not in (0, killed) and view.status["healthy"])
    view.watch(rows(0))
    assert eventually(lambda: view.status["sent"] == 50)
    assert view.url == url


def test_a_stuck_streamer_is_replaced_and_what_it_lost_is_counted(view: LiveView) -> None:
    first = view._process.pid
    os.kill(first, signal.SIGSTOP)
    for block in range(400):
        view.watch(rows(50 * block))
    assert eventually(lambda: view._process is not None and view._process.pid != first)
    assert eventually(lambda: view.status.get("sent", 0) + view.dropped == 20_000)
    assert 0 < view.dropped < 20_000
    assert not exists(first)


def test_closing_while_all_is_stuck_ends_both_processes(view: LiveView) -> None:
    streamer, server = view._process.pid, view.status["server_pid"]
    os.kill(server, signal.SIGSTOP)
    os.kill(streamer, signal.SIGSTOP)
    view.watch(rows(0))
    view.close(patience_s=0.5)
    assert not exists(streamer)
    assert eventually(lambda: not exists(server))


def test_a_killed_run_leaves_nothing_behind() -> None:
    code = (
        "import sys, json, time\n"
        "from autotune.view.live import LiveView, LiveSettings\n"
        "live = LiveView(LiveSettings(port=int(sys.argv[1]), window=False, web=False)); live.start()\n"
        "print(json.dumps([live._process.pid, live.status['server_pid']]), flush=True)\n"
        "time.sleep(600)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", code, str(free_port())], stdout=subprocess.PIPE, text=True
    ) as run:
        assert run.stdout is not None
        pids = json.loads(run.stdout.readline())
        assert all(exists(pid) for pid in pids)
        run.kill()
    assert eventually(lambda: not any(exists(pid) for pid in pids))


def test_watching_before_the_start_only_fills_the_queue() -> None:
    live = LiveView(LiveSettings(window=False))
    for block in range(2200):
        live.watch(rows(50 * block))
    assert live.dropped == 2200 * 50 - 100_000
    assert live.url == ""
    live.close()


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
