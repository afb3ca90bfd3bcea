"""What the Rerun viewer shows of an axis, live and from a file: plots, columns, blueprint.

One wide entity a plot, sent as columns; times as integer nanoseconds, as float seconds are truncated;
names and colours static. Importing this imports rerun (0.3 s, 100 MB): do it only where something is
shown or saved.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.view.data import torque_unit
from autotune.view.plane import Plane

# The viewer is dark: the theme's hues, lighter.
GREY, BLUE, ORANGE, GREEN, PINK = "#aab4c0", "#56b4e9", "#e69f00", "#2fbf95", "#e39fc6"
LANES = ("#2f6f94", "#8a6100", "#1d765c", "#8a4f73", "#5a636e")

APPLICATION = "autotune"
TIMELINE = "machine_time"
BLOCK = 16384


class Line(NamedTuple):
    """One line of a plot: `plus` less `minus` (a column name, or none), times `factor`."""

    name: str
    colour: str
    plus: str
    minus: str = ""
    factor: float = 1.0


class Plot(NamedTuple):
    """One plot of several lines: one entity."""

    entity: str
    title: str
    lines: tuple[Line, ...]


def plots(motion_unit: str, unit_of_torque: str = "") -> tuple[Plot, ...]:
    """The plots of an axis, most telling first; the torque is in N m or N unless a unit is given."""
    torque = torque_unit(motion_unit, unit_of_torque)
    return (
        Plot(
            "traces/error",
            f"Tracking error [m{motion_unit}]",
            (Line("error", ORANGE, "reference", "position", 1e3),),
        ),
        Plot(
            "traces/position",
            f"Position [{motion_unit}]",
            (Line("reference", GREY, "reference"), Line("measured", BLUE, "position")),
        ),
        Plot(
            "traces/torque",
            f"Torque [{torque}]",
            (
                Line("measured", GREY, "torque"),
                Line("demand", BLUE, "torque_command"),
                Line("feedforward", GREEN, "torque_feedforward"),
                Line("feedback (u_PID)", ORANGE, "torque_feedback"),
                Line("model", PINK, "torque_model"),
            ),
        ),
        Plot(
            "traces/velocity",
            f"Velocity [{motion_unit}/s]",
            (Line("velocity", BLUE, "velocity"),),
        ),
        Plot("traces/temperature", "Temperature [°C]", (Line("temperature", ORANGE, "temperature"),)),
    )


def available(plot: Plot, columns: Mapping[str, Floats]) -> Plot | None:
    """The plot with the lines that have data; None where none has."""
    lines = tuple(
        line
        for line in plot.lines
        if all(
            name in columns and np.isfinite(columns[name]).any() for name in (line.plus, line.minus) if name
        )
    )
    return plot._replace(lines=lines) if lines else None


def send_names(stream: rr.RecordingStream, shown: Sequence[Plot]) -> None:
    """Names and colours of all lines, static."""
    for plot in shown:
        colours = np.array([rgba(line.colour) for line in plot.lines], dtype=np.uint32)
        names = [line.name for line in plot.lines]
        stream.log(plot.entity, rr.SeriesLines(names=names, colors=colours, widths=1.5), static=True)


def send_rows(
    stream: rr.RecordingStream,
    shown: Sequence[Plot],
    time_ns: NDArray[np.int64],
    columns: Mapping[str, Floats],
) -> None:
    """Sends rows of all plots; `columns` by name, each of shape (n,)."""
    for start in range(0, len(time_ns), BLOCK):
        rows = slice(start, start + BLOCK)
        index = time_column(time_ns[rows])
        for plot in shown:
            values = np.column_stack([_value(line, columns, rows) for line in plot.lines])
            scalars = rr.Scalars.columns(scalars=values.ravel())
            stream.send_columns(
                plot.entity, indexes=[index], columns=scalars.partition([len(plot.lines)] * len(values))
            )


def send_stage(stream: rr.RecordingStream, entity: str, time_ns: int, name: str) -> None:
    """From this moment on, the lane `entity` shows `name`."""
    moment = time_column(np.array([time_ns], dtype=np.int64))
    stream.send_columns(entity, indexes=[moment], columns=rr.StateChange.columns(state=[name]))


def send_lane(stream: rr.RecordingStream, entity: str, names: Sequence[str]) -> None:
    """A colour for each name that the lane may show, static."""
    colours = np.array([rgba(LANES[index % len(LANES)]) for index in range(len(names))], dtype=np.uint32)
    stream.log(
        entity, rr.StateConfiguration(values=list(names), labels=list(names), colors=colours), static=True
    )


def send_parameter(
    stream: rr.RecordingStream, name: str, unit: str, time_ns: NDArray[np.int64], value: Floats, error: Floats
) -> None:
    """A parameter over time, with a band of one standard error where it is known."""
    entity = parameter_entity(name)
    stream.log(entity, rr.Measurements.from_fields(names=name, units=unit, colors=rgba(BLUE)), static=True)
    variance = np.nan_to_num(error**2, nan=0.0)
    stream.send_columns(
        entity,
        indexes=[time_column(time_ns)],
        columns=rr.Measurements.columns(values=value, variances=variance),
    )


def parameter_entity(name: str) -> str:
    return f"parameters/{rr.escape_entity_path_part(name)}"


def send_text(stream: rr.RecordingStream, entity: str, markdown: str) -> None:
    """A page of text, such as the verdict."""
    stream.log(entity, rr.TextDocument(markdown, media_type=rr.MediaType.MARKDOWN), static=True)


def send_plane(stream: rr.RecordingStream, plane: Plane, curve: tuple[Floats, Floats] | None) -> None:
    """Grid, tick labels and the model's curve of the plane, static."""
    grid, axes = plane.grid()
    stream.log("plane/grid", rr.LineStrips2D(grid, colors=rgba("#2b3238"), radii=-0.5), static=True)
    stream.log("plane/axes", rr.LineStrips2D(axes, colors=rgba("#7c8794"), radii=-0.7), static=True)
    places, texts = plane.labels()
    labels = rr.Points2D(places, labels=texts, colors=rgba(GREY), radii=0.0, show_labels=True)
    stream.log("plane/labels", labels, static=True)
    if curve is not None:
        strips = plane.strips(*curve)
        stream.log("plane/model", rr.LineStrips2D(strips, colors=rgba(ORANGE), radii=-1.2), static=True)


