"""Whether an identified model can be that of an axis, by its sizes (`recordings.axis_sizes`)."""

from __future__ import annotations

import math
from collections.abc import Collection

from autotune.models.drive_model import DriveModel
from autotune.recordings.axis_sizes import GRAVITY, Sizes, judged_together, motion_sizes, sizes
from autotune.recordings.recording import Recording


def judge_model(model: DriveModel, recording: Recording, unknown: Collection[str]) -> tuple[str, list[str]]:
    """Why the model is of no axis ("" where it may be), and questions about the units.

    Several unusual sizes that one mistaken unit explains together are no chance: the model is refused then.

    Args:
        unknown: parameters that the fit did not identify; nothing is judged by them.
    """
    moved = sizes(recording)
    if moved.speed == 0.0:
        return "", []
    values = motion_sizes(moved) | model_sizes(model, moved, unknown)
    impossible, questions = judged_together(values, model.motion_unit)
    return (impossible[0] if impossible else ""), questions


def model_sizes(model: DriveModel, moved: Sizes, unknown: Collection[str]) -> dict[str, float]:
    """Those of `RANGES` that the identified parameters tell."""
    known = {
        name for name in ("inertia", "coulomb", "stiffness") if name not in unknown and _sure(model, name)
    }
    values = {}
    if {"inertia", "stiffness"} <= known:
        values["resonance"] = math.sqrt(model["stiffness"] / model["inertia"]) / (2.0 * math.pi)
    if {"inertia", "coulomb"} <= known and moved.speed > 0.0:
        friction = model["coulomb"] + model["viscous"] * moved.speed
        values["coasting"] = model["inertia"] * moved.speed / friction
        if model.motion_unit == "m" and not model.torque_unit:
            values["weight"] = model["coulomb"] / (model["inertia"] * GRAVITY)
    if {"coulomb", "stiffness"} <= known:
        values["reach"] = model["coulomb"] / model["stiffness"]
    return values


def _sure(model: DriveModel, name: str) -> bool:
    """Known to a factor of two: more is not asked of what is compared with decades."""
    value = model.parameters[name]
    return value.value > 0.0 and value.standard_error is not None and value.standard_error < 0.5 * value.value
