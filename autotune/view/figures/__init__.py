"""Figures as pure functions: plain data in, a plotly figure out. One theme, units on every axis."""

from autotune.view.figures.identification import dahl_curve, presliding, steady_state
from autotune.view.figures.model import (
    measured_and_model,
    ranking,
    residual_over_coordinate,
    staircase,
)
from autotune.view.figures.simulated import as_simulated
from autotune.view.figures.tracking import before_after, convergence, history

__all__ = [
    "as_simulated",
    "before_after",
    "convergence",
    "dahl_curve",
    "history",
    "measured_and_model",
    "presliding",
    "ranking",
    "residual_over_coordinate",
    "staircase",
    "steady_state",
]
