"""The streamer: a process between the run and the viewer (`python -m autotune.view.streamer`).

It reads rows and notes from its standard input, sends them to the Rerun server that it owns, flushes
once a second, and replaces a server that no longer takes data. Here may hang what wants to hang: the
run only writes to a pipe, and kills this process if it stops reading. Status goes to standard output,
a line of JSON a second. It ends, with its server, when its input ends.
"""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from autotune.core.errors import AutotuneError
from autotune.view.messages import Inbox
from autotune.view.viewer_server import MEMORY_MB, ViewerServer, quiet

ROWS_KEPT = 100_000
ROWS_A_TURN = 10_000
FAILURES_BEFORE_RESTART = 3
END_SECONDS = 6.0


@dataclass(frozen=True, slots=True)
class Settings:
    """What the run tells the streamer at its start."""

    port: int
    web_port: int | None = None
    memory_mb: int = MEMORY_MB
    motion_unit: str = "rad"
    period: float = 1e-3
    name: str = ""
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    flush_s: float = 2.0


class Streamer:
    """Sends what arrives; survives any loss of the server."""

    def __init__(self, settings: Settings, inbox: Inbox) -> None:
        from autotune.view.scene import Scene

        self.server = ViewerServer(settings.port, settings.web_port, settings.memory_mb)
        self._settings = settings
        self._inbox = inbox
        self._scene = Scene(settings.name, settings.motion_unit, settings.period, settings.limits)
        self._stream: Any = None
        self._failures = 0
        self._sent = self._confirmed = self._lost = self._restarts = 0

    @property
    def healthy(self) -> bool:
        return self._stream is not None and self._failures == 0

    def status(self) -> dict[str, Any]:
        return {
            "url": self.server.url,
            "page": self.server.page,
            "server_pid": self.server.pid,
            "sent": self._sent,
            "lost": self._lost + self._inbox.rows.dropped,
            "restarts": self._restarts,
            "healthy": self.healthy,
        }

    def turn(self) -> bool:
        """Sends what has come; while the server is unwell nothing is sent and the queue drops.

        Returns:
            more is waiting.
        """
        while self._inbox.notes:
            self._scene.note(self._stream if self.healthy else None, self._inbox.notes.popleft())
        if not self.healthy:
            return False
        blocks = self._inbox.rows.take(ROWS_A_TURN)
        if blocks:
            rows = np.concatenate(blocks)
        if blocks and len(rows):
            self._scene.rows(self._stream, rows)
            self._sent += len(rows)
        return bool(self._inbox.rows.waiting > ROWS_A_TURN)

    def flush(self) -> None:
        """Makes sure that data arrive; replaces the server when they do not."""
        if self._stream is not None and self.server.alive() and not self.server.too_large():
            try:
                self._stream.flush(timeout_sec=self._settings.flush_s)
            except RuntimeError as error:
                self._failures += 1
                if "timed out" in str(error) and self._failures < FAILURES_BEFORE_RESTART:
                    return
            else:
                self._failures = 0
                self._confirmed = self._sent
                return
        self._replace()

    def connect(self) -> None:
        """Connects a new stream and tells it all that is known, the last minute among it."""
        import rerun as rr

        from autotune.view import rerun_plots as plots

        name = (
            f"{plots.APPLICATION} live {os.getpid()}"  # a layout of its own in a viewer that shows others too
        )
        self._stream = rr.RecordingStream(name, recording_id=f"live-{os.getpid()}")
        self._stream.connect_grpc(self.server.url, default_blueprint=self._scene.blueprint())
        self._scene.send_all(self._stream)
        self._failures = 0

    def _replace(self) -> None:
        self._restarts += 1
        self._failures = max(1, self._failures)
        self._lost += self._sent - self._confirmed
        self._sent = self._confirmed
        broken, self._stream = self._stream, None
        self.server.kill()
        if broken is not None:
            ending = threading.Thread(target=broken.disconnect, daemon=True)
            ending.start()
            ending.join(self._settings.flush_s)
        self.server.restart()
        self.connect()


def main() -> int:
    """Entry of the process; the settings are the first argument, as JSON."""
    quiet()
    settings = Settings(**json.loads(sys.argv[1]))
    inbox = Inbox(sys.stdin.buffer, ROWS_KEPT)
    streamer = Streamer(settings, inbox)
    inbox.start()
    try:
        streamer.server.start()
        streamer.connect()
    except (AutotuneError, OSError) as error:
        _say({"error": str(error)})
        streamer.server.kill()
        return 5
    threading.Thread(target=_end_anyway, args=(inbox, streamer), daemon=True).start()
    _say(streamer.status())
    _serve(streamer, inbox)
    _say(streamer.status())
    streamer.server.kill()
    os._exit(0)  # rerun's own exit waits for a server that may hang


def _serve(streamer: Streamer, inbox: Inbox) -> None:
    next_flush = time.monotonic() + 1.0
    while not (inbox.ended.is_set() and not inbox.rows.waiting and not inbox.notes):
        more = streamer.turn()
        if time.monotonic() >= next_flush:
            try:
                streamer.flush()
            except AutotuneError as error:
                _say({**streamer.status(), "error": str(error)})
                time.sleep(1.0)
            _say(streamer.status())
            next_flush = time.monotonic() + 1.0
        time.sleep(0.0 if more else 0.05)
    if streamer.healthy:
        streamer.flush()


def _end_anyway(inbox: Inbox, streamer: Streamer) -> None:
    inbox.ended.wait()
    time.sleep(END_SECONDS)
    streamer.server.kill()
    os._exit(1)


def _say(status: Mapping[str, Any]) -> None:
    try:
        sys.stdout.write(json.dumps(status) + "\n")
        sys.stdout.flush()
    except OSError:
        return


if __name__ == "__main__":
    sys.exit(main())
