"""Pages for people who would rather look than read: comparison, diagnosis, and a model's story."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.diagnosis.compare import Compared, Worst
from autotune.diagnosis.verdict import Diagnosis
from autotune.diagnosis.wording import headline
from autotune.estimation.coordinates import coordinates
from autotune.estimation.data import Prepared
from autotune.estimation.residual import smoothed
from autotune.models.drive_model import DriveModel
from autotune.models.drive_model import staircase as stairs_of
from autotune.models.table import effect_kind
from autotune.signals.runs import runs_of
from autotune.view.data import Comparison, Rank, Residual, Step
from autotune.view.figures import measured_and_model, ranking, residual_over_coordinate, staircase
from autotune.view.model_tables import (
    candidates_table,
    effects_table,
    error_table,
    parameters_table,
    story_table,
    where_table,
    worst_table,
)
from autotune.view.report import Picture, Report, write_report
from autotune.view.scale import quantity

COORDINATE_UNITS = {
    "position": "{0}", "velocity": "{0}/s", "acceleration": "{0}/s²", "time": "s", "direction": "",
    "travel_since_reversal": "log10 {0}", "time_since_reversal": "log10 s",
    "temperature": "°C",
}  # fmt: skip
SHOWN = 3
LEAST_SHARE = 0.02


def write_comparison(path: Path, result: Compared, model: DriveModel) -> None:
    """Measured and model over time, and the residual where it lives."""
    unit = model.torque_symbol
    floor = known_floor(result.noise_floor_rms)
    text = f"The model misses the torque by {quantity(result.error_rms, unit)} rms, " + (
        f"{100 * result.relative_error:.1f} % of it."
    )
    if floor is not None:
        text += f" Noise is about {quantity(floor, unit)}{floor_range(result.noise_floor_interval, unit)}."
    text += "".join(f" Worst where {worst_place(worst, model)}." for worst in result.worst[:3])
    text += "".join(f" {note}" for note in result.notes)
    pictures = comparison_pictures(result, model)
    tables = [
        error_table(result, unit, model.motion_unit),
        worst_table(result, COORDINATE_UNITS, model.motion_unit),
        parameters_table(model),
    ]
    write_report(
        path,
        Report(
            "Model and measurement", "information", text, pictures=pictures, tables=tables, sign_off=False
        ),
    )


def floor_range(interval: tuple[float, float] | None, unit: str) -> str:
    """The interval of the noise floor, in words."""
    if interval is None:
        return ""
    low, high = (quantity(end, unit) for end in interval)
    return f" ({low} to {high}, estimated from what repeats do not share)"


def worst_place(worst: Worst, model: DriveModel) -> str:
    """A stretch of a coordinate in words, with its part of the squared error."""
    unit = COORDINATE_UNITS[worst.coordinate].format(model.motion_unit).removeprefix("log10 ")
    spoken = worst.coordinate.replace("_", " ")
    return f"{spoken} is {worst.low:.4g} to {worst.high:.4g} {unit}: {100 * worst.share:.0f} % of the squared error"


def comparison_pictures(result: Compared, model: DriveModel) -> list[Picture]:
    """Measured and model over time, and the residual over what it follows most."""
    floor = known_floor(result.noise_floor_rms)
    return [
        _over_time(result.problem.data, result.error, result.problem.weight, model.torque_symbol, floor),
        *_over_coordinates(result.problem.data, result.error, result.where, model, floor),
    ]


def write_diagnosis(path: Path, result: Diagnosis, model: DriveModel) -> None:
    """Verdict, ranking with evidence, and the residual where it lives."""
    unit = model.torque_symbol
    ranks = [Rank(c.effect, c.gain, c.accepted, c.why) for c in result.candidates]
    pictures = [
        Picture("Candidates", "How far each effect lowers the squared error on unseen data.", ranking(ranks))
    ]
    if result.problem is not None and result.root is not None:
        floor = known_floor(result.noise_floor_rms)
        error, data = result.root.fitted.error, result.problem.data
        pictures += [
            _over_time(data, error, result.problem.weight, unit, floor),
            *_over_coordinates(data, error, result.where, model, floor),
        ]
    steps = [f"{effect.replace('_', ' ')}: {effect_kind(effect).remedy}" for effect in result.effects]
    if result.next_experiment:
        steps.append(result.next_experiment)
    tables = [candidates_table(result, unit), where_table(result.where, result.noise_floor_rms, unit)]
    if result.effects:
        tables.insert(0, effects_table(result.effects))
    report = Report(
        "Diagnosis", "information", verdict_words(result), pictures=pictures, tables=tables, next_steps=steps,
        sign_off=False,
    )  # fmt: skip
    write_report(path, report)


def write_story(path: Path, model: DriveModel) -> None:
    """The model's history as a falling staircase."""
    entries = [entry for entry in model.history if entry.error_after is not None]
    steps = [Step(stair.action, stair.error) for stair in stairs_of(model.history)]
    floor = entries[-1].noise_floor if entries else None
    figure = staircase(steps, floor, model.torque_symbol)
    caption = "Rms error on unseen data after every effect added."
    if entries and entries[-1].unseen:
        caption = (
            f"Rms error on data that the fit never saw ({entries[-1].unseen}), after every effect added."
        )
    picture = Picture("How the error fell", caption, figure)
    text = f"Model of {model.axis or 'an axis'} with " + (
        ", ".join(effect.name.replace("_", " ") for effect in model.effects) or "no effects beside the base"
    )
    story = story_table(model)
    tables = [parameters_table(model), *([story] if story is not None else [])]
    write_report(
        path, Report("Model", "information", text + ".", pictures=[picture], tables=tables, sign_off=False)
    )


