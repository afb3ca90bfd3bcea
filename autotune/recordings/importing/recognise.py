"""What a foreign column is, by the words of its name and by its unit.

Only what is beyond doubt is taken; everything else is asked for with the option that would say it.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from autotune.recordings.importing.source import Column
from autotune.recordings.importing.units import Unit, find_unit
from autotune.recordings.recording import FLOAT_COLUMNS

_QUANTITIES = {
    "time": "time t timestamp timestamps zeit tijd elapsed clock times",
    "position": "position positions pos q qm qg theta angle phi encoder enc winkel lage weg displacement",
    "velocity": "velocity velocities vel speed omega qd dq qdot rpm geschwindigkeit drehzahl",
    "acceleration": "acceleration acc accel qdd ddq",
    "torque": "torque torques tau force moment drehmoment kraft trq tq effort",
    "current": "current curr iq strom i amps",
    "voltage": "voltage volt volts u uq ud vir vsupply vbus spannung",
    "temperature": "temperature temp temperatur",
}
_ROLES = {
    "wanted": "reference ref target demand demanded set setpoint desired des command cmd commanded qg soll sollwert sp "
    "qref qd* trajectory",
    "error": "error err following deviation lag residual",
    "forward": "feedforward ff offset",
    "other": "friction estimated est load disturbance limit max min std",
}
_ACTUAL = frozenset(
    ["actual", "act", "measured", "meas", "real", "feedback", "fb", "ist", "istwert", "gemessen"]
)
_WHICH = _ACTUAL | {"joint", "axis", "motor", "link", "shaft", "encoder", "sensor", "raw"}
"""Words that say which of several quantities of one kind a column is; beside them a short name is as plain as alone."""
_WORDS = {word: quantity for quantity, words in _QUANTITIES.items() for word in words.split()}
_COMPOUND = re.compile(
    r"(?P<before>soll|ist)(?P<behind>[a-zäöü]{2,})|(?P<ahead>[a-zäöü]{2,}?)s?(?P<after>soll|ist)(wert)?"
)
_IN_TWO = re.compile(r"\b(set|feed|time|soll|ist)[ _-](point|forward|stamp|wert)")
"""Words that are written in one or in two."""
_ROLE_WORDS = {word: role for role, words in _ROLES.items() for word in words.split()}
_TARGETS = {
    ("time", ""): "time",
    ("position", ""): "position",
    ("position", "wanted"): "reference",
    ("velocity", ""): "velocity",
    ("torque", ""): "torque",
    ("torque", "wanted"): "torque_command",
    ("torque", "forward"): "torque_feedforward",
    ("temperature", ""): "temperature",
}
_BY_KIND = {
    "angular speed": "velocity",
    "linear speed": "velocity",
    "count rate": "velocity",
    "angle": "position",
    "length": "position",
    "counts": "position",
    "torque": "torque",
    "force": "torque",
    "current": "current",
    "voltage": "voltage",
    "time": "time",
    "temperature": "temperature",
}
COMMAND = "_command"
"""What ends the guess of a current or a voltage that is wanted."""
MEASURED = {
    "reference": "position",
    "torque_command": "torque",
    "current" + COMMAND: "current",
    "voltage" + COMMAND: "voltage",
}
"""What is wanted → what is measured of it."""
KINDS = {
    "time": ("time",),
    "position": ("angle", "length", "counts"),
    "velocity": ("angular speed", "linear speed", "count rate"),
    "torque": ("torque", "force", "current", "voltage", "share"),
    "temperature": ("temperature",),
}
"""What a column's unit may measure, by the quantity of the recording."""


@dataclass(frozen=True, slots=True)
class Guess:
    """What a column seems to be: its place in a recording, or `current`, `voltage`, or one of them with `_command`.

    Empty if unknown.

    Attributes:
        canonical: the name is one of a recording's own, so that SI is meant if no unit is written.
    """

    target: str
    unit: Unit | None
    canonical: bool = False


def quantity_of(target: str) -> str:
    """`reference` → position, `torque_command` → torque."""
    return "position" if target == "reference" else target.split("_")[0]


def unit_of(column: Column, quantity: str = "") -> Unit | None:
    """The unit that the file writes for this column, if it is known."""
    return find_unit(column.unit, "length" if quantity == "position" else "") if column.unit else None


def wanted_of(target: str, measured: Column, columns: Sequence[Column], hits: list[int]) -> list[int]:
    """Of the columns that may be `target`, those of the fellow that a person has named; else those without a number."""
    of_it = [i for i in hits if stem(columns[i].name) == stem(measured.name)]
    return of_it or [i for i in hits if columns[i].name == target or not re.search("[0-9]", columns[i].name)]


def could_be_position(column: Column) -> bool:
    """Whether a column measures an angle, a length or counts, and its name does not say of what."""
    return unit_of(column, "position") is not None and _nameless(column, "position")


