"""`autotune check`: the gentle daily look at one axis, a minute at most."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from autotune.cli.live_view import View, following, looking_on
from autotune.cli.output import answer, answer_json
from autotune.cli.owned import holding, let_service, result_of, service_of
from autotune.cli.run import confirmation, reporting
from autotune.core.axis import Axis, read_axis
from autotune.view.console import Stage

if TYPE_CHECKING:
    from autotune.tuning.progress import Reporter


def check(
    axis_file: Annotated[Path, typer.Argument(metavar="AXIS.toml", help="The axis to look at.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")] = False,
    yes: Annotated[bool, typer.Option("--yes", help="Move the axis unasked.")] = False,
    view: View = False,
    runs: Annotated[Path, typer.Option(help="Folder for what runs leave.")] = Path("runs"),
) -> None:
    """Look at an axis for a minute at most: friction, tracking, temperature, and whether it has drifted."""
    from autotune.monitoring.motion_plan import planned_check

    axis = read_axis(axis_file)
    service = service_of(axis, axis_file)
    moved = service.axis if service else axis
    confirmation(moved, yes, planned_check(moved), "check")
    with reporting(stages=[Stage("connect", 2.0), Stage("look", 40.0)]) as console:
        if service is not None:
            with following(service, view):
                content = result_of(service, let_service(service, "check", console))
        else:
            content = _look(axis, axis_file, runs, console, view)
    show_check(content, as_json)


def _look(axis: Axis, axis_file: Path, runs: Path, reporter: Reporter, view: bool) -> dict[str, Any]:
    from autotune.monitoring.check import CheckRequest, check_axis
    from autotune.tuning.links import open_link

    with holding(axis, axis_file, "check"), looking_on(axis, view) as observers:
        request = CheckRequest(
            axis,
            lambda: open_link(axis, axis_file.resolve().parent, runs),
            runs,
            reporter,
            lambda: datetime.now().astimezone(),
            observers,
        )
        return check_axis(request).as_json()


def show_check(content: dict[str, Any], as_json: bool) -> None:
    """Prints a check's result."""
    if as_json:
        answer_json(content)
        return
    answer(f"{content['verdict']} {content['advice']}".strip())
    for line in check_lines(content):
        answer(f"  {line}")


def check_lines(content: dict[str, Any]) -> list[str]:
    """Friction, tracking and temperature, a line each."""
    level, unit = content["friction"]["level"], content["motion_unit"]
    low, high = level["interval"]
    lines = [f"friction {level['value']:.4g} {level['unit']} ({low:.4g} … {high:.4g})"]
    peak, without = content["tracking_error"]["peak_error"], content["uncompensated"]["peak_error"]
    lines.append(f"peak error {1e3 * peak:.2f} m{unit}, without compensation {1e3 * without:.2f} m{unit}")
    if content["temperature"] is not None and content["temperature"] == content["temperature"]:
        lines.append(f"temperature {content['temperature']:.1f} °C")
    return [*lines, *content["notes"]]
