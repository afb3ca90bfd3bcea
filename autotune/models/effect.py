"""An effect: a named piece of physics with parameters, an explanation for people, kernels and traits.

`Kind` describes the physics once: all that the rest of the code must know of it is one of its traits, so that
no other module needs the effect's name. `Effect` is one axis's values for it. Adding an effect to the code is
one file that defines its `Kind` and one entry in `layout.EFFECT_NAMES` (docs/adding-an-effect.md).
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import TypeAlias

from autotune.core.arrays import Floats
from autotune.core.errors import ConfigurationError, NotEnoughExcitation
from autotune.models.look_alikes import LookAlikes
from autotune.models.start_values import StartContext, StartValues, Vary

Measure: TypeAlias = Callable[[Floats], float]
"""A quantity that follows from the vector of parameters."""


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
        held: a refit of a model leaves it as it is: a raster, a reference level, a gear ratio.
        whole: a share of which none or all is as plain a case as any: its bounds are no edges of a law.
        refined: how far a refinement on measured periods of the benchmark may move it, as a part of all friction;
            0: such a slow motion says next to nothing about it.
        like_offset: without presliding it can hardly be told from the offset; held at neutral where it is vague.
        above: place of the parameter that this one is never below in a fit; -1: none.
        slowest: of the top speed: the lowest that a fit takes a speed to, as below nothing depends on it (`least`).
    """

    name: str
    unit: str
    neutral: float
    lower: float
    upper: float
    meaning: str
    slot: int
    optional: bool = False
    held: bool = False
    whole: bool = False
    like_offset: bool = False
    refined: float = 0.0
    above: int = -1
    slowest: float = 0.0

    def least(self, top_speed: float) -> float:
        """The lower bound of a fit to motion up to `top_speed` [rad/s or m/s]."""
        return max(self.lower, self.slowest * top_speed) if self.slowest > 0.0 else self.lower

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


def part_that_stiffens(slot: int) -> Parameter:
    """`stiffens`, of an effect that adds to friction: how much of that the contact is stiffer by."""
    meaning = "part of its growth by which the contact is stiffer too; 1: its reach stays"
    return Parameter("stiffens", "1", 0.0, 0.0, 1.0, meaning, slot, optional=True, held=True)


@dataclass(frozen=True, slots=True)
class Value:
    """A number with its uncertainty; None where it was never estimated."""

    value: float
    standard_error: float | None = None


@dataclass(frozen=True, slots=True)
class Terms:
    """Numbered terms of an effect: lines of a ripple, elements of a hysteresis (`sin_3` is the third sine).

    Attributes:
        present: the part that is above zero in every term in use.
        amplitudes: parts that decide whether a term is beyond chance.
    """

    present: str
    amplitudes: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Proportion:
    """Two parts of an effect's torque whose proportion its law knows, and who has the same two in another one.

    Attributes:
        parts: (p, position, velocity, acceleration) → both [N m], proportional to the effect's size; shape (n,) each.
        name: of the second part, in words.
        other: times that part, beside the same first part, what a law that is not in the library has.
        stranger: that law, in words.
        common: whether it is so common that a name must rule it out; a rarer one must be told beyond chance itself.
    """

    parts: Callable[[Floats, Floats, Floats, Floats], tuple[Floats, Floats]]
    name: str
    other: float
    stranger: str
    common: bool = True


@dataclass(frozen=True, slots=True)
class Kernels:
    """Where the effect enters the contact; compiled, each None where it does not (`contact` adds them up).

    Attributes:
        torque: (p, position) → torque that it needs beside inertia and friction [N m].
        level: (p, state, velocity) → added to the level of dry friction [N m].
        stiffening: (p, state, velocity) → the part of that by which the contact is stiffer too [N m].
        level_factor: (p, state, position) → what that level is multiplied by, after all additions.
        viscous: (p, velocity) → added to the viscous coefficient [N m s/rad].
        viscous_factor: (p, state) → what that coefficient is multiplied by, after all additions.
    """

    torque: Callable[..., float] | None = None
    level: Callable[..., float] | None = None
    stiffening: Callable[..., float] | None = None
    level_factor: Callable[..., float] | None = None
    viscous: Callable[..., float] | None = None
    viscous_factor: Callable[..., float] | None = None


