"""From the recording of the standard programme to one model with intervals.

Each experiment is analysed by itself; one that fails says why and the others go on. What they say is
combined (section 3.4.5) and refined together where a closed loop twin can be made (`joint`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TypeVar

from autotune.core.errors import NotEnoughExcitation
from autotune.core.units import torque_symbol
from autotune.identify.dahl import Complexity, Dahl, identify_dahl, judge_complexity
from autotune.identify.estimate import Estimate, Quantity, combine, invalid
from autotune.identify.high_speed import HighSpeed, identify_high_speed
from autotune.identify.presliding import Presliding, identify_presliding
from autotune.identify.refinement import refine_recording
from autotune.identify.steady_state import SteadyState, identify_steady_state
from autotune.models.drive_model import BASE, DriveModel, base_model
from autotune.models.torque_ripple import TORQUE_RIPPLE
from autotune.recordings.checks import check_recording
from autotune.recordings.recording import Metadata, Recording
from autotune.signals.place_terms import Line

Result = TypeVar("Result")
FARTHEST = 1.0
"""Largest relative change of a parameter by the joint refinement that is believed."""
KNOWN, FAR_OFF = 0.05, 0.3
"""Relative error of an inertia that is known, and how far from it a refinement is in another minimum."""
UNKNOWN_LAG = 0.1 / math.sqrt(3.0)
"""Of a sample, root mean square: any lag up to a tenth, current loops of 1 kHz and more behind a cycle of 1 ms."""
FALL = ("break_away", "stribeck_velocity")
"""What friction has that falls with speed."""
NO_FALL = (
    "friction falls with speed in the steady state alone: beside all experiments break-away comes out no higher than "
    "Coulomb friction, and is taken as equal to it"
)
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
    high_speed: HighSpeed | None = None

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
    fast = attempt("high_speed", identify_high_speed)
    if fast is not None:
        estimates["high_speed"] = fast.estimate
    lag = fast.lag if fast is not None and fast.estimate.valid else None
    joint = with_unknown_lag(_refined(recording, combine(estimates), steady), lag, recording)
    speed_change = acceleration if acceleration is not None else 0.2 * (2.0 * math.pi) ** 2
    reversal = dahl.reversal if dahl is not None else None
    complexity = judge_complexity(joint.parameters, precision, speed_change, recording.metadata, reversal)
    return Identification(
        MappingProxyType(estimates),
        joint,
        model_of(joint, recording) if joint.valid else None,
        complexity,
        steady,
        presliding,
        dahl,
        fast,
    )


def _refined(recording: Recording, combined: Estimate, steady: SteadyState | None) -> Estimate:
    """All experiments together, started from what they say one by one; that itself where it fails.

    Torque ripple found in the steady state is refined with the rest, so that it biases nothing.
    """
    if not combined.valid:
        return combined
    lines = steady.ripple if steady is not None else ()
    model = with_ripple(model_of(combined, recording), lines)
    try:
        refined = refine_recording(model, recording)
    except NotEnoughExcitation as error:
        return replace(combined, notes=(*combined.notes, f"no joint refinement: {error}"))
    if "break_away" in refined.refined.bounded:
        return _refined(recording, _without_fall(combined), steady)
    joint = refined.estimate
    if not refined.refined.converged and (why := _astray(joint, combined)):
        return replace(combined, notes=(*combined.notes, why))
    kept = dict(combined.parameters)
    for name, quantity in joint.parameters.items():
        if name in kept and quantity.identified and _near(quantity.value, kept[name].value):
            kept[name] = quantity
    notes = [*combined.notes, *joint.notes, *_ripple_notes(lines, recording.metadata)]
    return Estimate("joint", MappingProxyType(kept), True, "", joint.relative_error, tuple(notes))


def with_unknown_lag(joint: Estimate, lag: Quantity | None, recording: Recording) -> Estimate:
    """σ1 with what a lag of the torque path may have added to it, and a sentence.

    In slow presliding u(t − τ) looks like a damping larger by σ0·τ (3.46), near the resonance by less: a bound.
    High speed tells τ within some microseconds, but a small lag is no part of the model; so the interval is
    widened by what it may do, rather than the value moved. No torque comes before its command: an estimate below
    zero is noise. One above is a standard error as it is: its square is τ² and the square of its own error on
    average. Without high speed the lag is not known: up to a tenth of a sample is allowed for.
    """
    if not joint.valid or "micro_damping" not in joint or "stiffness" not in joint:
        return joint
    late = UNKNOWN_LAG * recording.period if lag is None else max(lag.value, 0.0)
    if late == 0.0:
        return joint
    shift = joint["stiffness"].value * late
    old = joint["micro_damping"]
    wide = replace(old, standard_error=math.hypot(old.standard_error, shift))
    source = (
        "is not known without high speed; taken as"
        if lag is None
        else "may be, by the high speed experiment,"
    )
    note = (
        f"micro_damping: the lag of the torque path {source} {1e6 * late:.2g} µs, which looks like a damping of "
        f"{shift:.2g} here; its interval allows for that"
    )
    parameters = MappingProxyType({**joint.parameters, "micro_damping": wide})
    return replace(joint, parameters=parameters, notes=(*joint.notes, note))


def _without_fall(estimate: Estimate) -> Estimate:
    """The estimate of friction that falls with speed in the steady state alone, and not in the twin."""
    kept = {name: one for name, one in estimate.parameters.items() if name not in FALL}
    return replace(estimate, parameters=MappingProxyType(kept), notes=(*estimate.notes, NO_FALL))


def _astray(joint: Estimate, combined: Estimate) -> str:
    """Why a refinement that has not converged is left out: its inertia is not the one that acceleration shows."""
    if "inertia" not in joint or "inertia" not in combined:
        return ""
    found, alone = joint["inertia"].value, combined["inertia"]
    if alone.standard_error > KNOWN * alone.value or abs(found - alone.value) <= FAR_OFF * alone.value:
        return ""
    return (
        f"the refinement of all experiments together did not converge, at an inertia of {found:.3g} where "
        f"acceleration alone shows {alone.value:.3g}: it was left out, and what each experiment says by itself is taken"
    )


def _near(value: float, start: float) -> bool:
    """A refinement that ends far from every single experiment has fitted something else."""
    return abs(value - start) <= max(FARTHEST * abs(start), 1e-12) or start == 0.0


def with_ripple(model: DriveModel, lines: Sequence[Line]) -> DriveModel:
    """The model with these torque waves, strongest first."""
    ordered = sorted(lines, key=lambda line: -line.amplitude)
    values: dict[str, float] = {}
    for number, line in enumerate(ordered, 1):
        values |= {f"order_{number}": line.order, f"sin_{number}": line.sine, f"cos_{number}": line.cosine}
    return model.with_effect(TORQUE_RIPPLE.make(values)) if values else model


def _ripple_notes(lines: Sequence[Line], metadata: Metadata) -> list[str]:
    per = "revolution" if metadata.motion_unit == "rad" else "metre"
    unit = torque_symbol(metadata.motion_unit, metadata.torque_unit)
    return [
        f"torque ripple of {line.order:g} periods a {per}, {line.amplitude:.2g} {unit}: the effect "
        "torque_ripple describes it"
        for line in lines
    ]


def model_of(estimate: Estimate, recording: Recording) -> DriveModel:
    """The estimate as a drive model: base parameters, and `stribeck` where friction falls with speed."""
    names = [parameter.name for parameter in BASE]
    if all(name in estimate for name in FALL):
        names += FALL
    values = {name: estimate[name].value for name in names}
    errors = {
        name: estimate[name].standard_error for name in names if math.isfinite(estimate[name].standard_error)
    }
    metadata = recording.metadata
    return base_model(
        values, errors, metadata.motion_unit, metadata.axis, metadata.fingerprint, metadata.torque_unit
    )
