"""`autotune view`: live traces of an axis that a service looks after, or what a run left."""

from __future__ import annotations

import threading
from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from autotune.cli.live_view import live_view
from autotune.cli.output import answer, say
from autotune.cli.owned import service_of
from autotune.core.axis import read_axis
from autotune.core.errors import ConfigurationError


def view(
    what: Annotated[
        Path,
        typer.Argument(
            metavar="AXIS.toml|RUN|FILE",
            help="An axis that a service looks after, the folder of a run, an .rrd file, or a recording.",
        ),
    ],
    browser: Annotated[
        bool, typer.Option("--browser", help="For a browser, also where there is a screen.")
    ] = False,
    runs: Annotated[Path, typer.Option(help="Folder for what runs leave.")] = Path("runs"),
) -> None:
    """Show live traces of an axis that a service looks after, or what a run left."""
    if not what.exists():
        raise ConfigurationError(f"there is no {what}: name an axis file, the folder of a run, or a file")
    with suppress(KeyboardInterrupt):  # how it ends
        if what.suffix == ".toml":
            _attach(what, runs)
        else:
            _open(what, browser)


def _open(what: Path, browser: bool) -> None:
    from autotune.view.open_file import rerun_file, show

    def ready(address: str) -> None:
        if address:
            answer(address)
            say("shown to this machine only; end it with Ctrl-C")
        else:
            say(f"{what} is open in a window of the Rerun viewer")

    with rerun_file(what) as file:
        show(file, browser, ready)


def _attach(axis_file: Path, runs: Path) -> None:
    """Until Ctrl-C, or until the service is gone for good."""
    from autotune.service.live_client import follow
    from autotune.tuning.results import run_folders

    axis = read_axis(axis_file)
    service = service_of(axis, axis_file)
    if service is None:
        newest = next(iter(run_folders(runs, axis.name)), None)
        left = f"; what its last run left: 'autotune view {newest}'" if newest else ""
        raise ConfigurationError(
            f"no service looks after axis {axis.name}, so that there is nothing to attach to; a command of its own "
            f"shows itself with --view (run, check, record, link){left}"
        )
    with live_view(service.axis) as live:
        say(f"attached to axis {axis.name} at {service.address}; end it with Ctrl-C")
        follow(service.client, service.axis.name, live, say, threading.Event())