def verdict_words(result: Diagnosis) -> str:
    """The verdict's line as a sentence, and its notes."""
    names = [effect.replace("_", " ") for effect in result.effects]
    line = headline(result.verdict, names, result.confidence, result.complete)
    return " ".join([f"{line[0].upper()}{line[1:]}.", *result.notes])


def known_floor(value: float) -> float | None:
    """A noise floor as pictures take it."""
    return value if math.isfinite(value) else None


def comparison_of(
    data: Prepared, error: Floats, unit: str, floor: float | None, weight: Floats | None = None
) -> Comparison:
    """Measured and model in the order of time, which goes on over pauses and recordings.

    Rows without `weight`, shape (m,), are told as left out.
    """
    order = np.argsort(data.grid, kind="stable")
    torque = smoothed(data, data.torque)
    time = np.asarray(data.grid[order] * data.period, dtype=np.float64)
    out = () if weight is None else left_out(time, weight[order] <= 0.0)
    return Comparison(time, torque[order], (torque - error)[order], unit, noise_floor=floor, left_out=out)


def residual_of(
    name: str,
    values: Mapping[str, Floats],
    error: Floats,
    share: float,
    model: DriveModel,
    floor: float | None,
    direction: Floats | None = None,
) -> Residual:
    """What is left over one of the coordinates' `values`, which explains a share of it."""
    unit = COORDINATE_UNITS[name].format(model.motion_unit)
    return Residual(name, unit, values[name], error, floor, share, model.torque_symbol, direction)


def _over_time(data: Prepared, error: Floats, weight: Floats, unit: str, floor: float | None) -> Picture:
    figure = measured_and_model(comparison_of(data, error, unit, floor, weight))
    caption = "Torque, and below it what is left."
    if np.any(weight <= 0.0):
        share = 100.0 * float(np.mean(weight <= 0.0))
        caption += f" Shaded: {share:.1f} % of the rows, left out as starts, stops or disturbances."
    return Picture("Measured and model over time", caption, figure)


def left_out(time: Floats, out: Flags) -> tuple[tuple[float, float], ...]:
    """Stretches of time that were left out, neighbours joined."""
    return tuple((float(time[a]), float(time[b - 1])) for a, b in runs_of(out))


def _over_coordinates(
    data: Prepared, error: Floats, where: Mapping[str, float], model: DriveModel, floor: float | None
) -> list[Picture]:
    values = coordinates(data)
    ranked = sorted((n for n in where if n != "direction"), key=lambda n: -where[n])
    chosen = [n for n in ranked if where[n] > LEAST_SHARE or n == ranked[0]][:SHOWN]
    pictures = []
    for name in chosen:
        shown = residual_of(name, values, error, where[name], model, floor, values["velocity"])
        spoken = name.replace("_", " ")
        pictures.append(
            Picture(
                f"Residual over {spoken}",
                f"{100 * where[name]:.0f} % of the residual's variance follows {spoken}{_with_direction(name)}.",
                residual_over_coordinate(shown),
            )
        )
    return pictures


def _with_direction(name: str) -> str:
    """Shares of these coordinates are those of their bins in each direction (`variance_shares`)."""
    return "" if name in ("velocity", "time", "temperature") else ", each direction by itself"
