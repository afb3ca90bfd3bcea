"""Fields of profiles: objects, signals (an object with its unit), and names that must be known."""

from __future__ import annotations

import difflib
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from typing import Annotated, Any

from pydantic import BeforeValidator

from autotune_drivers.canopen.objects import ObjectRef
from autotune_drivers.units import UNITS


@dataclass(frozen=True, slots=True)
class Signal:
    """An object with its unit."""

    ref: ObjectRef
    unit: str

    @classmethod
    def parse(cls, text: str) -> Signal:
        """Reads `6064:00 i32 count`; the unit may be left out (`SI`).

        Raises:
            ValueError: not of that form.
        """
        words = text.split()
        if len(words) not in (2, 3):
            raise ValueError(f"signal {text!r} is not understood; write '6064:00 i32 count'")
        unit = words[2] if len(words) == 3 else "SI"
        if unit not in UNITS:
            near = difflib.get_close_matches(unit, UNITS, 1)
            hint = f"did you mean {near[0]!r}" if near else f"known are {', '.join(UNITS)}"
            raise ValueError(f"signal {text!r} has the unknown unit {unit!r}; {hint}?")
        return cls(ObjectRef.parse(" ".join(words[:2])), unit)

    def named(self, name: str) -> Signal:
        """The same, with the name that errors give it."""
        return replace(self, ref=replace(self.ref, name=name))

    def at(self, sub: int) -> Signal:
        """The same in another sub-index."""
        return replace(self, ref=replace(self.ref, sub=sub))


def all_known(names: Iterable[str], known: Collection[str], what: str) -> None:
    """Raises ValueError for a name that is not known, with the nearest that is."""
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            hint = f"did you mean {near[0]!r}" if near else f"known are {', '.join(known)}"
            raise ValueError(f"unknown {what} {name!r}; {hint}?")


def _signal(value: Any) -> Any:
    return Signal.parse(value) if isinstance(value, str) else value


def _object(value: Any) -> Any:
    return ObjectRef.parse(value) if isinstance(value, str) else value


SignalField = Annotated[Signal, BeforeValidator(_signal)]
ObjectField = Annotated[ObjectRef, BeforeValidator(_object)]
