"""The effects that a model can hold: name to kind of physics, in the order of `layout.EFFECT_NAMES`."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from importlib import import_module
from types import MappingProxyType

from autotune.core.errors import ConfigurationError
from autotune.models.effect import Kind
from autotune.models.layout import EFFECT_NAMES
from autotune.models.look_alikes import LOOK_ALIKES, LookAlikes


def _kind(name: str) -> Kind:
    """The `Kind` of the effect's own module."""
    kind: Kind = getattr(import_module(f"autotune.models.{name}"), name.upper())
    return kind


EFFECTS: Mapping[str, Kind] = MappingProxyType({name: _kind(name) for name in EFFECT_NAMES})


def effect_kind(name: str) -> Kind:
    """The physics of that name.

    Raises:
        ConfigurationError: there is none; names the nearest, and all that there are.
    """
    if name in EFFECTS:
        return EFFECTS[name]
    near = difflib.get_close_matches(name, EFFECTS, 1, cutoff=0.4)
    there = f"did you mean {near[0]!r}? There" if near else "there"
    raise ConfigurationError(f"there is no effect {name!r}; {there} are {', '.join(EFFECTS)}")


def names(kinds: Iterable[Kind]) -> frozenset[str]:
    """Their names."""
    return frozenset(kind.name for kind in kinds)


def looking_alike() -> Mapping[LookAlikes, frozenset[str]]:
    """Which effects belong to each set of those that look alike."""
    return {one: names(kind for kind in EFFECTS.values() if one in kind.look_alikes) for one in LOOK_ALIKES}


def usual_rivals(effect: str) -> list[str]:
    """Effects that can look like this one."""
    rivals: dict[str, None] = {}
    for effects in looking_alike().values():
        if effect in effects:
            rivals |= dict.fromkeys(sorted(effects - {effect}))
    return list(rivals)
