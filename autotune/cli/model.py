"""`autotune model`: fit, compare, diagnose, add, show. Each works alone, on any recordings of one axis."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from autotune.cli.one_bar import one_bar
from autotune.cli.output import answer, answer_json, say
from autotune.core.errors import ConfigurationError, NotEnoughExcitation

if TYPE_CHECKING:
    from autotune.diagnosis.fit_result import FitResult
    from autotune.models.drive_model import DriveModel
    from autotune.recordings.recording import Recording

model = typer.Typer(no_args_is_help=True, help="Drive models: fit, compare, diagnose, add effects, show.")

Recordings = Annotated[list[Path], typer.Argument(metavar="RECORDING...", help="Recordings of one axis.")]
ModelFile = Annotated[Path, typer.Option("--model", metavar="MODEL.toml", help="The model.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object, nothing else.")]
Html = Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Write a page with figures.")]
Rrd = Annotated[Path | None, typer.Option("--rrd", metavar="FILE", help="Write a Rerun file.")]
NOTHING = 3
MOST_SECONDS = 300.0
"""Of a diagnosis, which takes ten to thirty for most recordings: who has seen a bar for so long wants to know."""
FIT_STEPS, DIAGNOSE_STEPS, ADD_STEPS = 4, 15, 2
"""Fits, about: a diagnosis looks at sixteen effects for each one that it finds, two of them with a load that rings."""


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
    """Fit one model to all recordings; every number with its uncertainty, what cannot be told named."""
    import autotune
    from autotune.api.known_laws import keep_laws
    from autotune.models.model_file import write_model

    _check_output(out)
    for path in (html, rrd):
        _check_folder(path)
    names = [name.strip() for name in effects.split(",") if name.strip()]
    read = _read(recordings)
    with one_bar("fit", FIT_STEPS, _rows(read)) as step:
        result = autotune.fit(
            read, effects=names, precision=precision, progress=step, source=_source(recordings)
        )
    fitted = result.model
    if fitted is not None and result.valid:
        write_model(fitted, out)
        keep_laws(out, read)
    if fitted is not None:
        _write_figures(read, fitted, result, html, rrd)
    for note in result.notes:
        say(note)
    if as_json:
        answer_json(result.to_json())
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
    import autotune
    from autotune.cli.model_text import compared_lines

    for path in (html, rrd):
        _check_folder(path)
    known, read = _with_model(model_file, recordings)
    result = autotune.compare(read, known)
    if html is not None:
        result.write_html(html)
        say(f"figures: {html}")
    if rrd is not None:
        result.write_rrd(rrd, read)
        say(f"Rerun recording: {rrd}")
    for note in result.notes:
        say(note)
    if as_json:
        answer_json(result.to_json())
    else:
        for line in compared_lines(result):
            answer(line)


@model.command()
def diagnose(
    recordings: Recordings,
    model_file: Annotated[
        Path | None,
        typer.Option(
            "--model", metavar="MODEL.toml", help="The model; without one the base model is fitted first."
        ),
    ] = None,
    as_json: Json = False,
    html: Html = None,
    rrd: Rrd = None,
    apply: Annotated[
        Path | None,
        typer.Option(metavar="MODEL.toml", help="Write the model with all that is named, fitted together."),
    ] = None,
    at_most: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            help="Then the verdict is on what was found until then, and nothing is confirmed; a fit of the base model "
            "counts, to half of them.",
        ),
    ] = MOST_SECONDS,
) -> None:
    """Tell which physical effect the model lacks, with the evidence."""
    import autotune
    from autotune.api.known_laws import keep_laws
    from autotune.cli.model_text import diagnosis_lines
    from autotune.models.model_file import write_model

    if not at_most > 0.0:
        raise ConfigurationError(f"--at-most is {at_most:g}, and must be a time above 0 s")
    for path in (html, rrd):
        _check_folder(path)
    if apply is not None:
        _check_output(apply)
    begun = time.monotonic()
    known, read = _with_base(recordings) if model_file is None else _with_model(model_file, recordings)
    left = max(at_most - (time.monotonic() - begun), 0.5 * at_most)
    with one_bar("diagnose", DIAGNOSE_STEPS, _rows(read)) as step:
        result = autotune.diagnose(read, known, at_most=left, progress=step)
    if html is not None:
        result.write_html(html)
        say(f"figures: {html}")
    if rrd is not None:
        result.write_rrd(rrd, read)
        say(f"Rerun recording: {rrd}")
    if as_json:
        answer_json(result.to_json())
    else:
        for line in diagnosis_lines(result):
            answer(line)
    if apply is not None:
        found = result.found_model(_source(recordings))
        if found is None:
            say("nothing is named, so that nothing was written")
            raise typer.Exit(NOTHING)
        write_model(found, apply)
        keep_laws(apply, read)
        say(f"the model with {', '.join(result.effects) or 'another law of its base'}: {apply}")


@model.command()
def add(
    words: Annotated[
        list[str],
        typer.Argument(
            metavar="EFFECT... RECORDING...", help="Names of effects, then recordings of one axis."
        ),
    ],
    model_file: ModelFile,
    out: Annotated[Path, typer.Option(metavar="MODEL.toml", help="Where to write the new model.")],
    as_json: Json = False,
    rrd: Rrd = None,
) -> None:
    """Add effects to a model and show how far the error falls on data that the fit never saw."""
    import autotune
    from autotune.api.known_laws import keep_laws
    from autotune.cli.model_text import added_lines
    from autotune.models.model_file import write_model

    _check_output(out)
    _check_folder(rrd)
    effects, recordings = _effects_first(words)
    given, read = _with_model(model_file, recordings)
    result, known = None, given
    with one_bar(f"add {', '.join(effects)}", ADD_STEPS * len(effects), _rows(read)) as step:
        for effect in effects:
            result = autotune.add_effect(effect, read, known, progress=step, source=_source(recordings))
            if not result.better:
                break
            known = result.model
    if result is None:
        raise ConfigurationError("no effect was named; 'autotune model effects' lists them")
    kept = result.better
    if kept:
        write_model(result.model, out)
        keep_laws(out, read)
    if rrd is not None:
        result.write_rrd(rrd, read, given)
        say(f"Rerun recording: {rrd}")
    for note in result.notes:
        say(note)
    if as_json:
        answer_json(result.to_json())
    else:
        for line in added_lines(result, out if kept else None):
            answer(line)
    if not kept:
        say(f"{result.effect} does not lower the error on unseen data; nothing was written")
        raise typer.Exit(NOTHING)


@model.command("effects")
def list_effects(
    names: Annotated[
        list[str] | None, typer.Argument(metavar="[NAME]...", help="Of these only, with their parameters.")
    ] = None,
    as_json: Json = False,
) -> None:
    """List the effects that there are: what each looks like, what causes it, what to do."""
    from autotune.models.table import EFFECTS, effect_kind

    chosen = [effect_kind(name) for name in names or EFFECTS]
    kinds = {
        kind.name: {"looks_like": kind.looks_like, "cause": kind.cause, "remedy": kind.remedy}
        for kind in chosen
    }
    if as_json:
        answer_json({"effects": kinds})
        return
    for name, words in kinds.items():
        answer(name)
        answer(f"  looks like: {words['looks_like']}")
        answer(f"  caused by:  {words['cause']}")
        answer(f"  what to do: {words['remedy']}")
        for one in EFFECTS[name].parameters if names else ():
            answer(f"  {one.name} [{one.unit}]: {one.meaning}")


@model.command()
def show(
    model_file: Annotated[Path, typer.Argument(metavar="MODEL.toml", help="The model.")],
    as_json: Json = False,
    html: Html = None,
) -> None:
    """Show what is in a model and how its error fell with every effect."""
    from autotune.cli.model_text import model_lines
    from autotune.models.as_json import shown_json
    from autotune.models.model_file import read_model

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


@model.command()
def curves(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="MODEL_OR_RECORDING...", help="Models (.toml) or recordings, one a curve."),
    ],
    as_json: Json = False,
    html: Html = None,
) -> None:
    """Steady-state friction of several lubricants, dates or temperatures side by side: does it fall with speed?"""
    from autotune.cli.curves import curves_of

    _check_folder(html)
    found, motion_unit, torque_unit = curves_of(files)
    if html is not None:
        from autotune.view.curves_page import write_curves

        write_curves(html, found, motion_unit, torque_unit)
        say(f"figures: {html}")
    if as_json:
        answer_json({"curves": [one.as_json() for one in found], "motion_unit": motion_unit})
        return
    for one in found:
        answer(one.sentence(motion_unit))


def _effects_first(words: list[str]) -> tuple[list[str], list[Path]]:
    """What is no file, before the first that is one, names effects.

    Raises:
        ConfigurationError: no recording, or an effect named twice.
    """
    first = next(
        (k for k, word in enumerate(words) if k and (Path(word).suffix or Path(word).exists())), len(words)
    )
    effects, files = words[:first], [Path(word) for word in words[first:]]
    if not files:
        raise ConfigurationError(
            f"add {' '.join(effects)} names no recording; effects come first, then recordings"
        )
    if len(set(effects)) != len(effects):
        raise ConfigurationError(f"add {' '.join(effects)} names an effect twice; name each once")
    return effects, files


def _read(paths: list[Path]) -> list[Recording]:
    from autotune.recordings.files import read_recording

    read = [read_recording(path) for path in paths]
    for remark in (remark for one in read for remark in one.metadata.remarks):
        say(remark)
    return read


def _with_model(model_file: Path, paths: list[Path]) -> tuple[DriveModel, list[Recording]]:
    """The model of a file and recordings, with the controllers that its fit found in them."""
    from autotune.api.known_laws import take_laws
    from autotune.models.model_file import read_model

    known, read = read_model(model_file), _read(paths)
    take_laws(model_file, read)
    return known, read


def _with_base(paths: list[Path]) -> tuple[DriveModel, list[Recording]]:
    """The base model, fitted to recordings, valid or not: what they lack may be what hides its parameters; and these.

    Raises:
        NotEnoughExcitation: nothing can be fitted to them.
    """
    import autotune

    read = _read(paths)
    with one_bar("fit", FIT_STEPS, _rows(read)) as step:
        fitted = autotune.fit(read, progress=step)
    if fitted.model is None:
        raise NotEnoughExcitation(fitted.estimate.reason)
    return fitted.model, read


def _rows(recordings: list[Recording]) -> int:
    return sum(len(one) for one in recordings)


def _joined(recordings: list[Recording]) -> Recording:
    from autotune.recordings.recording import concatenate

    return concatenate(recordings)


def _source(paths: list[Path]) -> str:
    return ", ".join(path.name for path in paths)


def _check_output(out: Path) -> None:
    if out.suffix != ".toml":
        raise ConfigurationError(f"--out {out} must end in .toml; a model is a TOML file")
    _check_folder(out)


def _check_folder(path: Path | None) -> None:
    if path is not None and not path.resolve().parent.is_dir():
        raise ConfigurationError(f"there is no folder {path.parent} to write {path.name} to; make it first")


def _print_fit(known: DriveModel | None, result: FitResult, out: Path) -> None:
    from autotune.cli.model_text import parameter_lines
    from autotune.diagnosis.fit_result import least_torque_line

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
    read: list[Recording], known: DriveModel, result: FitResult, html: Path | None, rrd: Path | None
) -> None:
    """The page and the Rerun recording of a fit."""
    from autotune.diagnosis.fit_recordings import compared_or_none
    from autotune.diagnosis.fit_result import least_torque_line, summary

    compared = compared_or_none(read, known) if html is not None or rrd is not None else None
    if html is not None:
        from autotune.view.fit_page import write_fit

        text = summary(result)
        if result.steady is not None:
            line = least_torque_line(result.steady, known.motion_unit)
            text += f" {line[0].upper()}{line[1:]}."
        write_fit(html, _joined(read), known, result.estimate, text, result.found, compared)
        say(f"figures: {html}")
    if rrd is not None:
        from autotune.view.compared_pages import write_fit_rrd

        write_fit_rrd(rrd, read, known, summary(result), compared)
        say(f"Rerun recording: {rrd}")
