"""Parameters of a drive by name, in SI: checked, written, read back."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from autotune.core.errors import ConfigurationError, LinkError, TransferAborted
from autotune.core.friction_table import LARGEST_TORQUE, LARGEST_VELOCITY, VELOCITY
from autotune.core.ripple_parameters import GAIN, HIGHEST_ORDER, ORDER, SOURCE, TORQUE, is_ripple
from autotune_drivers.canopen.objects import ObjectRef, Raw
from autotune_drivers.canopen.sdo import Sdo
from autotune_drivers.profile import Parameter, Profile
from autotune_drivers.tables import HarmonicsBlock, VelocityPoints, unit_factor
from autotune_drivers.units import MIRRORED, SIGNED_PARAMETERS, Units

_AREAS = {1: (0x1000, 0xFFFF), 2: (0x1000, 0x1FFF), 3: (0x6000, 0x9FFF), 4: (0x2000, 0x5FFF)}


@dataclass(frozen=True, slots=True)
class Place:
    """Where a parameter is, SI units a raw unit (with sign), and its range in SI."""

    ref: ObjectRef
    factor: float
    low: float
    high: float


class DriveParameters:
    """Reads and writes the parameters that a profile names, and its tables (`[ripple]`, `[friction_table]`)."""

    def __init__(self, sdo: Sdo, profile: Profile, units: Units) -> None:
        self._sdo = sdo
        self._places = {
            name: _place(name, _own(profile.parameters, name, units), units) for name in profile.parameters
        }
        self._told: dict[str, ObjectRef] = {}
        self._ripple = profile.ripple
        self._limits: Mapping[str, float] = {}
        if profile.friction_table is not None:
            self._limits = profile.friction_table.told(units)
            self._places |= _velocity_points(profile.friction_table, units)

    def find_ripple(self) -> None:
        """Asks whether this drive has the harmonics of the profile; not every motor has them. Raises LinkError."""
        block = self._ripple
        if block is None:
            return
        places = _harmonics(block)
        try:
            for ref in (places[GAIN].ref, *block.told().values()):
                self._sdo.read(ref)
        except TransferAborted:
            self._ripple = None
            return
        self._places |= places
        self._told = block.told()

    @property
    def ripple(self) -> HarmonicsBlock | None:
        """Where this drive holds harmonics; None where it has none."""
        return self._ripple if self._told or GAIN in self._places else None

    def read(self, names: Sequence[str] | None = None) -> dict[str, float]:
        """Values in SI. Raises ConfigurationError (unknown name), LinkError."""
        told = self._told_values(names)
        wanted = list(self._places) if names is None else [name for name in names if name not in told]
        places = {name: self._find(name) for name in wanted}
        return {name: _si(place, self._sdo.read(place.ref)) for name, place in places.items()} | told

    def _told_values(self, names: Sequence[str] | None) -> dict[str, float]:
        """What is only read: what tables can hold, where the turn is counted from, and the highest order."""
        found = {name: value for name, value in self._limits.items() if names is None or name in names}
        if self.ripple is None:
            return found
        found |= {
            name: float(self._sdo.read(ref))
            for name, ref in self._told.items()
            if names is None or name in names
        }
        if names is None or HIGHEST_ORDER in names:
            found[HIGHEST_ORDER] = float(self.ripple.highest_order)
        return found

    def stored_by(self, store: ObjectRef, name: str) -> bool:
        """True where 1010h with this sub-index (CiA 301: all, communication, application, manufacturer) keeps it."""
        block = self._ripple
        if is_ripple(name) and name not in (GAIN, SOURCE) and block is not None and block.save is not None:
            return block.control is None or self._sdo.read(block.control) == block.use
        low, high = _AREAS.get(store.sub, _AREAS[1]) if store.index == 0x1010 else _AREAS[1]
        return low <= self._find(name).ref.index <= high

    def write(self, values: Mapping[str, float]) -> None:
        """Writes all or nothing: everything is checked first, and put back where one is refused.

        Raises:
            ConfigurationError: unknown name, or a value outside its range; nothing was written.
            LinkError: refused, or not as written when read back; the old values are back.
        """
        known = [
            *(name for name in self._places if name in values),
            *(n for n in values if n not in self._places),
        ]
        wanted = {name: (self._find(name), self._raw(name, values[name])) for name in known}
        before: list[tuple[ObjectRef, Raw]] = []
        try:
            for name, (place, raw) in wanted.items():
                before.append((place.ref, self._sdo.read(place.ref)))
                if before[-1][1] != raw:
                    self._write(name, place, raw)
        except LinkError as error:
            self._put_back(before, error)
            raise

    def _write(self, name: str, place: Place, raw: Raw) -> None:
        self._sdo.write(place.ref, raw)
        found = self._sdo.read(place.ref)
        if found != raw:
            raise LinkError(
                f"{name} was written as {_si(place, raw):.9g}, but the drive has {_si(place, found):.9g} "
                f"({place.ref}); it limits the value, or something else writes it too"
            )

    def _put_back(self, before: Sequence[tuple[ObjectRef, Raw]], cause: LinkError) -> None:
        for ref, raw in reversed(before):
            try:
                if self._sdo.read(ref) != raw:
                    self._sdo.write(ref, raw)
            except TransferAborted as error:
                cause.add_note(f"{ref} could not be put back to {raw}: {error}")
            except LinkError as error:
                cause.add_note(f"{ref} and what was written before it could not be put back: {error}")
                return

    def _find(self, name: str) -> Place:
        place = self._places.get(name)
        if place is None:
            near = difflib.get_close_matches(name, self._places, 1, cutoff=0.5)
            hint = f"did you mean {near[0]!r}" if near else f"it has {', '.join(self._places) or 'none'}"
            raise ConfigurationError(f"this drive has no parameter {name!r}; {hint}?")
        return place

    def _raw(self, name: str, value: float) -> Raw:
        place = self._find(name)
        tolerance = 1e-9 * max(abs(place.low), abs(place.high), 1e-30) if place.high < 1e300 else 0.0
        if not place.low - tolerance <= value <= place.high + tolerance:
            raise ConfigurationError(
                f"{name} is {value:.9g}; this drive allows {place.low:.9g} to {place.high:.9g} ({place.ref})"
            )
        return place.ref.raw(value / place.factor)


def _own(parameters: Mapping[str, Parameter], name: str, units: Units) -> Parameter:
    """The drive's object for our name: limits change places where the drive counts against the axis."""
    other = MIRRORED.get(name, name)
    return parameters[other if units.direction < 0 and other in parameters else name]


