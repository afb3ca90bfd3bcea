"""`autotune history`: what has become of an axis over time."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import typer

from autotune.cli.output import answer, answer_json, say
from autotune.cli.owned import service_of
from autotune.core.axis import Axis, read_axis

SHOWN = 14


def history(
    axis_file: Annotated[Path, typer.Argument(metavar="AXIS.toml", help="The axis.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print everything as one JSON object.")] = False,
    runs: Annotated[Path, typer.Option(help="Folder of what runs left.")] = Path("runs"),
    url: Annotated[
        str | None, typer.Option("--url", help="History database; by default the one in the runs folder.")
    ] = None,
) -> None:
    """Show parameters over time, temperature beside friction, and events."""
    axis = read_axis(axis_file)
    found = _found(axis, axis_file, runs, url)
    if as_json:
        answer_json(found)
        return
    for line in lines(found):
        answer(line)


def _found(axis: Axis, axis_file: Path, runs: Path, url: str | None) -> dict[str, Any]:
    from autotune.service.database import open_database
    from autotune.service.report_history import history_of
    from autotune.service.store import Store
    from autotune.service.taking_up import absorb

    service = service_of(axis, axis_file) if url is None else None
    if service is not None:
        say(f"axis {axis.name} is owned by the service at {service.address}; this is its history")
        return service.client.history(service.axis.name)
    state = runs.absolute() / ".service"
    place = url or f"sqlite:///{state / 'history.sqlite'}"
    opened = open_database(place, state / "backups", datetime.now().astimezone())
    if opened.restored:
        say(opened.restored)
    store = Store(opened.engine)
    try:
        absorb(store, runs.absolute())
        return history_of(store, axis.name)
    finally:
        store.close()


def lines(found: dict[str, Any]) -> list[str]:
    """The history as text: sentences first, then the newest checks and events."""
    shown = [f"Axis {found['axis']}", *(f"  {sentence}" for sentence in found["sentences"])]
    checks = found["checks"][-SHOWN:]
    if checks:
        shown += ["", "  when              friction ± 95 %      temperature  peak error  drift"]
        shown += [f"  {_check_line(one)}" for one in checks]
    if found["events"]:
        shown += ["", "  events"]
        shown += [f"  {_when(one['at'])}  {one['sentence']}" for one in found["events"][-SHOWN:]]
    return shown


def _check_line(one: dict[str, Any]) -> str:
    temperature = f"{one['temperature']:.1f} °C" if one["temperature"] is not None else "unknown"
    friction = f"{one['level']:.4g} ± {1.96 * one['level_error']:.2g}"
    return (
        f"{_when(one['at'])}  {friction:<19}  {temperature:<11}  {one['peak_error']:<10.3g}  {one['drift']}"
    )


def _when(at: str) -> str:
    return datetime.fromisoformat(at).astimezone().strftime("%Y-%m-%d %H:%M")
