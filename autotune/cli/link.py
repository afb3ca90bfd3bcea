"""`autotune link`: is this host and link fit for the cycle asked for."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from autotune.cli.live_view import View, looking_on
from autotune.cli.output import answer, answer_json
from autotune.cli.owned import holding
from autotune.cli.run import reporting
from autotune.core.axis import read_axis


def link(
    axis_file: Annotated[Path, typer.Argument(metavar="AXIS.toml", help="The axis.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")] = False,
    view: View = False,
    runs: Annotated[Path, typer.Option(help="Folder for what runs leave.")] = Path("runs"),
) -> None:
    """Measure the link: round trip, jitter, lost cycles, bus load, torque semantics; the axis holds still."""
    from autotune.tuning.link_check import check_link, remarks_of
    from autotune.tuning.link_words import lines
    from autotune.tuning.links import open_link
    from autotune.tuning.preparation import SessionRequest
    from autotune.view.console import Stage

    axis = read_axis(axis_file)
    directory = axis_file.resolve().parent
    load, remarks = remarks_of(axis, directory)
    with (
        holding(axis, axis_file, "link"),
        reporting(stages=[Stage("link", 8.0)]) as console,
        looking_on(axis, view) as observers,
    ):
        request = SessionRequest(
            axis, lambda: open_link(axis, directory, runs), runs, console, datetime.now, observers
        )
        report = check_link(request, load, remarks)
    if as_json:
        answer_json(report.as_json())
        return
    for line in lines(report):
        answer(line)