def _place(name: str, parameter: Parameter, units: Units) -> Place:
    signal = parameter.at.named(name)
    signed = name in SIGNED_PARAMETERS
    factor = units.signed(signal.unit) if signed else units.factor(signal.unit)
    edges = sorted(edge * factor for edge in signal.ref.range)
    low = edges[0] if parameter.min is None else parameter.min
    high = edges[1] if parameter.max is None else parameter.max
    if signed and units.direction < 0 and parameter.min is not None and parameter.max is not None:
        low, high = -parameter.max, -parameter.min
    return Place(signal.ref, factor, low, high)


def _harmonics(block: HarmonicsBlock) -> dict[str, Place]:
    found: dict[str, Place] = {}
    for name, (ref, unit) in block.places().items():
        factor = unit_factor(unit)
        low, high = (edge * factor for edge in ref.range)
        if unit == "deg":
            low, high = 0.0, 360.0 * factor
        elif name.startswith(f"{ORDER}."):
            high = float(block.highest_order)
        elif name.startswith(f"{TORQUE}.") or name == GAIN:
            low = 0.0
        found[name] = Place(replace(ref, name=name), factor, low, high)
    return found


def _velocity_points(table: VelocityPoints, units: Units) -> dict[str, Place]:
    """Magnitudes: the table is the same in both directions."""
    told = table.told(units)
    return {
        name: Place(
            signal.named(name).ref,
            units.factor(signal.unit),
            0.0,
            told[LARGEST_VELOCITY if name.startswith(VELOCITY) else LARGEST_TORQUE],
        )
        for name, signal in table.places().items()
    }


def _si(place: Place, raw: Raw) -> float:
    return raw * place.factor
