"""Friction at speed of the whole axis: the base Coulomb torque and the elements of `reversal_memory`.

Several elastic elements take over what the single bristle carried, so that the base `coulomb` of a model
with `reversal_memory` may be next to nothing on an axis with plenty of friction. A person who compares
models, or looks for wear, wants the sum: F = F_c + Σ W_i, once all elements slide.

The parts trade friction with each other in a fit (their errors are correlated negatively). A fit says how well
the sum is known (`DriveModel.friction_error`); a file does not, and the root of the sum of squares is an upper bound.
"""

from __future__ import annotations

import math

from autotune.models.drive_model import DriveModel
from autotune.models.effect import Value
from autotune.models.reversal_memory import REVERSAL_MEMORY

_MEMORY, _ELEMENT = REVERSAL_MEMORY.name, "torque_"


def friction_parts(model: DriveModel) -> dict[str, Value]:
    """What carries friction at speed, by surface name: `coulomb`, and each element's torque."""
    return {
        name: value
        for name, value in model.parameters.items()
        if name == "coulomb" or name.startswith(f"{_MEMORY}.{_ELEMENT}")
    }


def total_friction(model: DriveModel) -> Value:
    """Friction torque at speed, viscous part left out [N m or N], with its standard error.

    The standard error is None where the error of a part that carries anything is not known.
    """
    parts = list(friction_parts(model).values())
    if model.friction_error is not None:
        return Value(sum(part.value for part in parts), model.friction_error)
    errors = [part.standard_error for part in parts if part.value != 0.0 or part.standard_error is not None]
    known = [error for error in errors if error is not None]
    spread = math.hypot(*known) if known and len(known) == len(errors) else None
    return Value(sum(part.value for part in parts), spread)


def stiffness_of_elements(model: DriveModel) -> float:
    """Stiffness at rest of all elements of the memory together [N m/rad or N/m]; 0 without them."""
    effect = next((one for one in model.effects if one.kind is REVERSAL_MEMORY), None)
    if effect is None:
        return 0.0
    values = {name: value.value for name, value in effect.values.items()}
    pairs = [
        (values[f"torque_{name.rpartition('_')[2]}"], travel)
        for name, travel in values.items()
        if name.startswith("displacement_") and travel > 0.0
    ]
    return sum(torque / travel for torque, travel in pairs)


def stiffness_at_rest(model: DriveModel) -> float:
    """Of a bristle that carries friction and all elements together [N m/rad or N/m]: what a small move feels."""
    bristle = model["stiffness"] if model["coulomb"] > 0.0 else 0.0
    return float(bristle + stiffness_of_elements(model))


def total_in_words(model: DriveModel) -> str:
    """The total with its share in the elements, a clause; empty where `coulomb` is the total."""
    if _MEMORY not in model:
        return ""
    total = total_friction(model)
    most = " at most" if model.friction_error is None else ""
    spread = "" if total.standard_error is None else f" (± {total.standard_error:.2g}{most})"
    share = 1.0 - model["coulomb"] / total.value if total.value > 0.0 else 0.0
    return (
        f"total friction {total.value:.4g} {model.torque_symbol}{spread}, {100.0 * share:.0f} % of it in the "
        f"elements of {_MEMORY}"
    )
