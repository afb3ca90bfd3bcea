"""The joint refinement as an estimate with sentences: what is known, what is not, and what would tell it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import scipy

from autotune.estimation.bandwidth import Bands
from autotune.estimation.controller import controller_of
from autotune.estimation.controller_law import PositionController
from autotune.estimation.joint_fit import Refined, refine
from autotune.estimation.pieces import UNFITTED, Surroundings, cut, marked_sticking
from autotune.identify.estimate import Estimate, Quantity
from autotune.models.drive_model import DriveModel, surface_parameter
from autotune.recordings.recording import Recording

NEEDED = ("inertia", "coulomb", "offset")
"""Without these there is no model; what else is not identified is said in the reason."""
UNKNOWN = 0.5
"""A parameter whose standard error is this share of its value is not identified."""
SYSTEMATIC = {"inertia": 5e-4, "stiffness": 5e-4, "coulomb": 1e-4}
SYSTEMATIC_ELSE = 2e-4
"""Of the value: what filters, integration steps and the quantiser's model are trusted to at best."""
_REMEDIES = {
    "inertia": "accelerate harder: a multisine of 5 to 50 Hz, or point-to-point moves",
    "viscous": "move faster, over a wide range of speeds",
    "coulomb": "move in both directions at constant speed",
    "stiffness": "record presliding (small torques round standstill) or slow reversals",
    "micro_damping": "record presliding with a multisine round the axis's resonance at rest",
    "offset": "move in both directions at the same speed",
    "break_away": "record triangles slower than the speed at which friction falls",
    "stribeck_velocity": "record more speeds between the slowest and the one where friction stops falling",
}


@dataclass(frozen=True, slots=True)
class Joint:
    """Estimate in words and numbers, the refined model, and the details."""

    estimate: Estimate
    model: DriveModel
    refined: Refined
    controller: PositionController


def refine_recording(
    model: DriveModel,
    recording: Recording,
    free: Sequence[str] | None = None,
    seed: int = 0,
    unfitted: tuple[str, ...] = UNFITTED,
    controller: PositionController | None = None,
) -> Joint:
    """Refines a model on a recording; by default all its parameters but ripple orders.

    Args:
        controller: of the twin; by default the recording's.

    Raises:
        NotEnoughExcitation: nothing in the recording is long enough.
    """
    names = free if free is not None else free_parameters(model)
    controller = controller if controller is not None else controller_of(recording)
    bands = Bands.of(recording)
    pieces = cut(recording, bands, controller, unfitted)
    displacement = max(model["coulomb"], 1e-12) / model["stiffness"]
    refined = refine(
        model, marked_sticking(pieces, displacement), surroundings(recording, controller), bands, names, seed
    )
    estimate = _estimate(refined)
    estimate = replace(estimate, notes=(*estimate.notes, *controller.notes))
    return Joint(estimate, refined.model, refined, controller)


def free_parameters(model: DriveModel) -> list[str]:
    """What a refinement moves: everything but what is held, as the orders of ripple."""
    return [name for name in model.parameters if not surface_parameter(name).held]


def surroundings(recording: Recording, controller: PositionController) -> Surroundings:
    """Encoder, limit and controller of the axis that was recorded."""
    metadata = recording.metadata
    limit = metadata.torque_limit
    return Surroundings(
        controller,
        metadata.position_resolution or 0.0,
        limit if limit is not None else math.inf,
    )


def _estimate(refined: Refined) -> Estimate:
    reaches = np.asarray(scipy.stats.t.ppf(0.975, refined.normal.freedom))
    errors = refined.standard_errors
    quantities: dict[str, Quantity] = {}
    notes = list(_directions(refined))
    for name, reach in zip(refined.names, reaches.tolist(), strict=True):
        value = refined.model[name]
        error = math.hypot(errors[name], SYSTEMATIC.get(name, SYSTEMATIC_ELSE) * value)
        quantities[name] = _quantity(refined, name, value, error, reach)
        if quantities[name].note:
            notes.append(f"{name}: {quantities[name].note}")
    if not refined.converged:
        notes.append("the refinement has not converged; take the intervals with care")
    if refined.twin < 1.0:
        share = f"{100 * (1 - refined.twin):.0f} %"
        notes.append(f"no closed loop twin for {share} of the data; biases of filters remain there")
    reason = missing(quantities)
    usable = all(quantities[name].identified for name in NEEDED if name in quantities)
    return Estimate(
        "joint",
        MappingProxyType(quantities),
        usable,
        reason,
        refined.relative_error,
        tuple(dict.fromkeys(notes)),
    )


def _quantity(refined: Refined, name: str, value: float, error: float, reach: float) -> Quantity:
    size = max(abs(value), _natural_size(refined.model, name))
    if not math.isfinite(error) or error > UNKNOWN * size:
        remedy = _REMEDIES.get(name, "record motion in which it matters")
        return Quantity(value, error, reach, False, f"not identified by these experiments; {remedy}")
    if name in refined.bounded and name not in ("viscous", "micro_damping"):
        return Quantity(value, error, reach, False, "ended at a bound of what is possible")
    note = "ended at its lower bound: not distinguishable from zero" if name in refined.bounded else ""
    return Quantity(value, error, reach, True, note)


def _natural_size(model: DriveModel, name: str) -> float:
    """What a signed or vanishing parameter is measured against."""
    if surface_parameter(name).unit == "N m":
        return max(model["coulomb"], abs(model["offset"]))
    if surface_parameter(name).unit == "N m s/rad" and name not in ("viscous", "micro_damping"):
        return model["viscous"]
    if name == "micro_damping":
        return 0.2 * math.sqrt(model["stiffness"] * model["inertia"])
    return 0.0


def _directions(refined: Refined) -> list[str]:
    """Combinations of parameters that the data say next to nothing about."""
    texts = []
    for direction in refined.normal.weak_directions(1e-9):
        loud = [
            name
            for name, part in zip(refined.names, direction, strict=True)
            if abs(part) > 0.4 * float(np.max(np.abs(direction)))
        ]
        if len(loud) > 1:
            texts.append(f"only a combination of {', '.join(loud)} is known from these experiments")
    return texts


def missing(quantities: Mapping[str, Quantity]) -> str:
    """What is not identified, and what would tell it; "" where all is known."""
    unknown = [name for name, quantity in quantities.items() if not quantity.identified]
    if not unknown:
        return ""
    wanted = "; ".join(dict.fromkeys(_REMEDIES.get(name, "") for name in unknown)).strip("; ")
    return f"{', '.join(unknown)} not identified by these experiments" + (f"; {wanted}" if wanted else "")
