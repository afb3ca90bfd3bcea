"""`autotune sim`: a simulated drive behind the wire that the axis file names."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from autotune.cli.output import answer, say
from autotune.core.axis import read_axis
from autotune.core.errors import ConfigurationError


def sim(
    axis_file: Annotated[Path, typer.Argument(metavar="AXIS.toml", help="The axis to simulate.")],
    link: Annotated[str, typer.Option(help="Kind of wire: canopen.")] = "canopen",
    effect: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME[=SIZE]", help="Plant a physical effect; may be given several times."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Vary the plant's parameters by ±20 %; 0: as in the preset.")] = 0,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="Follow the wall clock instead of one period per SYNC.")
    ] = False,
    fault: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME[@SECONDS]", help="Rehearse a failure; may be given several times."),
    ] = None,
) -> None:
    """Simulate the axis's drive in a process of its own, until Ctrl-C.

    The port that the axis file's link names becomes a link to the simulated adapter.
    """
    from autotune_sim.server import serve

    axis = read_axis(axis_file)
    if link != "canopen":
        raise ConfigurationError(f"--link is {link!r}; known is canopen")
    port, node = _wire(axis.link, axis_file.resolve().parent)
    serve(
        axis.simulation.preset,
        port,
        node,
        seed=seed,
        effects=dict(_effect(text) for text in effect or []),
        real_time=real_time,
        faults=fault or [],
        period=axis.cycle,
        announce=answer,
        log=say,
    )


def _wire(link: str, directory: Path) -> tuple[Path, int]:
    """Where the axis expects its adapter, and the node id."""
    from autotune_drivers.url import parse_link

    parsed = parse_link(link, directory)
    if parsed.scheme != "canopen+slcan":
        raise ConfigurationError(
            f"the link {link!r} is not a serial CAN adapter; to simulate behind a wire set it to, for "
            "example, 'canopen+slcan:axis.tty?node=5'; 'sim://PRESET' needs no process of its own"
        )
    return Path(parsed.path), parsed.node


def _effect(text: str) -> tuple[str, float | None]:
    name, separator, size = text.partition("=")
    if not separator:
        return name, None
    try:
        return name, float(size)
    except ValueError:
        raise ConfigurationError(f"--effect {text!r}: the size {size!r} is not a number") from None
