"""What identification saw: characteristics, presliding, Dahl's curve (figures 6.11–6.13)."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from autotune.view import theme
from autotune.view.data import DahlCurve, Presliding, SteadyState, torque_unit
from autotune.view.figures.parts import empty, line, motion_name, plain, small, titled
from autotune.view.scale import multiple, peak, quantity, thin_path


def steady_state(data: SteadyState) -> go.Figure:
    """Torque over velocity with error bars, and the model's curve (figure 6.11)."""
    if len(data.velocity) == 0:
        return empty("No constant-velocity points were measured.")
    factor, unit = multiple(
        peak(data.torque, data.model_torque), torque_unit(data.motion_unit, data.torque_unit)
    )
    figure = go.Figure()
    for side, name in ((data.model_velocity < 0, "model"), (data.model_velocity > 0, None)):
        if np.any(side):
            velocity, torque = data.model_velocity[side], data.model_torque[side] * factor
            figure.add_trace(
                line(
                    velocity, torque, name or "model", theme.MODEL, legendgroup="model", showlegend=bool(name)
                )
            )
    figure.add_trace(_points(data, factor))
    figure.update_xaxes(title=titled("velocity", f"{data.motion_unit}/s"))
    figure.update_yaxes(title=titled(motion_name(data.motion_unit), unit))
    return theme.finish(figure, 420)


def presliding(data: Presliding) -> go.Figure:
    """Torque in, position out against the model, and every method's stiffness (figure 6.12)."""
    if len(data.time) == 0:
        return empty("No presliding experiment was recorded.")
    rows = 3 if data.estimates else 2
    figure = make_subplots(
        rows=rows,
        cols=1,
    )
    torque_factor, torque_text = multiple(peak(data.torque), torque_unit(data.motion_unit))
    factor, unit = multiple(peak(_swing(data.position)), data.motion_unit)
    time = data.time - data.time[0]
    figure.add_trace(
        line(time, data.torque * torque_factor, "torque", theme.REFERENCE, line={"width": 1.2}), row=1, col=1
    )
    measured = _swing(data.position) * factor
    figure.add_trace(line(time, measured, "position, measured", theme.MEASURED, line={"width": 1.4}), 2, 1)
    modelled = _swing(data.model_position) * factor
    figure.add_trace(line(time, modelled, "position, model", theme.MODEL, line={"width": 1.8}), 2, 1)
    figure.update_yaxes(title=titled(motion_name(data.motion_unit), torque_text), row=1, col=1)
    figure.update_yaxes(title=titled("position", unit), row=2, col=1)
    figure.update_xaxes(matches="x", showticklabels=False, row=1, col=1)
    figure.update_xaxes(title=titled("time", "s"), row=2, col=1)
    if data.estimates:
        _crosses(figure, data)
    domains = [(0.8, 1.0), (0.45, 0.76), (0.0, 0.3)] if rows == 3 else [(0.68, 1.0), (0.0, 0.62)]
    for row, domain in enumerate(domains, 1):
        figure.update_yaxes(domain=domain, row=row, col=1)
    return theme.finish(figure, 660 if rows == 3 else 440)


def dahl_curve(data: DahlCurve) -> go.Figure:
    """Torque over position through slow reversals, measured against the model (figure 6.13)."""
    if len(data.position) == 0:
        return empty("No slow reversals were recorded.")
    torque_factor, torque_text = multiple(peak(data.torque), torque_unit(data.motion_unit))
    factor, unit = multiple(peak(data.position), data.motion_unit)
    figure = go.Figure()
    for torque, name, colour, width in (
        (data.torque, "measured", theme.MEASURED, 1.2),
        (data.model_torque, "model", theme.MODEL, 2.2),
    ):
        chosen = thin_path(data.position, torque, 2500)
        figure.add_trace(
            go.Scatter(
                x=small(data.position[chosen] * factor),
                y=small(torque[chosen] * torque_factor),
                name=name,
                mode="lines",
                line={"color": colour, "width": width},
            )
        )
    _guides(figure, data, torque_factor)
    figure.update_xaxes(title=titled("position", unit))
    figure.update_yaxes(title=titled(motion_name(data.motion_unit), torque_text))
    return theme.finish(figure, 460)


def _points(data: SteadyState, factor: float) -> go.Scatter:
    bars = None
    if data.torque_error is not None:
        bars = {
            "array": small(data.torque_error * factor),
            "thickness": 1.4,
            "width": 4,
            "color": theme.MUTED,
        }
    return go.Scatter(
        x=small(data.velocity),
        y=small(data.torque * factor),
        error_y=bars,
        name="measured" + (", with 95 % interval" if bars else ""),
        mode="markers",
        marker={"color": theme.MEASURED, "size": 7},
    )


LOWEST_DRAWN = 0.01  # of the value taken: an interval down to zero has no place on a logarithmic axis


def _crosses(figure: go.Figure, data: Presliding) -> None:
    """One cross for each data set, one column for each method, the value taken as a band."""
    unit = f"{torque_unit(data.motion_unit)}/{data.motion_unit}"
    for column, (method, values) in enumerate(data.estimates.items()):
        spread = np.linspace(-0.16, 0.16, len(values)) if len(values) > 1 else np.zeros(len(values))
        figure.add_trace(
            go.Scatter(
                x=small(column + spread),
                y=list(values),
                mode="markers",
                name=plain(method),
                showlegend=False,
                marker={"symbol": "x-thin", "size": 8, "line": {"width": 1.6, "color": theme.MEASURED}},
            ),
            row=3,
            col=1,
        )
    if data.adopted is not None:
        _adopted(figure, *data.adopted, unit)
    names = [plain(name) for name in data.estimates]
    shown = [value for values in data.estimates.values() for value in values if np.isfinite(value)]
    logarithmic = bool(shown) and min(shown) > 0.0  # methods differ by decades
    scale = {"type": "log"} if logarithmic else {"rangemode": "tozero"}
    figure.update_yaxes(title=titled("stiffness at rest", unit), row=3, col=1, **scale)
    figure.update_xaxes(
        title="Method (one cross for each data set)",
        tickvals=list(range(len(names))),
        ticktext=names,
        range=[-0.5, len(names) - 0.5],
        showgrid=False,
        row=3,
        col=1,
    )


def _adopted(figure: go.Figure, value: float, error: float, unit: str) -> None:
    figure.add_hrect(
        y0=max(value - 1.96 * error, LOWEST_DRAWN * value),
        y1=value + 1.96 * error,
        fillcolor=theme.translucent(theme.MODEL, 0.22),
        line_width=0,
        layer="below",
        row=3,
        col=1,
    )
    figure.add_hline(y=value, line={"color": theme.MODEL, "width": 1.6}, layer="below", row=3, col=1)
    figure.add_annotation(
        text=f"taken: {quantity(value, unit, error)}", font={"color": theme.MODEL, "size": 13},
        x=0, y=1, xref="x3 domain", yref="y3 domain", xanchor="left", yanchor="bottom", showarrow=False,
    )  # fmt: skip


def _guides(figure: go.Figure, data: DahlCurve, factor: float) -> None:
    if data.coulomb is None:
        return
    for sign, name in ((1.0, "offset + Coulomb"), (-1.0, "offset − Coulomb")):
        figure.add_hline(
            y=(data.offset + sign * data.coulomb) * factor,
            line={"color": theme.REFERENCE, "width": 1, "dash": "dot"},
            annotation={"text": name},
            annotation_position="top left" if sign > 0 else "bottom right",
        )


def _swing(
    values: np.ndarray[tuple[int], np.dtype[np.float64]],
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    return values - np.nanmean(values)
