"""The model in the loop against the measurement, with a closer look at the reversals (compare figure 6.17)."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from autotune.core.arrays import Floats
from autotune.view import theme
from autotune.view.data import Simulated, torque_unit
from autotune.view.figures.parts import band, empty, line, motion_name, titled
from autotune.view.figures.tracking import reversal_times
from autotune.view.scale import multiple, peak

BEFORE, AFTER = 0.04, 0.12
"""Of a period, to either side of a reversal, in the closer look."""


def as_simulated(data: Simulated) -> go.Figure:
    """Torque and tracking error over a period, measured and simulated; below, the error round two reversals."""
    if len(data.time) == 0:
        return empty("The benchmark was not measured.")
    figure = make_subplots(
        rows=3, cols=2, specs=[[{"colspan": 2}, None], [{"colspan": 2}, None], [{}, {}]], row_heights=[0.3, 0.3, 0.4],
        vertical_spacing=0.09, horizontal_spacing=0.1,
    )  # fmt: skip
    force, force_unit = multiple(
        peak(data.torque, data.model_torque), torque_unit(data.motion_unit, data.torque_unit)
    )
    factor, unit = multiple(peak(data.error, data.model_error), data.motion_unit)
    _pair(figure, data.time, data.torque * force, data.model_torque * force, 1, 1, True)
    _pair(figure, data.time, data.error * factor, data.model_error * factor, 2, 1, False)
    turns = reversal_times(data.time, data.reference)
    for column, turn in enumerate(turns[:2], 1):
        _closer(figure, data, turn, factor, column)
    for turn in turns:
        for row in (1, 2):
            figure.add_vline(
                x=turn, line={"color": theme.REFERENCE, "width": 1, "dash": "dot"}, row=row, col=1
            )
    figure.update_xaxes(matches="x", showticklabels=False, row=1, col=1)
    figure.update_xaxes(title=titled("time in the period", "s"), row=2, col=1)
    figure.update_yaxes(title=titled(motion_name(data.motion_unit), force_unit), row=1, col=1)
    for row in (2, 3):
        figure.update_yaxes(title=titled("error", unit), row=row, col=1)
    return theme.finish(figure, 720)


def _closer(figure: go.Figure, data: Simulated, turn: float, factor: float, column: int) -> None:
    """The error from shortly before a reversal to well after it; the motion is periodic."""
    period = len(data.time) * float(data.time[1] - data.time[0])
    shift = (data.time - turn + BEFORE * period) % period - BEFORE * period
    order = np.argsort(shift)
    order = order[shift[order] <= AFTER * period]
    time = np.asarray(1e3 * shift[order], dtype=np.float64)
    _pair(figure, time, data.error[:, order] * factor, data.model_error[order] * factor, 3, column, False)
    figure.add_vline(x=0.0, line={"color": theme.REFERENCE, "width": 1, "dash": "dot"}, row=3, col=column)
    figure.update_xaxes(title=titled(f"time since reversal {column}", "ms"), row=3, col=column)


def _pair(
    figure: go.Figure, time: Floats, measured: Floats, modelled: Floats, row: int, column: int, named: bool
) -> None:
    """Mean and spread of what was measured, and the model's line over it."""
    if len(measured) > 1:
        low, high = measured.min(axis=0), measured.max(axis=0)
        spread = band(time, low, high, theme.MEASURED, "measured", showlegend=False)
        figure.add_trace(spread, row=row, col=column)
    mean = line(
        time, measured.mean(axis=0), "measured", theme.MEASURED, legendgroup="measured", showlegend=named,
        line={"width": 1.4},
    )  # fmt: skip
    figure.add_trace(mean, row=row, col=column)
    simulated = line(
        time, modelled, "model, in the same loop", theme.MODEL, legendgroup="model", showlegend=named
    )
    figure.add_trace(simulated, row=row, col=column)
