"""TOML and JSON as a program may meet them: too large, too deep, with numbers that are none.

Both parsers accept more than anything after them can hold: nesting until Python's stack ends, integers of
any length, `NaN` and `1e999`. What passes here is small, shallow, and all its numbers are finite.
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

MOST_BYTES = 64_000_000
"""The largest that is written, a run's result with all its traces, has 5 MB."""
DEEPEST = 64
"""Levels of tables in tables; the program's own files have seven."""
LARGEST_INTEGER = 2**64
LONGEST_LINE = 10_000
"""Of TOML: the parser takes time with the square of a dotted key's parts."""


def read_limited(path: Path, most: int = MOST_BYTES) -> str:
    """The text of a file.

    Raises:
        OSError: as in reading.
        ValueError: too large, or not UTF-8.
    """
    with path.open("rb") as file:
        content = file.read(most + 1)
    if len(content) > most:
        size = path.stat().st_size
        raise ValueError(f"it has {size / 1e6:.0f} MB; such a file has at most {most / 1e6:.0f} MB")
    return content.decode("utf-8")


def parse_json(text: str | bytes) -> Any:
    """The value of a JSON text.

    Raises:
        ValueError: not JSON, nested too deep, or with a number that is not finite or far too long.
    """
    try:
        content = json.loads(text, parse_constant=_no_number, parse_float=_finite)
    except RecursionError:
        raise ValueError(_too_deep()) from None
    refuse_unusual(content)
    return content


def parse_toml(text: str) -> dict[str, Any]:
    """The tables of a TOML text.

    Raises:
        ValueError: not TOML, nested too deep, a line or a number far too long, or a number that is not finite.
    """
    longest = max(map(len, text.splitlines()), default=0)
    if longest > LONGEST_LINE:
        raise ValueError(f"a line has {longest} characters; at most {LONGEST_LINE} are allowed")
    try:
        content = tomllib.loads(text)
    except RecursionError:
        raise ValueError(_too_deep()) from None
    refuse_unusual(content)
    return content


def refuse_unusual(content: Any) -> None:
    """Raises ValueError for what is nested too deep, and for numbers that are not finite or far too long."""
    level, here = 0, [("", content)]
    while here:
        below: list[tuple[str, Any]] = []
        for name, value in here:
            if isinstance(value, (int, float)):
                _check_number(name, value)
            elif isinstance(value, dict):
                below += [(f"{name}.{key}" if name else str(key), one) for key, one in value.items()]
            elif isinstance(value, list):
                below += [(name, one) for one in value]
        level, here = level + 1, below
        if here and level > DEEPEST:  # so names stay short, too
            raise ValueError(_too_deep())


def _check_number(name: str, value: int | float) -> None:
    if isinstance(value, int):
        if abs(value) > LARGEST_INTEGER:
            raise ValueError(
                f"{name[:80]!r} is an integer of {value.bit_length()} bits; at most 64 are allowed"
            )
    elif not math.isfinite(value):
        raise ValueError(f"{name[:80]!r} is {value}; it must be a finite number")


def _no_number(text: str) -> NoReturn:
    raise ValueError(f"it holds {text}, which is no number; every number must be finite")


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(f"it holds {text[:40]}, which is too large for a number")
    return value


def _too_deep() -> str:
    return f"it is nested deeper than {DEEPEST} levels"


def numbers_of(content: Any) -> dict[str, float]:
    """A table of names and finite numbers, as parameters of a drive are kept.

    Raises:
        ValueError: anything else.
    """
    if not isinstance(content, dict):
        raise ValueError(f"{_shown(content)} stands where a table of numbers must be")
    for name, value in content.items():
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
            raise ValueError(f"{name[:40]!r} is {_shown(value)}; it must be a finite number")
    return dict(content)


def texts_of(content: dict[str, Any], *names: str) -> dict[str, str]:
    """The named texts of a table; those missing are left out.

    Raises:
        ValueError: one of them is no text.
    """
    for name in names:
        if not isinstance(content.get(name, ""), str):
            raise ValueError(f"{name!r} is {_shown(content[name])}; it must be a text")
    return {name: content[name] for name in names if name in content}


def _shown(value: Any) -> str:
    return repr(value)[:40]


def finite(value: Any) -> Any:
    """The same with nan and infinities replaced by None, recursively: JSON knows neither."""
    if isinstance(value, Mapping):
        return {str(key): finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
