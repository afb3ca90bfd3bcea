"""Measured against model: how large the error is, how much of it is noise, and where it sits.

The model is taken as it is, nothing is fitted. The torque residual is corrected by a twin where a
controller is known, so that the measurement chain is not blamed on the model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from autotune.core.errors import ConfigurationError
from autotune.core.recording import Recording, torque_symbol
from autotune.diagnose.alignment import best_shift, shifted
from autotune.diagnose.bandwidth import prepared_for
from autotune.diagnose.controller import find_controller, with_feedforward
from autotune.diagnose.coordinates import coordinates, since_reversal, variance_shares
from autotune.diagnose.filtered import without_twin
from autotune.diagnose.prepared import TRAINING, VETO, Prepared
from autotune.diagnose.residual import measured_motion, residual, run_twin, smoothed
from autotune.diagnose.score import bins
from autotune.diagnose.study import Study, estimate_noise, start_study, without_outlying
from autotune.models import layout
from autotune.models.drive_model import DriveModel, Packed
from autotune.models.lugre import Flags, Floats

WORST = 6
BINS = 12
REGIMES = ("presliding", "reversal", "low_speed", "high_speed", "acceleration")
_LOGARITHMIC = ("travel_since_reversal", "time_since_reversal")


@dataclass(frozen=True, slots=True)
class Worst:
    """A stretch of a coordinate with more than its part of the error: `share` of all squared error."""

    coordinate: str
    low: float
    high: float
    share: float


@dataclass(frozen=True, slots=True)
class Compared:
    """Model against measurement. Torques in N m or N, motor side.

    Attributes:
        error_rms: of the residual; `relative_error`: over the rms of the torque.
        noise_floor_rms: what differs from repeat to repeat; nan without repeats.
        explained: share of the torque's explainable variance that the model explains, 0…1.
        regimes: rms by kind of motion; nan where there is none.
        where: share of the residual's variance that each coordinate explains.
        position_rms: of the simulated against the measured position; nan without twin.
        error, torque: on the grid, shape (m,); `time` likewise.
    """

    error_rms: float
    relative_error: float
    noise_floor_rms: float
    explained: float
    worst: tuple[Worst, ...]
    regimes: Mapping[str, float]
    where: Mapping[str, float]
    twin: bool
    position_rms: float
    study: Study
    error: Floats
    rows: Flags
    notes: tuple[str, ...] = ()


def check_same_axis(model: DriveModel, recordings: Sequence[Recording]) -> None:
    """Raises ConfigurationError where model and recordings cannot be of the same axis."""
    for recording in recordings:
        other = recording.metadata
        if model.motion_unit != other.motion_unit:
            raise ConfigurationError(
                f"the model is for motion in {model.motion_unit}, the recording is in {other.motion_unit}; "
                "use the model of this axis, or fit one: autotune model fit"
            )
        if model.torque_unit != other.torque_unit:
            raise ConfigurationError(
                f"the model is for torque in {model.torque_symbol}, the recording is in "
                f"{torque_symbol(other.motion_unit, other.torque_unit)}; import the file with the unit of the model, "
                "or fit one to it: autotune model fit"
            )
        if model.fingerprint and other.fingerprint and model.fingerprint != other.fingerprint:
            raise ConfigurationError(
                f"the model is of axis {model.axis or model.fingerprint}, the recording of "
                f"{other.axis or other.fingerprint}; use the model of this axis, or fit one: autotune model fit"
            )


def compare(recordings: Sequence[Recording], model: DriveModel) -> Compared:
    """Compares a model with recordings.

    Raises:
        RecordingError, ConfigurationError, NotEnoughExcitation: recordings that cannot be used.
    """
    check_same_axis(model, recordings)
    data = prepared_for(recordings)
    found = find_controller(data)
    data = with_feedforward(data, found)
    study = start_study(data, found.controller)
    packed = model.pack()
    notes = () if found.controller else (f"No twin: {found.why}.",)
    if study.twin and not study.correction(packed, 1).stable:
        study = replace(study, controller=None)
        notes = ("No twin: a simulation of the model with this controller is unstable.",)
    if not study.twin:
        data, said = without_twin(data)
        data = data if data.repeated or data.steady else best_aligned(data, packed)
        study, notes = start_study(data, None), (*notes, *said)
    raw = residual(data, packed, study.moved)
    if study.twin:
        study = replace(study, noise=estimate_noise(study, packed, raw))
    correction = study.correction(packed, 3)
    if not correction.stable:
        study, correction = replace(study, controller=None), replace(correction, stable=True)
    error = raw - correction.bias
    if not data.repeated and not data.steady:
        study = replace(study, weight=without_outlying(study, error))
    rows = np.asarray(study.weight > 0)
    return _measures(study, model, error, rows, _position_error(study, model), notes)


def best_aligned(data: Prepared, packed: Packed) -> Prepared:
    """The data with the torque shifted to where this model explains it best."""

    def cost(shift: float) -> float:
        moved = shifted(data, shift)
        return float(np.mean(residual(moved, packed, measured_motion(moved)) ** 2))

    return shifted(data, best_shift(cost, data.shift, data.finer)[0])


def _measures(
    study: Study, model: DriveModel, error: Floats, rows: Flags, position: float, notes: tuple[str, ...]
) -> Compared:
    data = study.data
    torque = smoothed(data, data.torque)[rows]
    square = float(np.mean(error[rows] ** 2))
    noise = _noise(study, error)
    floor = noise if math.isfinite(noise) else 0.0
    explainable = max(float(np.var(torque)) - floor, 1e-300)
    return Compared(
        math.sqrt(square),
        math.sqrt(square / max(float(np.mean(torque**2)), 1e-300)),
        math.sqrt(noise) if math.isfinite(noise) else math.nan,
        float(np.clip(1.0 - max(square - floor, 0.0) / explainable, 0.0, 1.0)),
        worst_places(data, error, rows),
        regimes(data, model, error, rows),
        variance_shares(data, error, rows),
        study.twin,
        position,
        study,
        error,
        rows,
        notes,
    )


def _noise(study: Study, error: Floats) -> float:
    values = [study.noise_variance(error, role) for role in (TRAINING, VETO)]
    known = [value for value in values if math.isfinite(value)]
    return float(np.mean(known)) if known else math.nan


def _position_error(study: Study, model: DriveModel) -> float:
    if study.controller is None:
        return math.nan
    run = run_twin(study.data, model.pack(), study.controller, 0.0, np.random.default_rng(0))
    return float(np.sqrt(np.mean((run.position - study.data.measured) ** 2))) if run.stable else math.nan


def worst_places(data: Prepared, error: Floats, rows: Flags) -> tuple[Worst, ...]:
    """Where the squared error is most above its even share."""
    table = coordinates(data)
    total = max(float(np.sum(error[rows] ** 2)), 1e-300)
    found: list[tuple[float, Worst]] = []
    for name, values in table.items():
        member = bins(values, BINS, rows)
        for column in member.T:
            inside = rows & (column > 0)
            if inside.sum() < 20:
                continue
            share = float(np.sum(error[inside] ** 2)) / total
            low, high = float(values[inside].min()), float(values[inside].max())
            if name in _LOGARITHMIC:
                low, high = 10.0**low, 10.0**high
            found.append((share * rows.sum() / inside.sum(), Worst(name, low, high, share)))
    found.sort(key=lambda item: -item[0])
    return tuple(worst for _, worst in found[:WORST])


def regimes(data: Prepared, model: DriveModel, error: Floats, rows: Flags) -> dict[str, float]:
    """Rms of the error by kind of motion; nan where the recordings have none."""
    p = model.pack().p
    reach = p[layout.COULOMB] / p[layout.STIFFNESS]
    travel, _ = since_reversal(data)
    speed, change = np.abs(data.velocity[data.grid]), np.abs(data.acceleration[data.grid])
    fast, hard = np.percentile(speed[rows], 99.5), np.percentile(change[rows], 99.5)
    kinds = {
        "presliding": travel < 3.0 * reach,
        "reversal": (travel >= 3.0 * reach) & (travel < 30.0 * reach),
        "low_speed": (travel >= 3.0 * reach) & (speed < 0.1 * fast),
        "high_speed": speed > 0.5 * fast,
        "acceleration": change > 0.4 * hard,
    }
    return {name: _rms(error[rows & kinds[name]]) for name in REGIMES}


def _rms(values: Floats) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else math.nan
