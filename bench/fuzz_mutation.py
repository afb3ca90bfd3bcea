"""Inputs for the fuzzer: pieces of a corpus, hurt a little or a lot, always the same for the same seed.

Bytes are flipped, replaced, removed, doubled, moved, cut off and spliced; numbers in texts become those that
parsers fall over; trees (TOML, JSON) lose, double and swap branches, and get values of other types.
"""

from __future__ import annotations

import copy
import json
import random
import re
from collections.abc import Callable, Sequence
from typing import Any

NUMBERS = (
    "0", "-0", "1", "-1", "127", "128", "255", "256", "32767", "65535", "65536", "2147483647", "-2147483648",
    "4294967296", "9223372036854775808", "1e308", "1e309", "-1e309", "1e-320", "nan", "NaN", "-nan", "inf",
    "-Infinity", "1_000", "0x10", "0b1", "1e", "--1", "+1", "1.2.3", "1,5", "９", "9" * 40, "9" * 5000, "",
    "true", "null", "0.1e1", "1e6", "-1e6", "1e12",
)  # fmt: skip
TOKENS = (
    b"\x00", b"\xff", b"\xfe\xff", b"\xef\xbb\xbf", b"\r", b"\n", b"\r\n", b"\t", b" ", b"\x1b[2J", b"\x07", b"\x85",
    b"\xe2\x80\xa8", b",", b";", b"=", b"#", b"[", b"]", b"[[", b"{", b"}", b'"', b"'", b'"""', b"\\", b"\\u0000",
    b"\xc3\x28", b"\xf0\x9f\x98\x80", b"nan", b"inf", b"1e999", b"../../etc/passwd", b"%00", b"//", b":", b"*",
)  # fmt: skip
ODD: tuple[Any, ...] = (
    None, True, False, 0, -1, 1, 2**31, 2**63, 2**64, 10**30, 0.0, -0.0, 1e308, -1e308, 5e-324, 1e-12, "", "a", "1",
    "nan", "\x1b[2J", "x" * 3000, "..", "/dev/null", [], {}, [[]], [{}], [1, "a", None], {"": 1}, {"value": "x"},
)  # fmt: skip
_NUMBER = re.compile(rb"[-+]?[0-9]+(?:\.[0-9]+)?(?:[eE][-+]?[0-9]+)?")
Change = Callable[[random.Random, bytearray], None]


def mutated(chance: random.Random, seeds: Sequence[bytes], most: int = 200_000) -> bytes:
    """One of the seeds with one to many changes."""
    data = bytearray(chance.choice(seeds))
    for _ in range(chance.choice((1, 1, 1, 2, 2, 3, 5, 10, 30))):
        if chance.random() < 0.05:
            _splice(chance, data, chance.choice(seeds))
        else:
            chance.choice(_CHANGES)(chance, data)
    return bytes(data[:most])


def _place(chance: random.Random, data: bytearray) -> int:
    return chance.randrange(len(data) + 1)


def _span(chance: random.Random, data: bytearray) -> slice:
    start = _place(chance, data)
    return slice(start, start + chance.choice((1, 2, 4, 8, 30, 200, 2000)))


def _flip(chance: random.Random, data: bytearray) -> None:
    if data:
        bit = chance.randrange(8 * len(data))
        data[bit >> 3] ^= 1 << (bit & 7)


def _byte(chance: random.Random, data: bytearray) -> None:
    if data:
        data[chance.randrange(len(data))] = chance.randrange(256)


def _token(chance: random.Random, data: bytearray) -> None:
    at = _place(chance, data)
    data[at:at] = chance.choice(TOKENS) * chance.choice((1, 1, 1, 2, 100))


def _remove(chance: random.Random, data: bytearray) -> None:
    del data[_span(chance, data)]


def _double(chance: random.Random, data: bytearray) -> None:
    part, at = data[_span(chance, data)], _place(chance, data)
    data[at:at] = part * chance.choice((1, 1, 2, 20))


