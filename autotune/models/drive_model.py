"""The model of one axis: an inertia, base friction, and a list of effects.

Base parameters (motor side, SI): inertia J, viscous σ2, Coulomb F_c, stiffness at rest σ0, damping of
the bristle σ1 (`micro_damping`) and offset F_g. Where σ1 fades with speed the base has v_d, too (`damping_velocity`,
`damping_tail`, see `lugre.faded_part`). Everything else is an effect.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np

from autotune.core.arrays import Flags, Floats
from autotune.core.errors import ConfigurationError
from autotune.core.units import torque_symbol
from autotune.models import layout
from autotune.models.effect import Effect, Kind, Parameter, Value, check
from autotune.models.inverse import load_substeps, required
from autotune.models.reversal_memory import REVERSAL_MEMORY
from autotune.models.stribeck import STRIBECK
from autotune.models.table import EFFECTS, effect_kind
from autotune.models.torque_ripple import scale_slot

SCHEMA_VERSION = 1

BASE: tuple[Parameter, ...] = (
    Parameter("inertia", "kg m²", 1.0, 1e-12, 1e9, "all that is accelerated, at the motor", layout.INERTIA),
    Parameter("viscous", "N m s/rad", 0.0, 0.0, 1e9, "friction that grows with speed", layout.VISCOUS),
    Parameter("coulomb", "N m", 0.0, 0.0, 1e9, "friction while moving, at any speed", layout.COULOMB),
    Parameter("stiffness", "N m/rad", 1.0, 1e-12, 1e15, "spring of the contact at rest", layout.STIFFNESS),
    Parameter("micro_damping", "N m s/rad", 0.0, 0.0, 1e12, "damping of that spring", layout.MICRO_DAMPING),
    Parameter(
        "offset",
        "N m",
        0.0,
        -1e9,
        1e9,
        "constant torque: gravity, amplifier, friction that differs by direction",
        layout.OFFSET,
    ),
)
DAMPING_VELOCITY = Parameter(
    "damping_velocity",
    "rad/s",
    0.0,
    0.0,
    1e9,
    "speed at which that damping has fallen to 1/e; 0: the same at all speeds",
    layout.DAMPING_VELOCITY,
    optional=True,
)
DAMPING_TAIL = Parameter(
    "damping_tail",
    "1",
    0.0,
    0.0,
    2.0,
    "how it falls: 0 as exp(-(v/v_d)²), 1 as 1/(1 + (v/v_d)²)",
    layout.DAMPING_TAIL,
    optional=True,
)
FADING = (DAMPING_VELOCITY, DAMPING_TAIL)
"""Of the base, where the damping in presliding fades with speed."""
CURVE = tuple(
    Parameter(
        name, "1", 0.0, 0.0, 3.0, f"part of the motion that bends the contact {where}", slot, optional=True
    )
    for name, where, slot in (
        ("bends_back", "where it is bent the other way; 0: a bristle's, 2", layout.BENDS_BACK),
        ("bends_35", "at 35 % of its level", layout.BENDS_35),
        ("bends_65", "at 65 % of its level", layout.BENDS_65),
        ("bends_85", "at 85 % of its level", layout.BENDS_85),
    )
)
"""Of the base, where the contact bends by another curve than a bristle's (`lugre.bends`)."""
BRISTLES_CURVE = (2.0, 0.65, 0.35, 0.15)
"""What a bristle's own curve has there: 1 less the part of its level."""
CREEP = (
    Parameter(
        "creep_velocity",
        "rad/s",
        0.0,
        0.0,
        1e9,
        "speed at which friction without a static part has come to three quarters of its level; 0: it has one",
        layout.CREEP_VELOCITY,
        optional=True,
    ),
    Parameter(
        "creep_tail",
        "1",
        0.0,
        0.0,
        3.0,
        "how it comes there: 0 as tanh(v/v_c), 1 as x/sqrt(1 + x²)",
        layout.CREEP_TAIL,
        optional=True,
    ),
)
"""Of the base, where the contact has no static friction (`lugre.crept`)."""
WHOLE_BASE = (*BASE, *FADING, *CURVE, *CREEP)
OPTIONAL_BASE = WHOLE_BASE[len(BASE) :]
_BASE_BY_NAME = {parameter.name: parameter for parameter in WHOLE_BASE}


@dataclass(frozen=True, slots=True)
class HistoryEntry:
    """One step in a model's life: what was done, when, on which data, and how far the error fell.

    `unseen` says on which data, that the fit never saw, the errors and the noise floor were found; empty in files
    of earlier versions, whose first error is the fit's own.
    """

    when: str
    action: str
    data: str = ""
    error_before: float | None = None
    error_after: float | None = None
    noise_floor: float | None = None
    unseen: str = ""


@dataclass(frozen=True, slots=True)
class Stair:
    """One step of a model's story: what was done, and the error on unseen data after it [N m or N]."""

    action: str
    error: float


REFITTED = "refitted on these data"
SAME_ERROR = 0.005  # relative; less is not seen in the three digits that people read


