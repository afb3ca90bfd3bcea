"""What a live view shows at the moment, and how it is sent: again and whole, whenever the server is a new one.

Importing this imports rerun; only the streamer does.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.core.loop import ROW_FIELDS
from autotune.view import rerun_plots as plots
from autotune.view.data import torque_unit
from autotune.view.page_plots import page_view, send_page
from autotune.view.pages import Page, page_from_json
from autotune.view.plane import Plane, symmetric
from autotune.view.scale import continuous, peak

KEPT_SECONDS = 60.0
ROWS_KEPT = 65_000
VALUES_KEPT = 5_000
WAITING = "Waiting for the axis to move."


class Scene:
    """The state of a live view. `stream` in every method is where it is shown; None where nothing can be sent."""

    def __init__(
        self, name: str, motion_unit: str, period: float, limits: Mapping[str, tuple[float, float]]
    ) -> None:
        self._name, self._unit, self._period = name, motion_unit, period
        self._limits = limits
        self._bare: list[plots.Plot] = []
        self._shown: list[plots.Plot] = []
        self._reach: dict[str, float] = {}
        self._plane: Plane | None = None
        self._planes = 0
        self._pages: dict[str, Page] = {}
        self._active = ""
        self._kept: deque[tuple[NDArray[np.int64], dict[str, Floats]]] = deque()
        self._rows_kept = 0
        self._clock: Floats | None = None
        self._label = -1.0
        self._labels: dict[int, str] = {}
        self._stages: list[tuple[int, str]] = []
        self._units: dict[str, str] = {}
        self._values: deque[tuple[int, dict[str, tuple[float, float]]]] = deque(maxlen=VALUES_KEPT)
        self._verdict = ""

    def send_all(self, stream: rr.RecordingStream) -> None:
        """Everything that is known, the rows of the last minute among it."""
        plots.send_text(stream, "waiting", f"# {self._name}\n\n{WAITING}")
        plots.send_names(stream, self._shown)
        if self._plane is not None:
            plots.send_plane(stream, self._plane, None, self._plane_entity)
        self._send_lanes(stream)
        for at, name in self._stages:
            plots.send_stage(stream, "stage/run", at, name)
        if self._verdict:
            plots.send_text(stream, "verdict", self._verdict)
        self._send_values(stream, list(self._values))
        for page in self._pages.values():
            send_page(stream, page)
        self._label = -1.0
        for time_ns, columns in self._kept:
            self._send_rows(stream, time_ns, columns)

    def blueprint(self) -> Any:
        """How it is arranged at the moment."""
        return plots.blueprint(
            plots.Layout(
                self._shown,
                self._plane,
                live=True,
                parameters=self._units,
                words=bool(self._verdict),
                pages=[page_view(page) for page in self._pages.values()],
                active=self._active,
                plane_entity=self._plane_entity,
            )
        )

    def rows(self, stream: rr.RecordingStream, rows: Floats) -> None:
        """Takes and sends rows, shape (k, fields)."""
        columns = {name: rows[:, index] for index, name in enumerate(ROW_FIELDS)}
        time_ns = plots.nanoseconds(self._continuous(columns["time"]))
        more, larger = self._more_plots(columns), self._larger_plane(columns)
        if more:
            plots.send_names(stream, self._shown)
        if larger and self._plane is not None:
            plots.send_plane(stream, self._plane, None, self._plane_entity)
        if more or larger:
            stream.send_blueprint(self.blueprint())
        self._send_rows(stream, time_ns, columns)
        self._keep(time_ns, columns)

    def note(self, stream: rr.RecordingStream | None, note: Mapping[str, Any]) -> None:
        """Remembers a note, and shows it; a page and a stage come to the front."""
        kind, new = note.get("kind"), False
        if kind == "labels":
            self._labels |= {note["base"] + index: name for index, name in enumerate(note["names"])}
        elif kind == "stage":
            self._stages.append((self._now, str(note["name"])))
        elif kind == "verdict":
            self._verdict = str(note["text"])
        elif kind == "page":
            self._take_page(page_from_json(note["page"]))
        elif kind == "parameters":
            units = self._units | {name: entry[2] for name, entry in note["values"].items()}
            new, self._units = units != self._units, units
            spread = {
                name: (float(value), float("nan") if error is None else float(error))
                for name, (value, error, _) in note["values"].items()
            }
            self._values.append((self._now, spread))
        if stream is not None:
            self._send_note(stream, str(kind), note)
        if stream is not None and (kind in ("stage", "page", "verdict") or new):
            stream.send_blueprint(self.blueprint())

    def _take_page(self, page: Page) -> None:
        self._pages[page.name] = page
        self._active = page.title
        if page.name == "adaptation":
            self._units = {}  # the page has them whole

    def _send_note(self, stream: rr.RecordingStream, kind: str, note: Mapping[str, Any]) -> None:
        if kind in ("labels", "stage"):
            self._send_lanes(stream)
        if kind == "stage":
            plots.send_stage(stream, "stage/run", self._now, self._stages[-1][1])
            self._active = ""
        elif kind == "verdict":
            plots.send_text(stream, "verdict", self._verdict)
        elif kind == "page":
            send_page(stream, self._pages[str(note["page"]["name"])])
        elif kind == "parameters":
            self._send_values(stream, [self._values[-1]])

    def _send_values(
        self, stream: rr.RecordingStream, told: Sequence[tuple[int, dict[str, tuple[float, float]]]]
    ) -> None:
        """Parameters as they were told, each with its spread."""
        for name, unit in self._units.items():
            known = [(at, *values[name]) for at, values in told if name in values]
            if known:
                at, value, spread = (np.array(column) for column in zip(*known, strict=True))
                plots.send_parameter(stream, name, unit, at.astype(np.int64), value, spread)

    @property
    def _now(self) -> int:
        return 0 if self._clock is None else int(max(0.0, self._clock[1]) * 1e9)

    @property
    def _plane_entity(self) -> str:
        """Each range has an entity of its own: points of another range would be in wrong places."""
        return f"plane/{self._planes}"

    def _send_rows(
        self, stream: rr.RecordingStream, time_ns: NDArray[np.int64], columns: Mapping[str, Floats]
    ) -> None:
        plots.send_rows(stream, self._shown, time_ns, columns)
        if self._plane is not None:
            velocity, torque = columns["velocity"], columns["torque"]
            plots.send_plane_rows(stream, self._plane, time_ns, velocity, torque, self._plane_entity)
        self._send_labels(stream, time_ns, columns["label"])

    def _keep(self, time_ns: NDArray[np.int64], columns: dict[str, Floats]) -> None:
        self._kept.append((time_ns, {name: values.copy() for name, values in columns.items()}))
        self._rows_kept += len(time_ns)
        oldest = time_ns[-1] - int(KEPT_SECONDS * 1e9)
        while self._kept and (self._kept[0][0][-1] < oldest or self._rows_kept > ROWS_KEPT):
            self._rows_kept -= len(self._kept.popleft()[0])

    def _more_plots(self, columns: Mapping[str, Floats]) -> bool:
        """A plot, or a line of one, has its first data; or a limit is near for the first time."""
        bare = {plot.entity: plot for plot in self._bare}
        self._bare = []
        for plot in plots.plots(self._unit):
            found, had = plots.available(plot, columns), bare.get(plot.entity)
            if found is not None:
                self._reach[plot.entity] = max(
                    self._reach.get(plot.entity, 0.0), plots.reach_of(found, columns)
                )
            best = max(
                (one for one in (had, found) if one is not None), key=lambda one: len(one.lines), default=None
            )
            if best is not None:
                self._bare.append(best)
        shown = [plots.with_limits(plot, self._limits, self._reach[plot.entity]) for plot in self._bare]
        changed = shown != self._shown
        self._shown = shown
        return changed

    def _larger_plane(self, columns: Mapping[str, Floats]) -> bool:
        """The plane grows with what the axis does; it is of no use where nothing moves yet."""
        speed, torque = peak(columns["velocity"]), peak(columns["torque"])
        reach = self._plane
        if not speed or not torque:
            return False
        if reach is not None and speed <= reach.x_range[1] and torque <= reach.y_range[1]:
            return False
        if reach is not None:
            speed, torque = max(1.3 * speed, reach.x_range[1]), max(1.3 * torque, reach.y_range[1])
        self._planes += 1
        self._plane = Plane(
            "Torque over velocity, last 5 s",
            f"velocity [{self._unit}/s]",
            f"torque [{torque_unit(self._unit)}]",
            symmetric(1.3 * speed if reach is None else speed),
            symmetric(1.3 * torque if reach is None else torque),
        )
        return True

    def _continuous(self, time: Floats) -> Floats:
        """Time that goes on where the drive's clock starts again; `_clock`: last raw and shown time."""
        if self._clock is None:
            self._clock = np.full(2, time[0] - self._period)
        raw, shown = self._clock
        running = continuous(np.concatenate([[raw], time]), self._period)[1:] + (shown - raw)
        self._clock = np.array([time[-1], running[-1]])
        return np.asarray(running, dtype=np.float64)

    def _send_labels(self, stream: rr.RecordingStream, time_ns: NDArray[np.int64], label: Floats) -> None:
        for row in np.flatnonzero(np.diff(label, prepend=self._label)):
            name = self._labels.get(int(label[row]), "")
            plots.send_stage(stream, "stage/experiment", int(time_ns[row]), name)
        self._label = float(label[-1])

    def _send_lanes(self, stream: rr.RecordingStream) -> None:
        lanes = (("run", [name for _, name in self._stages]), ("experiment", list(self._labels.values())))
        for lane, names in lanes:
            if names:
                plots.send_lane(stream, f"stage/{lane}", list(dict.fromkeys(names)))
