"""From the recording of the standard programme to one model with intervals.

Each experiment is analysed by itself; one that fails says why and the others go on. What they say is
combined (section 3.4.5) and refined together where a closed loop twin can be made (`joint`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeVar

from autotune.core.errors import NotEnoughExcitation
from autotune.core.recording import Recording
from autotune.identify.checks import check_recording
from autotune.identify.combine import combine
from autotune.identify.complexity import Complexity, judge_complexity
from autotune.identify.dahl import Dahl, identify_dahl
from autotune.identify.estimate import Estimate, invalid
from autotune.identify.presliding import Presliding, identify_presliding
from autotune.identify.steady_state import SteadyState, identify_steady_state
from autotune.models.drive_model import BASE, DriveModel, base_model

Result = TypeVar("Result")
EXPERIMENTS = ("steady_state", "presliding", "dahl", "high_speed")


@dataclass(frozen=True, slots=True)
class Identification:
    """Everything that the programme told.

    Attributes:
        estimates: by experiment, those without a valid result among them, with the reason.
        joint: the parameters to use; not valid where something needed is missing.
        model: the joint parameters as a drive model; None where they are not valid.
        complexity: whether the axis needs LuGre; None where friction or stiffness is unknown.
    """

    estimates: Mapping[str, Estimate]
    joint: Estimate
    model: DriveModel | None
    complexity: Complexity | None
    steady_state: SteadyState | None = None
    presliding: Presliding | None = None
    dahl: Dahl | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """All sentences for the report."""
        texts = [
            *self.joint.notes,
            *(note for estimate in self.estimates.values() for note in estimate.notes),
        ]
        return tuple(dict.fromkeys(texts))


def identify_run(
    recording: Recording, precision: float = 1e-3, acceleration: float | None = None
) -> Identification:
    """Identifies an axis from the recording of the standard programme.

    Args:
        precision: what positions are to be held to [rad or m], for the verdict on complexity.
        acceleration: at the reversals of the application; by default that of a 0.2 rad, 1 Hz sine.

    Raises:
        RecordingError, NotEnoughExcitation: the recording as a whole cannot be used.
    """
    check_recording(recording)
    estimates: dict[str, Estimate] = {}

    def attempt(name: str, analyse: Callable[[Recording], Result]) -> Result | None:
        part = recording.select(name)
        if len(part) == 0:
            estimates[name] = invalid(name, f"there is no experiment {name!r} in the recording")
            return None
        try:
            return analyse(part)
        except NotEnoughExcitation as error:
            estimates[name] = invalid(name, str(error))
            return None

    steady = attempt("steady_state", identify_steady_state)
    if steady is not None:
        estimates["steady_state"] = steady.estimate
    coulomb = steady.estimate.value("coulomb") if steady else math.nan
    viscous = steady.estimate.value("viscous", 0.0) if steady else 0.0
    known = coulomb if math.isfinite(coulomb) else None
    presliding = attempt("presliding", lambda part: identify_presliding(part, known))
    if presliding is not None:
        estimates["presliding"] = presliding.estimate
    dahl = attempt("dahl", lambda part: identify_dahl(part, viscous))
    if dahl is not None:
        estimates["dahl"] = dahl.estimate
    joint = combine(estimates)
    speed_change = acceleration if acceleration is not None else 0.2 * (2.0 * math.pi) ** 2
    complexity = judge_complexity(joint.parameters, precision, speed_change, recording.metadata.motion_unit)
    return Identification(
        MappingProxyType(estimates),
        joint,
        model_of(joint, recording) if joint.valid else None,
        complexity,
        steady,
        presliding,
        dahl,
    )


def model_of(estimate: Estimate, recording: Recording) -> DriveModel:
    """The estimate as a drive model: base parameters, and `stribeck` where friction falls with speed."""
    names = [parameter.name for parameter in BASE]
    if "break_away" in estimate and "stribeck_velocity" in estimate:
        names += ["break_away", "stribeck_velocity"]
    values = {name: estimate[name].value for name in names}
    errors = {
        name: estimate[name].standard_error for name in names if math.isfinite(estimate[name].standard_error)
    }
    metadata = recording.metadata
    return base_model(values, errors, metadata.motion_unit, metadata.axis, metadata.fingerprint)
