"""What live traces cost: the process that cycles, a viewer that is suspended, attaching, an hour of them.

`python -m bench.live_view cost|suspended|attach|hour`. Rows have 20 columns at 1 kHz in blocks of 50, as a loop
gives them; with and without a view take turns within one run, so that a loaded machine loads both.
"""

from __future__ import annotations

import argparse
import http.client
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import uvicorn
from fastapi import FastAPI

from autotune.core.arrays import Floats
from autotune.service.live_client import pass_on
from autotune.service.live_hub import LiveHubs
from autotune.service.live_routes import live_routes
from autotune.view.live import LiveSettings, LiveView
from autotune.view.messages import ROWS
from autotune.view.snapshot import headless_viewer
from autotune.view.viewer_server import any_port

COLUMNS, PERIOD, BLOCK = 20, 1e-3, 50
LIMITS = {"velocity": (-20.0, 20.0), "torque": (-1.3, 1.3), "temperature": (float("nan"), 80.0)}


def block(number: int, rows: int = BLOCK) -> Floats:
    """Rows of an axis that swings, by their number."""
    time_s = (number * rows + np.arange(rows)) * PERIOD
    found = np.repeat(np.sin(2 * np.pi * time_s)[:, None], COLUMNS, axis=1)
    found[:, 0], found[:, 9:12] = time_s, 0.0
    found[:, 8] = 30.0
    return found


def view(**options: object) -> LiveView:
    """A live view without a window."""
    return LiveView(LiveSettings(name="bench", limits=LIMITS, window=False, **options))  # type: ignore[arg-type]


def resident_mb(pid: int) -> float:
    """Memory of a process; 0 where there is none."""
    try:
        pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    except (OSError, IndexError):
        return 0.0
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def cycles(seconds: float, watch: Callable[[Floats], None]) -> Floats:
    """Runs cycles by the clock; how late each began [s]."""
    late, start = np.empty(round(seconds / PERIOD)), time.monotonic()
    ready = [block(number) for number in range(40)]
    for cycle in range(len(late)):
        due = start + cycle * PERIOD
        while (left := due - time.monotonic()) > 0:
            time.sleep(left)
        late[cycle] = time.monotonic() - due
        if cycle % BLOCK == BLOCK - 1:
            rows = ready[cycle // BLOCK % 40]
            rows[:, 0] = cycle * PERIOD + np.arange(BLOCK) * PERIOD
            watch(rows)
    return late


def cost(turns: int, seconds: float) -> None:
    """Processor time of the process that cycles, with and without a view, in turns."""
    used: dict[str, list[float]] = {"without": [], "with": []}
    with view() as live:
        for turn in range(2 * turns):
            name = ("without", "with")[turn % 2]
            watch = live.watch if name == "with" else _nobody
            began = time.process_time()
            cycles(seconds, watch)
            used[name].append((time.process_time() - began) / seconds)
        say(f"rows dropped {live.dropped}")
    for name, values in used.items():
        say(
            f"{name:8} {100 * np.mean(values):6.2f} % of a core ({' '.join(f'{100 * v:.2f}' for v in values)})"
        )
    say(f"live traces cost {100 * (np.mean(used['with']) - np.mean(used['without'])):.2f} % of a core")


def suspended(turns: int, seconds: float, minutes: float) -> None:
    """A viewer that is suspended: lateness of the cycles beside one without a view, and memory."""
    late: dict[str, list[Floats]] = {"without": [], "with": []}
    with view() as live, headless_viewer() as shown:
        shown.open(live.url)
        cycles(5.0, live.watch)
        pid = shown.process.pid
        shown.process.send_signal(signal.SIGSTOP)
        own, server = resident_mb(os.getpid()), live.status["server_pid"]
        first = resident_mb(server)
        try:
            for turn in range(2 * turns):
                name = ("without", "with")[turn % 2]
                late[name].append(cycles(seconds, live.watch if name == "with" else _nobody))
            say(f"suspended viewer {pid}: own memory +{resident_mb(os.getpid()) - own:.1f} MB")
            for number in range(round(minutes * 60 / (BLOCK * PERIOD))):
                live.watch(block(number))
                if number % 20 == 0:
                    time.sleep(0.05)
            grown, then = resident_mb(os.getpid()) - own, resident_mb(live.status["server_pid"])
            say(f"after {minutes:g} min of data more: own memory +{grown:.1f} MB, dropped {live.dropped}")
            say(f"server {first:.0f} -> {then:.0f} MB, replaced {live.status['restarts']} times")
        finally:
            shown.process.send_signal(signal.SIGCONT)
    for name, parts in late.items():
        whole = 1e3 * np.concatenate(parts)
        p50, p99, p999 = np.quantile(whole, [0.5, 0.99, 0.999])
        say(f"{name:8} late: median {p50:.3f}, 99 % {p99:.3f}, 99.9 % {p999:.3f}, most {whole.max():.2f} ms")


def attach(turns: int) -> None:
    """From asking the service until a viewer has the last minute."""
    hubs = LiveHubs()
    hub = hubs.of("one")
    for number in range(1400):
        rows = block(number)
        hub.take(ROWS, COLUMNS, np.ascontiguousarray(rows, dtype="<f8").tobytes())
    manager = SimpleNamespace(configuration=SimpleNamespace(axis=lambda name: name == "one"), live=hubs)
    app = FastAPI()
    app.include_router(live_routes(manager))  # type: ignore[arg-type]
    port = any_port()
    server = uvicorn.Server(uvicorn.Config(app, port=port, log_level="error"))
    threading.Thread(target=server.run, daemon=True).start()
    while not server.started:
        time.sleep(0.05)
    for _ in range(turns):
        with view() as live, headless_viewer() as shown:
            shown.open(live.url)
            time.sleep(1.0)
            began = time.monotonic()
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10.0)
            connection.request("GET", "/api/axes/one/live")
            source = connection.getresponse()
            threading.Thread(target=_quietly, args=(source, live), daemon=True).start()
            while shown.seconds() < 59.0 and time.monotonic() - began < 30.0:
                time.sleep(0.01)
            say(f"the viewer has {shown.seconds():.1f} s after {time.monotonic() - began:.2f} s")
            if connection.sock is not None:
                connection.sock.shutdown(socket.SHUT_RDWR)
    server.should_exit = True