def could_be_torque(column: Column) -> bool:
    """Whether a column measures a torque or a force, and its name does not say of what."""
    unit = unit_of(column, "torque")
    return unit is not None and unit.kind in ("torque", "force") and _nameless(column, "torque")


def guesses_of(columns: Sequence[Column]) -> list[Guess]:
    """What each column seems to be, by itself and by its fellow: `x` is what is measured where `x_ref` is wanted.

    With a number in its name (`F2_cmd`) a column is what is wanted of its fellow only (`F2`).
    """
    alone = [guess(column) for column in columns]
    known = {found.target for found in alone}
    fellows: dict[tuple[str, ...], list[int]] = {}
    for index, column in enumerate(columns):
        fellows.setdefault(stem(column.name), []).append(index)
    found = list(alone)
    for index, column in enumerate(columns):
        wanted = alone[index] if alone[index].target else guess(_without_numbers(column))
        measured = MEASURED.get(wanted.target, "")
        for other in fellows[stem(column.name)] if measured else ():
            if alone[other].target == measured:
                found[index] = wanted
            elif measured not in known and _nameless(columns[other], measured):
                found[index], found[other] = wanted, Guess(measured, unit_of(columns[other], measured))
    return found


def _without_numbers(column: Column) -> Column:
    return replace(column, name=re.sub(r"[0-9]+", "", column.name))


def _nameless(column: Column, quantity: str) -> bool:
    """Whether a column's name says nothing of what it is, and its unit no other than `quantity`."""
    unit = unit_of(column, quantity)
    fits = unit.kind in KINDS.get(quantity, ()) if unit is not None else not column.unit
    return fits and words_of(column.name) == ("", "")


def _a_measured(column: Column) -> bool:
    """Whether a name is one letter and a word for what is measured: `F_act`, `M_ist`."""
    words = _all_words(column.name)
    letters = [word for word in words if len(word) == 1 and word.isalpha()]
    return len(words) == 2 and len(letters) == 1 and any(word in _ACTUAL for word in words)


def guess(column: Column) -> Guess:
    """What the column seems to be."""
    if column.name in FLOAT_COLUMNS:
        return Guess(column.name, unit_of(column, quantity_of(column.name)), True)
    quantity, role = words_of(column.name)
    unit = unit_of(column, quantity)
    if unit is not None:
        by_unit = _BY_KIND.get(unit.kind, "")
        if not quantity:
            plain = by_unit in ("time", "current", "voltage") or (by_unit == "torque" and _a_measured(column))
            quantity = by_unit if plain or (role == "wanted" and by_unit in ("position", "torque")) else ""
        elif by_unit in ("current", "voltage") and quantity == "torque":
            quantity = by_unit
        elif quantity in KINDS and unit.kind not in KINDS[quantity]:
            return Guess("", unit)
    if quantity in ("current", "voltage"):
        return Guess({"": quantity, "wanted": quantity + COMMAND}.get(role, ""), unit)
    return Guess(_TARGETS.get((quantity, role), ""), unit)


def _parts(word: str) -> list[str]:
    """A compound taken apart: Sollposition, Lageistwert."""
    found = _COMPOUND.fullmatch(word)
    if found is None:
        return [word]
    role, known = found["before"] or found["after"], found["behind"] or found["ahead"]
    return [role, known] if known in _WORDS else [word]


def _spaced(name: str) -> str:
    spaced = re.sub(r"([a-z])([A-Z])", r"\1 \2", name.rsplit(".", 1)[-1])
    return _IN_TWO.sub(r"\1\2", spaced.lower())


def _all_words(name: str) -> list[str]:
    """Words and numbers of a name, compounds taken apart."""
    return [part for word in re.findall(r"[a-zäöüµ]+|[0-9]+", _spaced(name)) for part in _parts(word)]


def stem(name: str) -> tuple[str, ...]:
    """The words of a name but for those that tell wanted from measured: `M_soll` and `M_ist` have one stem."""
    kept = (word for word in _all_words(name) if word not in _ACTUAL and _ROLE_WORDS.get(word) != "wanted")
    return tuple(kept)


def words_of(name: str) -> tuple[str, str]:
    """Quantity and role by the name's words; an unclear name has none, one like 'setpoint' has a role alone."""
    spaced = _spaced(name)
    words = [part for word in re.split(r"[^a-zäöüµ]+", spaced) if word for part in _parts(word)]
    if not words:
        return "", ""
    short = sum(word not in _WHICH and word not in _ROLE_WORDS for word in words) == 1
    quantities = [
        _WORDS[word] for word in words if word in _WORDS and (short or len(word) > 1 or word == "t")
    ]
    roles = [_ROLE_WORDS[word] for word in words if word in _ROLE_WORDS]
    numbered = re.search(r"\d", spaced) is not None
    if len(set(quantities)) > 1:
        return "", ""
    return (quantities or [""])[0], "" if not roles else (
        "other" if numbered or len(set(roles)) > 1 else roles[0]
    )
