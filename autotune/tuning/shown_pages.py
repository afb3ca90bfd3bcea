"""What the stages of a run found, as pages of the viewer: the same in run.rrd and in a live view."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.axis import Axis
from autotune.core.errors import AutotuneError
from autotune.diagnosis.compare import Compared, compare
from autotune.identify.run import Identification
from autotune.models.drive_model import DriveModel, surface_parameter
from autotune.models.table import effect_kind
from autotune.recordings.recording import Recording
from autotune.tuning.given_model import Given, sentence
from autotune.tuning.proof import TrackingError, fold
from autotune.tuning.stage_adapt import Adapted
from autotune.tuning.stage_diagnose import Diagnosed
from autotune.tuning.stage_prove import Proved
from autotune.view import data
from autotune.view.colours import BLUE_ON_DARK, GREEN_ON_DARK, ORANGE_ON_DARK
from autotune.view.compared_pages import residuals_of
from autotune.view.data import Rank, Step, Trace
from autotune.view.identification_pictures import steady_state_data
from autotune.view.model_pages import comparison_of
from autotune.view.pages import Bar, Page
from autotune.view.rerun_file import FinalValue, parameter_table
from autotune.view.scale import multiple, quantity
from autotune.view.stage_pages import adaptation_page, diagnosis_page, fit_page, proof_page, verdict_page

if TYPE_CHECKING:
    from autotune.tuning.outcome import RunResult

HARMFUL = -0.05
"""Candidates that make it worse than this are left out of the picture."""


def limits_shown(axis: Axis) -> dict[str, tuple[float, float]]:
    """The axis's limits by what a plot shows."""
    limits = axis.limits
    return {
        "error": (-limits.following_error, limits.following_error),
        "position": (limits.position_min, limits.position_max),
        "velocity": (-limits.speed, limits.speed),
        "torque": (-limits.torque, limits.torque),
        "temperature": (np.nan, limits.temperature),
    }


def fit_shown(axis: Axis, found: Identification, recording: Recording) -> Page:
    """The identified model against the experiments."""
    steady = found.steady_state
    curve = steady_state_data(steady, axis.motion_unit) if steady is not None and steady.curves else None
    finals = [
        FinalValue(name, one.value, one.standard_error, surface_parameter(name).unit_for(axis.motion_unit))
        for name, one in found.joint.parameters.items()
    ]
    table = parameter_table(finals)
    compared = _compared(recording, found.model)
    if compared is None or found.model is None:
        return fit_page(None, curve, table)
    sample, floor = compared.problem.data, _finite(compared.noise_floor_rms)
    return fit_page(
        comparison_of(sample, compared.error, found.model.torque_symbol, floor),
        curve,
        table,
        residuals_of(sample, compared.error, compared.where, found.model, floor),
    )


def diagnosis_shown(
    axis: Axis, told: Diagnosed, model: DriveModel | None, recording: Recording, given: Given | None = None
) -> Page:
    """What the identified model lacks. `model`: as identified; `recording`: of the experiments.

    `given`: the model that goes to the proof instead; nothing here is found about it.
    """
    ranks = [
        Rank(one["effect"], one["gain"], one["accepted"], one["why"])
        for one in told.candidates
        if one["gain"] > HARMFUL
    ]
    compared = _compared(recording, model)
    residuals = []
    if compared is not None and model is not None:
        floor = _finite(compared.noise_floor_rms)
        residuals = residuals_of(compared.problem.data, compared.error, compared.where, model, floor)
    unit = data.torque_unit(axis.motion_unit)
    words = _meaning(told, unit)
    if given is not None:
        words = f"{sentence(given)} What is shown here is the run's own, of the model that it identified.\n\n{words}"
    return diagnosis_page(ranks, _steps(told), residuals, words, unit, told.noise_floor_rms)


def adaptation_shown(axis: Axis, adapted: Adapted, stiffness_range: tuple[float, float] | None) -> Page:
    """The parameters while they converged, and what refinement made of them."""
    words = adapted.laws.reason or "The laws have settled."
    steps = "\n".join(
        f"| {number} | {quantity(step.peak_error, axis.motion_unit)} |"
        for number, step in enumerate(adapted.steps)
    )
    table = f"\n\n| refinement | peak error |\n|---|---|\n{steps}" if steps else ""
    traces = traces_of(adapted, stiffness_range, axis.motion_unit)
    return adaptation_page(traces, words + table, 1.0 / axis.benchmark.frequency)


