"""How a text file is written: encoding, delimiter, decimal sign, header, units line, first row of numbers.

The delimiter is the one that cuts the last lines of the beginning into equally many fields, most of
them numbers; the numbers start after the last line that does not fit; names and units are the lines
above, or the last comment.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from autotune.core.errors import RecordingError
from autotune.recordings.importing.source import Column, within
from autotune.recordings.importing.units import find_unit, split_unit

WHITESPACE = " "
NULLS = (
    "", "NaN", "nan", "NAN", "-nan", "-NaN", "NA", "N/A", "n/a", "null", "NULL", "None", "-", "--", "#N/A", "?",
    "1.#QNAN", "-1.#IND", "1.#INF", "-nan(ind)", "nan(ind)",
)  # fmt: skip
_NULLS = frozenset(NULLS)
_POINT = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?|[+-]?inf(inity)?", re.IGNORECASE)
_COMMA = re.compile(r"[+-]?(\d+(,\d*)?|,\d+)([eE][+-]?\d+)?")
_DATE = re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d{1,9})?)?")
_CLOCK = re.compile(r"\d\d:\d\d:\d\d(\.\d{1,9})?")
_COMMENT = ("#", "%", "//", '"#', "'")
_HEADER_LINES = 400
_TAIL = 1000
"""Lines at the end of the beginning that tell what the columns hold."""
_LONGEST_QUOTED = 100_000  # characters; the library's reader refuses fields of 131 072


@dataclass(frozen=True, slots=True)
class Dialect:
    """How to read the file.

    Attributes:
        skip: lines before the first row of numbers.
        kinds: of each column: `number`, `date` (ISO 8601), `clock` (hours:minutes:seconds) or empty.
        scalars: numbers in the first row of columns that are empty below it, by name.
    """

    encoding: str
    delimiter: str
    decimal: str
    skip: int
    columns: tuple[Column, ...]
    kinds: tuple[str, ...]
    named: bool
    scalars: Mapping[str, float] = field(default_factory=dict)

    @property
    def spoken(self) -> str:
        """For the person: what was found."""
        words = {";": "semicolons", ",": "commas", "\t": "tabs", " ": "spaces", "|": "bars"}
        decimal = ", decimal comma" if self.decimal == "," else ""
        names = "names in the header" if self.named else "no header (columns by number)"
        texts = [str(column) for column, kind in zip(self.columns, self.kinds, strict=True) if not kind]
        left = f"; columns of texts: {within(texts)}" if texts else ""
        return f"fields between {words[self.delimiter]}{decimal}, {names}, numbers from line {self.skip + 1}{left}"


def decode(path: Path, start: bytes) -> tuple[str, str]:
    """Text and encoding of the first bytes.

    Raises:
        RecordingError: not text.
    """
    for mark, encoding in ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16"), (b"\xef\xbb\xbf", "utf-8-sig")):
        if start.startswith(mark):
            return start.decode(encoding, errors="replace"), encoding
    strange = sum(start.count(bytes([code])) for code in (*range(9), *range(14, 27)))
    if strange:
        raise RecordingError(
            f"{path} is not text ({strange} control bytes at its beginning); name its format with --format, or export "
            "it as CSV"
        )
    try:
        return start[: start.rfind(b"\n") + 1 or None].decode("utf-8"), "utf-8"
    except UnicodeDecodeError:
        return start.decode("latin-1"), "latin-1"


def find_dialect(path: Path, start: bytes, complete: bool) -> Dialect:
    """The dialect, from the first bytes of the file; `complete` if these are all.

    Raises:
        RecordingError: no rows of numbers in at least two columns.
    """
    text, encoding = decode(path, start)
    lines = re.split(r"\r\n|\n|\r", text)
    if not complete and len(lines) > 1:
        lines.pop()
    best: tuple[float, str, str, int] = (0.0, "", "", 0)
    for delimiter, decimal in ((";", "."), (";", ","), ("\t", "."), ("\t", ","), (",", "."), (",", ","), ("|", "."),
                               (WHITESPACE, "."), (WHITESPACE, ",")):  # fmt: skip
        score, width = _score(lines, delimiter, decimal)
        if score > best[0] * (1.0 + 1e-9):
            best = (score, delimiter, decimal, width)
    if best[3] < 2:
        raise RecordingError(
            f"{path} holds no table of numbers: no delimiter (semicolon, comma, tab, space, bar) cuts its lines into "
            "at least two columns; export it as CSV with a column for time, position and torque"
        )
    return _dialect(path, lines, encoding, best[1], best[2], best[3])


def fields(line: str, delimiter: str) -> list[str]:
    """Fields of a line, without quotes and blanks; an empty one after a last delimiter is dropped."""
    if '"' in line and delimiter != WHITESPACE and len(line) <= _LONGEST_QUOTED:
        parts = next(csv.reader([line], delimiter=delimiter), [])
    else:
        parts = line.split() if delimiter == WHITESPACE else line.split(delimiter)
    clean = [part.strip().strip('"').strip() for part in parts]
    return clean[:-1] if len(clean) > 2 and clean[-1] == "" and delimiter != WHITESPACE else clean


def _score(lines: list[str], delimiter: str, decimal: str) -> tuple[float, int]:
    """Number fields in the lines of the most frequent width, and that width."""
    sample = [fields(line, delimiter) for line in lines[-_TAIL:] if line.strip() and not is_comment(line)]
    widths = Counter(len(parts) for parts in sample if _numbers(parts, decimal) >= max(1, len(parts) / 3))
    if not widths:
        return 0.0, 0
    width = max(widths, key=lambda w: (widths[w] * min(w, 2), w))
    if width < 2:
        return 0.0, 0
    matching = [parts for parts in sample if len(parts) == width]
    numbers = sum(_numbers(parts, decimal) for parts in matching)
    total = sum(len(parts) for parts in matching)
    return numbers / total * len(matching) / len(sample), width


def _numbers(parts: list[str], decimal: str) -> int:
    pattern = _COMMA if decimal == "," else _POINT
    return sum(1 for part in parts if pattern.fullmatch(part))


def is_comment(line: str) -> bool:
    """True for a line that many programs write as a remark."""
    return line.lstrip().startswith(_COMMENT)


def _dialect(
    path: Path, lines: list[str], encoding: str, delimiter: str, decimal: str, width: int
) -> Dialect:
    rows = [fields(line, delimiter) if line.strip() and not is_comment(line) else None for line in lines]
    if _open_end(rows, lines, delimiter, width):
        rows = [[*parts, ""] if parts is not None and len(parts) == width else parts for parts in rows]
        width += 1
    tail = [parts for parts in rows[-_TAIL:] if parts is not None and len(parts) == width]
    below = tail if len(rows) > _TAIL else [parts for parts in tail if _numbers(parts, decimal)][1:]
    filled = [any(parts[index] for parts in below) for index in range(width)]
    kinds = tuple(
        _kind([parts[index] for parts in tail], decimal) if filled[index] else "" for index in range(width)
    )
    first = _first_row(rows, kinds, decimal)
    if first is None or sum(bool(kind) for kind in kinds) < 2:
        raise RecordingError(
            f"{path} has no two columns of numbers; export time, position and torque as numbers"
        )
    names, units = _header(lines[:first], delimiter, width, max(i + 1 for i in range(width) if filled[i]))
    example = rows[first] or []
    columns = tuple(
        _column(i, names[i] if names else "", units[i] if units else "", example[i], kinds[i])
        for i in range(width)
    )
    scalars = {
        columns[i].name: float(example[i].replace(decimal, "."))
        for i in range(width)
        if not filled[i] and _numbers([example[i]], decimal)
    }
    return Dialect(encoding, delimiter, decimal, first, columns, kinds, bool(names), scalars)


def _open_end(rows: list[list[str] | None], lines: list[str], delimiter: str, width: int) -> bool:
    """Whether rows end with a delimiter because a column that the header names is empty in them."""
    if delimiter == WHITESPACE:
        return False
    header = next((parts for parts in rows if parts is not None), [])
    ends = [
        line.rstrip().endswith(delimiter)
        for parts, line in zip(rows[-_TAIL:], lines[-_TAIL:], strict=True)
        if parts is not None and len(parts) == width and parts is not header
    ]
    return len(header) == width + 1 and all(header) and bool(ends) and all(ends)


def _kind(values: list[str], decimal: str) -> str:
    """What most of a column's values are; empty for texts and for columns without values."""
    written = [value for value in values if value not in _NULLS]
    if not written:
        return ""
    number = _COMMA if decimal == "," else _POINT
    for kind, pattern in (("number", number), ("date", _DATE), ("clock", _CLOCK)):
        if sum(1 for value in written if pattern.fullmatch(value)) >= 0.5 * len(written):
            return kind
    return ""


