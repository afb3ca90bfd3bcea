"""Parameters of a moteus by name, in SI: checked, written through the console, read back."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from autotune.core.errors import ConfigurationError, LinkError, TransferAborted
from autotune_drivers.moteus.console import Console
from autotune_drivers.moteus.profile import UNITS, MoteusParameter, MoteusProfile
from autotune_drivers.units import MIRRORED, SIGNED_PARAMETERS

PRINTED = 1e-5
"""Relative resolution of what the console prints: six digits."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where a parameter is, SI units a unit of the controller (with sign), its range and resolution in SI."""

    at: str
    factor: float
    low: float
    high: float
    resolution: float


class MoteusParameters:
    """Reads and writes the parameters that a profile names.

    Attributes:
        absent: names that this controller does not have, or has no number for (a limit that is `nan`).
    """

    def __init__(self, console: Console, profile: MoteusProfile, direction: int) -> None:
        self._console = console
        self._places = {name: _place(name, profile.parameters, direction) for name in profile.parameters}
        self.absent: set[str] = set()

    def find_absent(self) -> None:
        """Asks for every parameter once. Raises LinkError."""
        for name, place in self._places.items():
            try:
                if math.isnan(self._console.number(place.at)):
                    self.absent.add(name)
            except TransferAborted:
                self.absent.add(name)

    def where(self, name: str) -> Place:
        """Where a parameter of the profile is, also one that is absent."""
        return self._places[name]

    def place(self, name: str) -> Place:
        """Raises ConfigurationError: unknown, with the nearest right name."""
        known = [known for known in self._places if known not in self.absent]
        if name not in known:
            near = difflib.get_close_matches(name, known, 1, cutoff=0.5)
            hint = f"did you mean {near[0]!r}" if near else f"it has {', '.join(known) or 'none'}"
            raise ConfigurationError(f"this drive has no parameter {name!r}; {hint}?")
        return self._places[name]

    def read(self, names: Sequence[str] | None = None) -> dict[str, float]:
        """Values in SI. Raises ConfigurationError (unknown name), LinkError."""
        wanted = [name for name in self._places if name not in self.absent] if names is None else names
        places = {name: self.place(name) for name in wanted}
        return {name: self._console.number(place.at) * place.factor for name, place in places.items()}

    def write(self, values: Mapping[str, float]) -> None:
        """Writes all or nothing: everything is checked first, and put back where one is refused.

        Raises:
            ConfigurationError: unknown name, or a value outside its range; nothing was written.
            LinkError: refused, or not as written when read back; the old values are back.
        """
        wanted = {name: (self._checked(name, value), value) for name, value in values.items()}
        before: list[tuple[str, str]] = []
        try:
            for name, (place, value) in wanted.items():
                before.append((place.at, self._console.get(place.at)))
                self._write(name, place, value)
        except LinkError as error:
            self._put_back(before, error)
            raise

    def _write(self, name: str, place: Place, value: float) -> None:
        self._console.set(place.at, f"{value / place.factor:.9g}")
        found = self._console.number(place.at) * place.factor
        if abs(found - value) > max(place.resolution, PRINTED * abs(value), 1e-12):
            raise LinkError(
                f"{name} was written as {value:.9g}, but the drive has {found:.9g} ({place.at}); it limits the "
                "value, or something else writes it too"
            )

    def _put_back(self, before: Sequence[tuple[str, str]], cause: LinkError) -> None:
        for at, text in reversed(before):
            try:
                self._console.set(at, text)
            except TransferAborted as error:
                cause.add_note(f"{at} could not be put back to {text}: {error}")
            except LinkError as error:
                cause.add_note(f"{at} and what was written before it could not be put back: {error}")
                return

    def _checked(self, name: str, value: float) -> Place:
        place = self.place(name)
        tolerance = 1e-9 * max(abs(place.low), abs(place.high)) if math.isfinite(place.high) else 0.0
        inside = place.low - tolerance <= value <= place.high + tolerance
        if not (inside and math.isfinite(value)):
            raise ConfigurationError(
                f"{name} is {value:.9g}; this drive allows {place.low:.9g} to {place.high:.9g} ({place.at})"
            )
        return place


def _place(name: str, parameters: Mapping[str, MoteusParameter], direction: int) -> Place:
    """Limits change places where the controller counts against the axis."""
    other = MIRRORED.get(name, name)
    parameter = parameters[other if direction < 0 and other in parameters else name]
    signed = direction if name in SIGNED_PARAMETERS else 1
    factor = signed * UNITS[parameter.unit]
    low = -math.inf if parameter.min is None else parameter.min
    high = math.inf if parameter.max is None else parameter.max
    if signed < 0:
        low, high = -high, -low
    return Place(parameter.at, factor, low, high, parameter.resolution * abs(factor))
