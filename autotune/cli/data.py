"""`autotune data import`: recordings that others made become recordings of this program."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from autotune.cli.output import answer, say
from autotune.core.errors import ConfigurationError
from autotune.recordings.files import write_recording
from autotune.recordings.recording import MOTION_UNITS, Controller, Recording

CONTROLLER_HELP = (
    "Gains of its position controller in SI: torque by position (kp), by speed (kd), by position and second (ki); "
    "derivative_filter too, the share of a new difference in the filtered one, 1 - exp(-row / time constant), a row "
    "being the file's sample period. Any other law, such as cascaded loops, is found in the data: leave it out."
)
data = typer.Typer(no_args_is_help=True, help="Recordings that others made.")


@data.callback()
def _group() -> None:
    """Recordings that others made."""


@data.command("import")
def import_(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="One file or several of one axis.")],
    format_: Annotated[str, typer.Option("--format", metavar="csv|mat|epos|parquet", help="What they are.")],
    out: Annotated[Path, typer.Option(metavar="FILE", help="Recording to write: .parquet or .csv.")],
    column: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=FIELD[*FACTOR]",
            help="Column of the recording = column of the file (name, or number from 1) times what takes it to "
            "SI: a number, a unit (deg, rpm, ms, mNm), products and quotients. experiment=FIELD: labels that cut the "
            "recording into experiments.",
        ),
    ] = None,
    unit: Annotated[str | None, typer.Option(metavar="rad|m", help="Rotary or linear axis.")] = None,
    torque_unit: Annotated[
        str | None,
        typer.Option(
            metavar="Nm|mNm|N|A|V", help="Unit of the torque column; A or V: work in amperes or volts."
        ),
    ] = None,
    resolution: Annotated[float | None, typer.Option(help="One count of the encoder, in rad or m.")] = None,
    period: Annotated[
        float | None,
        typer.Option(help="Sample period in seconds: the file has no clock, or only its stamps jitter."),
    ] = None,
    speed_curve: Annotated[
        bool, typer.Option("--speed-curve", help="Each row is a constant speed with its mean torque.")
    ] = False,
    torque_limit: Annotated[float | None, typer.Option(help="Where the drive clamps its torque.")] = None,
    controller: Annotated[
        str | None, typer.Option(metavar="'pid kp=… kd=… ki=…'", help=CONTROLLER_HELP)
    ] = None,
    experiment: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Name of the segments; several files are repetitions then."),
    ] = None,
    keep_signs: Annotated[
        bool, typer.Option("--keep-signs", help="The signs are right although they look wrong.")
    ] = False,
    keep_leaps: Annotated[
        bool, typer.Option("--keep-leaps", help="The axis did leap as the position says.")
    ] = False,
) -> None:
    """Import measurements of any axis; what was recognised is said line by line."""
    from autotune.recordings.importing.importing import import_files
    from autotune.recordings.importing.options import Options, Wishes

    _check_output(out, files)
    _check_numbers({"resolution": resolution, "period": period, "torque-limit": torque_limit})
    _check_words(unit, torque_unit, experiment)
    wishes = Wishes(unit, torque_unit, resolution, period, speed_curve)
    gains = Controller.parse(controller) if controller is not None else None
    known = tuple(column or ()), wishes, torque_limit, gains, experiment
    options = Options(format_, *known, keep_signs, keep_leaps, out=str(out))
    imported = import_files(files, options)
    for line in imported.lines:
        say(line)
    write_recording(imported.recording, out)
    answer(_summary(imported.recording, out))


def _check_output(out: Path, files: list[Path]) -> None:
    if out.suffix not in (".parquet", ".csv"):
        raise ConfigurationError(
            f"--out {out} must end in .parquet or .csv; the ending decides what is written"
        )
    if not out.absolute().parent.is_dir():
        raise ConfigurationError(f"--out {out}: there is no folder {out.absolute().parent}; create it first")
    if any(file.resolve() == out.resolve() for file in files):
        raise ConfigurationError(f"--out {out} is one of the files to import; choose another name")


def _check_numbers(numbers: dict[str, float | None]) -> None:
    for name, value in numbers.items():
        if value is not None and not 0.0 < value < float("inf"):
            raise ConfigurationError(f"--{name} is {value:g}; it must be a finite number above 0")


def _check_words(unit: str | None, torque_unit: str | None, experiment: str | None) -> None:
    if unit is not None and unit not in MOTION_UNITS:
        raise ConfigurationError(f"--unit is {unit!r}; allowed are {', '.join(MOTION_UNITS)}")
    if torque_unit is not None and torque_unit not in ("Nm", "mNm", "N", "A", "V"):
        raise ConfigurationError(f"--torque-unit is {torque_unit!r}; allowed are Nm, mNm, N, A, V")
    if experiment is not None and (not experiment.strip() or set(experiment) & set(',"\r\n')):
        raise ConfigurationError(f"--experiment is {experiment!r}; write a name without commas and quotes")


def _summary(recording: Recording, out: Path) -> str:
    segments = len(recording.segments())
    seconds = len(recording) * recording.period
    return (
        f"{out}: {len(recording)} rows of {recording.period * 1e3:g} ms ({seconds:.4g} s) in {segments} "
        f"segment{'s' if segments != 1 else ''}; columns {', '.join(recording.floats)}"
    )
