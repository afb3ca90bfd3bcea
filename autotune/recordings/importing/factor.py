"""`NAME=FIELD[*FACTOR]`: which column of the file is which of the recording, and times what.

A factor is a product or quotient of numbers, `pi`, units (`*deg` multiplies by π/180) and single
numbers that the file itself holds (`vir*gtau`).
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

from autotune.core.errors import ConfigurationError
from autotune.recordings.importing.source import Source, by_name, by_number, near, within
from autotune.recordings.importing.units import find_unit
from autotune.recordings.recording import FLOAT_COLUMNS

TARGETS = (*FLOAT_COLUMNS, "repeat")
_NUMBER = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?")


@dataclass(frozen=True, slots=True)
class Assignment:
    """What a person asked for: recording column, index in the file, factor (None: none was given)."""

    target: str
    index: int
    factor: float | None
    written: str


def parse_assignments(texts: list[str], source: Source) -> dict[str, Assignment]:
    """The `--column` options, for this file.

    Raises:
        ConfigurationError: not of the form, an unknown name or field, or one name twice.
    """
    found: dict[str, Assignment] = {}
    for text in texts:
        assignment = _assignment(text, source)
        if assignment.target in found:
            raise ConfigurationError(f"--column gives {assignment.target} twice; keep one of the two")
        _refuse_shared(assignment, found, source)
        found[assignment.target] = assignment
    return found


def _refuse_shared(new: Assignment, found: Mapping[str, Assignment], source: Source) -> None:
    """One column cannot be two quantities: a torque that is the position makes a perfect spring."""
    for other in found.values():
        if other.index == new.index:
            column = source.columns[new.index]
            raise ConfigurationError(
                f"--column takes column {column.number}, {column}, of {source.path} as {other.target} and as "
                f"{new.target}; name another for one of them, of {source.numbered()}"
            )


def _assignment(text: str, source: Source) -> Assignment:
    target, separator, rest = (part.strip() for part in text.partition("="))
    if not separator or not target or not rest:
        raise ConfigurationError(
            f"--column {text!r} is not understood; write NAME=FIELD or NAME=FIELD*FACTOR, for example "
            "'position=Pos*deg' or 'torque=Iq*0.12'"
        )
    if target not in TARGETS:
        allowed = (*TARGETS, "experiment")
        like = difflib.get_close_matches(target.lower(), allowed, 1, 0.5)
        hint = f" (did you mean {like[0]}?)" if like else ""
        raise ConfigurationError(
            f"--column {text!r}: {target!r} is no column of a recording{hint}; allowed are {', '.join(allowed)}"
        )
    index, factor = _field(rest, source, text)
    return Assignment(target, index, factor, rest)


def _field(rest: str, source: Source, text: str) -> tuple[int, float | None]:
    """Splits FIELD from FACTOR; a field's own name may contain `*` and `/`, so the longest name wins."""
    cuts = [len(rest), *reversed([place for place, letter in enumerate(rest) if letter in "*/"])]
    for cut in cuts:
        index = _find(rest[:cut].strip(), source, text)
        if index is None:
            continue
        if cut == len(rest):
            return index, None
        tail = rest[cut + 1 :] if rest[cut] == "*" else f"1/{rest[cut + 1 :]}"
        return index, evaluate(tail, source.scalars, f"--column {text!r}")
    field = re.split(r"[*/]", rest)[0].strip()
    highest = max((column.number for column in (*source.columns, *source.texts)), default=0)
    raise ConfigurationError(
        f"--column {text!r}: {source.path} has no column {field!r}{near(field, source.columns)}; it has "
        f"{source.described()}, or say its number, 1 to {highest}"
    )


def _find(field: str, source: Source, text: str) -> int | None:
    """Index of the column with that name or number; None where there is none."""
    hits = by_name(field, source.columns)
    if len(hits) > 1:
        raise ConfigurationError(
            f"--column {text!r}: {source.path} has {len(hits)} columns {field!r}; say which by its number: "
            f"{within([str(column.number) for column in hits])}"
        )
    if not hits:
        for column in source.texts:
            if field == column.name or column in by_number(field, source.texts):
                raise ConfigurationError(
                    f"--column {text!r}: column {column.number} of {source.path}, {column}, holds texts or nothing; it "
                    f"has numbers in {source.numbered()}"
                )
    hits = hits or by_number(field, source.columns)
    return source.columns.index(hits[0]) if hits else None


def evaluate(text: str, scalars: Mapping[str, float], where: str) -> float:
    """Value of a product or quotient such as `-9.84e-3/100` or `-rpm`.

    Raises:
        ConfigurationError: something that is no number, unit or single number of the file; 0 or infinite.
    """
    whole = text.strip()
    if find_unit(whole.removeprefix("-")) is not None:
        return _term(whole, scalars, where)
    pieces = re.split(r"([*/])", whole)
    value = 1.0
    try:
        for operator, piece in zip(["*", *pieces[1::2]], pieces[::2], strict=True):
            term = _term(piece.strip(), scalars, where)
            value = value * term if operator == "*" else value / term
    except (ZeroDivisionError, OverflowError):
        value = 0.0
    if value == 0.0 or not math.isfinite(value):
        raise ConfigurationError(f"{where}: the factor {text!r} must be a finite number other than 0")
    return value


def _term(text: str, scalars: Mapping[str, float], where: str) -> float:
    if _NUMBER.fullmatch(text):
        return float(text)
    sign, name = (-1.0, text[1:].strip()) if text.startswith("-") else (1.0, text)
    if name == "pi":
        return sign * math.pi
    if name in scalars:
        return sign * scalars[name]
    unit = find_unit(name)
    if unit is not None and unit.kind not in ("share", "counts", "count rate"):
        return sign * unit.factor
    hint = f", {', '.join(scalars)} (of the file)" if scalars else ""
    raise ConfigurationError(
        f"{where}: {text!r} in the factor is not a number; allowed are numbers, pi, units such as deg, rpm, "
        f"ms, mNm{hint}, with * and /"
    )
