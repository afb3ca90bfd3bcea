"""`autotune tribology`: what a rough contact should show, beside what was identified on an axis."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from autotune.cli.output import answer, answer_json, say
from autotune.core.errors import ConfigurationError

if TYPE_CHECKING:
    from autotune.tribology.expectation import Expectation, Judged


def tribology(
    surface: Annotated[Path, typer.Argument(metavar="SURFACE.toml", help="Surface, material and load.")],
    axis: Annotated[
        Path | None, typer.Option(metavar="MODEL.toml", help="An axis's model to hold beside it.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object, nothing else.")] = False,
    html: Annotated[Path | None, typer.Option("--html", metavar="FILE", help="Write a page.")] = None,
) -> None:
    """Tell what a contact of this surface, material and load should show: stiffness at rest, break-away."""
    from autotune.tribology.configuration import read_contact
    from autotune.tribology.expectation import expected

    if html is not None and not html.absolute().parent.is_dir():
        raise ConfigurationError(f"there is no folder {html.absolute().parent} for {html.name}")
    file = read_contact(surface)
    found = expected(file)
    beside = None if axis is None else _beside(axis, surface)
    if html is not None:
        from autotune.view.tribology_page import write_tribology

        write_tribology(html, found, beside)
        say(f"figures: {html}")
    if as_json:
        answer_json({**found.to_json(), "axis": None if beside is None else beside.to_json()})
        return
    for line in _lines(found, beside):
        answer(line)


def _beside(model_file: Path, surface: Path) -> Judged:
    from autotune.models.model_file import read_model
    from autotune.models.total_friction import stiffness_at_rest
    from autotune.tribology.configuration import read_contact
    from autotune.tribology.expectation import expected, judged

    file, model = read_contact(surface), read_model(model_file)
    if file.place is None:
        raise ConfigurationError(
            f"{surface}: where the contact sits on the axis is not told; add [place] with metres_per_motor_unit "
            "(for a screw: lead over 2π; for a carriage on a linear motor: 1) and contacts"
        )
    unit = model.unit("stiffness")
    return judged(file, expected(file), identified=stiffness_at_rest(model), unit=unit)


def _lines(found: Expectation, beside: Judged | None) -> Iterator[str]:
    from autotune.view.scale import significant

    yield f"{found.name} under {found.load:g} N"
    yield f"  stiffness at rest    {significant(found.stiffness_at_load / 1e6)} N/µm, ∝ load^{found.exponent:.2f}"
    yield f"  real area of contact {significant(found.area_at_load * 1e6)} mm²"
    for film in found.films:
        ends = sorted((film.over_load[0] * 1e9, film.over_load[-1] * 1e9))
        yield (
            f"  {film.name}: breaks away at {significant(film.break_away)} N after "
            f"{film.break_away_displacement * 1e9:.0f} nm ({ends[0]:.0f} to {ends[1]:.0f} nm between "
            f"{found.loads[0]:g} and {found.loads[-1]:g} N), shear strength "
            f"{significant(film.shear_strength / 1e9)} GPa"
        )
    for note in found.notes:
        yield f"  note: {note}"
    if beside is not None:
        yield beside.sentence
