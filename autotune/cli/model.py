"""`autotune model`: fit, compare, diagnose, add, show. Each works alone, on any recordings of one axis."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from autotune.cli.output import answer, answer_json, say
from autotune.core.errors import ConfigurationError
from autotune.core.recording import Recording
from autotune.core.recording_files import read_recording
from autotune.models.drive_model import DriveModel, HistoryEntry
from autotune.models.model_file import read_model, write_model

if TYPE_CHECKING:
    from autotune.cli.model_fit import Fit

model = typer.Typer(no_args_is_help=True, help="Drive models: fit, compare, diagnose, add effects, show.")

Recordings = Annotated[list[Path], typer.Argument(metavar="RECORDING...", help="Recordings of one axis.")]
ModelFile = Annotated[Path, typer.Option("--model", metavar="MODEL.toml", help="The model.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object, nothing else.")]
Html = Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Write a page with figures.")]
Rrd = Annotated[Path | None, typer.Option("--rrd", metavar="FILE", help="Write a Rerun file.")]
APPLIED, NOTHING = 0, 3


@model.callback()
def _group() -> None:
    """Drive models."""


@model.command()
def fit(
    recordings: Recordings,
    out: Annotated[Path, typer.Option(metavar="MODEL.toml", help="Where to write the model.")],
    effects: Annotated[
        str, typer.Option(metavar="NAME,...", help="Effects to fit beside the base model.")
    ] = "",
    precision: Annotated[
        float | None,
        typer.Option(
            metavar="RAD|M",
            help="What positions are to be held to: decides whether the kinetic model will do. "
            "By default 1 mrad or 10 µm.",
        ),
    ] = None,
    as_json: Json = False,
    html: Html = None,
    rrd: Rrd = None,
) -> None:
    """Fit a model to recordings; every number with its uncertainty, what cannot be told named."""
    from autotune.cli.model_fit import fit_files, fit_json

    _check_output(out)
    for path in (html, rrd):
        _check_folder(path)
    names = [name.strip() for name in effects.split(",") if name.strip()]
    read = _read(recordings)
    result = fit_files(read, names, precision, say)
    entry = HistoryEntry(_now(), "fitted", _source(recordings), None, result.error_rms, result.floor)
    fitted = result.model.with_history(entry) if result.model is not None else None
    if fitted is not None and result.valid:
        write_model(fitted, out)
    if fitted is not None:
        _write_figures(read, fitted, result, html, rrd)
    for note in result.notes:
        say(note)
    if as_json:
        answer_json(fit_json(result, _parameters(fitted) if fitted else {}))
    else:
        _print_fit(fitted, result, out)
    if not result.valid:
        raise typer.Exit(NOTHING)


@model.command()
def compare(
    recordings: Recordings,
    model_file: ModelFile,
    as_json: Json = False,
    html: Html = None,
    rrd: Rrd = None,
) -> None:
    """Compare a model with recordings: how large the error is, and where it sits."""
    from autotune.cli.model_text import compared_json, compared_lines
    from autotune.diagnose.compare import compare as compare_model

    for path in (html, rrd):
        _check_folder(path)
    known, read = read_model(model_file), _read(recordings)
    result = compare_model(read, known)
    if html is not None:
        from autotune.view.model_pages import write_comparison

        write_comparison(html, result, known)
        say(f"figures: {html}")
    if rrd is not None:
        _write_rerun(rrd, read, known)
    for note in result.notes:
        say(note)
    if as_json:
        answer_json(compared_json(result, known))
    else:
        for line in compared_lines(result, known):
            answer(line)


@model.command()
def diagnose(recordings: Recordings, model_file: ModelFile, as_json: Json = False, html: Html = None) -> None:
    """Tell which physical effect the model lacks, with the evidence."""
    from autotune.cli.model_text import diagnosis_json, diagnosis_lines
    from autotune.diagnose.adapter import diagnose_recordings

    _check_folder(html)
    known = read_model(model_file)
    result = diagnose_recordings(_read(recordings), known, say)
    if html is not None:
        from autotune.view.model_pages import write_diagnosis

        write_diagnosis(html, result, known)
        say(f"figures: {html}")
    if as_json:
        answer_json(diagnosis_json(result, known))
    else:
        for line in diagnosis_lines(result, known):
            answer(line)


@model.command()
def add(
    effect: Annotated[str, typer.Argument(metavar="EFFECT", help="Name of the effect.")],
    recordings: Recordings,
    model_file: ModelFile,
    out: Annotated[Path, typer.Option(metavar="MODEL.toml", help="Where to write the new model.")],
    as_json: Json = False,
) -> None:
    """Add an effect to a model and show how far the error falls on data that the fit never saw."""
    from autotune.cli.model_text import added_json, added_lines
    from autotune.diagnose.adding import add_effect

    _check_output(out)
    known = read_model(model_file)
    result = add_effect(effect, _read(recordings), known, _now(), _source(recordings), say)
    kept = result.error_after < result.error_before
    if kept:
        write_model(result.model, out)
    for note in result.notes:
        say(note)
    if as_json:
        answer_json(added_json(result))
    else:
        for line in added_lines(effect, result, out if kept else None):
            answer(line)
    if not kept:
        say(f"{effect} does not lower the error on unseen data; nothing was written")
        raise typer.Exit(NOTHING)


@model.command()
def show(
    model_file: Annotated[Path, typer.Argument(metavar="MODEL.toml", help="The model.")],
    as_json: Json = False,
    html: Html = None,
) -> None:
    """Show what is in a model and how its error fell with every effect."""
    from autotune.cli.model_text import model_lines, shown_json

    _check_folder(html)
    known = read_model(model_file)
    if html is not None:
        from autotune.view.model_pages import write_story

        write_story(html, known)
        say(f"figures: {html}")
    if as_json:
        answer_json(shown_json(known))
    else:
        for line in model_lines(known):
            answer(line)


def _read(paths: list[Path]) -> list[Recording]:
    return [read_recording(path) for path in paths]


def _joined(recordings: list[Recording]) -> Recording:
    from autotune.core.recording import concatenate

    return concatenate(recordings)


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="seconds")


def _source(paths: list[Path]) -> str:
    return ", ".join(path.name for path in paths)


def _check_output(out: Path) -> None:
    if out.suffix != ".toml":
        raise ConfigurationError(f"--out {out} must end in .toml; a model is a TOML file")
    _check_folder(out)


def _check_folder(path: Path | None) -> None:
    if path is not None and not path.resolve().parent.is_dir():
        raise ConfigurationError(f"there is no folder {path.parent} to write {path.name} to; make it first")


def _parameters(known: DriveModel) -> dict[str, Any]:
    from autotune.cli.model_text import parameters_json

    return parameters_json(known)


def _print_fit(known: DriveModel | None, result: Fit, out: Path) -> None:
    from autotune.cli.model_fit import least_torque_line
    from autotune.cli.model_text import parameter_lines

    for line in parameter_lines(known) if known is not None else []:
        mark = "  not identified" if line.split()[0] in result.not_identified else ""
        answer(line + mark)
    answer(f"relative error {100 * result.estimate.relative_error:.2f} %")
    if result.complexity is not None:
        answer(result.complexity.text)
    if result.steady is not None and known is not None:
        answer(least_torque_line(result.steady, known.motion_unit))
    if result.estimate.reason:
        answer(result.estimate.reason if result.valid else f"not valid: {result.estimate.reason}")
    if result.valid:
        answer(f"written to {out}")


def _write_figures(
    read: list[Recording], known: DriveModel, result: Fit, html: Path | None, rrd: Path | None
) -> None:
    """The page and the Rerun recording of a fit."""
    from autotune.cli.model_fit import compared_or_none, summary

    if html is not None:
        from autotune.view.fit_page import write_fit

        compared = compared_or_none(read, known)
        write_fit(html, _joined(read), known, result.estimate, summary(result), result.found, compared)
        say(f"figures: {html}")
    if rrd is not None:
        _write_rerun(rrd, read, known)


def _write_rerun(rrd: Path, read: list[Recording], known: DriveModel) -> None:
    """Recording and model in one file: the model's torque beside the measured one, parameters at the end."""
    from autotune.cli.model_fit import model_torque
    from autotune.view.rerun_file import FinalValue, Shown, write_rrd

    finals = [
        FinalValue(name, value.value, value.standard_error, known.unit(name))
        for name, value in known.parameters.items()
    ]
    whole = _joined(read)
    write_rrd(rrd, whole, Shown(torque_model=model_torque(whole, known), parameters=finals))
    say(f"Rerun recording: {rrd}")
