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
from autotune.view.colours import BLUE_ON_DARK as BLUE
from autotune.view.colours import GREEN_ON_DARK as GREEN
from autotune.view.colours import GREY_ON_DARK as GREY
from autotune.view.colours import ORANGE_ON_DARK as ORANGE
from autotune.view.colours import PINK_ON_DARK as PINK
from autotune.view.colours import RED_ON_DARK as RED
from autotune.view.data import torque_unit
from autotune.view.plane import Plane
from autotune.view.scale import peak

LANES = ("#2f6f94", "#8a6100", "#1d765c", "#8a4f73", "#5a636e")

APPLICATION = "autotune"
TIMELINE = "machine_time"
BLOCK = 16384
LIVE_SECONDS = 60.0
"""What a live view shows of the past."""
NEAR = 2.5
"""A limit is drawn where it is at most so many times the largest value; else the title names it."""

LimitsShown = Mapping[str, tuple[float, float]]
"""Low and high by the name of the plot's quantity: error, position, velocity, torque, temperature; nan: none."""


class Line(NamedTuple):
    """One line of a plot: `plus` less `minus` (a column name, or none), times `factor`."""

    name: str
    colour: str
    plus: str
    minus: str = ""
    factor: float = 1.0


class Plot(NamedTuple):
    """One plot of several lines: one entity; `limits`: drawn as lines, an entity below it."""

    entity: str
    title: str
    lines: tuple[Line, ...]
    limits: tuple[float, ...] = ()


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


def with_limits(plot: Plot, limits: LimitsShown, reach: float) -> Plot:
    """The plot with its limits as lines where they are near, named in its title where they are far.

    Args:
        reach: largest value that is shown.
    """
    quantity = plot.entity.rpartition("/")[2]
    low, high = limits.get(quantity, (np.nan, np.nan))
    factor = plot.lines[0].factor
    edges = tuple(factor * edge for edge in (low, high) if np.isfinite(edge))
    if not edges:
        return plot
    if quantity != "temperature" and peak(np.array(edges)) > NEAR * factor * reach:
        told = " to ".join(f"{edge:g}".replace("-", "−") for edge in edges)
        return plot._replace(title=f"{plot.title}, limits {told}")
    return plot._replace(limits=edges, title=f"{plot.title}, red: limits")


def reach_of(plot: Plot, columns: Mapping[str, Floats]) -> float:
    """Largest value that the plot's lines have."""
    whole = slice(None)
    return max((peak(_value(line, columns, whole)) / line.factor for line in plot.lines), default=0.0)


def send_names(stream: rr.RecordingStream, shown: Sequence[Plot]) -> None:
    """Names and colours of all lines, static."""
    for plot in shown:
        colours = np.array([rgba(line.colour) for line in plot.lines], dtype=np.uint32)
        names = [line.name for line in plot.lines]
        stream.log(plot.entity, rr.SeriesLines(names=names, colors=colours, widths=1.5), static=True)
        if plot.limits:
            red = np.full(len(plot.limits), rgba(RED), dtype=np.uint32)
            texts = ["limit"] * len(plot.limits)
            stream.log(limits_entity(plot), rr.SeriesLines(names=texts, colors=red, widths=1.5), static=True)


def limits_entity(plot: Plot) -> str:
    return f"{plot.entity}/limits"


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
    _send_limits(stream, shown, time_ns)


