"""What tuning achieved: before and after (figure 6.17), parameters as they converge, years of checks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from autotune.core.arrays import Floats
from autotune.view import theme
from autotune.view.data import BeforeAfter, History, Trace
from autotune.view.figures.parts import band, empty, line, plain, small, titled
from autotune.view.scale import multiple, peak, quantity, significant


def before_after(data: BeforeAfter) -> go.Figure:
    """Reference, and below it the period-averaged errors, each with its spread over the repeats.

    Reversals of the reference are marked: that is where the quadrant glitch sits. The grey stripe is
    one count of the position sensor to either side.
    """
    if len(data.time) == 0:
        return empty("The benchmark was not measured.")
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, row_heights=[0.27, 0.73], vertical_spacing=0.05)
    reference_factor, reference_unit = multiple(peak(data.reference), data.motion_unit)
    factor, unit = multiple(peak(data.before, data.after, data.committed), data.motion_unit)
    figure.add_trace(
        line(data.time, data.reference * reference_factor, "reference", theme.REFERENCE, showlegend=False),
        row=1,
        col=1,
    )
    sets = [(data.before, data.before_name, theme.BEFORE)]
    if data.committed is not None:
        sets.append((data.committed, data.committed_name, theme.GOOD))
    sets.append((data.after, data.after_name, theme.AFTER))
    for errors, name, colour in sets:
        for trace in _mean_and_band(data.time, errors * factor, _label(errors, name, factor, unit), colour):
            figure.add_trace(trace, row=2, col=1)
    _mark_reversals(figure, data)
    if data.resolution:
        _mark_count(figure, data.resolution, factor, data.motion_unit)
    figure.update_yaxes(title=titled("reference", reference_unit), nticks=4, row=1, col=1)
    figure.update_yaxes(title=titled("tracking error", unit), row=2, col=1)
    figure.update_xaxes(title=titled("time in the period", "s"), row=2, col=1)
    return theme.finish(figure, 560)


def convergence(traces: Sequence[Trace]) -> go.Figure:
    """Every adapted parameter over time, with its bounds and the value of the refinement; one below the other."""
    if not traces:
        return empty("Nothing was adapted in this run.")
    rows = len(traces)
    figure = make_subplots(
        rows=rows,
        cols=1,
        shared_xaxes=True,
        subplot_titles=[_subtitle(trace) for trace in traces],
        vertical_spacing=0.22 / rows if rows > 1 else 0.1,
    )
    for title in figure.layout.annotations:  # in the middle they look like labels of the axis above
        title.update(x=0.0, xanchor="left")
    for index, trace in enumerate(traces):
        _converging(figure, trace, index + 1, 1, first=index == 0)
    figure.update_xaxes(title=titled("time", "s"), row=rows, col=1)
    height = 90 + (230 if rows == 1 else 170 * rows)
    figure = theme.finish(figure, height)
    figure.update_annotations(font={"size": 13, "color": theme.INK})
    figure.update_layout(legend={"y": 1 + 46 / height}, margin={"t": 76})
    return figure


def history(data: History) -> go.Figure:
    """One number of the axis over its life, with the band it should stay in."""
    if len(data.when) == 0:
        return empty("No check has been stored yet.")
    factor, unit = multiple(peak(data.value), data.unit)
    days = (np.asarray(data.when) * 1e3).astype("datetime64[ms]")
    bars = (
        None
        if data.error is None
        else {
            "array": small(1.96 * data.error * factor),
            "width": 0,
            "thickness": 1,
            "color": theme.REFERENCE,
        }
    )
    figure = go.Figure(
        go.Scatter(
            x=days,
            y=small(data.value * factor),
            error_y=bars,
            mode="lines+markers",
            name=plain(data.name.replace("_", " ")),
            line={"color": theme.MODEL, "width": 1.5},
            marker={"size": 6},
        )
    )
    if data.warning is not None:
        low, high = (edge * factor for edge in data.warning)
        figure.add_hrect(y0=low, y1=high, fillcolor=theme.translucent(theme.GOOD, 0.10), line_width=0)
    for moment, text in data.events:
        stamp = np.datetime64(int(moment * 1e3), "ms").astype(str)
        figure.add_vline(x=stamp, line={"color": theme.MUTED, "dash": "dot", "width": 1})
        figure.add_annotation(x=stamp, y=1, yref="paper", text=plain(text), showarrow=False, yanchor="bottom")
    figure.update_yaxes(title=titled(data.name.replace("_", " "), unit))
    figure.update_layout(showlegend=False)
    return theme.finish(figure, 340)


def _label(errors: Floats, name: str, factor: float, unit: str) -> str:
    highest = peak(np.mean(np.atleast_2d(errors), axis=0))
    return f"{name}: peak {significant(highest * factor)} {unit}"


def _mean_and_band(time: Floats, errors: Floats, name: str, colour: str) -> list[go.Scatter]:
    errors = np.atleast_2d(errors)
    mean = errors.mean(axis=0)
    traces = [line(time, mean, name, colour, legendgroup=name)]
    if len(errors) > 1:
        low, high = errors.min(axis=0), errors.max(axis=0)
        traces.insert(0, band(time, low, high, colour, name, legendgroup=name, showlegend=False))
    return traces


def reversal_times(time: Floats, reference: Floats) -> list[float]:
    """Instants at which the reference turns round [s]: largest and smallest values, plateaus once."""
    direction = np.sign(np.diff(reference))
    moving = np.flatnonzero(direction)
    turns = moving[:-1][direction[moving[:-1]] != direction[moving[1:]]] + 1
    return [float(time[turn]) for turn in turns]


def _mark_reversals(figure: go.Figure, data: BeforeAfter) -> None:
    turns = reversal_times(data.time, data.reference)
    if len(turns) > 12:
        return
    for turn in turns:
        figure.add_vline(x=turn, line={"color": theme.REFERENCE, "width": 1, "dash": "dot"})
    if turns:
        figure.add_annotation(
            x=turns[0], y=1, xref="x2", yref="y2 domain", text="reversal", showarrow=False,
            xanchor="left", yanchor="top", xshift=4,
        )  # fmt: skip


def _mark_count(figure: go.Figure, resolution: float, factor: float, unit: str) -> None:
    figure.add_hrect(
        y0=-resolution * factor,
        y1=resolution * factor,
        fillcolor=theme.translucent(theme.MUTED, 0.22),
        line_width=0,
        layer="below",
        row=2,
        col=1,
    )
    figure.add_annotation(
        x=1, y=resolution * factor, xref="x2 domain", yref="y2", showarrow=False,
        xanchor="right", yanchor="bottom",
        text=f"±1 count ({quantity(resolution, unit)})",
    )  # fmt: skip


def _converging(figure: go.Figure, trace: Trace, row: int, column: int, *, first: bool) -> None:
    factor, unit = multiple(peak(trace.value), trace.unit)
    time, value = trace.time, trace.value * factor
    adapted = line(time, value, "adapted", theme.MEASURED, legendgroup="adapted", showlegend=first)
    figure.add_trace(adapted, row=row, col=column)
    if trace.lower is not None and trace.upper is not None and len(time):
        _bounds(figure, trace, factor, row, column, first)
    if trace.refined is not None and len(time):
        refined = trace.refined * factor
        bars = {"array": [1.96 * trace.error * factor], "width": 5} if trace.error else None
        figure.add_trace(
            go.Scatter(
                x=[float(time[-1])],
                y=[refined],
                error_y=bars,
                mode="markers+text",
                text=[significant(refined)],
                textposition="top left" if len(time) and refined >= value[-1] else "bottom left",
                textfont={"color": theme.MODEL},
                name="after refinement",
                legendgroup="refined",
                showlegend=first,
                marker={"symbol": "diamond", "size": 9, "color": theme.MODEL},
                cliponaxis=False,
            ),
            row=row,
            col=column,
        )
    figure.update_yaxes(
        title=plain(unit) and f"[{plain(unit)}]", range=_window(trace, factor), row=row, col=column
    )


def _subtitle(trace: Trace) -> str:
    name = plain(trace.name.replace("_", " "))
    if trace.lower is None or trace.upper is None:
        return name
    factor, unit = multiple(peak(trace.value), trace.unit)
    low, high = significant(trace.lower * factor, 2), significant(trace.upper * factor, 2)
    return f"{name} <span style='color:{theme.MUTED}'>(held to {low} … {high} {plain(unit)})</span>"


def _window(trace: Trace, factor: float) -> list[float] | None:
    """Range of the ordinate: the values with some room; bounds show where they are near."""
    shown = trace.value[np.isfinite(trace.value)] * factor
    if trace.refined is not None:
        reach = 1.96 * (trace.error or 0.0)
        shown = np.append(shown, [(trace.refined - reach) * factor, (trace.refined + reach) * factor])
    if not shown.size:
        return None
    low, high = float(shown.min()), float(shown.max())
    room = 0.2 * (high - low) + 0.05 * max(abs(low), abs(high)) + 1e-12
    return [low - room, high + room]


def _bounds(figure: go.Figure, trace: Trace, factor: float, row: int, column: int, first: bool) -> None:
    ends = np.array([trace.time[0], trace.time[-1]])
    for index, bound in enumerate((trace.lower, trace.upper)):
        figure.add_trace(
            line(
                ends,
                np.full(2, float(bound or 0.0) * factor),
                "bounds",
                theme.REFERENCE,
                line={"dash": "dash", "width": 1.2},
                legendgroup="bounds",
                showlegend=first and index == 0,
            ),
            row=row,
            col=column,
        )
