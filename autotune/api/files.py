"""Foreign files as recordings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from autotune.recordings.importing.importing import import_files
from autotune.recordings.importing.options import Options, Wishes
from autotune.recordings.recording import Controller, Recording


def import_recording(
    files: str | Path | Sequence[str | Path],
    *,
    format: str = "csv",
    columns: Sequence[str] = (),
    unit: str | None = None,
    torque_unit: str | None = None,
    resolution: float | None = None,
    period: float | None = None,
    torque_limit: float | None = None,
    controller: str | Controller | None = None,
    experiment: str | None = None,
    keep_signs: bool = False,
) -> Recording:
    """Reads files of others as one recording, each a segment; what was recognised is in `metadata.remarks`.

    Args:
        format: csv, mat, epos or parquet.
        columns: `NAME=FIELD[*FACTOR]`: the file's column, times what takes it to SI (a number or a unit).
        unit: rad or m; `torque_unit`: Nm, mNm, N, A or V.
        resolution: one count of the encoder [rad or m]; `period`: of the samples [s].
        torque_limit: where the drive clamps its torque; `controller`: `pid kp=… kd=… ki=…`.
        experiment: name of all segments, which are repetitions then; by default the file's name.
        keep_signs: the signs were looked at and are right.

    Raises:
        RecordingError: a file cannot be a recording of one axis.
        ConfigurationError: an argument is wrong, or one is needed to settle a doubt.
    """
    paths = [Path(files)] if isinstance(files, (str, Path)) else [Path(file) for file in files]
    gains = Controller.parse(controller) if isinstance(controller, str) else controller
    wishes = Wishes(unit, torque_unit, resolution, period)
    options = Options(format, tuple(columns), wishes, torque_limit, gains, experiment, keep_signs)
    imported = import_files(paths, options)
    recording = imported.recording
    return replace(recording, metadata=replace(recording.metadata, remarks=imported.lines))