def _swap(chance: random.Random, data: bytearray) -> None:
    one = _span(chance, data)
    part = data[one]
    del data[one]
    at = _place(chance, data)
    data[at:at] = part


def _cut(chance: random.Random, data: bytearray) -> None:
    del data[_place(chance, data) :]


def _number(chance: random.Random, data: bytearray) -> None:
    found = list(_NUMBER.finditer(data, 0, 20_000))
    if found:
        match = chance.choice(found)
        data[match.start() : match.end()] = chance.choice(NUMBERS).encode()


def _line(chance: random.Random, data: bytearray) -> None:
    lines = data.split(b"\n")
    kind = chance.randrange(3)
    at = chance.randrange(len(lines))
    if kind == 0:
        del lines[at]
    elif kind == 1:
        lines.insert(chance.randrange(len(lines) + 1), lines[at])
    else:
        other = chance.randrange(len(lines))
        lines[at], lines[other] = lines[other], lines[at]
    data[:] = b"\n".join(lines)


def _splice(chance: random.Random, data: bytearray, other: bytes) -> None:
    start = chance.randrange(len(other) + 1)
    at = _place(chance, data)
    data[at:] = other[start:]


_CHANGES: tuple[Change, ...] = (
    _flip, _flip, _byte, _byte, _token, _token, _remove, _double, _swap, _cut, _number, _number, _number, _line,
)  # fmt: skip


def changed_tree(chance: random.Random, tree: dict[str, Any]) -> dict[str, Any]:
    """A copy of a tree of dictionaries and lists with a few branches changed."""
    changed: dict[str, Any] = json.loads(json.dumps(tree))
    for _ in range(chance.choice((1, 1, 2, 3, 6))):
        _change_branch(chance, changed)
    return changed


def _change_branch(chance: random.Random, tree: dict[str, Any]) -> None:
    here: Any = tree
    while isinstance(here, (dict, list)) and here:
        keys = list(here) if isinstance(here, dict) else list(range(len(here)))
        key = chance.choice(keys)
        below = here[key]
        if isinstance(below, (dict, list)) and below and chance.random() < 0.8:
            here = below
            continue
        kind = chance.randrange(5)
        if kind == 0:
            del here[key]
        elif kind == 1 and isinstance(here, dict):
            here[chance.choice(("x", "", "schema", f"{key}_", "a.b"))] = below
        elif kind == 2:
            here[key] = deep(chance.choice((3, 70, 400)))
        elif isinstance(below, (int, float)) and not isinstance(below, bool) and kind == 3:
            here[key] = below * chance.choice((-1, 0, 10, 1e3, 1e9, 1e300))
        else:
            here[key] = copy.deepcopy(chance.choice(ODD))
        return


def deep(levels: int) -> Any:
    """So many lists in one another."""
    value: Any = 1
    for _ in range(levels):
        value = [value]
    return value


def toml_text(tree: dict[str, Any], prefix: str = "") -> str:
    """A tree as TOML, as far as it goes: what TOML does not have becomes an empty text."""
    lines, tables = [], []
    for key, value in tree.items():
        name = f"{prefix}{json.dumps(key)}"
        if isinstance(value, dict):
            tables.append(f"[{name}]\n{toml_text(value, name + '.')}")
        elif isinstance(value, list) and value and all(isinstance(one, dict) for one in value):
            tables += [f"[[{name}]]\n{toml_text(one, name + '.')}" for one in value]
        else:
            lines.append(f"{json.dumps(key)} = {_toml_value(value)}")
    return "\n".join([*lines, *tables]) + "\n"


def _toml_value(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{json.dumps(k)} = {_toml_value(v)}" for k, v in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_toml_value, value)) + "]"
    if isinstance(value, float):
        return repr(value)
    return '""' if value is None else json.dumps(value)
