"""Pieces that several figures share: thinned lines, bands, axis titles."""

from __future__ import annotations

import html

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.view import theme
from autotune.view.scale import thin


def line(x: Floats, y: Floats, name: str, colour: str, **more: object) -> go.Scatter:
    """A line, thinned to what a screen can show; `more` goes to the trace."""
    rows = thin(y)
    style = {"color": colour, "width": 2, "simplify": False} | dict(more.pop("line", {}))  # type: ignore[call-overload]
    return go.Scatter(x=small(x[rows]), y=small(y[rows]), name=plain(name), mode="lines", line=style, **more)


def broken_line(time: Floats, y: Floats, name: str, colour: str, **more: object) -> go.Scatter:
    """As `line`, but broken where time jumps: what was not recorded is not drawn."""
    trace = line(time, y, name, colour, **more)
    if len(time) < 3:
        return trace
    step = np.diff(time)
    jumps = np.flatnonzero(step > 5 * np.median(step))
    rows = thin(y)
    after = np.unique(np.searchsorted(rows, jumps + 1))
    after = after[(after > 0) & (after < len(rows))]
    trace.x = small(np.insert(time[rows], after, time[rows][after]))
    trace.y = small(np.insert(y[rows], after, np.nan))
    return trace


def band(x: Floats, low: Floats, high: Floats, colour: str, name: str, **more: object) -> go.Scatter:
    """A filled band between two curves."""
    rows = np.linspace(0, len(x) - 1, min(len(x), 360)).round().astype(int)
    return go.Scatter(
        x=small(np.concatenate([x[rows], x[rows][::-1]])),
        y=small(np.concatenate([high[rows], low[rows][::-1]])),
        name=plain(name),
        fill="toself",
        fillcolor=theme.translucent(colour, 0.25),
        line={"width": 0},
        hoverinfo="skip",
        mode="lines",
        **more,
    )


def small(values: Floats) -> NDArray[np.float32]:
    """Single precision: half the size in the report, more digits than a screen has."""
    return np.asarray(values, dtype=np.float32)


def plain(text: str) -> str:
    """Text from outside, safe where plotly understands mark-up."""
    return html.escape(text, quote=False)


def titled(quantity: str, unit: str) -> str:
    """Axis title: `Torque [mN m]`."""
    return f"{quantity[:1].upper()}{quantity[1:]} [{plain(unit)}]" if unit else quantity


def empty(message: str, height: int = 260) -> go.Figure:
    """A figure that says why there is nothing to see."""
    figure = go.Figure()
    figure.add_annotation(
        text=plain(message), x=0.5, y=0.5, xref="paper", yref="paper", showarrow=False, font={"size": 14}
    )
    figure.update_xaxes(visible=False)
    figure.update_yaxes(visible=False)
    return theme.finish(figure, height)


def motion_name(motion_unit: str) -> str:
    """Force for axes that slide, torque for axes that turn."""
    return "Force" if motion_unit == "m" else "Torque"


def floor_lines(ends: tuple[float, float], floor: float, label: str) -> list[go.Scatter]:
    """Dashed lines at plus and minus the noise floor, named once in the legend."""
    style = {"color": theme.GOOD, "dash": "dash", "width": 2}
    return [
        go.Scatter(
            x=list(ends),
            y=[level, level],
            mode="lines",
            name=plain(label),
            line=style,
            legendgroup="floor",
            showlegend=level > 0,
            hoverinfo="skip",
        )
        for level in (floor, -floor)
    ]
