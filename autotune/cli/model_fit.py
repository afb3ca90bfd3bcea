"""`autotune model fit`: which way recordings are fitted, and what is said about the result.

The standard programme is analysed experiment by experiment; any other motion is fitted as a whole inside
the twin. What that cannot start (effects beyond friction and ripple, motion one way only) is left to the
search of `diagnose`, which needs less and promises less.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autotune.core.errors import ConfigurationError, NotEnoughExcitation
from autotune.core.recording import Metadata, Recording
from autotune.diagnose.compare import Compared, compare
from autotune.diagnose.fitting import fit_model
from autotune.identify.complexity import Complexity, judge_complexity
from autotune.identify.estimate import Estimate, Quantity
from autotune.identify.first_guess import OneDirection
from autotune.identify.fit import STARTED, fit, joined
from autotune.identify.residuals import ClosedLoop, simulate_closed_loop, torque_residual
from autotune.identify.run import EXPERIMENTS, Identification, identify_run
from autotune.identify.steady_state import SteadyState
from autotune.models.drive_model import DriveModel
from autotune.models.table import effect_kind

Floats = NDArray[np.float64]
Progress = Callable[[str], None]
USUAL_ACCELERATION = 0.2 * (2.0 * math.pi) ** 2
"""Of the benchmark sine, at its reversals."""
ONE_NUMBER = ("coulomb", "offset")
"""What motion in one direction cannot tell apart."""
BEYOND_SPEEDS = ("inertia", "stiffness", "micro_damping")
USUAL_PRECISION = {"rad": 1e-3, "m": 1e-5}


@dataclass(frozen=True, slots=True)
class Fit:
    """A fitted model and all that is known about it.

    Attributes:
        method: `programme`, `twin`, `speed_curve` or `search`.
        estimate: by surface name, with intervals; empty parameters where only the model has numbers.
        error_rms, floor: of the model on the recordings, and of repeats; None where unknown.
        found: the single experiments, where they were made.
        steady: the curve over constant speeds, where the recordings hold nothing else or the programme's.
        loop: the model in closed loop; None where there is no model.
    """

    model: DriveModel | None
    method: str
    estimate: Estimate
    notes: tuple[str, ...]
    error_rms: float | None = None
    floor: float | None = None
    complexity: Complexity | None = None
    found: Identification | None = None
    loop: ClosedLoop | None = None
    steady: SteadyState | None = None

    @property
    def valid(self) -> bool:
        return self.model is not None and self.estimate.valid

    @property
    def not_identified(self) -> list[str]:
        names = [name for name, quantity in self.estimate.parameters.items() if not quantity.identified]
        return [*BEYOND_SPEEDS, *names] if self.method == "speed_curve" else names


def fit_files(
    recordings: Sequence[Recording], effects: Sequence[str], precision: float | None, progress: Progress
) -> Fit:
    """Fits a model and judges how much model the axis needs for `precision` [rad or m].

    Raises:
        RecordingError, NotEnoughExcitation: what is wrong with the data, in a sentence.
        ConfigurationError: an unknown effect, one named twice, a precision that is none.
    """
    for effect in effects:
        effect_kind(effect)
        if list(effects).count(effect) > 1:
            raise ConfigurationError(f"effect {effect!r} is named twice in --effects; name it once")
    if precision is not None and not 0.0 < precision < math.inf:
        raise ConfigurationError(f"--precision is {precision:g}; it must be a finite number above 0")
    whole = joined(recordings)
    result = _fitted(whole, effects, progress)
    model = result.model
    if model is None:
        return result
    rows = sum(len(part) for part in recordings)
    if len(whole) < rows:
        said = f"of {rows} rows {len(whole)} were fitted, in stretches spread evenly: more would tell little more"
        result = replace(result, notes=(*result.notes, said))
    complexity = _complexity(result.estimate, precision, whole.metadata)
    result = replace(result, complexity=complexity, loop=simulate_closed_loop(whole, model))
    return _with_error(result, recordings)


def _complexity(estimate: Estimate, precision: float | None, metadata: Metadata) -> Complexity | None:
    known = {name: quantity for name, quantity in estimate.parameters.items() if quantity.identified}
    wanted = precision if precision is not None else USUAL_PRECISION[metadata.motion_unit]
    return judge_complexity(known, wanted, USUAL_ACCELERATION, metadata)


def _fitted(whole: Recording, effects: Sequence[str], progress: Progress) -> Fit:
    standard = sum(name in whole.experiment for name in EXPERIMENTS) >= 2
    if standard and not effects:
        progress("fit of the standard programme")
        return _by_experiments(whole)
    if all(effect in STARTED for effect in effects):
        progress("fit of all motion together")
        try:
            result = fit(whole, effects)
        except OneDirection as reason:
            return _by_search(whole, effects, (f"{reason}; coulomb is the sum of both here",), progress)
        method = "speed_curve" if result.steady_state is not None else "twin"
        model = _with_errors(result.model, result.estimate)
        return Fit(model, method, result.estimate, result.estimate.notes, steady=result.steady_state)
    return _by_search(whole, effects, (), progress)


def _by_experiments(whole: Recording) -> Fit:
    found = identify_run(whole)
    joint = found.joint
    if found.model is None:
        reasons = "; ".join(f"{e.source}: {e.reason}" for e in found.estimates.values() if not e.valid)
        reason = f"{joint.reason} ({reasons})" if reasons else joint.reason
        return Fit(None, "programme", replace(joint, valid=False, reason=reason), found.notes, found=found)
    return Fit(found.model, "programme", joint, found.notes, found=found, steady=found.steady_state)


def _by_search(whole: Recording, effects: Sequence[str], notes: tuple[str, ...], progress: Progress) -> Fit:
    result = fit_model([whole], effects, progress)
    reason = "; ".join(text for text in (result.reason, *notes) if text)
    model = result.model
    unknown: dict[str, Quantity] = {}
    if notes:
        model, unknown = _as_one_number(model, notes[0])
    estimate = Estimate(
        "search", unknown, result.valid, reason, result.relative_error, tuple(result.notes) + notes
    )
    return Fit(model, "search", estimate, estimate.notes)


def _as_one_number(model: DriveModel, why: str) -> tuple[DriveModel, dict[str, Quantity]]:
    """The model of an axis that moved one way only: neither part of a sum has an error of its own."""
    base = dict(model.base)
    unknown = {}
    for name in ONE_NUMBER:
        base[name] = replace(base[name], standard_error=None)
        unknown[name] = Quantity(model[name], math.inf, identified=False, note=why)
    return replace(model, base=base), unknown


def _with_errors(model: DriveModel, estimate: Estimate) -> DriveModel:
    """The model with the standard errors of the estimate: those allow for colour and for what is systematic."""
    errors = {
        name: quantity.standard_error
        for name, quantity in estimate.parameters.items()
        if name in model.parameters and math.isfinite(quantity.standard_error)
    }
    return model.with_values({name: model[name] for name in errors}, errors)


def _with_error(result: Fit, recordings: Sequence[Recording]) -> Fit:
    """The error of the model as `compare` measures it, where it can."""
    if result.model is None:
        return result
    compared = compared_or_none(recordings, result.model)
    if compared is None:
        return result
    floor = compared.noise_floor_rms if math.isfinite(compared.noise_floor_rms) else None
    estimate = result.estimate
    if not math.isfinite(estimate.relative_error):
        estimate = replace(estimate, relative_error=compared.relative_error)
    return replace(result, estimate=estimate, error_rms=compared.error_rms, floor=floor)


def compared_or_none(recordings: Sequence[Recording], model: DriveModel) -> Compared | None:
    """`compare`; None where the recordings are too poor for it."""
    try:
        return compare(recordings, model)
    except NotEnoughExcitation:
        return None


def model_torque(recording: Recording, model: DriveModel) -> Floats:
    """What the model says for every row [N m or N]: the measured torque less the residual; nan in gaps."""
    residual = torque_residual(recording, model)
    predicted = np.full(len(recording), math.nan)
    edges = np.flatnonzero(np.diff(residual.row) > 4 * np.median(np.diff(residual.row))) + 1
    for rows, values in zip(
        np.split(residual.row, edges), np.split(residual.torque - residual.error, edges), strict=True
    ):
        every = np.arange(rows[0], rows[-1] + 1)
        predicted[every] = np.interp(every, rows, values)
    return predicted


def summary(result: Fit) -> str:
    """One or two sentences for the top of a page."""
    relative = result.estimate.relative_error
    parts = [
        f"The model leaves {100 * relative:.2g} % of the torque unexplained."
        if math.isfinite(relative)
        else ""
    ]
    if not result.valid:
        parts.append(f"It must not be used: {result.estimate.reason}.")
    elif result.estimate.reason:
        parts.append(f"{result.estimate.reason}.")
    if result.complexity is not None:
        text = result.complexity.text
        parts.append(f"{text[0].upper()}{text[1:]}.")
    return " ".join(part for part in parts if part)


def fit_json(result: Fit, parameters: Mapping[str, Any]) -> dict[str, Any]:
    """The object of `fit --json`."""
    return {
        "parameters": dict(parameters),
        "valid": result.valid,
        "reason": result.estimate.reason,
        "relative_error": result.estimate.relative_error,
        "method": result.method,
        "intervals": {
            name: list(q.interval)
            for name, q in result.estimate.parameters.items()
            if math.isfinite(q.standard_error)
        },
        "not_identified": result.not_identified,
        "complexity": _complexity_json(result.complexity),
        "closed_loop": _loop_json(result.loop),
        "steady_state": _steady_json(result.steady),
        "experiments": _experiments_json(result.found),
        "notes": list(result.notes),
    }


def least_torque_speeds(steady: SteadyState) -> dict[str, float]:
    """Speed of the measured point with the least torque, in each direction [rad/s or m/s]."""
    speeds, torque = steady.points.velocity, steady.points.torque
    found = {}
    for name, sign in (("positive", 1.0), ("negative", -1.0)):
        there = np.flatnonzero(sign * speeds > 0.0)
        if len(there):
            found[name] = float(speeds[there[np.argmin(sign * torque[there])]])
    return found


def least_torque_line(steady: SteadyState, motion_unit: str) -> str:
    """Where friction at constant speed is least, in words."""
    texts = []
    for value in least_torque_speeds(steady).values():
        turns = f" ({value * 30.0 / math.pi:.3g} rpm)" if motion_unit == "rad" else ""
        texts.append(f"{value:.3g} {motion_unit}/s{turns}")
    return f"friction at constant speed, {len(steady.points)} points, is least at " + " and ".join(texts)


def _steady_json(steady: SteadyState | None) -> dict[str, Any] | None:
    if steady is None:
        return None
    return {
        "velocity": steady.points.velocity.tolist(),
        "torque": steady.points.torque.tolist(),
        "standard_error": steady.points.standard_error.tolist(),
        "least_torque_at": least_torque_speeds(steady),
        "shapes": [{"shape": curve.shape, "held_out_rms": curve.held_out_rms} for curve in steady.curves],
    }


def _loop_json(loop: ClosedLoop | None) -> dict[str, float] | None:
    """Position and torque of the model in the loop on the recorded references, against the measured ones."""
    if loop is None or not math.isfinite(loop.relative_position_error):
        return None
    return {
        "relative_position_error": loop.relative_position_error,
        "relative_torque_error": loop.relative_torque_error,
    }


def _complexity_json(complexity: Complexity | None) -> dict[str, Any] | None:
    if complexity is None:
        return None
    return {
        "displacement": complexity.displacement.value,
        "displacement_interval": list(complexity.displacement.interval),
        "precision": complexity.precision,
        "model": "lugre" if complexity.lugre_needed else "kinetic",
        "peak_difference": complexity.peak_difference,
        "duration": complexity.duration,
        "text": complexity.text,
    }


def _experiments_json(found: Identification | None) -> dict[str, Any]:
    if found is None:
        return {}
    return {
        name: {
            "valid": estimate.valid,
            "reason": estimate.reason,
            "parameters": {
                key: {"value": q.value, "standard_error": q.standard_error}
                for key, q in estimate.parameters.items()
            },
        }
        for name, estimate in found.estimates.items()
    }
