"""`SURFACE.toml`: a contact as its owner describes it. SI units; unknown keys are errors that name the nearest."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from autotune.core.configuration import Strict, read_toml, validate
from autotune.core.errors import ConfigurationError
from autotune.tribology.contact import Interface, Material
from autotune.tribology.surface import Surface, surface_of_profile, together

MOST_BYTES = 50_000_000
"""Of a profile: a million points are 30 MB."""


class _Surface(Strict):
    height_deviation: float | None = Field(None, gt=0.0, lt=1e-2)
    slope_deviation: float | None = Field(None, gt=0.0, lt=100.0)
    curvature_deviation: float | None = Field(None, gt=0.0, lt=1e10)
    profiles: list[str] = Field(default_factory=list, max_length=2)

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        given = [self.height_deviation, self.slope_deviation, self.curvature_deviation]
        missing = sum(value is None for value in given)
        if self.profiles and missing != len(given):
            raise ValueError("give either the three deviations or `profiles`, not both")
        if not self.profiles and missing:
            raise ValueError(
                "height_deviation, slope_deviation and curvature_deviation belong together; "
                "or give `profiles`, one or two CSV files of heights"
            )
        return self


class _Material(Strict):
    young_modulus: float = Field(gt=1e6, lt=2e12)
    poisson_ratio: float = Field(ge=0.0, lt=0.5)
    hardness: float | None = Field(None, gt=1e5, lt=2e11)


class _Contact(Strict):
    lay: Literal["across", "none"] = "across"
    width: float = Field(gt=0.0, lt=10.0)
    length: float = Field(gt=0.0, lt=10.0)
    load: float = Field(gt=0.0)
    load_min: float | None = Field(None, gt=0.0)
    load_max: float | None = Field(None, gt=0.0)

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        low, high = self.load_min or self.load, self.load_max or self.load
        if not low <= self.load <= high:
            raise ValueError(f"load_min {low:g} N, load {self.load:g} N and load_max {high:g} N must rise")
        return self


class _Interface(Strict):
    shear_strength: float | None = Field(None, gt=0.0)
    break_away_displacement: float | None = Field(None, gt=0.0, lt=1e-3)

    @model_validator(mode="after")
    def _one_way(self) -> Self:
        if (self.shear_strength is None) == (self.break_away_displacement is None):
            raise ValueError("give either shear_strength or break_away_displacement")
        return self


class _Place(Strict):
    metres_per_motor_unit: float = Field(gt=0.0, lt=1e3)
    contacts: int = Field(1, ge=1, le=10_000)


class _File(Strict):
    schema_: Literal[1] = Field(alias="schema")
    name: str = Field(min_length=1, max_length=80)
    surface: _Surface
    material: _Material
    contact: _Contact
    interfaces: dict[str, _Interface] = Field(default_factory=dict, max_length=10)
    place: _Place | None = None


@dataclass(frozen=True)
class FilmOf:
    """What an interface stands: shear strength τ_B [Pa], or the break-away displacement that was measured [m]."""

    shear_strength: float | None
    break_away_displacement: float | None


@dataclass(frozen=True)
class Place:
    """Where the contact sits: its motion [m] for each unit of the motor's, and how many share the friction."""

    metres_per_motor_unit: float
    contacts: int


@dataclass(frozen=True)
class ContactFile:
    """A `SURFACE.toml` that was read; loads [N], `place` None where nobody told it."""

    name: str
    interface: Interface
    load: float
    loads: tuple[float, float]
    films: dict[str, FilmOf]
    place: Place | None


def read_contact(path: str | Path) -> ContactFile:
    """Reads and checks a `SURFACE.toml`.

    Raises:
        ConfigurationError: no such file, wrong keys, impossible statistics, or a profile that is none.
    """
    path = Path(path)
    content = validate(_File, read_toml(path, "surface file"), str(path))
    contact, material = content.contact, content.material
    interface = Interface(
        surface=_surface(content.surface, path.parent),
        material=Material(material.young_modulus, material.poisson_ratio, material.hardness or math.nan),
        width=contact.width,
        length=contact.length,
        geometry="line" if contact.lay == "across" else "point",
    )
    films = {
        name: FilmOf(film.shear_strength, film.break_away_displacement)
        for name, film in content.interfaces.items()
    }
    place = content.place
    where = None if place is None else Place(place.metres_per_motor_unit, place.contacts)
    low, high = contact.load_min or contact.load, contact.load_max or contact.load
    return ContactFile(content.name, interface, contact.load, (low, high), films, where)


def _surface(given: _Surface, folder: Path) -> Surface:
    if given.profiles:
        return reduce(together, (_profile(folder / name) for name in given.profiles))
    height, slope, curvature = given.height_deviation, given.slope_deviation, given.curvature_deviation
    if height is None or slope is None or curvature is None:
        raise ConfigurationError("surface: three deviations belong together")
    return Surface(height, slope, curvature)


def _profile(path: Path) -> Surface:
    """Two columns, position and height [m]; lines that begin with # and one line of names are passed over."""
    try:
        if path.stat().st_size > MOST_BYTES:
            raise ConfigurationError(f"profile {path} has more than {MOST_BYTES / 1e6:.0f} MB: cut it")
        with path.open(newline="", encoding="utf-8") as file:
            rows = [row for row in csv.reader(file) if row and not row[0].startswith("#")]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ConfigurationError(f"profile {path} cannot be read: {error}") from error
    try:
        body = rows[1:] if rows and not _is_number(rows[0][0]) else rows
        table = np.array([[float(row[0]), float(row[1])] for row in body])
    except (ValueError, IndexError) as error:
        raise ConfigurationError(
            f"profile {path}: every line needs two numbers, position and height in metres ({error}); "
            "cut the profile where it has holes"
        ) from error
    try:
        return surface_of_profile(table.reshape(-1, 2)[:, 0], table.reshape(-1, 2)[:, 1])
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from error


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
