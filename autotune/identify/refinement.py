"""The joint refinement as an estimate with sentences: what is known, what is not, and what would tell it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
import scipy

from autotune.estimation.bandwidth import COUNTED, Bands, prepared_repeats
from autotune.estimation.contact_start import usual_damping
from autotune.estimation.controller import as_recorded, controller_of
from autotune.estimation.controller_law import PositionController
from autotune.estimation.data import known_resolution
from autotune.estimation.joint_fit import Refined, refine
from autotune.estimation.pieces import UNFITTED, Piece, Surroundings, cut, marked_sticking
from autotune.estimation.problem import Problem, new_problem
from autotune.identify.estimate import Estimate, Quantity
from autotune.models.drive_model import DriveModel, surface_parameter
from autotune.models.effect import Value
from autotune.models.reversal_memory import REVERSAL_MEMORY
from autotune.models.torque_lag import TORQUE_LAG
from autotune.models.total_friction import (
    ELEMENTS_DAMPING,
    damping_at_rest,
    stiffness_at_rest,
    stiffness_of_elements,
    stiffness_spread,
    total_friction,
)
from autotune.recordings.recording import Recording

SHARING = 6
"""Steps in which the damping is shared; the torque is linear in both parts."""
NEEDED = ("inertia", "coulomb", "offset")
"""Without these there is no model; what else is not identified is said in the reason."""
UNKNOWN = 0.5
"""A parameter whose standard error is this share of its value is not identified."""
SYSTEMATIC = {"inertia": 5e-4, "stiffness": 5e-4, "coulomb": 1e-4}
SYSTEMATIC_ELSE = 2e-4
"""Of the value: what filters, integration steps and the quantiser's model are trusted to at best."""
AT_REVERSALS = ("stiffness", "micro_damping")
FINER = "record a finer position"
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
    pieces = marked_sticking(pieces, displacement)
    refined = refine(
        model, pieces, surroundings(recording, controller), bands, names, seed,
        repeats=_repeats(recording, controller),
    )  # fmt: skip
    counts = Counts.of(recording, refined, pieces, bands, seed)
    estimate = _estimate(refined, counts)
    estimate = replace(estimate, notes=(*estimate.notes, *controller.notes))
    return Joint(estimate, _without_unseen(refined, counts), refined, controller)


@dataclass(frozen=True, slots=True)
class Counts:
    """What counts of the encoder may make of a refinement.

    Attributes:
        reach: of the fitted contact [counts]; infinite where the position has none.
        share: of the acceleration's power, where no twin makes the same counts.
        change: of the parameters, by name, where they are coarse and no controller is known for a twin: to those that
            are found with a twin that is led along the measured motion and makes counts there.
    """

    reach: float
    share: float
    change: Mapping[str, float]

    @classmethod
    def of(
        cls, recording: Recording, refined: Refined, pieces: Sequence[Piece], bands: Bands, seed: int
    ) -> Counts:
        """Those of a refinement that was made on pieces of a recording."""
        resolution = known_resolution(recording.metadata, recording["position"])
        reach = refined.model["coulomb"] / refined.model["stiffness"] / max(resolution, 1e-300)
        share = bands.counted * (1.0 - refined.twin)
        if refined.around.controller.usable or not (bands.lowered or reach < 1.0):
            return cls(reach, share, {})
        led = [replace(piece, closed=False, sticks=False) if piece.closed else piece for piece in pieces]
        around = replace(refined.around, resolution=resolution)
        other = refine(refined.model, led, around, bands, refined.names, seed)
        change = {name: abs(other.model[name] - refined.model[name]) for name in refined.names}
        return cls(reach, share, change)


@dataclass(frozen=True, slots=True)
class AtRest:
    """Damping in presliding of friction that has several elements [N m s/rad or N s/m].

    Attributes:
        whole, error: of the bristle and all elements together, with its standard error.
        share, share_error: the elements' part of it.
    """

    whole: float
    error: float
    share: float
    share_error: float = 0.0

    @property
    def values(self) -> dict[str, Value]:
        """Of bristle and elements, by surface name."""
        parts = {"micro_damping": 1.0 - self.share, ELEMENTS_DAMPING: self.share}
        spread = self.share_error * self.whole
        return {
            name: Value(part * self.whole, math.hypot(part * self.error, spread))
            for name, part in parts.items()
        }


