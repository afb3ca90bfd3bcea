"""Drive models as TOML that people read and edit.

```toml
schema = 1
axis = "edm-vertical"
fingerprint = "0123456789ab"
motion_unit = "rad"

[inertia]
value = 0.000666
standard_error = 2e-06
unit = "kg m²"

[effects.stribeck.break_away]
value = 0.34

[[history]]
when = "2024-05-01T12:00:00+00:00"
action = "fitted"
```
"""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Literal

import tomlkit
from pydantic import Field
from tomlkit.items import Table

from autotune.core.configuration import Strict, read_toml, validate
from autotune.core.errors import ConfigurationError
from autotune.models.drive_model import SCHEMA_VERSION, WHOLE_BASE, DriveModel, HistoryEntry
from autotune.models.effect import Parameter, Value
from autotune.models.reversal_memory import REVERSAL_MEMORY
from autotune.models.table import effect_kind
from autotune.models.total_friction import total_in_words

_MEMORY = REVERSAL_MEMORY.name


class _Number(Strict):
    value: float
    standard_error: Annotated[float, Field(ge=0)] | None = None
    unit: str | None = None
    about: str | None = None


class _Sums(Strict):
    total_friction: Annotated[float, Field(ge=0)] | None = None
    stiffness_at_rest: Annotated[float, Field(ge=0)] | None = None
    presliding_damping: Annotated[float, Field(ge=0)] | None = None


class _History(Strict):
    when: str
    action: str
    data: str = ""
    error_before: float | None = None
    error_after: float | None = None
    noise_floor: float | None = None
    unseen: str = ""


class _File(Strict):
    schema_version: Annotated[int, Field(alias="schema", ge=1)]
    axis: str = ""
    fingerprint: str = ""
    motion_unit: Literal["rad", "m"] = "rad"
    torque_unit: Literal["", "A", "V"] = ""
    inertia: _Number
    viscous: _Number
    coulomb: _Number
    stiffness: _Number
    micro_damping: _Number
    offset: _Number
    damping_velocity: _Number | None = None
    damping_tail: _Number | None = None
    bends_back: _Number | None = None
    bends_35: _Number | None = None
    bends_65: _Number | None = None
    bends_85: _Number | None = None
    creep_velocity: _Number | None = None
    creep_tail: _Number | None = None
    standard_errors: _Sums = Field(default_factory=_Sums)
    effects: dict[str, dict[str, _Number]] = Field(default_factory=dict)
    history: list[_History] = Field(default_factory=list)


