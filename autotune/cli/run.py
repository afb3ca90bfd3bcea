"""`autotune run`: tune one axis, from the first look to the committed parameters."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from autotune.cli.live_view import View, following, looking_on
from autotune.cli.output import answer, answer_json, say
from autotune.cli.owned import Service, holding, let_service, result_of, service_of
from autotune.core.axis import Axis, read_axis
from autotune.core.errors import ConfigurationError
from autotune.core.text import clean_line
from autotune.view.console import ConsoleProgress, Stage

if TYPE_CHECKING:
    from autotune.models.drive_model import DriveModel
    from autotune.tuning.motion_plan import MotionPlan
    from autotune.tuning.outcome import RunResult

Confirm = Callable[[str], bool]
SIMULATED = "autotune-sim"  # how the profiles of simulated drives begin
EXPECTED = {
    "connect": 2.0,
    "check": 1.0,
    "experiment": 110.0,
    "fit": 5.0,
    "diagnose": 25.0,
    "adapt": 60.0,
    "prove": 60.0,
    "commit": 12.0,
}


def run(
    axis_file: Annotated[Path, typer.Argument(metavar="AXIS.toml", help="The axis to tune.")],
    yes: Annotated[
        bool, typer.Option("--yes", help="Move the axis and keep what is proved, unasked.")
    ] = False,
    only: Annotated[
        str | None,
        typer.Option(
            metavar="STAGE", help="One stage alone: check, experiment, fit, diagnose, adapt, prove or commit."
        ),
    ] = None,
    resume: Annotated[
        str | None,
        typer.Option(
            metavar="[RUN]",
            help="Take up an interrupted run (the newest, or the one named) from its last whole stage.",
        ),
    ] = None,
    decide: Annotated[
        bool,
        typer.Option("--decide", help="A diagnosis in doubt may move the axis a minute more, to decide it."),
    ] = False,
    model: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL.toml", help="Takes this model to the proof, in place of the one that is diagnosed."
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")] = False,
    view: View = False,
    runs: Annotated[Path, typer.Option(help="Folder for what runs leave.")] = Path("runs"),
) -> None:
    """Tune an axis: check, experiment, fit, adapt, prove, commit."""
    axis = read_axis(axis_file)
    from autotune.tuning.links import open_link  # here, so that mistakes and --help are answered at once
    from autotune.tuning.motion_plan import planned_run
    from autotune.tuning.run import Request, tune

    given = _given(model)
    service = service_of(axis, axis_file)
    if service is not None:
        _check_whole(service, only is not None or decide)
    moved = service.axis if service else axis
    confirm = confirmation(moved, yes, planned_run(moved, only, decide))
    if service is not None:
        with following(service, view):
            _let_service_run(service, confirm, _asks_nobody(service.axis, yes), as_json, model)
        return
    with holding(axis, axis_file, "run"), reporting(only) as console, looking_on(axis, view) as observers:
        request = Request(
            axis, lambda: open_link(axis, axis_file.resolve().parent, runs), runs, console, datetime.now, observers,
            only=only, resume=resume, decide=decide, model=given, approve=confirm,
        )  # fmt: skip
        result = tune(request)
    _show(result, as_json)
    raise typer.Exit(result.exit_code)


def _given(model: Path | None) -> DriveModel | None:
    from autotune.models.model_file import read_model

    return None if model is None else read_model(model)


def _check_whole(service: Service, more: bool) -> None:
    if more:
        raise ConfigurationError(
            f"axis {service.axis.name} is owned by the service at {service.address}, which does whole runs; leave "
            "--only and --decide out, or stop the service"
        )


def _let_service_run(
    service: Service, confirm: Confirm, unasked: bool, as_json: bool, model: Path | None
) -> None:
    """The service that owns the axis does the run; before it keeps anything the same person is asked as without it."""
    with reporting() as console:
        wish = {} if model is None else {"model": model.read_text(encoding="utf-8")}
        job = let_service(service, "run", console, commit="automatic" if unasked else "ask", **wish)
    proposal = None if unasked else service.client.proposal_of(job)
    if proposal is not None and confirm(clean_line(proposal["sentence"], 500)):
        with reporting("commit") as console:
            job = service.client.follow(service.client.approve(proposal), console)
    elif proposal is not None:
        say("not kept; it can still be approved at the service (POST /api/proposals/ID/approve)")
    content = result_of(service, job)
    if as_json:
        answer_json(content)
    else:
        answer(content["verdict"])
    raise typer.Exit(int(job["exit_code"] or 0))


class ConsoleReporter:
    """Stages, progress and sentences of a run on the console."""

    def __init__(self, console: ConsoleProgress) -> None:
        self._console = console

    def stage(self, name: str, seconds: float) -> None:
        if name != self._console.stage:
            self._console.finish()
        self._console.start(name)

    def progress(self, fraction: float) -> None:
        self._console.advance(fraction)

    def say(self, sentence: str) -> None:
        self._console.message(sentence)


@contextmanager
def reporting(only: str | None = None, stages: Sequence[Stage] = ()) -> Iterator[ConsoleReporter]:
    """Shows a run's stages while the block lasts; at their end the last one counts as done."""
    shown = stages or [
        Stage(name, seconds)
        for name, seconds in EXPECTED.items()
        if only in (None, name) or name == "connect"
    ]
    with ConsoleProgress(shown) as console:
        yield ConsoleReporter(console)
        console.finish()


