"""`--rrd` of fit, compare, diagnose and add: a layout of their own in front, the recordings' traces behind it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import AutotuneError
from autotune.diagnosis.compare import Compared, compare
from autotune.diagnosis.fit_recordings import model_torque
from autotune.diagnosis.verdict import Diagnosis
from autotune.estimation.coordinates import coordinates
from autotune.estimation.data import Prepared
from autotune.models.drive_model import DriveModel
from autotune.models.drive_model import staircase as stairs_of
from autotune.models.table import effect_kind
from autotune.recordings.recording import Recording, concatenate
from autotune.view.colours import BLUE_ON_DARK
from autotune.view.data import Comparison, Rank, Residual, Step
from autotune.view.model_pages import comparison_of, known_floor, residual_of, verdict_words, worst_place
from autotune.view.pages import Bar, Page
from autotune.view.rerun_file import FinalValue, Shown, parameter_table, write_rrd
from autotune.view.scale import quantity
from autotune.view.stage_pages import added_page, comparison_page, diagnosis_page, fit_page

Residuals = list[tuple[Residual, Floats]]
MOST_COORDINATES = 2


def write_fit_rrd(
    path: Path, recordings: Sequence[Recording], model: DriveModel, words: str, compared: Compared | None
) -> None:
    """The fitted model against what it was fitted to, and its parameters.

    Raises:
        RecordingError: the file cannot be written.
    """
    over, residuals = _told(compared, model) if compared is not None else (None, [])
    page = fit_page(over, None, f"{words}\n\n{parameter_table(finals(model))}", residuals)
    _write(path, recordings, model, page)


def write_comparison_rrd(
    path: Path, recordings: Sequence[Recording], result: Compared, model: DriveModel
) -> None:
    """Measured and model, and where the error lives.

    Raises:
        RecordingError: the file cannot be written.
    """
    _write(path, recordings, model, compared_page(result, model))


def write_diagnosis_rrd(
    path: Path, recordings: Sequence[Recording], result: Diagnosis, model: DriveModel
) -> None:
    """Verdict, ranking and the residual where it lives.

    Raises:
        RecordingError: the file cannot be written.
    """
    _write(path, recordings, model, diagnosed_page(result, model))


def write_added_rrd(
    path: Path, recordings: Sequence[Recording], before: DriveModel, after: DriveModel
) -> None:
    """What is left of the torque with the model before and after, and how the error fell.

    Raises:
        RecordingError: the file cannot be written.
    """
    unit = after.torque_symbol
    was, now = (_compared_or_none(recordings, one) for one in (before, after))
    steps = [Step(stair.action.removeprefix("+ "), stair.error) for stair in stairs_of(after.history)]
    told = [entry for entry in after.history if entry.error_after is not None]
    floor = told[-1].noise_floor if told else None
    page = added_page(steps, was, now, _old_and_new(before, after), unit, floor)
    _write(path, recordings, after, page)


def compared_page(result: Compared, model: DriveModel) -> Page:
    """The page of a comparison."""
    over, residuals = _told(result, model)
    regimes = [
        Bar(name.replace("_", " "), value, BLUE_ON_DARK, quantity(value, model.torque_symbol))
        for name, value in result.regimes.items()
        if math.isfinite(value)
    ]
    lines = [
        f"The model misses the torque by **{quantity(result.error_rms, model.torque_symbol)}** rms, "
        f"{100 * result.relative_error:.2f} % of it.",
        *(f"Worst where {worst_place(worst, model)}." for worst in result.worst[:3]),
        *result.notes,
    ]
    return comparison_page(over, residuals, regimes, "\n\n".join(lines))


def diagnosed_page(result: Diagnosis, model: DriveModel) -> Page:
    """The page of a diagnosis."""
    ranks = [Rank(c.effect, c.gain, c.accepted, c.why) for c in result.candidates]
    residuals: Residuals = []
    if result.problem is not None and result.root is not None:
        residuals = residuals_of(
            result.problem.data,
            result.root.fitted.error,
            result.where,
            model,
            known_floor(result.noise_floor_rms),
        )
    return diagnosis_page(ranks, (), residuals, _diagnosis_words(result), model.torque_symbol)


def _diagnosis_words(result: Diagnosis) -> str:
    parts = [f"**{verdict_words(result)}**"]
    for effect in result.effects:
        kind = effect_kind(effect)
        parts.append(
            f"### {effect.replace('_', ' ')}\n\nlooks like: {kind.looks_like}\n\ncaused by: {kind.cause}\n\n"
            f"what to do: {kind.remedy}"
        )
    if result.next_experiment:
        parts.append(f"Next: {result.next_experiment}")
    return "\n\n".join(parts)


def _told(result: Compared, model: DriveModel) -> tuple[Comparison, Residuals]:
    data, floor = result.problem.data, known_floor(result.noise_floor_rms)
    return (
        comparison_of(data, result.error, model.torque_symbol, floor),
        residuals_of(data, result.error, result.where, model, floor),
    )


def residuals_of(
    data: Prepared, error: Floats, where: Mapping[str, float], model: DriveModel, floor: float | None
) -> Residuals:
    """The residual over the coordinates that it follows most, each with the direction of motion."""
    values = coordinates(data)
    ranked = sorted(
        (name for name in where if name not in ("direction", "time")), key=lambda name: -where[name]
    )
    return [
        (residual_of(name, values, error, where[name], model, floor), values["direction"])
        for name in ranked[:MOST_COORDINATES]
    ]


def finals(model: DriveModel) -> list[FinalValue]:
    """The model's parameters."""
    return [
        FinalValue(name, value.value, value.standard_error, model.unit(name))
        for name, value in model.parameters.items()
    ]


def _old_and_new(before: DriveModel, after: DriveModel) -> str:
    rows = ["| parameter | before | now |", "|---|---|---|"]
    old = {one.name: one for one in finals(before)}
    for one in finals(after):
        was = old.get(one.name)
        earlier = quantity(was.value, was.unit, was.standard_error) if was is not None else "–"
        rows.append(
            f"| {one.name.replace('_', ' ')} | {earlier} | {quantity(one.value, one.unit, one.standard_error)} |"
        )
    return "\n".join(rows)


def _compared_or_none(recordings: Sequence[Recording], model: DriveModel) -> Comparison | None:
    try:
        return _told(compare(recordings, model), model)[0]
    except (AutotuneError, np.linalg.LinAlgError):
        return None


def _write(path: Path, recordings: Sequence[Recording], model: DriveModel, page: Page) -> None:
    whole = concatenate(recordings)
    try:
        torque: Floats | None = model_torque(whole, model)
    except (AutotuneError, np.linalg.LinAlgError):
        torque = None
    shown = Shown(torque_model=torque, parameters=finals(model), pages=[page], in_front=page.title)
    write_rrd(path, whole, shown)