def damping_in_small_motion(
    model: DriveModel, recording: Recording, late: float, share: float
) -> AtRest | None:
    """The damping of a model with reversal memory by small motion at rest, where all elements stick, all else held.

    Args:
        late: by how much the torque comes later than the model says [s].
        share: of the elements.

    Returns:
        None where the recording has no small motion in torque mode, or does not tell.

    Raises:
        NotEnoughExcitation: nothing in the recording is long enough.
    """
    pieces, around, bands = _pieces(model, recording)
    small = [one for one in pieces if one.sticks and not one.closed and np.ptp(one.torque) > 0.0]
    if not small:
        return None
    stiffness = stiffness_at_rest(model)
    start = _damped(_later(model, late), usual_damping(stiffness, model["inertia"]), share)
    larger = ELEMENTS_DAMPING if share >= 0.5 else "micro_damping"
    refined = refine(start, small, around, bands, (larger,))
    whole = damping_at_rest(refined.model)
    error = math.hypot(refined.standard_errors[larger], whole * (stiffness_spread(model) or 0.0) / stiffness)
    known = refined.converged and not refined.bounded and error < UNKNOWN * whole
    return AtRest(whole, error, share) if known else None


def damping_of_elements(model: DriveModel, recording: Recording, late: float, whole: float) -> AtRest | None:
    """Damping and the elements' share of it: by motion in which one after another slides, then by small motion.

    The share is that of their stiffness (one relaxation time) unless the motion comes nearer to none; by how much it
    comes to another one is in its standard error.

    Args and errors as in `damping_in_small_motion`; `whole`: about the damping [N m s/rad].
    """
    alike = stiffness_of_elements(model) / stiffness_at_rest(model)
    pieces, around, bands = _pieces(model, recording)
    start = _damped(_later(model, late), whole, alike)
    parts = ("micro_damping", ELEMENTS_DAMPING)
    share, error = _shared(refine(start, pieces, around, bands, parts, iterations=SHARING), alike)
    found = damping_in_small_motion(model, recording, late, share)
    return None if found is None else replace(found, share_error=error)


def _pieces(model: DriveModel, recording: Recording) -> tuple[list[Piece], Surroundings, Bands]:
    controller, bands = controller_of(recording), Bands.of(recording)
    reach = total_friction(model).value / stiffness_at_rest(model)
    pieces = marked_sticking(cut(recording, bands, controller), reach)
    return pieces, surroundings(recording, controller), bands


def _damped(model: DriveModel, whole: float, share: float) -> DriveModel:
    """The model with this damping in presliding, the `share` of it in the elements."""
    memory = model.effect(REVERSAL_MEMORY)
    values = {name: value.value for name, value in memory.values.items()} | {"damping": share * whole}
    return model.with_effect(REVERSAL_MEMORY.make(values)).with_values(
        {"micro_damping": (1.0 - share) * whole}
    )


def _later(model: DriveModel, late: float) -> DriveModel:
    """The model with its torque so much later [s]."""
    if late <= 0.0:
        return model
    name = TORQUE_LAG.surface("time_constant")
    if TORQUE_LAG.name in model:
        return model.with_values({name: model[name] + late})
    return model.with_effect(TORQUE_LAG.make({"time_constant": late}))


def _shared(refined: Refined, alike: float) -> tuple[float, float]:
    """The elements' share of the damping, and its standard error; `alike` where that is nearer than none."""
    bristle, elements = (refined.model[name] for name in refined.names)
    whole = bristle + elements
    if not whole > 0.0:
        return alike, 1.0
    slope = np.array([-elements, bristle]) / whole**2
    error, share = math.sqrt(max(float(slope @ refined.covariance @ slope), 0.0)), elements / whole
    nearer = alike if share > 0.5 * alike else share
    return nearer, min(math.hypot(error, share - nearer), 1.0)


def free_parameters(model: DriveModel) -> list[str]:
    """What a refinement moves: everything but what is held, as the orders of ripple."""
    return [name for name in model.parameters if not surface_parameter(name).held]


def _repeats(recording: Recording, controller: PositionController) -> Problem | None:
    """What repeats do not share tells what shakes the axis, where a twin can be led; None where nothing does."""
    if not controller.usable:
        return None
    data = prepared_repeats([recording])
    return None if data is None else new_problem(as_recorded(data, controller), controller)