def no_start(context: StartContext) -> Iterator[StartValues]:
    """Of an effect that no fit can begin with."""
    yield from ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Kind:
    """The physics of an effect, and all that other modules must know of it.

    What people read:
        looks_like: what a person sees in the traces.
        cause: which part of a machine causes it.
        remedy: what a technician can do about it.
        look_alikes: with which other effects it can be confused, and what would tell them apart.
        not_fed_forward: why a feedforward does not play it; empty where it does.

    How it is fitted:
        starts: where a fit of it begins; several where its law has several minima.
        why_no_start: what it means for people where there is no start.
        size: what the effect is proportional to, where else that is free says how it is shaped: a fit begins with it
            alone, as a shape of nothing leads anywhere.
        freed_later: name → how it varies, once a first fit is there.
        free_shape: what begins and varies beside its own law where that is another one: the same place, any course.
        plain_shape: a part of that which is tried first, where a number or two make the law a family.
        least_own: of what is asked of its own law before its course may be free; less where the course is as definite.
        own_size: what its own law is scaled by, where a free course is a sum beside that law and may do without it.
        terms: of what it is a sum of numbered terms; None where it is not.
        proportion: of two parts of its torque, by which a stranger's law is told from it; None where none has these.
        waves: p → orders of waves over place that it has by its own law or another: none of them is another's.
        may_grow: further terms are looked for beside those that a model has.

    When it can be seen:
        extent: travel that the encoder must resolve [motion unit].
        resonance: frequency that must lie in the band [Hz].
        slow_change: time constant that the recording must outlast [s].
        shows_course: (p, travel) → whether the travel [motion unit] is enough to tell its course from any other smooth
            function of place; None where every travel is.
        own_course: context → whether the course that was fitted is the effect's at all, or may be another's; None where
            every course inside its bounds is.
        needs_rests: only the difference between short and long rests shows it.
        both_ways: motion one way cannot tell it from a torque that depends on the place.
        quick: it lives in quick changes of torque, and is lost where a column was filtered or is too coarse.
        of_place: it depends on place or direction alone, and shows even where the sampling is too slow.
        keeps_zero: it lies at places; a position that counts from another zero makes it another torque.
        at_constant_speed: it shows in mean torques at constant speeds.
        rotary_only: it belongs to axes that turn.
        lost_in_alignment: shifting torque against motion hides it.
        loop_like: it is linear in the motion, as a position controller is.

    What else sets it apart:
        in_transmission: motor and load are two masses with it.
        approximate: its law is a few elements in place of a distribution; some error is left beside it.
        drifts: repeats of one motion differ by it.
        end_of: effects that become it at an end of their parameters: where it does as well as one of those, it is it.
        in_lugre: the LuGre feedforward of the thesis has it too.
        surface_prefix: whether parameter names carry the effect's name on every surface.
    """

    name: str
    parameters: tuple[Parameter, ...]
    looks_like: str
    cause: str
    remedy: str
    look_alikes: tuple[LookAlikes, ...] = ()
    not_fed_forward: str = ""
    kernels: Kernels = Kernels()
    starts: Callable[[StartContext], Iterator[StartValues]] = no_start
    why_no_start: str = "there is nothing in the motion to start a fit from"
    size: str = ""
    freed_later: Callable[[Floats], Mapping[str, Vary]] | None = None
    free_shape: Callable[[StartContext], StartValues | None] | None = None
    plain_shape: Callable[[StartContext], StartValues | None] | None = None
    least_own: float = 1.0
    own_size: str = ""
    terms: Terms | None = None
    proportion: Proportion | None = None
    waves: Callable[[Floats], tuple[float, ...]] | None = None
    may_grow: bool = False
    extent: Measure | None = None
    resonance: Measure | None = None
    slow_change: Measure | None = None
    shows_course: Callable[[Floats, float], bool] | None = None
    own_course: Callable[[StartContext], bool] | None = None
    needs_rests: bool = False
    both_ways: bool = False
    quick: bool = False
    of_place: bool = False
    keeps_zero: bool = False
    at_constant_speed: bool = False
    rotary_only: bool = False
    lost_in_alignment: bool = False
    loop_like: bool = False
    in_transmission: bool = False
    approximate: bool = False
    drifts: bool = False
    end_of: tuple[str, ...] = ()
    in_lugre: bool = False
    surface_prefix: bool = True

    @property
    def fed_forward(self) -> bool:
        """Whether a feedforward plays it."""
        return not self.not_fed_forward

    def is_of(self, motion_unit: str) -> bool:
        """Whether an axis that moves in this unit can have the effect."""
        return motion_unit == "rad" or not self.rotary_only

    def refuse_unit(self, motion_unit: str) -> None:
        """Raises NotEnoughExcitation where an axis that moves in this unit cannot have the effect."""
        if not self.is_of(motion_unit):
            raise NotEnoughExcitation(
                f"these recordings cannot say anything about {self.name}: it belongs to axes that turn, and this one "
                f"moves in {motion_unit}. It would look like this: {self.looks_like}"
            )

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

    def slot(self, name: str) -> int:
        """Place of a parameter in the vector of parameters."""
        return self.parameter(name).slot

    def terms_in_use(self, p: Floats) -> list[int]:
        """Numbers of the terms in use; empty for an effect that has none."""
        if self.terms is None:
            return []
        names = [q.name for q in self.parameters if q.name.startswith(f"{self.terms.present}_")]
        return [int(name.rpartition("_")[2]) for name in names if p[self.slot(name)] > 0.0]

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
