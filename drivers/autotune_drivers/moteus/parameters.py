"""Parameters of a moteus by name, in SI: checked, written through the console, read back."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from autotune.core.errors import ConfigurationError, LinkError, TransferAborted
from autotune.core.ripple_parameters import GAIN, LARGEST_STEP, is_ripple
from autotune_drivers.moteus.console import Console
from autotune_drivers.moteus.profile import UNITS, MoteusParameter, MoteusProfile
from autotune_drivers.units import MIRRORED, SIGNED_PARAMETERS

MANY = 32
"""So many parameters and more are read by one `conf enumerate`."""
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
    """Reads and writes the parameters that a profile names, and the table of its `[ripple]`.

    Attributes:
        absent: names that this controller does not have, or has no number for (a limit that is `nan`).
    """

    def __init__(self, console: Console, profile: MoteusProfile, direction: int) -> None:
        self._console = console
        self._places = {name: _place(name, profile.parameters, direction) for name in profile.parameters}
        self.absent: set[str] = set()
        self._told: dict[str, str] = {}
        self._table = profile.ripple

    def find_absent(self) -> None:
        """Asks for every parameter once. Raises LinkError."""
        self._find_table()
        for name, place in list(self._places.items()):
            if is_ripple(name):
                continue
            try:
                if math.isnan(self._console.number(place.at)):
                    self.absent.add(name)
            except TransferAborted:
                self.absent.add(name)

    def _find_table(self) -> None:
        """Whether this firmware has the whole table and what moves its zero; not every one has."""
        table = self._table
        if table is None:
            return
        listed = self._console.enumerate()
        names = {*table.places().values(), *table.told().values()}
        speed = _number(listed.get(table.constant, ""))
        if not names <= set(listed) or not speed > 0.0:
            self._table = None
            return
        step = float(table.largest_step)
        places = {name: Place(at, 1.0, -step, step, 0.0) for name, at in table.places().items()}
        constant = table.torque_factor / speed
        self._places |= places | {GAIN: Place(table.scale, constant, 0.0, math.inf, 0.0)}
        self._told = dict(table.told())

    def places_of(self, prefixes: tuple[str, ...]) -> list[str]:
        """The controller's names of all parameters that are there and begin so."""
        return [
            place.at
            for name, place in self._places.items()
            if name not in self.absent and name.startswith(prefixes)
        ]

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
        told = {name: at for name, at in self._told.items() if names is None or name in names}
        fixed = self._fixed(names)
        if names is None:
            wanted = [name for name in self._places if name not in self.absent]
        else:
            wanted = [name for name in names if name not in told and name not in fixed]
        places = {name: self.place(name) for name in wanted}
        numbers = self._numbers([*(place.at for place in places.values()), *told.values()])
        found = {name: numbers[place.at] * place.factor for name, place in places.items()}
        return found | {name: numbers[at] for name, at in told.items()} | fixed

    def _fixed(self, names: Sequence[str] | None) -> dict[str, float]:
        """What the profile says of the table."""
        if self._table is None or (names is not None and LARGEST_STEP not in names):
            return {}
        return {LARGEST_STEP: float(self._table.largest_step)}

    def _numbers(self, wanted: Sequence[str]) -> dict[str, float]:
        """Values by the controller's names, one by one or all in one go."""
        if len(wanted) < MANY:
            return {at: self._console.number(at) for at in wanted}
        listed = self._console.enumerate()
        return {at: _number(listed[at]) if at in listed else self._console.number(at) for at in wanted}

    def write(self, values: Mapping[str, float]) -> None:
        """Writes all or nothing: everything is checked first, and put back where one is refused.

        Raises:
            ConfigurationError: unknown name, or a value outside its range; nothing was written.
            LinkError: refused, or not as written when read back; the old values are back.
        """
        wanted = {name: (self._checked(name, value), value) for name, value in values.items()}
        before: list[tuple[str, str]] = []
        try:
            if len(wanted) >= MANY:
                self._write_many(wanted, before)
                return
            for name, (place, value) in wanted.items():
                before.append((place.at, self._console.get(place.at)))
                self._write(name, place, value)
        except LinkError as error:
            self._put_back(before, error)
            raise

    def _write_many(self, wanted: Mapping[str, tuple[Place, float]], before: list[tuple[str, str]]) -> None:
        """What differs from what is listed; all is listed again, and compared, at the end."""
        listed = self._console.enumerate()
        for place, value in wanted.values():
            present = listed.get(place.at, "")
            if not _same(place, _number(present) * place.factor, value):
                before.append((place.at, present))
                self._console.set(place.at, f"{value / place.factor:.9g}")
        found = self._console.enumerate()
        for name, (place, value) in wanted.items():
            self._compare(name, place, value, _number(found.get(place.at, "")) * place.factor)

    def _write(self, name: str, place: Place, value: float) -> None:
        self._console.set(place.at, f"{value / place.factor:.9g}")
        self._compare(name, place, value, self._console.number(place.at) * place.factor)

    def _compare(self, name: str, place: Place, value: float, found: float) -> None:
        if not _same(place, found, value):
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


def _same(place: Place, found: float, value: float) -> bool:
    return abs(found - value) <= max(place.resolution, PRINTED * abs(value), 1e-12)


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


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
