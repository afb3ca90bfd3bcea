"""Draws pages in the Rerun viewer: their data once, static or over time, and a view for each panel.

Importing this imports rerun; see `rerun_plots`.
"""

from __future__ import annotations

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from autotune.core.arrays import Floats
from autotune.view.pages import Bar, Bars, Chart, Curve, Page, Panel, TimePlot, Words
from autotune.view.plane import HEIGHT, WIDTH, Plane, round_range
from autotune.view.rerun_plots import nanoseconds, rgba, send_labels, send_plane, time_column, whole_axis
from autotune.view.scale import peak

NAMES = 0.72
"""Part of the box that the names of bars take."""
LEFT = 0.16
"""Of the box, shown left of it at least (`Plane.bounds`)."""
LETTER = 0.045
"""Width of a letter, in the box's unit, where the view is as small as a page has it."""
MOST_ROOM = 0.45
GRID, AXES, FLOOR = "#2b3238", "#7c8794", "#1d765c"
STROKE = 0.004
"""Half the width of a bar's lines, in the box's unit."""
LABEL_BELOW = 0.035
"""About how far below its point the viewer writes a label."""


def send_page(stream: rr.RecordingStream, page: Page) -> None:
    """Sends all data of a page."""
    for entity, panel in page.panels():
        if isinstance(panel, Words):
            stream.log(entity, rr.TextDocument(panel.markdown, media_type=rr.MediaType.MARKDOWN), static=True)
        elif isinstance(panel, TimePlot):
            _send_time_plot(stream, entity, panel)
        elif isinstance(panel, Chart):
            _send_chart(stream, entity, panel)
        else:
            _send_bars(stream, entity, panel)


def page_view(page: Page) -> rrb.Horizontal:
    """The views of a page."""
    views = iter([_view(entity, panel) for entity, panel in page.panels()])
    columns = [
        rrb.Vertical(
            *[next(views) for _ in column],
            row_shares=[1.0 if not isinstance(panel, Words) else 0.8 for panel in column],
        )
        for column in page.columns
    ]
    return rrb.Horizontal(*columns, column_shares=list(page.shares), name=page.title)


def _view(entity: str, panel: Panel) -> rrb.View:
    if isinstance(panel, Words):
        return rrb.TextDocumentView(origin=entity, name=panel.title)
    if isinstance(panel, TimePlot):
        times = np.concatenate([curve.x[np.isfinite(curve.x)] for curve in panel.curves])
        return rrb.TimeSeriesView(
            origin=entity,
            name=panel.title,
            axis_x=whole_axis(float(times.min()), float(times.max())),
            plot_legend=rrb.PlotLegend(corner=rrb.Corner2D.LeftTop, visible=len(panel.curves) > 1),
        )
    low, high = (plane_of(panel) if isinstance(panel, Chart) else _bars_plane(panel)).bounds()
    if isinstance(panel, Bars):
        low = low[0] - _more_room(panel), low[1]
    return rrb.Spatial2DView(
        origin=entity,
        name=panel.title,
        background=[16, 18, 20],
        visual_bounds=rrb.VisualBounds2D(x_range=low, y_range=high),
    )


def _send_time_plot(stream: rr.RecordingStream, entity: str, plot: TimePlot) -> None:
    for index, curve in enumerate(plot.curves):
        path, good = f"{entity}/{index}", np.isfinite(curve.x)
        times, values = time_column(nanoseconds(curve.x[good])), curve.y[good]
        if curve.spread is None:
            stream.log(
                path, rr.SeriesLines(names=curve.name, colors=rgba(curve.colour), widths=1.5), static=True
            )
            stream.send_columns(path, indexes=[times], columns=rr.Scalars.columns(scalars=values))
            continue
        style = rr.Measurements.from_fields(names=curve.name, colors=rgba(curve.colour))
        stream.log(path, style, static=True)
        variances = np.nan_to_num(curve.spread[good] ** 2)
        columns = rr.Measurements.columns(values=values, variances=variances)
        stream.send_columns(path, indexes=[times], columns=columns)


def _send_chart(stream: rr.RecordingStream, entity: str, chart: Chart) -> None:
    plane = plane_of(chart)
    send_plane(stream, plane, None, entity)
    if chart.band is not None:
        _send_band(stream, f"{entity}/band", plane, chart.band)
    for index, curve in enumerate(chart.curves):
        _send_curve(stream, f"{entity}/curve_{index}", plane, curve)
    _send_legend(stream, f"{entity}/legend", chart)


def _send_curve(stream: rr.RecordingStream, entity: str, plane: Plane, curve: Curve) -> None:
    colour = rgba(curve.colour)
    good = np.isfinite(curve.x) & np.isfinite(curve.y)
    if curve.dots:
        points = plane.place(curve.x[good], curve.y[good])
        stream.log(entity, rr.Points2D(points, colors=colour, radii=-1.5), static=True)
    else:
        strips = [plane.place(curve.x[rows], curve.y[rows]) for rows in _stretches(good)]
        stream.log(entity, rr.LineStrips2D(strips, colors=colour, radii=-1.0), static=True)
    if curve.spread is not None:
        low, high = curve.y - curve.spread, curve.y + curve.spread
        x = np.repeat(curve.x[good], 2)
        ends = plane.place(x, np.column_stack([low[good], high[good]]).ravel()).reshape(-1, 2, 2)
        stream.log(f"{entity}/spread", rr.LineStrips2D(ends, colors=colour, radii=-0.6), static=True)


