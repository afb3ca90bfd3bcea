"""Figures of the loop: Bode pictures of both regimes (4.10, 6.16), steps (6.15), the catalogue's sines (6.17, 6.18)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from autotune.core.arrays import Floats
from autotune.view import theme
from autotune.view.colours import SERIES
from autotune.view.figures.parts import band, empty, line, plain, titled
from autotune.view.scale import multiple, peak

SHOWN_PERIODS = 2


@dataclass(frozen=True, slots=True)
class LoopCurve:
    """|L| [dB] and its phase [deg] over frequency [Hz], shape (n,) each; `dashed` for today's gains."""

    name: str
    frequency: Floats
    magnitude: Floats
    phase: Floats
    dashed: bool


@dataclass(frozen=True, slots=True)
class TimeCurve:
    """Something over time [s], shape (n,)."""

    name: str
    time: Floats
    values: Floats


@dataclass(frozen=True, slots=True)
class SteadyCurve:
    """A steady-state characteristic: torque over speed with its 95 % band, shape (n,) each."""

    name: str
    speed: Floats
    torque: Floats
    low: Floats
    high: Floats


def bode(curves: Sequence[LoopCurve]) -> go.Figure:
    """Open loops in both regimes, magnitude above phase; the lines at 0 dB and −180° are where margins are read."""
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06)
    for number, curve in enumerate(curves):
        style = {"dash": "dash"} if curve.dashed else {}
        colour = SERIES[number % len(SERIES)]
        above = line(curve.frequency, curve.magnitude, curve.name, colour)
        below = line(curve.frequency, curve.phase, curve.name, colour, showlegend=False)
        for trace, row in ((above, 1), (below, 2)):
            trace.line.update(style)
            figure.add_trace(trace, row=row, col=1)
    figure.update_xaxes(type="log")
    figure.update_xaxes(title=titled("frequency", "Hz"), row=2, col=1)
    figure.update_yaxes(title=titled("loop gain", "dB"), range=[-40, 60], row=1, col=1)
    figure.update_yaxes(title=titled("phase", "deg"), range=[-360, 0], row=2, col=1)
    figure.add_hline(y=0.0, line_color=theme.REFERENCE, line_width=1, row=1, col=1)
    figure.add_hline(y=-180.0, line_color=theme.REFERENCE, line_width=1, row=2, col=1)
    return theme.finish(figure, 520)


def over_time(curves: Sequence[TimeCurve], quantity: str, unit: str) -> go.Figure:
    """Curves over time in one frame."""
    if not curves:
        return empty("Nothing was simulated.")
    factor, shown = multiple(peak(*(curve.values for curve in curves)), unit)
    figure = go.Figure()
    for number, curve in enumerate(curves):
        figure.add_trace(
            line(curve.time, curve.values * factor, plain(curve.name), SERIES[number % len(SERIES)])
        )
    figure.update_xaxes(title=titled("time", "s"))
    figure.update_yaxes(title=titled(quantity, shown))
    return theme.finish(figure, 380)


def bars(values: Mapping[str, float], quantity: str, unit: str, marked: str = "") -> go.Figure:
    """One bar for each structure; the marked one in the colour of what is good."""
    finite = {name: value for name, value in values.items() if np.isfinite(value)}
    factor, shown = multiple(max(finite.values(), default=1.0), unit)
    colours = [theme.GOOD if name == marked else theme.MODEL for name in finite]
    figure = go.Figure(
        go.Bar(
            x=[value * factor for value in finite.values()],
            y=[plain(name) for name in finite],
            orientation="h",
            marker_color=colours,
        )
    )
    figure.update_yaxes(autorange="reversed")
    figure.update_xaxes(title=titled(quantity, shown))
    return theme.finish(figure, 60 + 28 * max(len(finite), 4))


def characteristics(curves: Sequence[SteadyCurve], motion_unit: str, torque_unit: str) -> go.Figure:
    """Steady-state friction over speed, each with its band (Figures 6.1 and 6.11)."""
    factor, shown = multiple(peak(*(curve.torque for curve in curves)), torque_unit)
    figure = go.Figure()
    for number, curve in enumerate(curves):
        colour, name = SERIES[number % len(SERIES)], plain(curve.name)
        figure.add_trace(
            band(curve.speed, curve.low * factor, curve.high * factor, colour, name, showlegend=False)
        )
        figure.add_trace(line(curve.speed, curve.torque * factor, name, colour))
    figure.update_xaxes(title=titled("speed", f"{motion_unit}/s"))
    figure.update_yaxes(title=titled("friction", shown))
    return theme.finish(figure, 460)
