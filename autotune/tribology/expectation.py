"""What a contact should show on an axis, and whether an identified stiffness can be this contact's."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from autotune.core.arrays import Floats
from autotune.tribology.configuration import ContactFile, FilmOf
from autotune.tribology.contact import Interface, plasticity_index, stiffness_exponent

POINTS = 25
"""Loads of a curve."""
ALIKE = 1.6
"""Factor within which two stiffnesses are called the same: a profile's curvature, and with it the number of peaks,
depends on stylus and step by about that much (thesis, Figure 6.6: points scatter by a third)."""
_STEEPEST = 0.3
"""rms slope above which flanks of asperities touch sideways, which no theory of summits knows."""


@dataclass(frozen=True)
class Film:
    """One interface at the nominal load: τ_B [Pa], F_s [N], x_s [m], and x_s over the loads of the curve."""

    name: str
    shear_strength: float
    break_away: float
    break_away_displacement: float
    over_load: Floats


@dataclass(frozen=True)
class Expectation:
    """What a contact of this surface, material and load should show, at the contact itself.

    `loads` [N], `stiffness` [N/m] and `area` [m²] are curves of the same length; the single values are at `load`.
    """

    name: str
    load: float
    stiffness_at_load: float
    area_at_load: float
    pressure: float
    exponent: float
    plasticity: float
    loads: Floats
    stiffness: Floats
    area: Floats
    films: tuple[Film, ...]
    notes: tuple[str, ...]

    def to_json(self) -> dict[str, Any]:
        """For `--json`: SI units, at the contact."""
        return {
            "name": self.name,
            "load": self.load,
            "stiffness": self.stiffness_at_load,
            "real_area": self.area_at_load,
            "mean_pressure": self.pressure,
            "stiffness_load_exponent": self.exponent,
            "plasticity_index": self.plasticity,
            "curve": {
                "load": self.loads.tolist(),
                "stiffness": self.stiffness.tolist(),
                "real_area": self.area.tolist(),
            },
            "interfaces": {
                film.name: {
                    "shear_strength": film.shear_strength,
                    "break_away": film.break_away,
                    "break_away_displacement": film.break_away_displacement,
                }
                for film in self.films
            },
            "notes": list(self.notes),
        }


@dataclass(frozen=True)
class Judged:
    """An axis's identified stiffness at rest beside a contact's, both in the axis's units.

    `rest` is the stiffness that in series with the contact gives the identified one; nan where there is none.
    """

    identified: float
    contact: float
    rest: float
    verdict: str
    sentence: str

    def to_json(self) -> dict[str, Any]:
        """For `--json`: N m/rad or N/m, motor side."""
        return {
            "identified_stiffness": self.identified,
            "contact_stiffness": self.contact,
            "remaining_stiffness": self.rest,
            "verdict": self.verdict,
            "sentence": self.sentence,
        }


def expected(file: ContactFile) -> Expectation:
    """What the contact should show.

    Raises:
        ConfigurationError: a load that asperities alone cannot carry.
    """
    interface = file.interface
    low, high = file.loads if file.loads[1] > 1.01 * file.loads[0] else (file.load / 3.0, file.load * 3.0)
    loads = np.geomspace(low, high, POINTS)
    heights = [interface.height_at(float(load)) for load in loads]
    stiffness = np.array([interface.stiffness(t) for t in heights])
    area = np.array([interface.area(t) for t in heights])
    at = interface.height_at(file.load)
    now, real = interface.stiffness(at), interface.area(at)
    films = tuple(_film(name, film, now, real, stiffness, area) for name, film in file.films.items())
    return Expectation(
        name=file.name,
        load=file.load,
        stiffness_at_load=now,
        area_at_load=real,
        pressure=file.load / real,
        exponent=stiffness_exponent(interface, low, high),
        plasticity=plasticity_index(interface.surface, interface.material),
        loads=loads,
        stiffness=stiffness,
        area=area,
        films=films,
        notes=tuple(_notes(interface, at, file.load / real)),
    )


def judged(file: ContactFile, expectation: Expectation, *, identified: float, unit: str) -> Judged:
    """Whether an identified stiffness at rest can be this contact's, in words.

    Contacts that share the friction act in parallel; whatever else yields before the sensor acts in series and can
    only make the axis softer than its contacts.

    Args:
        identified: σ0 of the axis's model, motor side [N m/rad or N/m].
        unit: of it.
    """
    ratio, contacts = (file.place.metres_per_motor_unit, file.place.contacts) if file.place else (1.0, 1)
    contact = contacts * expectation.stiffness_at_load * ratio**2
    rest = identified * contact / (contact - identified) if identified < contact else math.nan
    told = f"identified {identified:.3g} {unit}, the contact gives {contact:.3g} {unit}"
    if contact / ALIKE <= identified <= contact * ALIKE:
        return Judged(
            identified, contact, rest, "contact", f"the stiffness at rest can be this contact's: {told}"
        )
    if identified < contact:
        return Judged(
            identified, contact, rest, "elsewhere",
            f"the stiffness at rest sits elsewhere: {told}, {contact / identified:.1f} times as much; something "
            f"in series with it has about {rest:.3g} {unit}: bearing, coupling, or the sensor's mounting",
        )  # fmt: skip
    return Judged(
        identified, contact, rest, "too_soft",
        f"this contact is too soft to be the whole: {told}; the load is higher, more contacts share the friction, "
        "or the motion at the contact is larger than [place] says",
    )  # fmt: skip


def _film(name: str, film: FilmOf, now: float, real: float, stiffness: Floats, area: Floats) -> Film:
    strength = film.shear_strength
    if strength is None:
        strength = (film.break_away_displacement or math.nan) * now / real
    force = strength * real
    return Film(name, strength, force, force / now, strength * area / stiffness)


def _notes(interface: Interface, height: float, pressure: float) -> list[str]:
    notes = []
    hardness = interface.material.hardness
    index = plasticity_index(interface.surface, interface.material)
    if math.isnan(hardness):
        notes.append("the material's hardness is not given: whether asperities yield cannot be told")
    elif pressure > hardness:
        notes.append(
            f"beyond elastic contact: asperities would carry {pressure / 1e9:.3g} GPa on average where the material "
            f"yields at {hardness / 1e9:.3g} GPa (plasticity index {index:.3g}, elastic below 0.6). When first "
            "loaded they flatten until they carry it; stiffness and real area here are those of the surface as it "
            "was measured, so measure one that has run in"
        )
    if interface.surface.slope > _STEEPEST:
        notes.append(
            f"slopes of {interface.surface.slope:.2g} rms are steep for a theory of summits "
            f"(up to about {_STEEPEST:g})"
        )
    if interface.touching(height) > 0.3:
        notes.append(
            f"{100 * interface.touching(height):.0f} % of all asperities touch: they no longer yield each for "
            "itself, and the contact is softer than this"
        )
    return notes
