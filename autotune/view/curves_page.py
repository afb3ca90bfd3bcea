"""The page of `autotune model curves`: characteristics in one figure, and what each means for slow motion."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from autotune.control.steady_curves import Characteristic
from autotune.view.figures.control import SteadyCurve, characteristics
from autotune.view.report import Picture, Report, write_report


def write_curves(path: Path, curves: Sequence[Characteristic], motion_unit: str, torque_unit: str) -> None:
    """One figure, one sentence a curve."""
    drawn = [SteadyCurve(one.name, one.speed, one.torque, one.low, one.high) for one in curves]
    said = [one.sentence(motion_unit) for one in curves]
    picture = Picture(
        "Friction in steady motion",
        "Bands are 95 % of what the standard errors allow; where a curve falls, slow motion may stick and slip.",
        characteristics(drawn, motion_unit, torque_unit),
    )
    title, verdict = "Steady-state friction", said[0]
    write_report(
        path, Report(title, "information", verdict, pictures=[picture], next_steps=said, sign_off=False)
    )
