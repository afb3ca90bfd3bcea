"""Recordings that hold constant speeds only: one file a speed, as some test benches record them.

They tell friction over speed and nothing of inertia and contact stiffness; those are placeholders in
the model, without a standard error, and the reason says so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from autotune.estimation.pieces import UNFITTED
from autotune.identify.characteristic import fit_curve
from autotune.identify.estimate import Estimate
from autotune.identify.legs import find_legs
from autotune.identify.steady_state import SteadyState, identify_steady_state
from autotune.models.direction_asymmetry import DIRECTION_ASYMMETRY
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.lugre import Shape
from autotune.models.stribeck import STRIBECK
from autotune.recordings.checks import guide_of
from autotune.recordings.recording import Recording

PLACEHOLDER_INERTIA = 1e-9
LEAST_SEGMENTS = 4
_COVERED, _OF_ROWS = 0.6, 0.8


@dataclass(frozen=True, slots=True)
class SpeedCurve:
    """A model for constant speeds, its estimate, and the curve with its points."""

    model: DriveModel
    estimate: Estimate
    steady_state: SteadyState


def holds_constant_speeds_only(recording: Recording) -> bool:
    """Whether nearly every segment is one stretch of constant speed."""
    resolution = recording.metadata.position_resolution or 0.0
    single = total = count = 0
    for segment, part in recording.split():
        if segment.experiment in UNFITTED or len(part) < 16:
            continue
        legs = find_legs(guide_of(part), part.period, resolution)
        total += len(part)
        if len(legs) == 1 and len(legs[0]) > _COVERED * len(part):
            single += len(part)
            count += 1
    return count >= LEAST_SEGMENTS and single > _OF_ROWS * total


def fit_speed_curve(recording: Recording, effects: Sequence[str]) -> SpeedCurve:
    """A model of friction at constant speeds.

    Raises:
        NotEnoughExcitation: too few speeds, or one direction only.
    """
    state = identify_steady_state(recording)
    shape: Shape = "gaussian" if STRIBECK.name in effects else "linear"
    curve = fit_curve(state.points, shape, DIRECTION_ASYMMETRY.name in effects)
    found = curve.parameters
    values = {name: quantity.value for name, quantity in found.items() if "." not in name}
    reach = float(np.min(np.abs(state.points.velocity))) * recording.period
    stiffness = values["coulomb"] / max(reach, 1e-12)
    metadata = recording.metadata
    model = base_model(
        values | {"inertia": PLACEHOLDER_INERTIA, "stiffness": stiffness, "micro_damping": 0.0},
        {name: q.standard_error for name, q in found.items() if math.isfinite(q.standard_error)},
        metadata.motion_unit,
        metadata.axis,
        metadata.fingerprint,
        metadata.torque_unit,
    )
    if DIRECTION_ASYMMETRY.name in effects:
        name = DIRECTION_ASYMMETRY.surface("viscous")
        asymmetry = {"coulomb": 0.0, "viscous": found[name].value}
        model = model.with_effect(
            DIRECTION_ASYMMETRY.make(asymmetry, {"viscous": found[name].standard_error})
        )
    reason = (
        f"only the speed curve: {len(state.points)} points. Inertia, stiffness and micro_damping are not "
        "identified by these experiments; record accelerations and reversals"
    )
    estimate = Estimate("steady_state", found, True, reason, curve.relative_error)
    return SpeedCurve(model, estimate, state)