def _first_row(rows: list[list[str] | None], kinds: tuple[str, ...], decimal: str) -> int | None:
    """The first line from which a table of numbers goes on: its number columns hold numbers."""
    for index, parts in enumerate(rows):
        if parts is None or len(parts) != len(kinds):
            continue
        fit = [
            part in _NULLS or _kind([part], decimal) == kind
            for part, kind in zip(parts, kinds, strict=True)
            if kind
        ]
        if all(fit) and any(part not in _NULLS for part in parts):
            return index
    return None


def _header(lines: list[str], delimiter: str, width: int, filled: int) -> tuple[list[str], list[str]]:
    """Names and units: the two lines above the numbers, comments included if they have as many fields.

    Empty fields at the end of a line do not count, nor columns after the `filled` first, which are empty.
    """
    above: list[list[str]] = []
    for line in reversed(lines[-_HEADER_LINES:]):
        bare = re.sub(r"^\s*(#|%|//)\s*", "", line)
        parts = fields(bare, delimiter)
        if len(parts) == width - 1 and line.startswith(delimiter):
            parts = ["", *parts]
        if len(parts) < width and delimiter != WHITESPACE and bare.count(delimiter) == width - 1:
            parts = [part.strip().strip('"').strip() for part in bare.split(delimiter)]
        if len(parts) != width and len(named := _without_end(parts)) == filled:
            parts = named + [""] * (width - filled)
        if len(parts) == width and any(parts):
            above.append(parts)
        if len(above) == 2:
            break
    if not above:
        return [], []
    if _are_units(above[0]) and len(above) == 2:
        return above[1], above[0]
    return above[0], []


def _without_end(parts: list[str]) -> list[str]:
    """The fields up to the last that is not empty."""
    return parts[: max((i + 1 for i, part in enumerate(parts) if part), default=0)]


def _are_units(parts: list[str]) -> bool:
    """Mostly known or bracketed units; a lone `t` or `s` beside names is none."""
    written = [part for part in parts if part and part not in ("-", "[-]", "[]")]
    known = [part for part in written if find_unit(part) or re.fullmatch(r"[\[(].*[\])]", part)]
    return bool(written) and len(known) >= max(1, 0.6 * len(written))


def _column(index: int, name: str, unit: str, example: str, kind: str) -> Column:
    bare, own = split_unit(name)
    if kind in ("date", "clock"):
        return Column(bare or str(index + 1), "s", example)
    return Column(bare or str(index + 1), unit.strip("[]() ") or own, example)
