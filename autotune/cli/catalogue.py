"""`autotune catalogue`: control structures compared on the twin of an axis."""

from __future__ import annotations

from dataclasses import asdict
from datetime import datetime
from functools import partial
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from autotune.cli.gains import checked_dead_time, held_by_drive, need_folder
from autotune.cli.output import answer, answer_json, say
from autotune.cli.owned import holding
from autotune.cli.run import confirmation, reporting
from autotune.core.axis import Axis, read_axis
from autotune.core.units import torque_symbol
from autotune.view.console import Stage

if TYPE_CHECKING:
    from autotune.control.learning import TwinCeiling
    from autotune.control.structures.catalogue import Entry
    from autotune.tuning.ceiling import Ceiling


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
    ceiling: Annotated[
        bool,
        typer.Option(
            "--ceiling",
            help="Learn the benchmark on the axis too: it moves; nothing is written to the drive.",
        ),
    ] = False,
    yes: Annotated[bool, typer.Option("--yes", help="With --ceiling: move the axis unasked.")] = False,
    runs: Annotated[Path, typer.Option(help="Folder for what runs leave.")] = Path("runs"),
) -> None:
    """Compare control structures on the twin of the axis; nothing moves without --ceiling."""
    from autotune.tuning.catalogue import catalogue_of

    checked_dead_time(dead_time)
    need_folder(html)
    axis = read_axis(axis_file)
    shown = catalogue_of(axis, runs, held_by_drive(axis, axis_file, runs, needed=ceiling), dead_time)
    measured = _measured(axis, axis_file, runs, yes) if ceiling else None
    if html is not None:
        from autotune.view.gains_page import write_catalogue

        write_catalogue(html, shown.found, axis.motion_unit)
        say(f"figures: {html}")
    if as_json:
        twin = asdict(shown.ceiling) if shown.ceiling else None
        on_axis = measured.as_json() if measured else None
        answer_json({**shown.found.as_json(), "ceiling": {"twin": twin, "axis": on_axis}})
        return
    for entry in shown.found.entries:
        answer(_line(entry, axis.motion_unit))
    answer(f"Recommended: {shown.found.why}" if shown.found.recommended else shown.found.why)
    if shown.ceiling is not None:
        answer(_ceiling(shown.ceiling, axis.motion_unit))
    if measured is not None:
        answer(measured.in_words(axis.motion_unit))


def _measured(axis: Axis, axis_file: Path, runs: Path, yes: bool) -> Ceiling:
    from autotune.tuning.ceiling import ceiling_plan, fixed_law, measure_ceiling
    from autotune.tuning.links import open_link
    from autotune.tuning.preparation import SessionRequest

    law, plan = fixed_law(axis, runs), ceiling_plan(axis)
    confirmation(axis, yes, plan, "catalogue --ceiling")
    with (
        holding(axis, axis_file, "catalogue"),
        reporting(stages=[Stage("connect", 2.0), Stage("ceiling", plan.seconds)]) as console,
    ):
        open_loop = partial(open_link, axis, axis_file.resolve().parent, runs)
        return measure_ceiling(SessionRequest(axis, open_loop, runs, console, datetime.now), law)


def _ceiling(found: TwinCeiling, unit: str) -> str:
    """What could be learnt on the twin, a line."""
    learnt, fixed, neither = (1e3 * value for value in (found.learnt, found.fixed, found.neither))
    return (
        f"Ceiling on the twin: iterative learning leaves {learnt:.3g} m{unit} on the sine, the model's own feedforward "
        f"{fixed:.3g} m{unit}; without either it is {neither:.3g} m{unit}"
    )


def _line(entry: Entry, unit: str) -> str:
    """One structure, a line."""
    from autotune.control.gains.steps import HORIZON
    from autotune.control.structures.structure import EFFORTS

    if not isfinite(entry.sine_peak_error):
        return f"{entry.structure.name}: runs away on the twin"
    torque, most = torque_symbol(unit), HORIZON
    swings = ", oscillates" if entry.oscillates else ""
    where = "; on the twin only" if entry.structure.in_host else ""
    slow = entry.step_settling >= most
    steps = "steps do not settle within" if slow else "steps settle within"
    steps += f" {most:g} s" if slow else f" {1e3 * entry.step_settling:.0f} ms"
    effort = "nothing" if entry.structure.effort == EFFORTS[0] else entry.structure.effort
    more = "1 more cycle" if entry.dead_time == 1.0 else f"{entry.dead_time:g} more cycles"
    return (
        f"{entry.structure.name}: sine {1e3 * entry.sine_peak_error:.3g} m{unit}, {steps}, "
        f"as good on {100 * entry.robustness:.0f} % of the axes within the intervals, torque noise "
        f"{entry.torque_noise:.2g} {torque}, tolerates {more} of dead time{swings}; needs {effort}{where}"
    )
