"""`autotune catalogue`: control structures compared on the twin of an axis."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from autotune.cli.gains import checked_dead_time, held_by_drive, need_folder
from autotune.cli.output import answer, answer_json, say
from autotune.core.axis import read_axis

if TYPE_CHECKING:
    from autotune.control.structures.catalogue import Entry


def catalogue(
    axis_file: Annotated[Path, typer.Argument(metavar="AXIS.toml", help="The axis.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")] = False,
    html: Annotated[
        Path | None, typer.Option("--html", metavar="FILE", help="Write a page with figures.")
    ] = None,
    dead_time: Annotated[
        float,
        typer.Option(metavar="SECONDS", help="From sample to torque, as the drive's data sheet says."),
    ] = 0.0,
    runs: Annotated[Path, typer.Option(help="Folder for what runs leave.")] = Path("runs"),
) -> None:
    """Compare control structures on the twin of the axis; nothing moves."""
    from autotune.tuning.catalogue import catalogue_of

    checked_dead_time(dead_time)
    need_folder(html)
    axis = read_axis(axis_file)
    shown = catalogue_of(axis, runs, held_by_drive(axis, axis_file, runs, needed=False), dead_time)
    if html is not None:
        from autotune.view.gains_page import write_catalogue

        write_catalogue(html, shown.found, axis.motion_unit)
        say(f"figures: {html}")
    if as_json:
        answer_json(shown.found.as_json())
        return
    for entry in shown.found.entries:
        answer(_line(entry, axis.motion_unit))
    answer(f"Recommended: {shown.found.why}")


def _line(entry: Entry, unit: str) -> str:
    """One structure, a line."""
    swings = ", oscillates" if entry.oscillates else ""
    where = ", on the twin only" if entry.structure.in_host else ""
    return (
        f"{entry.structure.name}: sine {1e3 * entry.sine_peak_error:.3g} m{unit}, steps within "
        f"{1e3 * entry.step_settling:.0f} ms, robust on {100 * entry.robustness:.0f} %, torque noise "
        f"{entry.torque_noise:.2g}, bears {entry.dead_time:g} cycles more{swings}; needs "
        f"{entry.structure.effort}{where}"
    )
