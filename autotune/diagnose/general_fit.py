"""A first model from any recording: the base parameters, without knowing which experiments were made.

Inertia, viscous and Coulomb friction and offset by least squares on motion and torque; stiffness from
the best of several presliding distances; then everything together inside the twin.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from autotune.core.errors import NotEnoughExcitation
from autotune.diagnose.adding import grown
from autotune.diagnose.baseline import begin
from autotune.diagnose.candidates import Progress, no_progress
from autotune.estimation.bandwidth import prepared_for
from autotune.estimation.bias_corrected_fit import Level
from autotune.estimation.data import Prepared, prepare
from autotune.estimation.free_parameters import model_from
from autotune.estimation.least_squares import standard_errors
from autotune.estimation.policy import POLICY, Policy
from autotune.estimation.problem import Study, start_study
from autotune.estimation.residual import residual, smoothed
from autotune.models.drive_model import DriveModel, base_model
from autotune.recordings.recording import Recording

REACHES = (1e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2)  # of the travel


@dataclass(frozen=True, slots=True)
class FittedModel:
    """A fitted model and whether it may be used."""

    model: DriveModel
    valid: bool
    reason: str
    relative_error: float
    notes: tuple[str, ...] = ()


def fit_model(
    recordings: Sequence[Recording],
    effects: Sequence[str] = (),
    progress: Progress = no_progress,
    policy: Policy = POLICY,
) -> FittedModel:
    """Base model, and effects on top in the order given.

    Raises:
        RecordingError, ConfigurationError, NotEnoughExcitation: recordings that cannot be used.
    """
    data = prepared_for(recordings, policy)
    start = starting_model(data, policy)
    if data.steady:
        # constant speeds tell nothing about inertia and presliding; the noise on them a little
        rough = starting_model(prepare(recordings), policy)
        start = start.with_values({name: rough[name] for name in ("inertia", "stiffness", "micro_damping")})
    study, level, nominal, notes = begin(data, start, progress, policy=policy)
    for effect in effects:
        progress(f"refit with {effect}")
        study, _, level = grown(study, level, nominal, effect, start)
    errors = standard_errors(level.fitted, study.training)
    model = model_from(start, level.fitted.packed, level.fitted.free, errors)
    relative = relative_error(study, level)
    reason = _reason(model, relative, policy)
    if not reason and relative > policy.fit_poor:
        notes = (
            *notes,
            f"The base model leaves {100 * relative:.0f} % of the torque unexplained; "
            "'autotune model diagnose' tells what is missing.",
        )
    if data.steady:
        notes = (*notes, "Only the curve over constant speeds was fitted; inertia and stiffness are rough.")
    if study.scales.one_way:
        notes = (
            *notes,
            "The axis moved one way only: offset and Coulomb friction are one number; it is "
            "given as Coulomb friction.",
        )
    return FittedModel(model, not reason, reason, relative, notes)


def relative_error(study: Study, level: Level) -> float:
    """Norm of the residual over norm of the torque, on what was fitted."""
    rows = study.training > 0
    torque = smoothed(study.data, study.data.torque)[rows]
    return float(np.linalg.norm(level.fitted.error[rows]) / max(float(np.linalg.norm(torque)), 1e-300))


def starting_model(data: Prepared, policy: Policy = POLICY) -> DriveModel:
    """Rough base parameters from least squares.

    Raises:
        NotEnoughExcitation: inertia or friction cannot be told from the motion.
    """
    study = start_study(data, None)
    values = _least_squares(data, study.scales.one_way, policy)
    travel = float(np.ptp(data.position[data.grid]))
    best = (math.inf, values)
    for reach in REACHES[:1] if data.steady else REACHES:
        stiffness = values["coulomb"] / (reach * travel)
        damping = 0.3 * math.sqrt(stiffness * values["inertia"])
        trial = {**values, "stiffness": stiffness, "micro_damping": damping}
        packed = base_model(trial, motion_unit=data.metadata.motion_unit).pack()
        cost = float(np.mean(residual(data, packed, study.moved)[study.training > 0] ** 2))
        best = min(best, (cost, trial), key=lambda item: item[0])
    meta = data.metadata
    return base_model(best[1], None, meta.motion_unit, meta.axis, meta.fingerprint, meta.torque_unit)


def _least_squares(data: Prepared, one_way: bool, policy: Policy) -> dict[str, float]:
    rows = data.role("training")
    speed = np.percentile(np.abs(data.velocity[data.grid[rows]]), 90)
    moving = rows & (np.abs(data.velocity[data.grid]) > 0.02 * speed)
    parts = {
        "inertia": data.acceleration,
        "viscous": data.velocity,
        "coulomb": np.sign(data.velocity),
        "offset": np.ones(len(data.velocity)),
    }
    table = np.column_stack([smoothed(data, np.ascontiguousarray(x))[moving] for x in parts.values()])
    target = smoothed(data, 0.5 * (data.torque + np.concatenate([data.torque[:1], data.torque[:-1]])))[moving]
    if moving.sum() < 50:
        raise NotEnoughExcitation("the axis hardly moves in these recordings; record longer, faster motion")
    size = np.linalg.norm(table, axis=0)
    found = np.linalg.lstsq(table / np.maximum(size, 1e-300), target, rcond=1e-10)[0] / np.maximum(
        size, 1e-300
    )
    values = dict(zip(parts, found.tolist(), strict=True))
    if values["inertia"] <= 0.0:
        part = float(np.std(values["inertia"] * table[:, 0]) / max(float(np.std(target)), 1e-300))
        if part > policy.wrong_sign:
            raise NotEnoughExcitation(
                f"the torque falls where the axis accelerates (inertia {values['inertia']:.3g}): its sign is "
                "wrong, or it is not the torque of this motion. Import again with a factor of -1"
            )
    scale = float(np.std(target))
    values["inertia"] = max(values["inertia"], 1e-3 * scale / max(float(np.std(table[:, 0])), 1e-300))
    values["viscous"] = max(values["viscous"], 1e-3 * scale / max(float(np.std(table[:, 1])), 1e-300))
    values["coulomb"] = max(values["coulomb"], 1e-2 * scale)
    if one_way:
        values["coulomb"] = max(values["coulomb"] + values["offset"], 1e-2 * scale)
        values["offset"] = 0.0
    return values


def _reason(model: DriveModel, relative: float, policy: Policy) -> str:
    if relative > policy.fit_error:
        return (
            f"the model leaves {100 * relative:.0f} % of the torque unexplained; run 'autotune model diagnose' "
            "to see what is missing"
        )
    loose = [
        name
        for name in ("inertia", "coulomb")
        if (error := model.base[name].standard_error) is not None and error > policy.fit_loose * model[name]
    ]
    if loose:
        return f"{', '.join(loose)} cannot be told from these recordings; record the whole programme"
    return ""
