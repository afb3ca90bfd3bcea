"""The effects that a model can hold: name to kind of physics."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from types import MappingProxyType

from autotune.core.errors import ConfigurationError
from autotune.models.direction_asymmetry import DIRECTION_ASYMMETRY
from autotune.models.effect import Kind
from autotune.models.stribeck import STRIBECK
from autotune.models.torque_ripple import TORQUE_RIPPLE

EFFECTS: Mapping[str, Kind] = MappingProxyType(
    {
        "torque_ripple": TORQUE_RIPPLE,
        "direction_asymmetry": DIRECTION_ASYMMETRY,
        "stribeck": STRIBECK,
    }
)


def effect_kind(name: str) -> Kind:
    """The physics of that name.

    Raises:
        ConfigurationError: there is none; names the nearest.
    """
    if name in EFFECTS:
        return EFFECTS[name]
    near = difflib.get_close_matches(name, EFFECTS, 1, cutoff=0.4)
    hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(EFFECTS)}"
    raise ConfigurationError(f"there is no effect {name!r}; {hint}")
