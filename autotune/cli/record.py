"""`autotune record`: play a programme on the axis and keep what was measured."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from autotune.cli.live_view import View, looking_on
from autotune.cli.output import answer
from autotune.cli.owned import holding
from autotune.cli.run import confirmation, reporting
from autotune.core.axis import read_axis
from autotune.core.errors import ConfigurationError
from autotune.view.console import Stage

ENDINGS = (".parquet", ".csv")


def record(
    axis_file: Annotated[Path, typer.Argument(metavar="AXIS.toml", help="The axis.")],
    programme: Annotated[
        str,
        typer.Argument(
            help="identification, steady-state, presliding, dahl, high-speed, benchmark, diagnosis or decide."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Where to write: .parquet or .csv.")],
    asked: Annotated[
        Path | None,
        typer.Option("--from", metavar="DIAGNOSIS.json", help="For decide: the diagnosis that is in doubt."),
    ] = None,
    set_points: Annotated[
        bool,
        typer.Option(
            "--set-points", help="Move nothing: write the set points as CSV, for another rig to play."
        ),
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Move the axis unasked.")] = False,
    view: View = False,
    runs: Annotated[Path, typer.Option(help="Folder for what runs leave.")] = Path("runs"),
) -> None:
    """Play a programme on the axis and write the recording."""
    from autotune.tuning.links import open_link
    from autotune.tuning.motion_plan import planned_programme
    from autotune.tuning.preparation import SessionRequest
    from autotune.tuning.question import question_in
    from autotune.tuning.recording_run import record_programme, write_set_points

    if out.suffix not in ENDINGS or not out.resolve().parent.is_dir():
        raise ConfigurationError(f"--out {out}: it must end in .parquet or .csv, in a folder that is there")
    if asked is not None and programme != "decide":
        raise ConfigurationError(f"--from belongs to programme 'decide', not to {programme!r}")
    rivals = question_in(asked) if asked is not None else None
    axis = read_axis(axis_file)
    if set_points:
        if out.suffix != ".csv":
            raise ConfigurationError(f"--out {out}: set points are written as .csv")
        seconds = write_set_points(axis, programme, out, rivals)
        answer(_points_in(out, seconds, axis.limits.machine_seconds))
        return
    confirmation(axis, yes, planned_programme(axis, programme, rivals), "record")
    with (
        holding(axis, axis_file, "record"),
        reporting(stages=[Stage("record", 60.0)]) as console,
        looking_on(axis, view) as observers,
    ):
        request = SessionRequest(
            axis,
            lambda: open_link(axis, axis_file.resolve().parent, runs),
            runs,
            console,
            datetime.now,
            observers,
        )
        recording = record_programme(request, programme, out, rivals)
    answer(f"{out}: {len(recording)} samples, {len(recording) * recording.period:.1f} s")
    if rivals is not None:
        answer("Decide with both: autotune model diagnose FIRST " + str(out) + " --model MODEL.toml")


def _points_in(out: Path, seconds: float, most: float) -> str:
    """What to do with a file of set points, and whether they move the axis for longer than `most` seconds."""
    longer = (
        f"; that is longer than the axis may move in one run (limits.machine_seconds = {most:g} s): play it in parts"
        if seconds > most
        else ""
    )
    return (
        f"{out}: set points of {seconds:.1f} s, to be played from rest at the middle of the travel{longer}; "
        "with columns 'position' and 'torque' as measured beside them it is a recording"
    )
