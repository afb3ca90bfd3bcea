"""`autotune sim`: a simulated drive behind the wire that the axis file names."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from autotune.cli.output import answer, say
from autotune.core.axis import Axis, read_axis
from autotune.core.errors import ConfigurationError
from autotune_drivers.url import LinkAddress, parse_link


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
    from autotune_sim.server import parse_effects, serve

    axis = read_axis(axis_file)
    if link != "canopen":
        raise ConfigurationError(f"--link is {link!r}; known is canopen")
    address = _wire(axis, axis_file.resolve().parent)
    serve(
        axis.simulation.preset,
        address.target,
        address.options["node"],
        seed=seed,
        effects=parse_effects(effect or []),
        real_time=real_time,
        faults=fault or [],
        log=say,
        ready=lambda port: answer(f"{axis.name} is simulated at {axis.link} ({port}); end it with Ctrl-C"),
    )


def _wire(axis: Axis, directory: Path) -> LinkAddress:
    """Where the axis expects its adapter.

    Raises:
        ConfigurationError: the link needs no process of its own, or a kernel interface that is not ours.
    """
    address = parse_link(axis.link, directory)
    if address.scheme != "canopen+slcan":
        raise ConfigurationError(
            f"the link {axis.link!r} is not a serial CAN adapter; to simulate behind a wire set it to, for "
            "example, 'canopen+slcan:axis.tty?bitrate=1000000&node=5'; 'sim://edm-vertical' needs no process "
            "of its own"
        )
    return address
