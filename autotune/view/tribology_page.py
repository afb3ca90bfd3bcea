"""A page about a contact: stiffness, real area and break-away over load, and both hysteresis laws."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import plotly.graph_objects as go

from autotune.tribology.elements import after_reversal
from autotune.tribology.expectation import Expectation, Judged
from autotune.view import theme
from autotune.view.report import Picture, Report, Table, write_report
from autotune.view.scale import significant


def write_tribology(path: Path, found: Expectation, beside: Judged | None = None) -> None:
    """Writes the page; figures from the plain results."""
    text = (
        f"Under {found.load:g} N this contact has a stiffness at rest of "
        f"{significant(found.stiffness_at_load / 1e6)} N/µm; it grows with the load to the power "
        f"{found.exponent:.2f}."
    )
    if beside is not None:
        text += f" On the axis {beside.sentence}."
    pictures = [_stiffness(found), *_displacement(found), *_reversal(found)]
    notes = Table("Notes", ("what limits this",), [[note] for note in found.notes])
    tables = [_numbers(found), *([notes] if found.notes else [])]
    write_report(
        path,
        Report(
            f"Contact {found.name}", "information", text, pictures=pictures, tables=tables, sign_off=False
        ),
    )


def _stiffness(found: Expectation) -> Picture:
    figure = go.Figure(
        go.Scatter(
            x=found.loads, y=found.stiffness / 1e6, mode="lines", name="contact",
            line={"color": theme.MODEL},
        )
    )  # fmt: skip
    figure.update_xaxes(title="normal load [N]", type="log")
    figure.update_yaxes(title="stiffness at rest [N/µm]", type="log")
    return Picture(
        "Stiffness at rest",
        "Tangential stiffness over normal load, (2.7) and (2.17).",
        theme.finish(figure, 340),
    )


def _displacement(found: Expectation) -> list[Picture]:
    if not found.films:
        return []
    figure = go.Figure()
    for film, colour in zip(found.films, theme.SERIES * len(found.films), strict=False):
        figure.add_trace(
            go.Scatter(
                x=found.loads, y=film.over_load * 1e9, mode="lines", name=film.name, line={"color": colour}
            )
        )
    figure.update_xaxes(title="normal load [N]", type="log")
    figure.update_yaxes(title="break-away displacement [nm]", rangemode="tozero")
    caption = "How far the contact yields before it slides, F_s/σ0: almost independent of load."
    return [Picture("Break-away displacement", caption, theme.finish(figure, 340))]


def _reversal(found: Expectation) -> list[Picture]:
    if not found.films:
        return []
    film = found.films[0]
    travel = np.linspace(0.0, 6.0 * film.break_away_displacement, 200)
    elements, dahl = after_reversal(travel, stiffness=found.stiffness_at_load, break_away=film.break_away)
    figure = go.Figure()
    for name, values, colour in (
        ("elements (Masing)", elements, theme.MODEL),
        ("Dahl's equation", dahl, theme.BEFORE),
    ):
        figure.add_trace(
            go.Scatter(x=travel * 1e9, y=values, mode="lines", name=name, line={"color": colour})
        )
    figure.update_xaxes(title="travel since the reversal [nm]")
    figure.update_yaxes(title="friction [N]")
    caption = (
        "After sliding one way and turning back: distributed elements (2.18) and Dahl's equation (2.22) agree on "
        "the virgin curve and differ here by up to half the break-away force."
    )
    return [Picture(f"After a reversal ({film.name})", caption, theme.finish(figure, 360))]


def _numbers(found: Expectation) -> Table:
    rows = [
        ["stiffness at rest", f"{significant(found.stiffness_at_load / 1e6)} N/µm"],
        ["real area of contact", f"{significant(found.area_at_load * 1e6)} mm²"],
        ["mean pressure", f"{significant(found.pressure / 1e9)} GPa"],
        ["plasticity index", significant(found.plasticity)],
    ]
    for film in found.films:
        rows.append([f"break-away force, {film.name}", f"{significant(film.break_away)} N"])
        ends = sorted((film.over_load[0] * 1e9, film.over_load[-1] * 1e9))
        displacement = (
            f"{film.break_away_displacement * 1e9:.0f} nm ({ends[0]:.0f} to {ends[1]:.0f} nm between "
            f"{found.loads[0]:g} and {found.loads[-1]:g} N)"
        )
        rows.append([f"break-away displacement, {film.name}", displacement])
        rows.append([f"shear strength, {film.name}", f"{significant(film.shear_strength / 1e9)} GPa"])
    return Table(f"Under {found.load:g} N", ("quantity", "value"), rows, numeric=frozenset({1}))
