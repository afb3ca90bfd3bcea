"""`autotune rollback`: put back what the drive held before a commit."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from autotune.cli.output import answer, say
from autotune.cli.owned import JobFailed, holding, let_service, service_of
from autotune.core.axis import read_axis


def rollback(
    axis_file: Annotated[Path, typer.Argument(metavar="AXIS.toml", help="The axis.")],
    to: Annotated[str | None, typer.Option(metavar="ID", help="Which backup; the newest by default.")] = None,
    runs: Annotated[Path, typer.Option(help="Folder for what runs leave.")] = Path("runs"),
) -> None:
    """Restore the drive's parameters from a backup, and store them."""
    from autotune.tuning.links import open_link
    from autotune.tuning.progress import Silent
    from autotune.tuning.rollback import roll_back

    axis = read_axis(axis_file)
    service = service_of(axis, axis_file)
    if service is not None:
        job = let_service(service, "rollback", Silent(), **({"to": to} if to else {}))
        if job["exit_code"]:
            raise JobFailed(str(job["sentence"]), int(job["exit_code"]))
        answer(str(job["sentence"]))
        return
    with holding(axis, axis_file, "rollback"):
        backup = roll_back(
            axis, lambda: open_link(axis, axis_file.resolve().parent, runs), runs, datetime.now(), to, say
        )
    answer(
        f"Axis {axis.name} holds again what it held on {backup.taken.replace('T', ' ')} (backup {backup.id})."
    )