def parse_model(text: str) -> DriveModel:
    """The model of a TOML text.

    Raises:
        ConfigurationError: as `read_model`.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.toml"
        path.write_text(text, encoding="utf-8")
        return read_model(path)


def read_model(path: str | Path) -> DriveModel:
    """Reads a model file.

    Raises:
        ConfigurationError: no such file, not TOML, a newer schema, an unknown key, a unit that is not
            this axis's, or a value out of bounds.
    """
    data = read_toml(path, "model")
    where = f"model {path}"
    schema = data.get("schema")
    if isinstance(schema, int) and schema > SCHEMA_VERSION:
        raise ConfigurationError(
            f"{where} has schema {schema}, this program knows up to {SCHEMA_VERSION}; update autotune"
        )
    file = validate(_File, data, where)
    try:
        return _model(file)
    except ConfigurationError as error:
        raise ConfigurationError(f"{where}: {error}") from error


def write_model(model: DriveModel, path: str | Path) -> None:
    """Writes a model, replacing the file in one step; what was there before is kept as `*.bak`."""
    path = Path(path)
    temporary = path.with_name(path.name + ".part")
    with temporary.open("w", encoding="utf-8") as file:
        file.write(model_text(model))
        file.flush()
        os.fsync(file.fileno())
    if path.is_file():
        backup = path.with_name(path.name + ".bak")
        backup.write_bytes(path.read_bytes())
    os.replace(temporary, path)


def model_text(model: DriveModel) -> str:
    """The model as TOML."""
    document = tomlkit.document()
    document.add(tomlkit.comment("Drive model, SI, on the motor side. Written by autotune; may be edited."))
    document["schema"] = SCHEMA_VERSION
    for key in ("axis", "fingerprint", "motion_unit"):
        document[key] = getattr(model, key)
    if model.torque_unit:
        document["torque_unit"] = model.torque_unit
    for parameter in WHOLE_BASE:
        if parameter.name in model.base:
            document[parameter.name] = _number(model, parameter, model.base[parameter.name])
    if _MEMORY in model and (sums := _sums(model)):
        document["standard_errors"] = sums
    if model.effects:
        document["effects"] = _effects(model)
    if model.history:
        entries = tomlkit.aot()
        for entry in model.history:
            entries.append(_entry(entry))
        document["history"] = entries
    return tomlkit.dumps(document)


def _sums(model: DriveModel) -> Table:
    """Errors of sums whose parts trade with each other; empty where no fit has said them."""
    table = tomlkit.table()
    errors = {
        "total_friction": model.friction_error,
        "stiffness_at_rest": model.stiffness_error,
        "presliding_damping": model.damping_error,
    }
    for name, error in errors.items():
        if error is not None:
            table[name] = float(error)
    if table:
        table.comment("of sums, whose parts are less well known")
    return table


def _effects(model: DriveModel) -> Table:
    effects = tomlkit.table(is_super_table=True)
    for effect in model.effects:
        table = tomlkit.table(is_super_table=True)
        for name, value in effect.values.items():
            table[name] = _number(model, effect.kind.parameter(name), value)
        effects[effect.name] = table
    return effects


def _number(model: DriveModel, parameter: Parameter, value: Value) -> Table:
    table = tomlkit.table()
    table["value"] = float(value.value)
    if value.standard_error is not None:
        table["standard_error"] = float(value.standard_error)
    table["unit"] = parameter.unit_for(model.motion_unit, model.torque_unit)
    total = total_in_words(model) if parameter.name == "coulomb" else ""
    table["about"] = f"{parameter.meaning}; {total}" if total else parameter.meaning
    return table


def _entry(entry: HistoryEntry) -> Table:
    table = tomlkit.table()
    for key in HistoryEntry.__slots__:
        value = getattr(entry, key)
        if value is not None and value != "":
            table[key] = value
    return table


def _model(file: _File) -> DriveModel:
    base: dict[str, Value] = {}
    for parameter in WHOLE_BASE:
        number = getattr(file, parameter.name)
        if number is not None:
            base[parameter.name] = _value(number, parameter, parameter.name, file)
    effects = []
    for name, numbers in file.effects.items():
        kind = effect_kind(name)
        values = {
            key: _value(number, kind.parameter(key), kind.surface(key), file)
            for key, number in numbers.items()
        }
        errors = {key: v.standard_error for key, v in values.items() if v.standard_error is not None}
        effects.append(kind.make({key: v.value for key, v in values.items()}, errors))
    history = tuple(HistoryEntry(**entry.model_dump()) for entry in file.history)
    return DriveModel(
        MappingProxyType(base),
        tuple(effects),
        file.motion_unit,
        file.axis,
        file.fingerprint,
        history,
        file.torque_unit,
        file.standard_errors.total_friction,
        file.standard_errors.stiffness_at_rest,
        file.standard_errors.presliding_damping,
    )


def _value(number: _Number, parameter: Parameter, surface: str, file: _File) -> Value:
    unit = parameter.unit_for(file.motion_unit, file.torque_unit)
    if number.unit is not None and number.unit != unit:
        raise ConfigurationError(
            f"{surface} is in {number.unit!r}; on an axis in {file.motion_unit} it must be in {unit!r}"
        )
    return Value(number.value, number.standard_error)
