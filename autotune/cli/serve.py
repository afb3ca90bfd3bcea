"""`autotune serve`: look after several axes, day after day."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from autotune.cli.output import answer, say

if TYPE_CHECKING:
    from autotune.service.settings import Configuration


def serve(
    service_file: Annotated[
        Path | None,
        typer.Argument(
            metavar="SERVICE.toml", help="Which axes, and when; else by the rule of docs/service.md."
        ),
    ] = None,
    check: Annotated[bool, typer.Option("--check", help="Validate the files and start nothing.")] = False,
) -> None:
    """Look after axes: a gentle check every day, a re-tune when one has drifted, an HTTP API."""
    from autotune.service.service_file import service_file as by_rule
    from autotune.service.settings import read_service

    file = by_rule(service_file)
    say(f"service file {file.absolute()}")
    if check:
        configuration = read_service(file)
        answer(f"{file} is right: {_listed(configuration)}")
        return
    from autotune.service.daemon import serve as run_service

    run_service(file, answer)


def _listed(configuration: Configuration) -> str:
    return "; ".join(
        f"axis {one.name} checked at '{one.settings.check}' {one.settings.time_zone}, re-tuned: "
        f"{one.settings.retune}, commit: {one.settings.commit}"
        for one in configuration.axes
    )