def proof_shown(axis: Axis, proved: Proved, committed: Sequence[Recording] = ()) -> Page:
    """Before and after over the period; `committed`: windows of the drive by itself."""
    low, high = proved.proof.interval
    words = (
        f"Gain of the peak error: {quantity(low, axis.motion_unit)} to {quantity(high, axis.motion_unit)} with "
        f"{100 * axis.acceptance.confidence:g} % confidence."
    )
    if proved.harmful:
        words += f" But {proved.harmful}."
    return proof_page(before_after_of(axis, proved, committed), words)


def verdict_shown(result: RunResult) -> Page:
    """What the run concludes, with the peak errors."""
    sides: list[tuple[str, str, TrackingError | None]] = [
        ("before", ORANGE_ON_DARK, result.before),
        ("in the drive", GREEN_ON_DARK, result.committed),
        ("played by the host", BLUE_ON_DARK, result.after),
    ]
    known = [(name, colour, one.peak_error) for name, colour, one in sides if one is not None]
    factor, unit = multiple(max((value for *_, value in known), default=0.0), result.motion_unit)
    bars = [
        Bar(name, factor * value, colour, quantity(value, result.motion_unit))
        for name, colour, value in known
    ]
    notes = "\n".join(f"- {note}" for note in result.notes)
    return verdict_page(f"# {result.axis}\n\n{result.verdict}\n\n{notes}", bars, unit)


def traces_of(adapted: Adapted, stiffness_range: tuple[float, float] | None, motion_unit: str) -> list[Trace]:
    """The parameters that the laws moved."""
    if not len(adapted.laws.time):
        return []
    low, high = stiffness_range or (None, None)
    return [
        Trace(
            name,
            surface_parameter(name).unit_for(motion_unit),
            adapted.laws.time,
            adapted.laws.history[:, column],
            low if name == "stiffness" else None,
            high if name == "stiffness" else None,
            getattr(adapted.best.parameters, name),
        )
        for column, name in enumerate(("stiffness", "coulomb", "offset"))
    ]


def before_after_of(axis: Axis, proved: Proved, committed: Sequence[Recording] = ()) -> data.BeforeAfter:
    """The tracking errors of the proof over one period."""
    period = proved.before[0].period
    samples = round(1.0 / (axis.benchmark.frequency * period))
    return data.BeforeAfter(
        np.asarray(np.arange(samples) * period, dtype=np.float64),
        fold(proved.before[0]["reference"], samples).mean(axis=0),
        _averages(proved.before, samples),
        _averages(proved.after, samples),
        axis.position_resolution,
        axis.motion_unit,
        after_name="played by the host",
        committed=_averages(committed, samples) if committed else None,
    )


def _averages(windows: Sequence[Recording], samples: int) -> Floats:
    return np.array([fold(w["reference"] - w["position"], samples).mean(axis=0) for w in windows])


def _steps(told: Diagnosed) -> list[Step]:
    if told.model is None:
        return []
    entries = [entry for entry in told.model.history if entry.error_after is not None]
    steps = [Step("as identified", entries[0].error_before or np.nan)] if entries else []
    return steps + [Step(entry.action.removeprefix("+ "), entry.error_after or 0.0) for entry in entries]


def _meaning(told: Diagnosed, unit: str) -> str:
    parts = [f"**Verdict: {told.verdict}**" + (f" ({told.confidence})" if told.confidence else "")]
    if told.error_before is not None and told.error_after is not None:
        parts.append(
            f"Error on unseen data {quantity(told.error_before, unit)} → {quantity(told.error_after, unit)}"
        )
    for effect in told.effects:
        kind = effect_kind(effect)
        parts.append(
            f"### {effect.replace('_', ' ')}\n\ncaused by: {kind.cause}\n\nwhat to do: {kind.remedy}"
        )
    if told.next_experiment:
        parts.append(f"Next: {told.next_experiment}")
    return "\n\n".join(parts)


def _compared(recording: Recording, model: DriveModel | None) -> Compared | None:
    if model is None:
        return None
    try:
        return compare([recording], model)
    except (AutotuneError, np.linalg.LinAlgError):
        return None


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
