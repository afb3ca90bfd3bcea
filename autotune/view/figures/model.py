"""Where the model fails and how its error fell: residual, staircase, ranking."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from autotune.core.arrays import Floats
from autotune.view import theme
from autotune.view.data import Comparison, Rank, Residual, Step
from autotune.view.figures.parts import broken_line, empty, floor_lines, plain, small, titled
from autotune.view.scale import binned, continuous, multiple, peak, quantity, significant

LOGARITHMIC = "log10 "
SAMPLES = 800
"""Of each direction, drawn behind the means."""
_LIGHT = ("#bcd9ea", "#f0d0b3")


def measured_and_model(data: Comparison) -> go.Figure:
    """Measured and modelled over time, and what is left of it below."""
    if len(data.time) == 0:
        return empty("There is nothing to compare.")
    figure = make_subplots(rows=2, cols=1, shared_xaxes=True, row_heights=[0.66, 0.34], vertical_spacing=0.07)
    factor, unit = multiple(peak(data.measured, data.modelled), data.unit)
    time = continuous(data.time, float(np.median(np.abs(np.diff(data.time)))) if len(data.time) > 1 else 1.0)
    for values, name, colour, width in (
        (data.measured, "measured", theme.MEASURED, 1.1),
        (data.modelled, "model", theme.MODEL, 1.6),
    ):
        figure.add_trace(
            broken_line(time, values * factor, name, colour, line={"width": width}), row=1, col=1
        )
    rest = data.measured - data.modelled
    rest_factor, rest_unit = multiple(peak(rest), data.unit)
    left = broken_line(
        time,
        rest * rest_factor,
        f"residual, rms {_rms(rest, data.unit)}",
        theme.BEFORE,
        line={"width": 1},
    )
    figure.add_trace(left, row=2, col=1)
    if data.noise_floor is not None:
        ends, name = (float(time[0]), float(time[-1])), _floor_name(data.noise_floor, data.unit)
        for trace in floor_lines(ends, data.noise_floor * rest_factor, name):
            figure.add_trace(trace, row=2, col=1)
    for start, stop in data.left_out:
        figure.add_vrect(x0=start, x1=stop, fillcolor=theme.REFERENCE, opacity=0.15, line_width=0)
    figure.update_yaxes(title=titled(data.quantity, unit), row=1, col=1)
    figure.update_yaxes(title=titled("residual", rest_unit), row=2, col=1)
    figure.update_xaxes(title=titled("time", "s"), row=2, col=1)
    return theme.finish(figure, 520)


def residual_over_coordinate(data: Residual) -> go.Figure:
    """Where the residual lives: samples, and the mean of each bin with its 95 % interval, each direction by itself.

    What is opposite in the two directions, such as friction after a reversal, would be nothing in a common mean.
    """
    if len(data.values) == 0:
        return empty("There is no residual to show.")
    factor, unit = multiple(peak(data.residual), data.residual_unit)
    logarithmic = data.unit.startswith(LOGARITHMIC)
    values = 10.0**data.values if logarithmic else data.values
    x_factor, x_unit = multiple(peak(values), data.unit.removeprefix(LOGARITHMIC))
    figure = go.Figure()
    sides = _sides(data)
    for name, rows, _, light in sides:
        figure.add_trace(_samples(values[rows] * x_factor, data.residual[rows] * factor, name, light))
    for name, rows, colour, _ in sides:
        centre, mean, error = binned(
            data.values[rows], data.residual[rows] * factor, 80 if len(rows) > 8000 else 40
        )
        centre = 10.0**centre if logarithmic else centre
        figure.add_trace(
            go.Scatter(
                x=small(centre * x_factor),
                y=small(mean),
                error_y={"array": small(1.96 * error), "width": 2, "thickness": 1.2},
                mode="lines+markers",
                name=f"mean {name}",
                line={"color": colour, "width": 2},
                marker={"size": 5},
            )
        )
    x = values[np.isfinite(values)] * x_factor
    span = _span(x)
    if data.noise_floor is not None:
        name = _floor_name(data.noise_floor, data.residual_unit)
        figure.add_traces(floor_lines(span, data.noise_floor * factor, name))
    ends = tuple(float(np.log10(end)) for end in span) if logarithmic else span
    figure.update_xaxes(
        title=titled(data.coordinate.replace("_", " "), x_unit),
        range=ends,
        type="log" if logarithmic else "linear",
    )
    figure.update_yaxes(title=titled("measured − model", unit), range=_reach(data.residual * factor))
    return theme.finish(figure, 420)


def staircase(steps: Sequence[Step], noise_floor: float | None = None, unit: str = "N m") -> go.Figure:
    """The error on unseen data after each effect that was added, falling towards the noise floor."""
    if not steps:
        return empty("The model has no history yet.")
    errors = np.array([step.error for step in steps])
    factor, text = multiple(peak(errors), unit)
    names = [_spaced(step.name) for step in steps]
    figure = go.Figure(
        go.Bar(
            x=list(range(len(steps))),
            y=small(errors * factor),
            marker={"color": [theme.REFERENCE] + [theme.translucent(theme.MODEL, 0.7)] * (len(steps) - 1)},
            width=0.98,
            hovertext=names,
            name="error on unseen data",
            showlegend=False,
        )
    )
    _falls(figure, errors, factor)
    if noise_floor is not None:
        _floor_of_stairs(figure, len(steps), noise_floor * factor, quantity(noise_floor, unit))
    ticks = [f"{h}<br><b>{significant(e * factor)} {text}</b>" for h, e in zip(names, errors, strict=True)]
    figure.update_xaxes(
        tickvals=list(range(len(steps))), ticktext=ticks, showgrid=False, autotickangles=[0, 90]
    )
    figure.update_yaxes(title=titled("rms error on unseen data", text), rangemode="tozero")
    return theme.finish(figure, 400)


def ranking(ranks: Sequence[Rank]) -> go.Figure:
    """How far each candidate brings the error down; the ones that pass every gate are filled."""
    if not ranks:
        return empty("No candidate could be judged.")
    ordered = sorted(ranks, key=lambda rank: rank.gain)
    figure = go.Figure()
    gains = [100 * rank.gain for rank in ordered]
    for accepted, name, colour in ((True, "accepted", theme.MODEL), (False, "not accepted", "#c3cad4")):
        chosen = [rank for rank in ordered if rank.accepted is accepted]
        if not chosen:
            continue
        figure.add_trace(
            go.Bar(
                y=[_spaced(rank.name) for rank in chosen],
                x=[100 * rank.gain for rank in chosen],
                text=[f"{round(100 * rank.gain, 1) + 0.0:.1f} %".replace("-", "−") for rank in chosen],
                textposition="outside",
                cliponaxis=False,
                hovertext=[plain(rank.why) for rank in chosen],
                orientation="h",
                marker={"color": colour},
                name=name,
                width=0.7,
            )
        )
    figure.update_yaxes(categoryorder="array", categoryarray=[_spaced(rank.name) for rank in ordered])
    reach = max(max(gains), -min(gains), 1e-3)
    figure.update_xaxes(
        title="Fall of the unseen error [%]",
        range=[
            min(0.0, min(gains)) - (0.3 * reach if min(gains) < 0 else 0.0),
            max(0.0, max(gains)) + 0.3 * reach,
        ],
    )
    figure.update_layout(barmode="overlay", showlegend=True)
    return theme.finish(figure, 120 + 28 * len(ordered))


def _sides(data: Residual) -> list[tuple[str, NDArray[np.int64], str, str]]:
    """Rows of each direction with their name and colours; all in one where no direction is known."""
    good = np.isfinite(data.values) & np.isfinite(data.residual)
    if data.direction is None:
        return [("in the bin", np.flatnonzero(good), theme.BEFORE, _LIGHT[1])]
    sides = []
    for name, sign, colour, light in (
        ("forwards", 1.0, theme.AFTER, _LIGHT[0]),
        ("backwards", -1.0, theme.BEFORE, _LIGHT[1]),
    ):
        rows = np.flatnonzero(good & (np.sign(data.direction) == sign))
        if rows.size:
            sides.append((name, rows, colour, light))
    return sides


def _samples(x: Floats, y: Floats, name: str, colour: str) -> go.Scatter:
    """Every so many-th sample, drawn pale: how wide they lie, not each of them."""
    step = max(1, len(x) // SAMPLES)
    return go.Scatter(
        x=small(x[::step]), y=small(y[::step]), mode="markers", name=f"samples {name}", showlegend=False,
        hoverinfo="skip", marker={"color": colour, "size": 3},
    )  # fmt: skip


def _reach(y: Floats) -> tuple[float, float]:
    """What is shown of the residual: single outliers do not press the rest flat."""
    finite = y[np.isfinite(y)]
    low, high = _span(np.percentile(finite, [0.2, 99.8]) if finite.size > 1000 else finite)
    margin = 0.08 * (high - low)
    return low - margin, high + margin


def _span(values: Floats) -> tuple[float, float]:
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _floor_name(floor: float, unit: str) -> str:
    return f"noise floor, {quantity(floor, unit)} rms"


def _floor_of_stairs(figure: go.Figure, steps: int, floor: float, text: str) -> None:
    figure.add_trace(
        go.Scatter(
            x=[-0.5, steps - 0.5],
            y=[floor, floor],
            mode="lines",
            name=f"noise floor, {text} (an estimate)",
            showlegend=True,
            line={"color": theme.GOOD, "dash": "dash", "width": 2},
        )
    )


def _falls(figure: go.Figure, errors: Floats, factor: float) -> None:
    for index in range(1, len(errors)):
        change = errors[index] / errors[index - 1] - 1 if errors[index - 1] > 0 else 0.0
        figure.add_annotation(
            x=index, y=float(errors[index - 1]) * factor, text=f"{100 * change:+.0f} %".replace("-", "−"),
            showarrow=False, yanchor="bottom", font={"color": theme.MUTED},
        )  # fmt: skip
        figure.add_shape(
            type="line", x0=index - 0.49, x1=index + 0.49,
            y0=float(errors[index - 1]) * factor, y1=float(errors[index - 1]) * factor,
            line={"color": theme.REFERENCE, "width": 1, "dash": "dot"},
        )  # fmt: skip


def _rms(values: Floats, unit: str) -> str:
    return quantity(float(np.sqrt(np.nanmean(values**2))), unit)


def _spaced(name: str) -> str:
    return plain(name.replace("_", " "))
