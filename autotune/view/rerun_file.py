"""A run as a Rerun recording (`run.rrd`): traces, stages, parameters, verdict, with its blueprint.

Written by a stream of its own, which no viewer shares: a viewer that hangs cannot stop a file.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import RecordingError
from autotune.recordings.recording import Recording
from autotune.view.data import Trace, torque_unit
from autotune.view.plane import Plane, symmetric
from autotune.view.scale import continuous, peak

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
        traces: parameters as they converged.
        parameters: as they ended.
        verdict: Markdown.
    """

    torque_model: Floats | None = None
    characteristic: tuple[Floats, Floats] | None = None
    traces: Sequence[Trace] = ()
    parameters: Sequence[FinalValue] = ()
    verdict: str = ""


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
        _write(temporary, recording, shown)
        os.replace(temporary, path)
    except (OSError, RuntimeError, ValueError) as error:
        raise RecordingError(
            f"{path} cannot be written: {error}; check the folder and the space left on its disk"
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def _write(path: Path, recording: Recording, shown: Shown) -> None:
    os.environ.setdefault("RUST_LOG", "error")
    import rerun as rr

    from autotune.view import rerun_plots as plots

    stream = rr.RecordingStream(plots.APPLICATION)
    columns = {name: np.asarray(values) for name, values in recording.floats.items()}
    if shown.torque_model is not None:
        columns["torque_model"] = shown.torque_model
    present = [
        p
        for plot in plots.plots(recording.metadata.motion_unit, recording.metadata.torque_unit)
        if (p := plots.available(plot, columns))
    ]
    plane = _plane(recording)
    parameters = {trace.name: trace.unit for trace in shown.traces}
    parameters |= {final.name: final.unit for final in shown.parameters}
    arrangement = plots.blueprint(present, plane, live=False, parameters=parameters)
    stream.save(path, default_blueprint=arrangement)
    try:
        _send(stream, recording, shown, columns, present, plane)
        stream.flush(timeout_sec=FLUSH_SECONDS)
    finally:
        stream.disconnect()


def _send(
    stream: Any,
    recording: Recording,
    shown: Shown,
    columns: Mapping[str, Floats],
    present: Sequence[Any],
    plane: Plane | None,
) -> None:
    from autotune.view import rerun_plots as plots

    if shown.verdict:
        plots.send_text(stream, "verdict", shown.verdict)
    if not len(recording):
        return
    time = continuous(recording["time"], recording.period)
    time_ns = plots.nanoseconds(time)
    plots.send_names(stream, present)
    plots.send_rows(stream, present, time_ns, columns)
    segments = recording.segments()
    plots.send_lane(
        stream, "stage/experiment", list(dict.fromkeys(s.experiment or "recording" for s in segments))
    )
    for segment in segments:
        name = segment.experiment or "recording"
        plots.send_stage(stream, "stage/experiment", int(time_ns[segment.start]), name)
    if plane is not None:
        plots.send_plane(stream, plane, shown.characteristic)
        plots.send_plane_rows(stream, plane, time_ns, columns["velocity"], columns["torque"])
    _send_parameters(stream, shown, int(time_ns[-1]))


def _send_parameters(stream: Any, shown: Shown, end_ns: int) -> None:
    from autotune.view import rerun_plots as plots

    for trace in shown.traces:
        time_ns, unknown = plots.nanoseconds(trace.time), np.full(len(trace.time), np.nan)
        plots.send_parameter(stream, trace.name, trace.unit, time_ns, trace.value, unknown)
        end_ns = max(end_ns, int(time_ns[-1]) if len(time_ns) else 0)
    for final in shown.parameters:
        error = np.nan if final.standard_error is None else final.standard_error
        moment = np.array([end_ns], dtype=np.int64)
        value, errors = np.array([final.value]), np.array([error])
        plots.send_parameter(stream, final.name, final.unit, moment, value, errors)


def _plane(recording: Recording) -> Plane | None:
    if "velocity" not in recording:
        return None
    unit = recording.metadata.motion_unit
    return Plane(
        "Torque over velocity",
        f"velocity [{unit}/s]",
        f"torque [{torque_unit(unit, recording.metadata.torque_unit)}]",
        symmetric(peak(recording["velocity"])),
        symmetric(peak(recording["torque"])),
    )
