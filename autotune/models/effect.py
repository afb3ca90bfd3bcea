"""An effect: a named piece of physics with parameters, an explanation for people, and a kernel.

`Kind` describes the physics once; `Effect` is one axis's values for it. Adding an effect to the code is
one file that defines its `Kind` (and its kernel) and one entry in `table.EFFECTS`.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

from autotune.core.errors import ConfigurationError


@dataclass(frozen=True, slots=True)
class Parameter:
    """What a parameter is, whatever the axis.

    Attributes:
        name: without the effect's name.
        unit: in the symbols of a rotary axis; `unit_for` gives it for a linear one.
        neutral: the value at which it has no influence.
        lower, upper: bounds of what is physically possible.
        meaning: a few words for the model file.
        slot: place in the vector of parameters (see `layout`).
        optional: an effect may be without it (a further ripple order, for example).
    """

    name: str
    unit: str
    neutral: float
    lower: float
    upper: float
    meaning: str
    slot: int
    optional: bool = False

    def unit_for(self, motion_unit: str, torque_unit: str = "") -> str:
        """Unit on an axis whose motion is in `motion_unit`: N m, kg m² and rad become N, kg and m.

        `torque_unit` stands in place of N m or N where the torque is in A or V; inertia is in A s²/rad then.
        """
        unit = self.unit
        if torque_unit:
            unit = (
                unit.replace("kg m²", "N m s²/rad").replace("(N m)", torque_unit).replace("N m", torque_unit)
            )
        if motion_unit == "rad":
            return unit
        linear = unit.replace("kg m²", "kg").replace("N m", "N")
        return linear.replace("cycles/rev", "cycles/m").replace("rad", "m")


@dataclass(frozen=True, slots=True)
class Value:
    """A number with its uncertainty; None where it was never estimated."""

    value: float
    standard_error: float | None = None


@dataclass(frozen=True, slots=True)
class Kind:
    """The physics of an effect.

    Attributes:
        looks_like: what a person sees in the traces.
        cause: which part of a machine causes it.
        remedy: what a technician can do about it.
        surface_prefix: whether parameter names carry the effect's name on every surface.
    """

    name: str
    parameters: tuple[Parameter, ...]
    looks_like: str
    cause: str
    remedy: str
    surface_prefix: bool = True

    def surface(self, parameter: str) -> str:
        """The parameter's name in files, tables and JSON."""
        return f"{self.name}.{parameter}" if self.surface_prefix else parameter

    def parameter(self, name: str) -> Parameter:
        """Raises ConfigurationError where the effect has no such parameter, naming the nearest."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        known = [parameter.name for parameter in self.parameters]
        near = difflib.get_close_matches(name, known, 1, cutoff=0.5)
        hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(known)}"
        raise ConfigurationError(f"effect {self.name!r} has no parameter {name!r}; {hint}")

    def make(self, values: Mapping[str, float], errors: Mapping[str, float] | None = None) -> Effect:
        """An effect with these values.

        Raises:
            ConfigurationError: unknown or missing parameter, or a value out of its bounds.
        """
        errors = errors or {}
        table = {name: Value(float(value), errors.get(name)) for name, value in values.items()}
        return Effect(self, MappingProxyType(table))


@dataclass(frozen=True, slots=True)
class Effect:
    """One axis's values for a kind of physics. `values` maps parameter names to numbers."""

    kind: Kind
    values: Mapping[str, Value] = field(default_factory=lambda: MappingProxyType({}))

    def __post_init__(self) -> None:
        for name, value in self.values.items():
            check(self.kind.parameter(name), value.value, self.kind.surface(name))
        missing = [p.name for p in self.kind.parameters if not p.optional and p.name not in self.values]
        if missing:
            raise ConfigurationError(f"effect {self.kind.name!r} lacks {', '.join(missing)}; it must be set")

    @property
    def name(self) -> str:
        return self.kind.name


def check(parameter: Parameter, value: float, surface: str) -> None:
    """Raises ConfigurationError where a value is not a number or out of its bounds."""
    if not math.isfinite(value) or not parameter.lower <= value <= parameter.upper:
        raise ConfigurationError(
            f"{surface} is {value!r}; it must be between {parameter.lower:g} and {parameter.upper:g} "
            f"{parameter.unit}".rstrip()
        )
