"""Friction at speed of the whole axis: the base Coulomb torque and the elements of `reversal_memory`.

Several elastic elements take over what the single bristle carried, so that the base `coulomb` of a model
with `reversal_memory` may be next to nothing on an axis with plenty of friction. A person who compares
models, or looks for wear, wants the sum: F = F_c + Σ W_i, once all elements slide.

The parts trade friction with each other in a fit (their errors are correlated negatively), and so they do stiffness
at rest. A fit says how well the sums are known (`DriveModel.friction_error`, `stiffness_error`); where none has, the
root of the sum of squares is an upper bound.
"""

from __future__ import annotations

import math

from autotune.models.drive_model import DriveModel
from autotune.models.effect import Value
from autotune.models.reversal_memory import REVERSAL_MEMORY

ELEMENTS_DAMPING = REVERSAL_MEMORY.surface("damping")
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


def stiffness_parts(model: DriveModel) -> dict[str, float]:
    """By how much the stiffness at rest changes with each parameter that it rests on, by surface name."""
    slopes = {"stiffness": 1.0} if model["coulomb"] > 0.0 else {}
    for travel, torque in _pairs(model):
        across, along = model[torque], model[travel]
        slopes |= {torque: 1.0 / along, travel: -across / along**2}
    return slopes


def stiffness_spread(model: DriveModel) -> float | None:
    """Standard error of the stiffness at rest [N m/rad or N/m]; None where that of a part is not known."""
    if model.stiffness_error is not None:
        return model.stiffness_error
    errors = {name: model.parameters[name].standard_error for name in stiffness_parts(model)}
    known = [
        slope * error for name, slope in stiffness_parts(model).items() if (error := errors[name]) is not None
    ]
    return math.hypot(*known) if known and len(known) == len(errors) else None


def stiffness_of_elements(model: DriveModel) -> float:
    """Stiffness at rest of all elements of the memory together [N m/rad or N/m]; 0 without them."""
    return sum(model[torque] / model[travel] for travel, torque in _pairs(model))


def _pairs(model: DriveModel) -> list[tuple[str, str]]:
    """Surface names of displacement and torque of each element that there is."""
    if REVERSAL_MEMORY.name not in model:
        return []
    return [
        (REVERSAL_MEMORY.surface(name), REVERSAL_MEMORY.surface(f"torque_{name.rpartition('_')[2]}"))
        for name, travel in model.effect(REVERSAL_MEMORY).values.items()
        if name.startswith("displacement_") and travel.value > 0.0
    ]


def stiffness_at_rest(model: DriveModel) -> float:
    """Of a bristle that carries friction and all elements together [N m/rad or N/m]: what a small move feels."""
    bristle = model["stiffness"] if model["coulomb"] > 0.0 else 0.0
    return float(bristle + stiffness_of_elements(model))


def damping_at_rest(model: DriveModel) -> float:
    """Of the bristle and all elements together, while all stick [N m s/rad or N s/m]; viscous friction is beside it."""
    elements = model.parameters.get(ELEMENTS_DAMPING)
    return model["micro_damping"] + (elements.value if elements is not None else 0.0)


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
