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
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

import autotune
from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError
from autotune.core.loop import ROW_FIELDS
from autotune.view import viewer_server
from autotune.view.messages import NOTES_KEPT, RowQueue, encode_note, encode_rows, write_all

ROWS_KEPT = 100_000
ROWS_A_MESSAGE = 2_000
MOST_STARTS = 5
START_SECONDS = 30.0
_LABEL = ROW_FIELDS.index("label")


@dataclass(frozen=True, slots=True)
class LiveSettings:
    """What the view needs to know of the axis.

    Attributes:
        speed_range, torque_range: largest values shown in the plane [SI].
        port: of the server; None takes the usual one, or any that is free.
        web: serve the viewer for a browser too.
        window: open the native viewer; None opens it where there is a screen.
        memory_mb: limit of the server; it may take two or three times as much.
        flush_s: time that the server has to take a second's data; three times too slow, it is replaced.
        patience_s: time that the streamer has to read; then it is replaced.
    """

    motion_unit: str = "rad"
    period: float = 1e-3
    speed_range: float = 10.0
    torque_range: float = 1.0
    port: int | None = None
    web: bool = True
    window: bool | None = None
    memory_mb: int = viewer_server.MEMORY_MB
    flush_s: float = 2.0
    patience_s: float = 10.0


class LiveView:
    """A live view of the run.

    `watch` fits `autotune.core.loop.Watch`. All methods but `start` and `close` return at once.
    """

    def __init__(self, settings: LiveSettings) -> None:
        self._settings = settings
        self._queue = RowQueue(ROWS_KEPT)
        self._notes: deque[dict[str, Any]] = deque(maxlen=NOTES_KEPT)
        self._closing = threading.Event()
        self._changing = threading.Lock()
        self._process: subprocess.Popen[bytes] | None = None
        self._thread: threading.Thread | None = None
        self._listener: threading.Thread | None = None
        self._status: dict[str, Any] = {}
        self._ready = threading.Event()
        self._starts = 0
        self._passed = 0
        self._lost_before = 0
        self._arguments: dict[str, Any] = {}
        self._memory: dict[str, dict[str, Any]] = {}
        self._names: list[str] = []
        self._base = 0
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
    def page(self) -> str:
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
        viewer_server.rerun_binary()
        kept = ("motion_unit", "period", "speed_range", "torque_range", "memory_mb", "flush_s")
        values = asdict(settings)
        self._arguments = {"port": port, "web_port": web} | {name: values[name] for name in kept}
        self._launch()
        if not self._ready.wait(timeout_s) or not self.url:
            reason = self._status.get("error", f"nothing was heard of it for {timeout_s:.0f} s")
            self.close()
            raise ConfigurationError(f"the live view does not start: {reason}; run without --view")
        self._thread = threading.Thread(target=self._feed, name="live-view", daemon=True)
        self._thread.start()
        if settings.window is not False:
            self._window = viewer_server.open_window(self.url)

    def watch(self, rows: Floats) -> None:
        """Takes rows of shape (k, len(ROW_FIELDS)); never waits, drops the oldest if it must."""
        own = np.array(rows, dtype=np.float64)
        own[:, _LABEL] += self._base
        self._queue.put(own)

    def labels(self, names: Sequence[str]) -> None:
        """Names for the `label` column of the rows that follow (`Routine.labels`)."""
        self._base = len(self._names)
        self._names += [str(name) for name in names]
        self._note({"kind": "labels", "base": 0, "names": list(self._names)})

    def stage(self, name: str) -> None:
        """The run enters a stage."""
        self._note({"kind": "stage", "name": name})

    def parameters(self, values: Mapping[str, tuple[float, float | None, str]]) -> None:
        """Present estimates: name → value, standard error, unit."""
        entries = {name: [float(v), None if e is None else float(e), u] for name, (v, e, u) in values.items()}
        self._note({"kind": "parameters", "values": entries})

    def verdict(self, markdown: str) -> None:
        """What the run concludes, in Markdown."""
        self._note({"kind": "verdict", "text": markdown})

    def _note(self, note: dict[str, Any]) -> None:
        self._memory[note["kind"]] = note
        self._notes.append(note)

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
        while not (self._closing.is_set() and not self._queue.waiting and not self._notes):
            if not self._pass_on() and not self._replace():
                return
            time.sleep(0.002 if self._closing.is_set() else 0.02)

    def _pass_on(self) -> bool:
        """Passes on what waits; False when the streamer is gone or does not read."""
        process = self._process
        if process is None or process.stdin is None:
            return False
        data = b"".join(encode_note(self._notes.popleft()) for _ in range(len(self._notes)))
        blocks = self._queue.take(ROWS_A_MESSAGE)
        if blocks:
            rows = np.concatenate(blocks)
            self._passed += len(rows)
            data += encode_rows(rows)
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
        self._notes.extendleft(list(self._memory.values()))
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