def _send_limits(stream: rr.RecordingStream, shown: Sequence[Plot], time_ns: NDArray[np.int64]) -> None:
    """Limits are straight: their first and last point suffice."""
    ends = np.unique(time_ns[[0, -1]]) if len(time_ns) else time_ns
    for plot in shown:
        if plot.limits and len(ends):
            values = rr.Scalars.columns(scalars=np.tile(np.array(plot.limits), len(ends)))
            stream.send_columns(
                limits_entity(plot),
                indexes=[time_column(ends)],
                columns=values.partition([len(plot.limits)] * len(ends)),
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


def send_plane(
    stream: rr.RecordingStream, plane: Plane, curve: tuple[Floats, Floats] | None, entity: str = "plane"
) -> None:
    """Grid, tick labels and the model's curve of the plane, static."""
    grid, axes = plane.grid()
    stream.log(f"{entity}/grid", rr.LineStrips2D(grid, colors=rgba("#2b3238"), radii=-0.5), static=True)
    stream.log(f"{entity}/axes", rr.LineStrips2D(axes, colors=rgba("#7c8794"), radii=-0.7), static=True)
    send_labels(stream, f"{entity}/labels", *plane.labels())
    if curve is not None:
        strips = plane.strips(*curve)
        stream.log(f"{entity}/model", rr.LineStrips2D(strips, colors=rgba(ORANGE), radii=-1.2), static=True)


def send_labels(stream: rr.RecordingStream, entity: str, places: Floats, texts: Sequence[str]) -> None:
    """Texts at places of the box, static."""
    labels = rr.Points2D(places, labels=list(texts), colors=rgba(GREY), radii=0.0, show_labels=True)
    stream.log(entity, labels, static=True)


def send_plane_rows(
    stream: rr.RecordingStream,
    plane: Plane,
    time_ns: NDArray[np.int64],
    x: Floats,
    y: Floats,
    entity: str = "plane",
) -> None:
    """Points of the plane at 100 Hz at most, so that a trail can be shown."""
    keep = np.flatnonzero(np.diff(time_ns // 10_000_000, prepend=-1) != 0)
    keep = keep[plane.inside(x[keep], y[keep])]
    if not len(keep):
        return
    stream.send_columns(
        f"{entity}/trail",
        indexes=[time_column(time_ns[keep])],
        columns=rr.Points2D.columns(
            positions=plane.place(x[keep], y[keep]),
            radii=np.full(len(keep), -1.5),
            colors=np.full(len(keep), rgba(BLUE), dtype=np.uint32),
        ),
    )


class Layout(NamedTuple):
    """What is arranged.

    Attributes:
        shown: plots over time; `plane`: None without.
        live: the last minute is followed; else `span` [s] is shown whole from its beginning.
        parameters: name → unit, each a plot, as their units differ.
        words: there is a text at `verdict`.
        pages: further tabs, see `page_plots.page_view`; `active`: title of the one in front, "" for the traces.
    """

    shown: Sequence[Plot]
    plane: Plane | None
    live: bool
    parameters: Mapping[str, str] = {}
    words: bool = False
    pages: Sequence[rrb.Container] = ()
    active: str = ""
    span: tuple[float, float] = (0.0, 1.0)
    plane_entity: str = "plane"


TRACES = "Traces"
SHARES = {"traces/error": 2.3, "traces/position": 2.1, "traces/torque": 4.1}
"""Heights of the plots over time: the torque has room for the six names of its lines."""


def blueprint(layout: Layout) -> rrb.Blueprint:
    """Arrangement of the views: the traces, and a tab for each page."""
    side: list[Any] = []
    if layout.plane is not None:
        side.append(_plane_view(layout))
    if layout.parameters:
        side.append(_parameter_views(layout.parameters))
    if layout.words:
        side.append(rrb.TextDocumentView(origin="verdict", name="Verdict"))
    columns = [_traces(layout)] if layout.shown or layout.live else []
    columns += [rrb.Vertical(*side)] if side else []
    run = rrb.Horizontal(*columns, column_shares=[2, 1][: len(columns)], name=TRACES)
    tabs = [run, *layout.pages] if columns else [*layout.pages]
    names = [str(tab.name) for tab in tabs]
    front = names.index(layout.active) if layout.active in names else 0
    return rrb.Blueprint(
        rrb.Tabs(*tabs, active_tab=front) if len(tabs) > 1 else tabs[0],
        rrb.TimePanel(
            timeline=TIMELINE, play_state="following" if layout.live else "paused", state="collapsed"
        ),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _traces(layout: Layout) -> rrb.Vertical:
    """The plots over time, and the lane of experiments."""
    ranges = [_last(LIVE_SECONDS)] if layout.live else None
    axis = None if layout.live else whole_axis(*layout.span)
    views: list[Any] = [
        rrb.TimeSeriesView(
            origin=plot.entity,
            name=plot.title,
            time_ranges=ranges,
            axis_x=axis,
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=len(plot.lines) > 1),
        )
        for plot in layout.shown
    ]
    shares = [SHARES.get(plot.entity, 1.6) for plot in layout.shown]
    if layout.shown:
        views.append(
            rrb.StateTimelineView(origin="stage", name="Experiment", time_view=axis, time_ranges=ranges)
        )
        shares.append(1.7)
    else:
        views, shares = [rrb.TextDocumentView(origin="waiting", name="Waiting")], [1.0]
    return rrb.Vertical(*views, row_shares=shares)


def whole_axis(start: float, end: float) -> rrb.TimeAxis:
    """A time axis that shows all from start to end [s], with a little room on both sides."""
    room = 0.01 * max(end - start, 1e-3)
    first, last = (rrb.TimeRangeBoundary.absolute(nanos=round(1e9 * at)) for at in (start - room, end + room))
    return rrb.TimeAxis(view_range=rrb.TimeRange(first, last), link="independent")


def time_column(time_ns: NDArray[np.int64]) -> rr.TimeColumn:
    return rr.TimeColumn(TIMELINE, duration=time_ns.astype("timedelta64[ns]"))


def nanoseconds(time: Floats) -> NDArray[np.int64]:
    """Seconds as integer nanoseconds, rounded."""
    return np.asarray(np.rint(np.nan_to_num(time) * 1e9), dtype=np.int64)


def rgba(colour: str) -> int:
    """`#rrggbb` as the number that Rerun takes."""
    return int(colour[1:] + "ff", 16)


def _parameter_views(parameters: Mapping[str, str]) -> rrb.Vertical:
    views = [
        rrb.TimeSeriesView(
            origin=parameter_entity(name),
            name=f"{name} [{unit}]" if unit else name,
            plot_legend=rrb.PlotLegend(visible=False),
        )
        for name, unit in parameters.items()
    ]
    return rrb.Vertical(*views, name="Parameters")


def _plane_view(layout: Layout) -> rrb.Spatial2DView:
    plane = layout.plane
    low, high = plane.bounds() if plane is not None else ((0.0, 1.0), (0.0, 1.0))
    return rrb.Spatial2DView(
        origin=layout.plane_entity,
        name=plane.title if plane is not None else "",
        background=[16, 18, 20],
        visual_bounds=rrb.VisualBounds2D(x_range=low, y_range=high),
        time_ranges=[_last(5.0)] if layout.live else [_everything()],
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
