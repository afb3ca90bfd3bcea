"""What an experiment tells: numbers with intervals, whether they may be used, why not; and all of them together.

One set of parameters from the separate experiments, after section 3.4.5: Coulomb friction, viscous friction and
offset come from the steady state, inertia and σ1 + σ2 from presliding, as there. Section 3.4.5 takes F_s and σ0
from Dahl's curve. Here break-away and its Stribeck velocity come from the steady state, which shows both, and the
stiffness is that of rest, from presliding; Dahl's, which is softer where friction has several elastic elements,
says over what displacement friction reverses (`dahl`) and bounds the adaptation. Dahl's curve and the high
speed experiment stand in where the others failed, and are compared where they did not.

Whether a model made of such numbers can be that of an axis is asked by its sizes (`recordings.axis_sizes`).
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from autotune.models.drive_model import DriveModel
from autotune.models.effect import Value
from autotune.recordings.axis_sizes import GRAVITY, Sizes, judged_together, motion_sizes, sizes
from autotune.recordings.recording import Recording

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class Quantity:
    """One estimated number.

    Attributes:
        value, standard_error: in the unit of the parameter.
        quantile: how many standard errors the 95 % interval reaches to each side.
        identified: False where the data say next to nothing about it; never use the value then.
        note: in words, where there is something to say (a bound was hit, why it is not identified).
    """

    value: float
    standard_error: float
    quantile: float = 1.96
    identified: bool = True
    note: str = ""

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval."""
        reach = self.quantile * self.standard_error
        return self.value - reach, self.value + reach

    @property
    def relative_error(self) -> float:
        """Standard error over the value's magnitude; infinite where the value is zero."""
        return self.standard_error / abs(self.value) if self.value else math.inf

    def as_value(self) -> Value:
        return Value(self.value, self.standard_error if math.isfinite(self.standard_error) else None)


@dataclass(frozen=True, slots=True)
class Estimate:
    """The result of one experiment or of a fit.

    Attributes:
        source: name of the experiment or method.
        parameters: by surface name; empty where nothing could be estimated.
        valid: whether the numbers may be used.
        reason: why not, or what limits them; a sentence.
        relative_error: norm of the error over the norm of what was predicted; nan where not computed.
        notes: further sentences for the report.
    """

    source: str
    parameters: Mapping[str, Quantity] = field(default_factory=lambda: MappingProxyType({}))
    valid: bool = True
    reason: str = ""
    relative_error: float = math.nan
    notes: tuple[str, ...] = ()

    def __getitem__(self, name: str) -> Quantity:
        return self.parameters[name]

    def __contains__(self, name: str) -> bool:
        return name in self.parameters and self.parameters[name].identified

    def value(self, name: str, otherwise: float = math.nan) -> float:
        """The value where the estimate is valid and the parameter identified."""
        return self.parameters[name].value if self.valid and name in self else otherwise


def invalid(source: str, reason: str) -> Estimate:
    """An estimate that says why there is none."""
    return Estimate(source, valid=False, reason=reason)


SAME_STIFFNESS = 0.10
NEEDED = ("inertia", "viscous", "coulomb", "stiffness", "micro_damping", "offset")


def combine(estimates: Mapping[str, Estimate]) -> Estimate:
    """The parameters, and in `reason` what is missing where it is not valid."""
    usable = {name: estimate for name, estimate in estimates.items() if estimate.valid}
    found: dict[str, Quantity] = {}
    for name in ("coulomb", "viscous", "offset", "break_away", "stribeck_velocity"):
        _take(found, name, usable, "steady_state", "dahl" if name == "offset" else "")
    _take(found, "inertia", usable, "presliding", "high_speed")
    _take(found, "stiffness", usable, "presliding", "dahl")
    _take(found, "viscous", usable, "", "high_speed")
    if "presliding" in usable and "viscous" in found:
        found["micro_damping"] = _difference(usable["presliding"]["presliding_damping"], found["viscous"])
    missing = [name for name in NEEDED if name not in found]
    reason = f"the experiments do not give {', '.join(missing)}" if missing else ""
    return Estimate("combined", found, not missing, reason, notes=tuple(stiffness_notes(estimates)))


def stiffness_notes(estimates: Mapping[str, Estimate]) -> list[str]:
    """What the two stiffnesses say about the contact: one elastic element, or several."""
    presliding, dahl = estimates.get("presliding"), estimates.get("dahl")
    if not presliding or not dahl or not presliding.valid or not dahl.valid:
        return []
    small, large = presliding["stiffness"], dahl["stiffness"]
    gap = abs(small.value - large.value)
    uncertain = math.hypot(small.standard_error, large.standard_error)
    text = (
        f"stiffness at rest is {small.value:.4g} for small displacements and {large.value:.4g} over "
        "Dahl's curve: "
    )
    if gap <= max(SAME_STIFFNESS * small.value, 2.0 * uncertain):
        return [text + "they agree, friction behaves like one elastic element"]
    if large.value < small.value:
        return [
            f"{text}they differ {small.value / large.value:.1f}-fold because friction has several elastic "
            "elements that break one after another; a model with one element can only fit one of the two. "
            "The effect reversal_memory describes it"
        ]
    return [
        text + "the curve looks stiffer than small displacements, which one contact cannot do; check that "
        "the junctions were relaxed before presliding"
    ]


def _take(
    found: dict[str, Quantity], name: str, usable: Mapping[str, Estimate], first: str, second: str
) -> None:
    for source in (first, second):
        if name not in found and source in usable and name in usable[source]:
            found[name] = usable[source][name]


def _difference(both: Quantity, viscous: Quantity) -> Quantity:
    """σ1 = (σ1 + σ2) − σ2; never below zero."""
    value = both.value - viscous.value
    error = math.hypot(both.standard_error, viscous.standard_error)
    note = "not distinguishable from zero" if value <= 0 else ""
    return Quantity(max(value, 0.0), error, max(both.quantile, viscous.quantile), True, note)


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
    """Those of `axis_sizes.RANGES` that the identified parameters tell."""
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
