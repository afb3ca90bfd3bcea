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
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.core.errors import AutotuneError
from autotune.core.loop import ROW_FIELDS
from autotune.view.data import torque_unit
from autotune.view.messages import Inbox
from autotune.view.plane import Plane, symmetric
from autotune.view.scale import continuous
from autotune.view.viewer_server import ViewerServer

ROWS_KEPT = 100_000
ROWS_A_TURN = 5_000
FAILURES_BEFORE_RESTART = 3
END_SECONDS = 6.0


@dataclass(frozen=True, slots=True)
class Settings:
    """What the run tells the streamer at its start."""

    port: int
    web_port: int | None = None
    memory_mb: int = 64
    motion_unit: str = "rad"
    period: float = 1e-3
    speed_range: float = 1.0
    torque_range: float = 1.0
    flush_s: float = 2.0


class Streamer:
    """Sends what arrives; survives any loss of the server."""

    def __init__(self, settings: Settings, inbox: Inbox) -> None:
        self.server = ViewerServer(settings.port, settings.web_port, settings.memory_mb)
        self._settings = settings
        self._inbox = inbox
        self._stream: Any = None
        self._failures = 0
        self._sent = self._confirmed = self._lost = self._restarts = 0
        self._shown: tuple[Any, ...] = ()
        self._clock: Floats | None = None
        self._label = -1.0
        self._labels: dict[int, str] = {}
        self._stages: list[str] = []
        self._verdict = ""
        self._units: dict[str, str] = {}

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

    def turn(self) -> None:
        """Sends what has come; while the server is unwell nothing is sent and the queue drops."""
        while self._inbox.notes:
            self._note(self._inbox.notes.popleft())
        if not self.healthy:
            return
        blocks = self._inbox.rows.take(ROWS_A_TURN)
        if blocks:
            self._rows(np.concatenate(blocks))

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
        """Connects a new stream and tells it all that does not change."""
        import rerun as rr

        from autotune.view import rerun_plots as plots

        self._stream = rr.RecordingStream(plots.APPLICATION, recording_id=f"live-{os.getpid()}")
        self._stream.connect_grpc(self.server.url, default_blueprint=self._blueprint())
        plots.send_names(self._stream, self._shown)
        plots.send_plane(self._stream, self._plane(), None)
        self._send_lanes()
        if self._verdict:
            plots.send_text(self._stream, "verdict", self._verdict)
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

    def _blueprint(self) -> Any:
        from autotune.view import rerun_plots as plots

        shown = self._shown or plots.plots(self._settings.motion_unit)
        return plots.blueprint(shown, self._plane(), live=True, parameters=self._units)

    def _plane(self) -> Plane:
        unit = self._settings.motion_unit
        return Plane(
            "Torque over velocity, last 5 s",
            f"velocity [{unit}/s]",
            f"torque [{torque_unit(unit)}]",
            symmetric(self._settings.speed_range),
            symmetric(self._settings.torque_range),
        )

    def _rows(self, rows: Floats) -> None:
        from autotune.view import rerun_plots as plots

        columns = {name: rows[:, index] for index, name in enumerate(ROW_FIELDS)}
        if not self._shown:
            candidates = plots.plots(self._settings.motion_unit)
            self._shown = tuple(p for plot in candidates if (p := plots.available(plot, columns)))
            plots.send_names(self._stream, self._shown)
            self._stream.send_blueprint(self._blueprint())
        time_ns = plots.nanoseconds(self._continuous(columns["time"]))
        plots.send_rows(self._stream, self._shown, time_ns, columns)
        plots.send_plane_rows(self._stream, self._plane(), time_ns, columns["velocity"], columns["torque"])
        self._send_labels(time_ns, columns["label"])
        self._sent += len(rows)

    def _continuous(self, time: Floats) -> Floats:
        """Time that goes on where the drive's clock starts again; `_clock`: last raw and shown time."""
        if self._clock is None:
            self._clock = np.full(2, time[0] - self._settings.period)
        raw, shown = self._clock
        running = continuous(np.concatenate([[raw], time]), self._settings.period)[1:] + (shown - raw)
        self._clock = np.array([time[-1], running[-1]])
        return np.asarray(running, dtype=np.float64)

    def _send_labels(self, time_ns: NDArray[np.int64], label: Floats) -> None:
        from autotune.view import rerun_plots as plots

        for row in np.flatnonzero(np.diff(label, prepend=self._label)):
            name = self._labels.get(int(label[row]), "")
            plots.send_stage(self._stream, "stage/experiment", int(time_ns[row]), name)
        self._label = float(label[-1])

    def _note(self, note: Mapping[str, Any]) -> None:
        """Remembers what a new server must be told again, and tells the present one."""
        kind = note.get("kind")
        if kind == "labels":
            self._labels |= {note["base"] + index: name for index, name in enumerate(note["names"])}
        elif kind == "stage":
            self._stages = list(dict.fromkeys([*self._stages, note["name"]]))
        elif kind == "verdict":
            self._verdict = note["text"]
        elif kind == "parameters":
            units = {name: entry[2] for name, entry in note["values"].items()}
            new, self._units = units.keys() - self._units.keys(), self._units | units
            if new and self.healthy:
                self._stream.send_blueprint(self._blueprint())
        if self.healthy:
            self._send_note(note)

    def _send_note(self, note: Mapping[str, Any]) -> None:
        from autotune.view import rerun_plots as plots

        now = 0 if self._clock is None else int(max(0.0, self._clock[1]) * 1e9)
        if note["kind"] in ("labels", "stage"):
            self._send_lanes()
        if note["kind"] == "stage":
            plots.send_stage(self._stream, "stage/run", now, note["name"])
        elif note["kind"] == "verdict":
            plots.send_text(self._stream, "verdict", note["text"])
        elif note["kind"] == "parameters":
            moment = np.array([now], dtype=np.int64)
            for name, (value, error, unit) in note["values"].items():
                spread = np.array([np.nan if error is None else error])
                plots.send_parameter(self._stream, name, unit, moment, np.array([value]), spread)

    def _send_lanes(self) -> None:
        from autotune.view import rerun_plots as plots

        for lane, names in (("run", self._stages), ("experiment", self._labels.values())):
            if names:
                plots.send_lane(self._stream, f"stage/{lane}", list(dict.fromkeys(names)))


def main() -> int:
    """Entry of the process; the settings are the first argument, as JSON."""
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
        streamer.turn()
        if time.monotonic() >= next_flush:
            try:
                streamer.flush()
            except AutotuneError as error:
                _say({**streamer.status(), "error": str(error)})
                time.sleep(1.0)
            _say(streamer.status())
            next_flush = time.monotonic() + 1.0
        time.sleep(0.05)
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