def staircase(history: Sequence[HistoryEntry]) -> list[Stair]:
    """The story of a model on data that its fits never saw, from the first error to the last.

    What stands before a step on other data (or, in files of earlier versions, on the fitted ones) is told as that
    step found it. Where a step first refitted what was there, that is a stair of its own: a fall is then what the
    step itself has brought, as it was said when it was done.
    """
    steps = [entry for entry in history if entry.error_after is not None]
    stairs: list[Stair] = []
    for i, entry in enumerate(steps):
        later = steps[i + 1] if i + 1 < len(steps) else None
        error = entry.error_after or 0.0
        if later is not None and later.error_before is not None and later.unseen != entry.unseen:
            error = later.error_before
        if i == 0 and entry.error_before is not None:
            stairs.append(Stair("before", entry.error_before))
        stairs.append(Stair(entry.action, error))
        before = later.error_before if later is not None else None
        if before is not None and abs(before - error) > SAME_ERROR * error:
            stairs.append(Stair(REFITTED, before))
    return stairs


_OF_SUMS = ("coulomb", "stiffness", "micro_damping", REVERSAL_MEMORY.surface(""))
"""How the parts of total friction, of the stiffness at rest and of presliding's damping are named."""


@dataclass(frozen=True, slots=True)
class Packed:
    """A model as the compiled routine takes it: `p` of shape (PARAMETERS,), `on` (effects,)."""

    p: Floats
    on: Flags