def _asks_nobody(axis: Axis, yes: bool) -> bool:
    """There is --yes, or nothing real moves.

    The simulated drive's profile is enough: a drive that says it is another one is refused before it moves.
    """
    return yes or axis.link.startswith("sim:") or axis.profile.startswith(SIMULATED)


def confirmation(axis: Axis, yes: bool, plan: MotionPlan | None, what: str = "run") -> Confirm:
    """Asks a person before the axis moves, by whichever program; without one there must be --yes, unless simulated.

    Args:
        plan: what will move; None where nothing does, and nobody is asked.

    Returns:
        What asks before something is kept.
    """
    if plan is None or _asks_nobody(axis, yes):
        return lambda sentence: True
    if not sys.stdin.isatty():
        raise ConfigurationError(
            f"'autotune {what}' moves axis {axis.name}; nobody is there to be asked, so say --yes"
        )
    say(plan.sentence(axis))
    if not typer.confirm("Is the axis free to move, and the emergency stop within reach?", err=True):
        raise ConfigurationError("not confirmed; nothing has moved")
    return lambda sentence: typer.confirm(sentence, err=True)


def _show(result: RunResult, as_json: bool) -> None:
    if as_json:
        answer_json(result.as_json())
        return
    answer(result.verdict)
    for line in _headline(result):
        answer(f"  {line}")
    for note in result.notes:
        answer(f"  {note}")
    answer(f"Report: {result.run_directory / 'report.html'}")


def _headline(result: RunResult) -> list[str]:
    """What is in the drive, then what a host adds while it plays; nothing where no proof was reached."""
    here, host, unit = result.in_drive, result.host_adds, result.motion_unit
    before, alone = here.get("peak_error_before"), here.get("peak_error")
    if before is None or alone is None or not host:
        return []
    keeps = ", ".join(here["keeps"]) or "nothing"
    gone = here.get("ripple_removed")
    ripple = f"; {100 * gone:.0f} % of the torque ripple gone" if gone is not None else ""
    if alone == before:
        here_now = f"In the drive, as before: {keeps}: peak error {1e3 * alone:.2f} m{unit}"
    else:
        here_now = (
            f"In the drive: {keeps}: peak error {1e3 * before:.2f} -> {1e3 * alone:.2f} m{unit}{ripple}"
        )
    return [here_now, f"While a host plays: {1e3 * host['peak_error']:.2f} m{unit}"]
