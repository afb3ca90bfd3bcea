"""Between a drive model with names and the vector that is fitted: free parameters, and back."""

from __future__ import annotations

import numpy as np

from autotune.core.arrays import Floats
from autotune.estimation.least_squares import Free
from autotune.estimation.problem import Scales
from autotune.models import layout
from autotune.models.drive_model import DriveModel, Packed, surface_parameter
from autotune.models.effect import Effect, Kind, Parameter
from autotune.models.table import EFFECTS


def free_of_model(model: DriveModel, scales: Scales) -> list[Free]:
    """Parameters of the model's effects that a refit may change."""
    free = []
    for effect in model.effects:
        for name, value in effect.values.items():
            parameter = effect.kind.parameter(name)
            if not parameter.held:
                free.append(_free(parameter, effect.kind.surface(name), value.value, scales))
    return free


def _free(parameter: Parameter, surface: str, value: float, scales: Scales) -> Free:
    typical = {
        "N m": 0.1 * scales.torque,
        "N m s/rad": 0.1 * scales.torque / scales.velocity,
        "N m/rad": 0.1 * scales.torque / scales.travel,
        "1": 0.2,
    }.get(parameter.unit, abs(value) or 1e-3)
    scale = max(0.3 * abs(value), 0.1 * typical) if value else typical
    bounded = parameter.lower >= 0.0 and value > 0.0
    step = 0.6 * value if bounded else np.inf
    above = layout.COULOMB if surface == "break_away" else -1
    return Free(surface, parameter.slot, parameter.lower, parameter.upper, scale, step, above=above)


def model_from(
    model: DriveModel, packed: Packed, free: tuple[Free, ...], errors: Floats | None = None
) -> DriveModel:
    """The model with fitted values, and effects that the fit has added."""
    table = {f.name: (errors[i] if errors is not None else None) for i, f in enumerate(free)}
    for name, kind in EFFECTS.items():
        if (packed.on[layout.flag(name)] and name not in model) or (kind.terms is not None and name in model):
            model = model.with_effect(_effect(kind, packed, table))
    values = {surface: float(packed.p[_slot(surface)]) for surface in model.parameters}
    return model.with_values(
        values, {k: float(v) for k, v in table.items() if v is not None and np.isfinite(v)}
    )


def _slot(surface: str) -> int:
    return surface_parameter(surface).slot


def _effect(kind: Kind, packed: Packed, table: dict[str, float | None]) -> Effect:
    values = {}
    for parameter in kind.parameters:
        value = float(packed.p[parameter.slot])
        fitted = value != parameter.neutral or kind.surface(parameter.name) in table
        if _in_use(kind, parameter.name, packed) and (not parameter.optional or fitted):
            values[parameter.name] = value
    return kind.make(values)


def _in_use(kind: Kind, parameter: str, packed: Packed) -> bool:
    """Whether the numbered term that a parameter belongs to is in use; all others are."""
    number = parameter.rpartition("_")[2]
    return kind.terms is None or int(number) in kind.terms_in_use(packed.p)
