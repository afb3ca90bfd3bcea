"""`autotune serve`: look after several axes, day after day."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from autotune.cli.output import answer
from autotune.core.paths import config_directory

if TYPE_CHECKING:
    from autotune.service.daemon.settings import Configuration


def serve(
    service_file: Annotated[
        Path | None, typer.Argument(metavar="SERVICE.toml", help="Which axes, and when; else the example.")
    ] = None,
    check: Annotated[bool, typer.Option("--check", help="Validate the files and start nothing.")] = False,
) -> None:
    """Look after axes: a gentle check every day, a re-tune when one has drifted, an HTTP API."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # jobs share the cores among axes, not within one sum
    from autotune.service.daemon.settings import read_service

    file = service_file or config_directory() / "service.toml"
    if check:
        configuration = read_service(file)
        answer(f"{file} is right: {_listed(configuration)}")
        return
    from autotune.service.daemon.daemon import serve as run_service

    run_service(file, answer)


def _listed(configuration: Configuration) -> str:
    return "; ".join(
        f"axis {one.name} checked at '{one.settings.check}' {one.settings.time_zone}, re-tuned: "
        f"{one.settings.retune}, commit: {one.settings.commit}"
        for one in configuration.axes
    )