def hour(minutes: int) -> None:
    """An hour of rows as fast as they are taken: memory of all three processes."""
    with view() as live:
        blocks_a_minute = round(60 / (BLOCK * PERIOD))
        for minute in range(minutes):
            for number in range(blocks_a_minute):
                live.watch(block(minute * blocks_a_minute + number))
                while live._queue.waiting > 50_000:
                    time.sleep(0.01)
            if minute % 10 == 9:
                server, streamer = live.status.get("server_pid", 0), live._process
                memory = [resident_mb(pid) for pid in (os.getpid(), streamer.pid if streamer else 0, server)]
                told = ", ".join(
                    f"{name} {mb:.0f} MB"
                    for name, mb in zip(("cycling", "streamer", "server"), memory, strict=True)
                )
                say(f"{minute + 1:3} min: {told}, dropped {live.dropped}")


def _nobody(rows: Floats) -> None:
    np.array(rows, dtype=np.float64)


def _quietly(source: http.client.HTTPResponse, live: LiveView) -> None:
    try:
        pass_on(source, live)
    except (OSError, ValueError, http.client.HTTPException):
        return


def say(text: str) -> None:
    """A line, at once."""
    print(text)
    sys.stdout.flush()


def main() -> None:
    """Runs what is named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("cost", "suspended", "attach", "hour"))
    parser.add_argument("--turns", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=15.0)
    parser.add_argument("--minutes", type=float, default=5.0)
    options = parser.parse_args()
    if options.what == "cost":
        cost(options.turns, options.seconds)
    elif options.what == "suspended":
        suspended(options.turns, options.seconds, options.minutes)
    elif options.what == "attach":
        attach(options.turns)
    else:
        hour(60)


if __name__ == "__main__":
    main()
