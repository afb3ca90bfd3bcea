"""`autotune workbench`: models and recordings in the browser."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import typer

from autotune.cli.output import answer, say


def workbench(
    files: Annotated[
        list[Path] | None, typer.Argument(metavar="[FILE]...", help="Recordings to begin with.")
    ] = None,
    port: Annotated[int, typer.Option(min=0, max=65535, help="Of the page; 0: any that is free.")] = 0,
    open_browser: Annotated[
        bool, typer.Option("--open/--no-open", help="Open the page in this machine's browser.")
    ] = True,
) -> None:
    """Look at models and recordings in the browser: compare, diagnose, add effects, save."""
    from autotune.service.workbench_page import serve

    def ready(address: str) -> None:
        answer(address)
        say("the page is for this machine and this session only; end it with Ctrl-C")
        if open_browser:
            webbrowser.open(address)

    serve(files or [], port, ready)
