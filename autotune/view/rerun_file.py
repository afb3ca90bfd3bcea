"""A run as a Rerun recording (`run.rrd`): traces, stages, parameters, verdict, with its blueprint.

Written by a stream of its own, which no viewer shares: a viewer that hangs cannot stop a file.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.core.errors import RecordingError
from autotune.recordings.recording import Recording
from autotune.view.data import torque_unit
from autotune.view.pages import Page
from autotune.view.plane import Plane, symmetric
from autotune.view.scale import continuous, peak, quantity
from autotune.view.viewer_server import quiet

FLUSH_SECONDS = 60.0


@dataclass(frozen=True, slots=True)
class FinalValue:
    """A parameter at the end of the run; SI."""

    name: str
    value: float
    standard_error: float | None
    unit: str


@dataclass(frozen=True, slots=True)
class Shown:
    """What goes into the file beside the recording.

    Attributes:
        torque_model: the model's torque for every row of the recording, shape (n,).
        characteristic: velocity and torque of the steady-state model, drawn in the plane.
        parameters: as they ended.
        verdict: Markdown.
        limits: low and high by quantity, see `rerun_plots.LimitsShown`.
        pages: further tabs; `in_front`: title of the one that is seen first, "" for the traces.
    """

    torque_model: Floats | None = None
    characteristic: tuple[Floats, Floats] | None = None
    parameters: Sequence[FinalValue] = ()
    verdict: str = ""
    limits: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    pages: Sequence[Page] = ()
    in_front: str = ""


def write_rrd(path: str | Path, recording: Recording, shown: Shown | None = None) -> None:
    """Writes the recording as a Rerun file, replacing the file in one step.

    Raises:
        RecordingError: `torque_model` has another length than the recording, or the file cannot be
            written; the one that was there before is untouched.
    """
    shown = shown or Shown()
    if shown.torque_model is not None and len(shown.torque_model) != len(recording):
        raise RecordingError(
            f"the model's torque has {len(shown.torque_model)} rows, the recording {len(recording)}; "
            "evaluate the model on this recording"
        )
    path = Path(path)
    temporary = path.with_name(path.name + ".part")
    try:
        temporary.touch()
        _write(temporary, recording, shown, f"{path.resolve().parent.name}/{path.stem}")
        os.replace(temporary, path)
    except (OSError, RuntimeError, ValueError) as error:
        raise RecordingError(
            f"{path} cannot be written: {error}; check the folder and the space left on its disk"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def _write(path: Path, recording: Recording, shown: Shown, name: str) -> None:
    """`name`: of the file among others: the viewer gives files of one name one layout."""
    quiet()
    import rerun as rr

    from autotune.view import rerun_plots as plots
    from autotune.view.page_plots import page_view, send_page

    stream = rr.RecordingStream(f"{plots.APPLICATION} {name}")
    columns = {name: np.asarray(values) for name, values in recording.floats.items()}
    if shown.torque_model is not None:
        columns["torque_model"] = shown.torque_model
    present = _present(recording, columns, shown)
    plane = _plane(recording)
    words = _words(shown) or ("" if len(recording) or shown.pages else "This recording has no samples.")
    time = continuous(recording["time"], recording.period)
    pages = [page for page in shown.pages if page.filled]
    layout = plots.Layout(
        present,
        plane,
        live=False,
        words=bool(words),
        pages=[page_view(page) for page in pages],
        active=shown.in_front,
        span=(float(time[0]), float(time[-1])) if len(time) else (0.0, 1.0),
    )
    stream.save(path, default_blueprint=plots.blueprint(layout))
    try:
        if words:
            plots.send_text(stream, "verdict", words)
        for page in pages:
            send_page(stream, page)
        if len(time):
            _send(stream, recording, shown, columns, present, plane, plots.nanoseconds(time))
        stream.flush(timeout_sec=FLUSH_SECONDS)
    finally:
        stream.disconnect()


def _present(recording: Recording, columns: Mapping[str, Floats], shown: Shown) -> list[Any]:
    """The plots that have data, with their limits."""
    from autotune.view import rerun_plots as plots

    known = plots.plots(recording.metadata.motion_unit, recording.metadata.torque_unit)
    there = [found for plot in known if (found := plots.available(plot, columns))]
    return [plots.with_limits(plot, shown.limits, plots.reach_of(plot, columns)) for plot in there]


def _send(
    stream: Any,
    recording: Recording,
    shown: Shown,
    columns: Mapping[str, Floats],
    present: Sequence[Any],
    plane: Plane | None,
    time_ns: NDArray[np.int64],
) -> None:
    from autotune.view import rerun_plots as plots

    plots.send_names(stream, present)
    plots.send_rows(stream, present, time_ns, columns)
    segments = recording.segments()
    names = list(dict.fromkeys(s.experiment or "recording" for s in segments))
    plots.send_lane(stream, "stage/experiment", names)
    for segment in segments:
        name = segment.experiment or "recording"
        plots.send_stage(stream, "stage/experiment", int(time_ns[segment.start]), name)
    if plane is not None:
        plots.send_plane(stream, plane, shown.characteristic)
        plots.send_plane_rows(stream, plane, time_ns, columns["velocity"], columns["torque"])


def _words(shown: Shown) -> str:
    """The verdict, and the parameters as a table."""
    return "\n\n".join(part for part in (shown.verdict, parameter_table(shown.parameters)) if part)


def parameter_table(parameters: Sequence[FinalValue]) -> str:
    """Parameters with their standard errors, as a Markdown table; "" without any."""
    if not parameters:
        return ""
    rows = [
        f"| {one.name.replace('_', ' ')} | {quantity(one.value, one.unit, one.standard_error)} |"
        for one in parameters
    ]
    return "\n".join(["| parameter | value |", "|---|---|", *rows])


def _plane(recording: Recording) -> Plane | None:
    if not len(recording) or "velocity" not in recording or not peak(recording["velocity"]):
        return None
    unit = recording.metadata.motion_unit
    return Plane(
        "Torque over velocity",
        f"velocity [{unit}/s]",
        f"torque [{torque_unit(unit, recording.metadata.torque_unit)}]",
        symmetric(peak(recording["velocity"])),
        symmetric(peak(recording["torque"])),
    )