def _stretches(
    good: np.ndarray[tuple[int], np.dtype[np.bool_]],
) -> list[np.ndarray[tuple[int], np.dtype[np.int64]]]:
    """Row numbers of the unbroken stretches of a curve."""
    rows = np.flatnonzero(good)
    return [part for part in np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1) if len(part) > 1]


def _send_band(stream: rr.RecordingStream, entity: str, plane: Plane, half: float) -> None:
    ends = [plane.place(np.array(plane.x_range), np.array([y, y])) for y in (-half, half)]
    stream.log(entity, rr.LineStrips2D(ends, colors=rgba(FLOOR), radii=-0.8), static=True)


def _send_legend(stream: rr.RecordingStream, entity: str, chart: Chart) -> None:
    """The names of the curves in their colours, above the box."""
    named = [(curve.name, curve.colour) for curve in chart.curves if curve.name]
    named += [("noise", FLOOR)] if chart.band is not None else []
    if not named:
        return
    x = WIDTH * (0.35 + 0.65 * (np.arange(len(named)) + 0.5) / len(named))
    places = np.column_stack([x, np.full(len(named), -0.07)])
    colours = np.array([rgba(colour) for _, colour in named], dtype=np.uint32)
    texts = [name for name, _ in named]
    stream.log(
        entity, rr.Points2D(places, labels=texts, colors=colours, radii=-3.0, show_labels=True), static=True
    )


def _send_bars(stream: rr.RecordingStream, entity: str, bars: Bars) -> None:
    plane = _bars_plane(bars)
    lines, axes = plane.grid()
    uprights = [line for line in lines if line[0, 0] == line[1, 0]]
    stream.log(f"{entity}/grid", rr.LineStrips2D(uprights, colors=rgba(GRID), radii=-0.5), static=True)
    stream.log(f"{entity}/axes", rr.LineStrips2D(axes[:1], colors=rgba(AXES), radii=-0.7), static=True)
    hatched = [_hatch(plane, bar.value, at) for bar, at in zip(bars.bars, _places(bars), strict=True)]
    colours = [rgba(bar.colour) for bar, part in zip(bars.bars, hatched, strict=True) for _ in part]
    strips = rr.LineStrips2D(
        [strip for part in hatched for strip in part], colors=np.array(colours, dtype=np.uint32), radii=STROKE
    )
    stream.log(f"{entity}/bars", strips, static=True)
    if bars.mark is not None:
        mark = plane.place(np.array([bars.mark, bars.mark]), np.array(plane.y_range))
        stream.log(f"{entity}/mark", rr.LineStrips2D([mark], colors=rgba(FLOOR), radii=-1.0), static=True)
    _send_bar_labels(stream, entity, bars, plane)


def _send_bar_labels(stream: rr.RecordingStream, entity: str, bars: Bars, plane: Plane) -> None:
    y = _places(bars)
    middle = plane.place(np.zeros(len(y)), y)[:, 1] - LABEL_BELOW
    names = np.column_stack([np.full(len(y), (NAMES - LEFT - _more_room(bars)) / 2), middle])
    send_labels(stream, f"{entity}/names", names, [_label(bar) for bar in bars.bars])
    places, ticks = plane.labels()
    under = [k for k, text in enumerate(ticks) if text and places[k, 1] > HEIGHT]
    send_labels(stream, f"{entity}/labels", places[under], [ticks[k] for k in under])


def _label(bar: Bar) -> str:
    return f"{bar.name}  {bar.text}".strip()


def _more_room(bars: Bars) -> float:
    """What the longest name needs left of the box, so that it does not lie on its bar in a small view."""
    longest = max(len(_label(bar)) for bar in bars.bars)
    return min(MOST_ROOM, max(0.0, LETTER * longest - NAMES - LEFT))


def _hatch(plane: Plane, value: float, at: float) -> list[Floats]:
    """A bar as close lines: one thick line would end in round caps, beyond its value."""
    if not np.isfinite(value):
        return []
    low, high = plane.y_range
    half = min(0.3, 0.05 * (high - low))
    offsets = np.arange(-half, half, 1.6 * STROKE * (high - low))
    return [plane.place(np.array([0.0, value]), np.array([at + d, at + d])) for d in offsets]


def _places(bars: Bars) -> Floats:
    """Where each bar lies: the first on top."""
    return np.asarray(len(bars.bars) - 0.5 - np.arange(len(bars.bars)), dtype=np.float64)


def _bars_plane(bars: Bars) -> Plane:
    """Bars lie right of their names: the box's left part is below the scale's low end."""
    values = np.array([bar.value for bar in bars.bars if np.isfinite(bar.value)] + [0.0, bars.mark or 0.0])
    low, high = round_range(float(values.min()), float(values.max()))
    left = low - (high - low) * NAMES / (WIDTH - NAMES)
    return Plane(bars.title, bars.unit, "", (left, high), (0.0, float(len(bars.bars))), scale_from=low)


def plane_of(chart: Chart) -> Plane:
    """The plane that holds all curves of a chart, and its band."""
    xs = np.concatenate([curve.x for curve in chart.curves])
    ys = np.concatenate([_reach(curve) for curve in chart.curves])
    xs, ys = xs[np.isfinite(xs)], ys[np.isfinite(ys)]
    if chart.band is not None and chart.band < 2.0 * peak(ys):
        ys = np.concatenate([ys, [-chart.band, chart.band]])
    x_range, y_range = (round_range(float(v.min()), float(v.max())) for v in (xs, ys))
    return Plane(chart.title, chart.x_name, chart.y_name, x_range, y_range)


def _reach(curve: Curve) -> Floats:
    if curve.spread is None:
        return curve.y
    spread = np.nan_to_num(curve.spread)
    return np.concatenate([curve.y - spread, curve.y + spread])
