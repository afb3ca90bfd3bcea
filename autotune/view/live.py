"""The live view of `autotune run --view`: the run appends to a bounded queue and never waits.

Three processes, so that nothing a viewer does can reach the run: this one (the queue and a thread
that feeds a pipe), the streamer (rerun's SDK), and the Rerun server, bound to this host. Each end
bounds its memory and drops the oldest; whoever no longer takes data is replaced.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

import autotune
from autotune.core.errors import ConfigurationError
from autotune.view import viewer_server
from autotune.view.messages import write_all
from autotune.view.teller import ROWS_A_MESSAGE, Teller

MOST_STARTS = 5
START_SECONDS = 30.0


@dataclass(frozen=True, slots=True)
class LiveSettings:
    """What the view needs to know of the axis.

    Attributes:
        name: of the axis.
        limits: low and high by quantity, see `rerun_plots.LimitsShown`.
        port: of the server; None takes the usual one, or any that is free.
        web: serve the viewer for a browser too.
        window: open the native viewer; None opens it where there is a screen.
        memory_mb: limit of the server, which takes about twice as much, and is replaced beyond three times.
        flush_s: time that the server has to take a second's data; three times too slow, it is replaced.
        patience_s: time that the streamer has to read; then it is replaced.
    """

    motion_unit: str = "rad"
    period: float = 1e-3
    name: str = ""
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    port: int | None = None
    web: bool = True
    window: bool | None = None
    memory_mb: int = viewer_server.MEMORY_MB
    flush_s: float = 2.0
    patience_s: float = 10.0


class LiveView(Teller):
    """A live view of the run. All methods but `start` and `close` return at once."""

    def __init__(self, settings: LiveSettings) -> None:
        super().__init__()
        self._settings = settings
        self._closing = threading.Event()
        self._changing = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._thread: threading.Thread | None = None
        self._listener: threading.Thread | None = None
        self._status: dict[str, Any] = {}
        self._ready = threading.Event()
        self._starts = 0
        self._lost_before = 0
        self._arguments: dict[str, Any] = {}
        self._window: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> LiveView:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def url(self) -> str:
        """Where a Rerun viewer connects; empty before `start`."""
        return str(self._status.get("url") or "")

    @property
    def address(self) -> str:
        """Address of the view in a browser; empty without one."""
        return str(self._status.get("page") or "")

    @property
    def dropped(self) -> int:
        """Rows that the view never showed, as something was too slow."""
        return self._queue.dropped + self._lost_before + int(self._status.get("lost", 0))

    @property
    def status(self) -> Mapping[str, Any]:
        """The streamer's last word: rows sent and lost, restarts of the server, its process id."""
        return dict(self._status)

    def start(self, timeout_s: float = START_SECONDS) -> None:
        """Starts streamer and server, and opens the viewer where there is a screen.

        Raises:
            ConfigurationError: the port is taken, Rerun is not installed, or it does not start.
        """
        settings = self._settings
        port = viewer_server.choose_port(settings.port, viewer_server.PORT)
        web = viewer_server.choose_port(None, viewer_server.WEB_PORT) if settings.web else None
        viewer_server.check_viewer()
        kept = ("motion_unit", "period", "name", "limits", "memory_mb", "flush_s")
        values = asdict(settings)
        self._arguments = {"port": port, "web_port": web} | {name: values[name] for name in kept}
        if not self._started(timeout_s) and not (self._another_port() and self._started(timeout_s)):
            reason = self._status.get("error", f"nothing was heard of it for {timeout_s:.0f} s")
            self.close()
            raise ConfigurationError(f"the live view does not start: {reason}; run without --view")
        self._thread = threading.Thread(target=self._feed, name="live-view", daemon=True)
        self._thread.start()
        if settings.window is not False:
            self._window = viewer_server.open_window(self.url)

    def close(self, patience_s: float = 5.0) -> None:
        """Lets waiting data through for a moment, then ends streamer and server. Idempotent.

        A viewer that is open keeps what it has received.
        """
        with self._changing:
            self._closing.set()
        if self._thread is not None:
            self._thread.join(patience_s)
            self._thread = None
        self._end_process(patience_s)

    def _started(self, timeout_s: float) -> bool:
        """Starts the streamer; whether it says that its server is there."""
        self._launch()
        return self._ready.wait(timeout_s) and bool(self.url)

    def _another_port(self) -> bool:
        """Takes other ports where somebody has taken the usual ones meanwhile; False where one was asked for."""
        if self._settings.port is not None or "error" not in self._status:
            return False
        self._end_process(0.0)
        self._status = {}
        self._arguments |= {"port": viewer_server.any_port()}
        if self._settings.web:
            self._arguments |= {"web_port": viewer_server.any_port()}
        return True

    def _launch(self) -> None:
        self._starts += 1
        self._ready.clear()
        root = str(Path(autotune.__file__).resolve().parents[1])
        environment = dict(viewer_server.quiet_environment())
        environment["PYTHONPATH"] = os.pathsep.join(filter(None, (root, environment.get("PYTHONPATH"))))
        process = subprocess.Popen(
            [sys.executable, "-m", "autotune.view.streamer", json.dumps(self._arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env=environment,
            start_new_session=True,
            bufsize=0,
        )
        if process.stdin is not None:
            os.set_blocking(process.stdin.fileno(), False)
        self._process = process
        self._listener = threading.Thread(
            target=self._listen, args=(process,), name="live-status", daemon=True
        )
        self._listener.start()

    def _listen(self, process: subprocess.Popen[bytes]) -> None:
        if process.stdout is None:
            return
        with process.stdout as lines:
            for line in lines:
                with contextlib.suppress(ValueError):
                    self._status = json.loads(line)
                    self._ready.set()
        self._ready.set()

    def _feed(self) -> None:
        """The feeding thread: ends when the view is closed and the queue empty, or when given up."""
        while not (self._closing.is_set() and not self.waiting()):
            if not self._pass_on() and not self._replace():
                return
            time.sleep(0.002 if self._closing.is_set() or self._queue.waiting > ROWS_A_MESSAGE else 0.02)

    def _pass_on(self) -> bool:
        """Passes on what waits; False when the streamer is gone or does not read."""
        process = self._process
        if process is None or process.stdin is None:
            return False
        data = self.take()
        try:
            return not data or write_all(process.stdin.fileno(), data, self._settings.patience_s)
        except (OSError, ValueError):
            return False

    def _replace(self) -> bool:
        """Another streamer for one that is gone; False when that happened too often, or at the end."""
        if self._closing.is_set() or self._starts >= MOST_STARTS:
            return False
        self._end_process(0.0)
        self._lost_before += self._passed - int(self._status.get("sent", 0))
        self._passed, self._status = 0, {**self._status, "sent": 0, "lost": 0}
        with self._changing:
            if self._closing.is_set():
                return False
            self._launch()
        self._notes.extendleft(reversed(self.remembered()))
        self._ready.wait(START_SECONDS)
        return True

    def _end_process(self, patience_s: float) -> None:
        process, self._process = self._process, None
        if process is None:
            return
        if process.stdin is not None:
            with contextlib.suppress(OSError):
                process.stdin.close()
        end = time.monotonic() + patience_s
        while not _has_ended(process.pid) and time.monotonic() < end:
            time.sleep(0.02)
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)  # with the server, should one be left
        process.wait()
        if self._listener is not None:
            self._listener.join(1.0)
        self._ready.set()


def _has_ended(pid: int) -> bool:
    """Whether our child has ended, without reaping it: so its number, and its group's, stay its own."""
    return os.waitid(os.P_PID, pid, os.WEXITED | os.WNOWAIT | os.WNOHANG) is not None
