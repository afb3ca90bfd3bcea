"""`autotune export`: a model, or what a run has proved, as a file that another controller plays."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from autotune.cli.output import answer, answer_json, say
from autotune.core.errors import ConfigurationError

if TYPE_CHECKING:
    from autotune.export.request import Exported, Request
    from autotune.models.drive_model import DriveModel

USUAL_CYCLE = 1e-3
_TWICE = (
    "that run has put a feedforward into the drive, and this file holds the whole law: switch the drive's own off, "
    "or the same torque is added twice"
)
TARGET_NAMES = ("c", "linuxcnc", "fmu", "st", "twincat-table", "csv")


def export(
    source: Annotated[
        Path, typer.Argument(metavar="MODEL.toml|RUN", help="A model, or the folder of a run.")
    ],
    target: Annotated[str, typer.Option("--to", metavar="|".join(TARGET_NAMES), help="What to make.")],
    out: Annotated[Path, typer.Option(metavar="FOLDER", help="Where to write; made if it is not there.")],
    cycle: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Sample period of the target; by default the run's, or 1 ms."),
    ] = None,
    torque_limit: Annotated[
        float | None,
        typer.Option(metavar="NM|N", help="Largest torque to put out; by default the run's limit, or none."),
    ] = None,
    rated_torque: Annotated[
        float | None,
        typer.Option(metavar="NM|N", help="Rated torque (6076h) that the drive's per mille are of."),
    ] = None,
    lead: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Travel of a linear axis per turn of its motor (twincat-table)."),
    ] = None,
    speed: Annotated[
        float | None, typer.Option(metavar="RAD/S|M/S", help="Up to which speed tables reach.")
    ] = None,
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="Of functions and files; one for each axis.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object, nothing else.")] = False,
) -> None:
    """Write a model as C, a LinuxCNC component, an FMU, structured text, or tables."""
    from autotune.export.targets import export as export_to

    given = {"period": cycle, "torque_limit": torque_limit, "speed": speed}
    fixed = {"rated_torque": rated_torque, "lead": lead}
    request = _request(source, {**given, **fixed, "name": name})
    made = export_to(request, target)
    _write(out, made)
    _tell(made, request)
    if as_json:
        answer_json(made.as_json(target, out, request))
    else:
        for name in made.files:
            answer(f"written to {out / name}")


def _request(source: Path, given: dict[str, Any]) -> Request:
    """What is asked for, completed by what a run knows.

    Raises:
        ConfigurationError: neither model nor run, a run without a proved law, or a cycle that is not the run's.
    """
    from autotune.export.request import Request

    known: dict[str, Any]
    if source.is_dir():
        model, known = _proved(source)
        _same_cycle(source, known["period"], given["period"])
        _within_limit(source, known["torque_limit"], given["torque_limit"])
    else:
        from autotune.models.model_file import read_model

        model, known = read_model(source), {"period": USUAL_CYCLE}
        if given["period"] is None:
            say(f"no cycle is known: made for {1e3 * USUAL_CYCLE:g} ms; --cycle says another")
    asked = {name: value for name, value in given.items() if value is not None}
    return Request(model, source.name, **(known | asked))


def _proved(run: Path) -> tuple[DriveModel, dict[str, Any]]:
    """The law that a run has proved, and its cycle, limits and benchmark."""
    from autotune.control.feedforward import LugreParameters
    from autotune.control.model_feedforward import lugre_model
    from autotune.core.documents import numbers_of
    from autotune.export.request import Motion
    from autotune.models.model_file import read_model
    from autotune.tuning.files import read_json
    from autotune.tuning.findings import FILE_NAME, HOST_FILE

    found = read_json(run / FILE_NAME, "findings file")
    try:
        made = found["made_with"]
        limits, benchmark = made["limits"], made["benchmark"]
        known = numbers_of(
            {"period": made["cycle"], "torque_limit": limits["torque"], "speed": limits["speed"]}
        )
        ends = numbers_of({name: limits[name] for name in ("position_min", "position_max")})
        motion = Motion(**numbers_of({name: benchmark[name] for name in ("amplitude", "frequency")}))
        proposed = LugreParameters(**numbers_of(found["proposed"])) if "proposed" in found else None
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigurationError(
            f"{run / FILE_NAME} is damaged: {error}; export the model of the run instead"
        ) from error
    if found.get("better") is not True:
        raise ConfigurationError(
            f"run {run} has proved nothing: its feedforward is not better beyond doubt. "
            f"Export {run / 'model.toml'} to have the model as it was fitted"
        )
    more = {"motion": motion, "travel": tuple(ends.values())}
    if _holds_part(run):
        more["warnings"] = (_TWICE,)
    if found.get("law") == "model":
        return read_model(run / HOST_FILE), known | more
    if proposed is None:
        raise ConfigurationError(
            f"run {run} ended before there was a feedforward; there is nothing to export"
        )
    fitted = read_model(run / "model.toml")
    return replace(lugre_model(proposed, fitted.motion_unit), axis=fitted.axis), known | more


def _holds_part(run: Path) -> bool:
    """Whether the run has left a feedforward in the drive."""
    from autotune.tuning.files import read_json

    path = run / "run.json"
    return path.is_file() and read_json(path, "result").get("outcome") == "kept"


def _within_limit(run: Path, limit: float, asked: float | None) -> None:
    if asked is not None and asked > limit:
        raise ConfigurationError(
            f"--torque-limit is {asked:g}; run {run} was held to {limit:g}, and an export of it is not let beyond"
        )


def _same_cycle(run: Path, proved: float, asked: float | None) -> None:
    if asked is not None and abs(asked - proved) > 1e-9:
        raise ConfigurationError(
            f"run {run} has proved its feedforward at a cycle of {1e3 * proved:g} ms, not at {1e3 * asked:g} ms; "
            f"leave --cycle out, or export {run / 'model.toml'} for a law that nobody has proved at that cycle"
        )


def _write(out: Path, made: Exported) -> None:
    try:
        for name, content in made.files.items():
            path = out / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)
    except OSError as error:
        raise ConfigurationError(f"{error.filename or out} cannot be written: {error.strerror}") from error


def _tell(made: Exported, request: Request) -> None:
    from autotune.export.request import lost_in_words

    for sentence in (*lost_in_words(request, made.lost), *made.notes):
        say(sentence)
