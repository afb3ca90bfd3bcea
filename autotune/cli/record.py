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
            help="identification, steady-state, presliding, dahl, high-speed, benchmark or diagnosis."
        ),
    ],
    out: Annotated[Path, typer.Option(help="Where to write: .parquet or .csv.")],
    yes: Annotated[bool, typer.Option("--yes", help="Move the axis unasked.")] = False,
    view: View = False,
    runs: Annotated[Path, typer.Option(help="Folder for what runs leave.")] = Path("runs"),
) -> None:
    """Play a programme on the axis and write the recording."""
    from autotune.tuning.links import open_link
    from autotune.tuning.motion_plan import planned_programme
    from autotune.tuning.preparation import SessionRequest
    from autotune.tuning.recording_run import record_programme

    if out.suffix not in ENDINGS or not out.resolve().parent.is_dir():
        raise ConfigurationError(f"--out {out}: it must end in .parquet or .csv, in a folder that is there")
    axis = read_axis(axis_file)
    confirmation(axis, yes, planned_programme(axis, programme), "record")
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
        recording = record_programme(request, programme, out)
    answer(f"{out}: {len(recording)} samples, {len(recording) * recording.period:.1f} s")
