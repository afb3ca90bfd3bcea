"""`autotune gains`: today's gains judged, better ones proposed and, on request, proved and written."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from autotune.cli.output import answer, answer_json, say
from autotune.cli.owned import holding
from autotune.cli.run import confirmation, reporting
from autotune.core.axis import Axis, read_axis
from autotune.core.errors import ConfigurationError, LinkError
from autotune.view.console import Stage

if TYPE_CHECKING:
    from autotune.control.gains.loop import Gains
    from autotune.tuning.gains import Judged
    from autotune.tuning.gains_apply import Applied

NOTHING = 3
LONGEST = 0.02
"""s, of dead time: beyond it no servo loop is closed."""


def gains(
    axis_file: Annotated[Path, typer.Argument(metavar="AXIS.toml", help="The axis.")],
    bandwidth: Annotated[
        float | None,
        typer.Option(metavar="HZ", help="The bandwidth wanted; the largest robust one by default."),
    ] = None,
    apply: Annotated[
        bool,
        typer.Option("--apply", help="Prove the proposed gains on the axis and write them to the drive."),
    ] = False,
    dead_time: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            help="From sample to torque, as the drive's data sheet says; beside what the model knows.",
        ),
    ] = 0.0,
    controller: Annotated[
        str | None,
        typer.Option(
            metavar="'pid kp=… kd=… ki=…'",
            help="Judge these gains (SI, motor side) instead of the drive's; 'p_pi position_gain=… velocity_gain=… "
            "integral_gain=…' and 'pi_velocity velocity_gain=… integral_gain=…' as well.",
        ),
    ] = None,
    yes: Annotated[
        bool, typer.Option("--yes", help="With --apply: move the axis and keep what is proved, unasked.")
    ] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the result as one JSON object.")] = False,
    html: Annotated[
        Path | None, typer.Option("--html", metavar="FILE", help="Write a page with figures.")
    ] = None,
    runs: Annotated[Path, typer.Option(help="Folder for what runs leave.")] = Path("runs"),
) -> None:
    """Judge today's gains by the last model, and propose better ones; nothing moves without --apply."""
    from autotune.tuning.gains import judge_axis

    checked_dead_time(dead_time)
    need_folder(html)
    asked = _asked(controller, apply)
    axis = read_axis(axis_file)
    held = held_by_drive(axis, axis_file, runs, needed=apply)
    judged = judge_axis(axis, runs, held, bandwidth, dead_time, asked)
    if html is not None:
        from autotune.view.gains_page import write_gains

        write_gains(
            html, judged.current, judged.proposal, judged.kin, judged.task, judged.words, axis.motion_unit
        )
        say(f"figures: {html}")
    applied = _applied(axis, axis_file, runs, judged, yes) if apply else None
    _show(judged, applied, as_json)
    if apply and not (applied and applied.kept):
        raise typer.Exit(NOTHING)


def checked_dead_time(seconds: float) -> None:
    """Raises ConfigurationError where no servo loop has such a dead time."""
    if not 0.0 <= seconds <= LONGEST:
        raise ConfigurationError(f"--dead-time is {seconds:g} s; it must be 0 to {LONGEST:g} s")


def _asked(controller: str | None, apply: bool) -> Gains | None:
    """The gains named on the command line.

    Raises:
        ConfigurationError: not understood, or to be compared with the drive's own.
    """
    from autotune.control.gains.loop import parse_gains

    if controller is not None and apply:
        raise ConfigurationError(
            "--apply compares the proposal with the gains that the drive has; leave --controller out"
        )
    return parse_gains(controller) if controller is not None else None


def need_folder(path: Path | None) -> None:
    """Raises ConfigurationError where a page could not be written, before the work is done."""
    if path is not None and not path.resolve().parent.is_dir():
        raise ConfigurationError(f"there is no folder {path.parent} to write {path.name} to; make it first")


def held_by_drive(axis: Axis, axis_file: Path, runs: Path, needed: bool) -> dict[str, float] | None:
    """The drive's parameters; None where it cannot be asked and need not be."""
    from autotune.tuning.links import open_link

    try:
        with holding(axis, axis_file, "gains"):
            loop = open_link(axis, axis_file.resolve().parent, runs)
            try:
                return loop.read_parameters()
            finally:
                loop.close()
    except LinkError as error:
        if needed:
            raise
        say(f"the drive cannot be asked ({error}); its gains are taken from the last recording")
        return None


def _applied(axis: Axis, axis_file: Path, runs: Path, judged: Judged, yes: bool) -> Applied | None:
    from autotune.tuning.gains_apply import GainsRequest, apply_gains
    from autotune.tuning.links import open_link
    from autotune.tuning.motion_plan import planned_run

    verdict = judged.proposal.verdict
    if verdict is None:
        return None
    confirm = confirmation(axis, yes, planned_run(axis, "prove"), "gains --apply")
    with (
        holding(axis, axis_file, "gains"),
        reporting(stages=[Stage("connect", 2.0), Stage("gains", 70.0), Stage("commit", 12.0)]) as console,
    ):
        return apply_gains(
            GainsRequest(
                axis,
                lambda: open_link(axis, axis_file.resolve().parent, runs),
                runs,
                console,
                datetime.now,
                gains=verdict.gains,
                approve=confirm,
            )
        )


def _show(judged: Judged, applied: Applied | None, as_json: bool) -> None:
    more = (applied.sentence,) if applied else judged.next_step
    content: dict[str, Any] = judged.as_json(bool(applied and applied.kept), more)
    if as_json:
        answer_json(content)
        return
    for sentence in content["advice"]:
        answer(sentence)