def send_plane_rows(
    stream: rr.RecordingStream, plane: Plane, time_ns: NDArray[np.int64], x: Floats, y: Floats
) -> None:
    """Points of the plane at 100 Hz at most, so that a trail can be shown."""
    keep = np.flatnonzero(np.diff(time_ns // 10_000_000, prepend=-1) != 0)
    keep = keep[plane.inside(x[keep], y[keep])]
    if not len(keep):
        return
    stream.send_columns(
        "plane/trail",
        indexes=[time_column(time_ns[keep])],
        columns=rr.Points2D.columns(
            positions=plane.place(x[keep], y[keep]),
            radii=np.full(len(keep), -1.5),
            colors=np.full(len(keep), rgba(BLUE), dtype=np.uint32),
        ),
    )


def blueprint(
    shown: Sequence[Plot], plane: Plane | None, *, live: bool, parameters: Mapping[str, str]
) -> rrb.Blueprint:
    """Arrangement of the views; live ones follow the last ten seconds.

    `parameters` maps names to units: they get a plot each, as their units differ.
    """
    ranges = [_last(10.0)] if live else None
    traces = rrb.Vertical(
        *(
            rrb.TimeSeriesView(
                origin=plot.entity,
                name=plot.title,
                time_ranges=ranges,
                plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=len(plot.lines) > 1),
            )
            for plot in shown
        ),
        rrb.StateTimelineView(origin="stage", name="Stage"),
        row_shares=[*(3.0 if i < 3 else 1.6 for i in range(len(shown))), 2.0],
    )
    side: list[Any] = [rrb.TextDocumentView(origin="verdict", name="Verdict")]
    if plane is not None:
        side.append(_plane_view(plane, live))
    if parameters:
        side.append(_parameter_views(parameters))
    return rrb.Blueprint(
        rrb.Horizontal(traces, rrb.Vertical(*side), column_shares=[2, 1]),
        rrb.TimePanel(timeline=TIMELINE, play_state="following" if live else "paused", state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def time_column(time_ns: NDArray[np.int64]) -> rr.TimeColumn:
    return rr.TimeColumn(TIMELINE, duration=time_ns.astype("timedelta64[ns]"))


def nanoseconds(time: Floats) -> NDArray[np.int64]:
    """Seconds as integer nanoseconds, rounded."""
    return np.asarray(np.rint(np.nan_to_num(time) * 1e9), dtype=np.int64)


def rgba(colour: str) -> int:
    """`#rrggbb` as the number that Rerun takes."""
    return int(colour[1:] + "ff", 16)


def _parameter_views(parameters: Mapping[str, str]) -> rrb.Grid:
    views = [
        rrb.TimeSeriesView(
            origin=parameter_entity(name),
            name=f"{name} [{unit}]" if unit else name,
            plot_legend=rrb.PlotLegend(visible=False),
        )
        for name, unit in parameters.items()
    ]
    return rrb.Grid(*views, grid_columns=2, name="Parameters")


def _plane_view(plane: Plane, live: bool) -> rrb.Spatial2DView:
    low, high = plane.bounds()
    return rrb.Spatial2DView(
        origin="plane",
        name=plane.title,
        background=[16, 18, 20],
        visual_bounds=rrb.VisualBounds2D(x_range=low, y_range=high),
        time_ranges=[_last(5.0)] if live else [_everything()],
    )


def _last(seconds: float) -> rrb.VisibleTimeRange:
    return rrb.VisibleTimeRange(
        TIMELINE,
        start=rrb.TimeRangeBoundary.cursor_relative(seconds=-seconds),
        end=rrb.TimeRangeBoundary.cursor_relative(),
    )


def _everything() -> rrb.VisibleTimeRange:
    infinite = rrb.TimeRangeBoundary.infinite()
    return rrb.VisibleTimeRange(TIMELINE, start=infinite, end=infinite)


def _value(line: Line, columns: Mapping[str, Floats], rows: slice) -> Floats:
    value = columns[line.plus][rows]
    if line.minus:
        value = value - columns[line.minus][rows]
    return value * line.factor