@dataclass(frozen=True, slots=True)
class DriveModel:
    """Base values by name and effects, in the order in which they were added.

    `torque_unit` is A or V where the torque of its recordings was; else empty: N m or N. `friction_error`,
    `stiffness_error` and `damping_error`: standard errors of the total friction, of the stiffness at rest and of
    presliding's damping, with what their parts have in common; None where no fit has said it, and once such a part is
    changed.

    Raises:
        ConfigurationError: a base parameter missing, unknown or out of bounds, an effect twice.
    """

    base: Mapping[str, Value]
    effects: tuple[Effect, ...] = ()
    motion_unit: str = "rad"
    axis: str = ""
    fingerprint: str = ""
    history: tuple[HistoryEntry, ...] = field(default=())
    torque_unit: str = ""
    friction_error: float | None = field(default=None, compare=False)
    stiffness_error: float | None = field(default=None, compare=False)
    damping_error: float | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        wrong = (set(self.base) ^ set(_BASE_BY_NAME)) - ({p.name for p in OPTIONAL_BASE} - set(self.base))
        if wrong:
            raise ConfigurationError(
                f"a drive model needs exactly the base parameters {', '.join(p.name for p in BASE)}; "
                f"missing or unknown: {', '.join(sorted(wrong))}"
            )
        for name, value in self.base.items():
            check(_BASE_BY_NAME[name], value.value, name)
        names = [effect.name for effect in self.effects]
        twice = {name for name in names if names.count(name) > 1}
        if twice:
            raise ConfigurationError(f"effect {', '.join(sorted(twice))} is in the model twice; keep one")

    @property
    def parameters(self) -> dict[str, Value]:
        """All values by their surface names (`stiffness`, `break_away`, `torque_ripple.order_1`)."""
        table = {parameter.name: self.base[parameter.name] for parameter in self._of_base}
        for effect in self.effects:
            table |= {effect.kind.surface(name): value for name, value in effect.values.items()}
        return table

    @property
    def _of_base(self) -> tuple[Parameter, ...]:
        """Those of the base that this model has, in their order."""
        return tuple(parameter for parameter in WHOLE_BASE if parameter.name in self.base)

    def __getitem__(self, surface: str) -> float:
        return self.parameters[surface].value

    def __contains__(self, effect: str) -> bool:
        return any(effect == present.name for present in self.effects)

    def effect(self, kind: Kind) -> Effect:
        """The effect of this kind, which the model has."""
        return next(effect for effect in self.effects if effect.kind is kind)

    def unit(self, surface: str) -> str:
        """Unit of a parameter on this axis."""
        return surface_parameter(surface).unit_for(self.motion_unit, self.torque_unit)

    @property
    def torque_symbol(self) -> str:
        """Unit of torque in what people read."""
        return torque_symbol(self.motion_unit, self.torque_unit)

    def pack(self) -> Packed:
        """Vector and flags for the compiled routine."""
        p = np.zeros(layout.PARAMETERS)
        on = np.zeros(len(layout.EFFECT_NAMES), dtype=np.bool_)
        for parameter in [*WHOLE_BASE, *(q for kind in EFFECTS.values() for q in kind.parameters)]:
            p[parameter.slot] = parameter.neutral
        p[scale_slot()] = 1.0 if self.motion_unit == "rad" else 2.0 * math.pi
        for surface, value in self.parameters.items():
            p[surface_parameter(surface).slot] = value.value
        for effect in self.effects:
            on[layout.flag(effect.name)] = True
        return Packed(p, on)

    def with_values(
        self, values: Mapping[str, float], errors: Mapping[str, float | None] | None = None
    ) -> DriveModel:
        """The same model with some values replaced, by surface name.

        A value whose error is not given has none afterwards.
        """
        errors = errors or {}
        table = self.parameters
        unknown = set(values) - set(table)
        if unknown:
            raise ConfigurationError(f"the model has no parameter {', '.join(sorted(unknown))}")
        table |= {name: Value(float(value), errors.get(name)) for name, value in values.items()}
        effects = tuple(
            replace(
                effect,
                values=MappingProxyType({name: table[effect.kind.surface(name)] for name in effect.values}),
            )
            for effect in self.effects
        )
        base = MappingProxyType({parameter.name: table[parameter.name] for parameter in self._of_base})
        return replace(self, base=base, effects=effects)._after_change(values)

    def with_fading(self, velocity: float, tail: float) -> DriveModel:
        """The model with damping in presliding that fades with speed [rad/s or m/s]; 0: the same at all speeds."""
        names = [parameter.name for parameter in FADING]
        base = {key: value for key, value in self.base.items() if key not in names}
        if velocity > 0.0:
            base |= dict(zip(names, (Value(velocity), Value(tail)), strict=True))
        return replace(self, base=MappingProxyType(base))

    def with_curve(self, values: Sequence[float]) -> DriveModel:
        """The model whose contact bends by a curve of its own, its values as `CURVE`; a bristle's where they are 0."""
        names = [parameter.name for parameter in CURVE]
        base = {key: value for key, value in self.base.items() if key not in names}
        if values[0] > 0.0:
            base |= {name: Value(float(value)) for name, value in zip(names, values, strict=True)}
        return replace(self, base=MappingProxyType(base))

    def with_creep(self, velocity: float, tail: float) -> DriveModel:
        """The model whose contact has no static friction, from a speed on [rad/s or m/s]; 0: it has."""
        names = [parameter.name for parameter in CREEP]
        base = {key: value for key, value in self.base.items() if key not in names}
        if velocity > 0.0:
            base |= dict(zip(names, (Value(velocity), Value(tail)), strict=True))
        return replace(self, base=MappingProxyType(base))

    def with_effect(self, effect: Effect) -> DriveModel:
        """The model with an effect added, or replaced if it is there."""
        kept = tuple(present for present in self.effects if present.name != effect.name)
        return replace(self, effects=(*kept, effect))._after_change((f"{effect.name}.",))

    def without_effect(self, name: str) -> DriveModel:
        kept = tuple(effect for effect in self.effects if effect.name != name)
        return replace(self, effects=kept)._after_change((f"{name}.",))

    def _after_change(self, surfaces: Iterable[str]) -> DriveModel:
        """Without the errors of sums where one of their parts, by surface name, was changed."""
        if not any(name.startswith(_OF_SUMS) for name in surfaces):
            return self
        return replace(self, friction_error=None, stiffness_error=None, damping_error=None)

    def with_history(self, entry: HistoryEntry) -> DriveModel:
        return replace(self, history=(*self.history, entry))

    def torque(self, position: Floats, velocity: Floats, acceleration: Floats, period: float) -> Floats:
        """Torque [N m] that a motion needs, started with relaxed junctions; arrays of shape (n,)."""
        packed = self.pack()
        result = np.empty(len(position))
        if len(position):
            q, v, a = (np.ascontiguousarray(x, dtype=np.float64) for x in (position, velocity, acceleration))
            state = np.zeros(layout.STATES)
            substeps = load_substeps(packed.p, packed.on, period)
            required(packed.p, packed.on, state, q, v, a, period, substeps, result)
        return result


def base_model(
    values: Mapping[str, float],
    errors: Mapping[str, float] | None = None,
    motion_unit: str = "rad",
    axis: str = "",
    fingerprint: str = "",
    torque_unit: str = "",
) -> DriveModel:
    """A model from plain numbers; with `break_away` and `stribeck_velocity` it has the effect `stribeck`."""
    errors = errors or {}
    base = {n: Value(float(v), errors.get(n)) for n, v in values.items() if n in _BASE_BY_NAME}
    rest = {name: value for name, value in values.items() if name not in _BASE_BY_NAME}
    effects = (STRIBECK.make(rest, errors),) if rest else ()
    return DriveModel(
        MappingProxyType(base), effects, motion_unit, axis, fingerprint, torque_unit=torque_unit
    )


def surface_parameter(surface: str) -> Parameter:
    """What a parameter is, by its surface name.

    Raises:
        ConfigurationError: there is no such parameter.
    """
    if surface in _BASE_BY_NAME:
        return _BASE_BY_NAME[surface]
    effect, dot, name = surface.partition(".")
    if dot:
        return effect_kind(effect).parameter(name)
    for kind in EFFECTS.values():
        if not kind.surface_prefix and any(surface == parameter.name for parameter in kind.parameters):
            return kind.parameter(surface)
    raise ConfigurationError(
        f"there is no parameter {surface!r}; base parameters: {', '.join(_BASE_BY_NAME)}"
    )
