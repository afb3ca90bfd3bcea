"""The effects that a model can hold: name to kind of physics."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from types import MappingProxyType

from autotune.core.errors import ConfigurationError
from autotune.models.direction_asymmetry import DIRECTION_ASYMMETRY
from autotune.models.dwell_time_break_away import DWELL_TIME_BREAK_AWAY
from autotune.models.effect import Kind
from autotune.models.encoder_eccentricity import ENCODER_ECCENTRICITY
from autotune.models.gravity_imbalance import GRAVITY_IMBALANCE
from autotune.models.load_dependent_friction import LOAD_DEPENDENT_FRICTION
from autotune.models.nonlinear_viscous import NONLINEAR_VISCOUS
from autotune.models.position_dependent_friction import POSITION_DEPENDENT_FRICTION
from autotune.models.reversal_memory import REVERSAL_MEMORY
from autotune.models.spring import SPRING
from autotune.models.stribeck import STRIBECK
from autotune.models.thermal_drift import THERMAL_DRIFT
from autotune.models.torque_path import TORQUE_LAG, TORQUE_SATURATION
from autotune.models.torque_ripple import TORQUE_RIPPLE
from autotune.models.transmission import BACKLASH, ELASTIC_TRANSMISSION

EFFECTS: Mapping[str, Kind] = MappingProxyType(
    {
        "torque_ripple": TORQUE_RIPPLE,
        "direction_asymmetry": DIRECTION_ASYMMETRY,
        "stribeck": STRIBECK,
        "nonlinear_viscous": NONLINEAR_VISCOUS,
        "position_dependent_friction": POSITION_DEPENDENT_FRICTION,
        "gravity_imbalance": GRAVITY_IMBALANCE,
        "spring": SPRING,
        "reversal_memory": REVERSAL_MEMORY,
        "thermal_drift": THERMAL_DRIFT,
        "elastic_transmission": ELASTIC_TRANSMISSION,
        "backlash": BACKLASH,
        "torque_lag": TORQUE_LAG,
        "torque_saturation": TORQUE_SATURATION,
        "dwell_time_break_away": DWELL_TIME_BREAK_AWAY,
        "load_dependent_friction": LOAD_DEPENDENT_FRICTION,
        "encoder_eccentricity": ENCODER_ECCENTRICITY,
    }
)


def effect_kind(name: str) -> Kind:
    """The physics of that name.

    Raises:
        ConfigurationError: there is none; names the nearest, and all that there are.
    """
    if name in EFFECTS:
        return EFFECTS[name]
    near = difflib.get_close_matches(name, EFFECTS, 1, cutoff=0.4)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise ConfigurationError(f"there is no effect {name!r}; {hint}There are {', '.join(EFFECTS)}")