def surroundings(recording: Recording, controller: PositionController) -> Surroundings:
    """Encoder, limit and controller of the axis that was recorded."""
    metadata = recording.metadata
    limit = metadata.torque_limit
    return Surroundings(
        controller,
        metadata.position_resolution or 0.0,
        limit if limit is not None else math.inf,
    )


def _estimate(refined: Refined, counts: Counts) -> Estimate:
    """The refinement in words."""
    reaches = np.asarray(scipy.stats.t.ppf(0.975, refined.normal.freedom))
    errors = refined.standard_errors
    quantities: dict[str, Quantity] = {}
    notes = list(_directions(refined))
    for name, reach in zip(refined.names, reaches.tolist(), strict=True):
        value = refined.model[name]
        short = max(counts.share * value if name == "inertia" else 0.0, counts.change.get(name, 0.0))
        error = math.hypot(errors[name], SYSTEMATIC.get(name, SYSTEMATIC_ELSE) * value, short)
        quantities[name] = _quantity(refined, counts, name, value, error, reach)
        if quantities[name].note:
            notes.append(f"{name}: {quantities[name].note}")
    if not refined.converged:
        notes.append("the refinement has not converged; take the intervals with care")
    if refined.twin < 1.0:
        share = f"{100 * (1 - refined.twin):.0f} %"
        notes.append(
            f"this fit has no closed loop twin for {share} of the data (a diagnosis may have one all the same): what "
            "filters and rows far apart do to inertia and viscous friction remains there, and the intervals do not "
            "hold it"
        )
    if counts.share > COUNTED:
        notes.append(
            f"the encoder is coarse for this motion: its counts make {100 * counts.share:.2g} % of the acceleration, "
            f"and the inertia may come out too small by as much; accelerate harder, or {FINER}"
        )
    reason = missing(quantities)
    return Estimate(
        "joint",
        MappingProxyType(quantities),
        usable(quantities),
        reason,
        refined.relative_error,
        tuple(dict.fromkeys(notes)),
    )


def _quantity(
    refined: Refined, counts: Counts, name: str, value: float, error: float, reach: float
) -> Quantity:
    size = max(abs(value), _natural_size(refined.model, name))
    if name in AT_REVERSALS and (unseen := _unseen(counts)):
        return Quantity(value, math.inf, reach, False, unseen)
    if not math.isfinite(error) or error > UNKNOWN * size:
        remedy = _REMEDIES.get(name, "record motion in which it matters")
        return Quantity(value, error, reach, False, f"not identified by these experiments; {remedy}")
    if name in refined.bounded and name not in ("viscous", "micro_damping"):
        falls = surface_parameter(name).above < 0
        note = "ended at a bound of what is possible" if falls else "friction does not fall with speed here"
        return Quantity(value, error, reach, False, note)
    note = "ended at its lower bound: not distinguishable from zero" if name in refined.bounded else ""
    return Quantity(value, error, reach, True, note)


def _unseen(counts: Counts) -> str:
    """Why an encoder does not show how friction reverses; "" where it does.

    A reversal shows when a count has passed. Friction that has reversed within less looks like any that does.
    """
    if counts.reach >= 1.0:
        return ""
    return (
        f"not identified: friction reverses within less than a count of the encoder (about {counts.reach:.1g}), which "
        f"cannot show it; {FINER}"
    )


def _without_unseen(refined: Refined, counts: Counts) -> DriveModel:
    """The refined model; what the encoder does not show has no standard error."""
    if not _unseen(counts):
        return refined.model
    base = dict(refined.model.base)
    told = {name: replace(base[name], standard_error=None) for name in AT_REVERSALS}
    return replace(refined.model, base=base | told)


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


def usable(quantities: Mapping[str, Quantity]) -> bool:
    """Whether what a model cannot do without is identified."""
    return all(quantities[name].identified for name in NEEDED if name in quantities)


def missing(quantities: Mapping[str, Quantity]) -> str:
    """What is not identified, and what would tell it; "" where all is known."""
    unknown = [name for name, quantity in quantities.items() if not quantity.identified]
    if not unknown:
        return ""
    remedies = (FINER if FINER in quantities[name].note else _REMEDIES.get(name, "") for name in unknown)
    wanted = "; ".join(dict.fromkeys(remedies)).strip("; ")
    return f"{', '.join(unknown)} not identified by these experiments" + (f"; {wanted}" if wanted else "")
