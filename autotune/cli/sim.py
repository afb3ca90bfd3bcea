"""`autotune sim`: a simulated drive behind the wire that the axis file names."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from autotune.cli.live_view import View
from autotune.cli.output import answer, say
from autotune.cli.sim_view import shown_truth
from autotune.core.axis import Axis, read_axis
from autotune.core.errors import ConfigurationError
from autotune_drivers.url import LinkAddress, parse_link


def sim(
    axis_file: Annotated[Path, typer.Argument(metavar="AXIS.toml", help="The axis to simulate.")],
    link: Annotated[
        str | None,
        typer.Option(help="Kind of wire: canopen or moteus; by default what the axis file's link says."),
    ] = None,
    effect: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME[=SIZE]", help="Plant a physical effect; may be given several times."),
    ] = None,
    seed: Annotated[int, typer.Option(help="Vary the plant's parameters by ±20 %; 0: as in the preset.")] = 0,
    real_time: Annotated[
        bool,
        typer.Option("--real-time", help="Follow the wall clock instead of one period per SYNC or command."),
    ] = False,
    fault: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME[@SECONDS]", help="Rehearse a failure; may be given several times."),
    ] = None,
    dead_time: Annotated[
        float,
        typer.Option(metavar="SECONDS", help="The torque comes so much later, in whole cycles of the drive."),
    ] = 0.0,
    view: View = False,
) -> None:
    """Simulate the axis's drive in a process of its own, until Ctrl-C.

    The port that the axis file's link names becomes a link to the simulated adapter.
    """
    from autotune_sim.server import parse_effects, serve

    axis = read_axis(axis_file)
    address, kind = _wire(axis, axis_file.resolve().parent, link)
    preset, folder = axis.simulation.preset, axis_file.resolve().parent
    with shown_truth(axis, view) as truth:
        serve(
            str(folder / preset) if preset.endswith(".toml") else preset,
            address.target,
            address.options["id" if kind == "moteus" else "node"],
            link=kind,
            seed=seed,
            effects=parse_effects(effect or []),
            real_time=real_time,
            faults=fault or [],
            truth=truth,
            dead_time=dead_time,
            log=say,
            ready=lambda port: answer(
                f"{axis.name} is simulated at {axis.link} ({port}); end it with Ctrl-C"
            ),
        )


_KINDS = {"canopen+slcan": "canopen", "moteus+serial": "moteus"}


def _wire(axis: Axis, directory: Path, wanted: str | None) -> tuple[LinkAddress, str]:
    """Where the axis expects its drive, and what is spoken there.

    Raises:
        ConfigurationError: the link needs no process of its own, is a kernel interface that is not ours, or
            is not of the kind that is wanted.
    """
    if wanted is not None and wanted not in _KINDS.values():
        raise ConfigurationError(f"--link is {wanted!r}; known are {' and '.join(_KINDS.values())}")
    scheme = axis.link.partition(":")[0]
    kind = _KINDS.get(scheme)
    if kind is None:
        parse_link(axis.link, directory)
        raise ConfigurationError(
            f"the link {axis.link!r} is not a serial line; to simulate behind a wire set it to, for example, "
            "'canopen+slcan:axis.tty?bitrate=1000000&node=5' or 'moteus+serial:axis.tty?id=1'; "
            "'sim://edm-vertical' needs no process of its own"
        )
    if wanted not in (None, kind):
        raise ConfigurationError(
            f"--link is {wanted!r}, but the link of axis {axis.name} is {axis.link!r}; leave --link out, or "
            "simulate an axis file with such a link (for moteus config/axes/edm-vertical-moteus.toml)"
        )
    return parse_link(axis.link, directory), kind
