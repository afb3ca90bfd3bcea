"""`autotune play`: the proved feedforward beside a machine's own master, as torque offset."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated

import typer

from autotune.cli.output import say
from autotune.cli.owned import holding
from autotune.core.axis import read_axis

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def play(
    axis_file: Annotated[
        Path,
        typer.Argument(
            metavar="AXIS.toml", help="The axis; its link is an adapter of our own on the master's bus."
        ),
    ],
    runs: Annotated[Path, typer.Option(help="Folder for what runs leave.")] = Path("runs"),
    metrics: Annotated[
        Path | None, typer.Option(metavar="FILE.prom", help="Metrics for Prometheus's textfile collector.")
    ] = None,
) -> None:
    """Play the proved feedforward as torque offset beside the machine's own master, until stopped."""
    from autotune.tuning.play_session import PlayRequest, play_axis

    axis = read_axis(axis_file)
    with holding(axis, axis_file, "play"), _asked_to_stop() as asked:
        play_axis(PlayRequest(axis, axis_file.resolve().parent, runs, metrics), lambda: bool(asked), say)


@contextmanager
def _asked_to_stop() -> Iterator[list[int]]:
    """Signals ask for a fade-out instead of interrupting whatever is under way; the list has those that came."""
    asked: list[int] = []
    before = {number: signal.signal(number, lambda number, _: asked.append(number)) for number in _SIGNALS}
    try:
        yield asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
