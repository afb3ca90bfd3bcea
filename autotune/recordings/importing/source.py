"""What every format is read into: named columns that are loaded when they are asked for."""

from __future__ import annotations

import difflib
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from autotune.core.arrays import Floats
from autotune.core.errors import LONGEST_NAME, RecordingError, a_few
from autotune.recordings.importing.texts import Labels

LIST_LETTERS = 60
"""Room for a list of names in a message of one line."""


def short(text: str, most: int = 20) -> str:
    """A text for a message, cut where it is longer than any name needs to be."""
    return text if len(text) <= most else f"{text[: most - 1]}…"


def within(names: Sequence[str], letters: int = LIST_LETTERS) -> str:
    """As many of the names as have room in a message, at least one, and how many more there are."""
    ends = np.cumsum([len(name) + 2 for name in names])
    return a_few(names, max(1, int(np.searchsorted(ends, letters + 2, side="right"))))


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a foreign file.

    Attributes:
        name: as the file has it, without a unit in brackets; its number, from 1, if it has none.
        unit: as the file has it; empty if it says nothing.
        example: what is in the first rows, for messages.
        number: among all columns of the file, texts included, from 1.
        rows: its length, where columns of one file may differ in length; None where they cannot.
    """

    name: str
    unit: str = ""
    example: str = ""
    number: int = 0
    rows: int | None = None

    def __str__(self) -> str:
        return f"'{short(self.name)}'" + (f" [{short(self.unit, 10)}]" if self.unit else "")


@dataclass(frozen=True, slots=True)
class Loaded:
    """Columns, each of shape (n,), NaN where a value is missing; and what had to be left out."""

    columns: list[Floats]
    notes: list[str] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class Source:
    """An opened foreign file.

    Attributes:
        load: indices of columns → their values.
        scalars: single numbers by name; factors may use them.
        period: sample period that the file states [s]; None if it does not.
        notes: what a person should know about the file, one sentence each.
        texts: columns that hold no numbers; they count where columns go by number.
        labels: number of a column of texts → the label of each row; None where the format has no texts.
    """

    path: Path
    columns: tuple[Column, ...]
    load: Callable[[Sequence[int]], Loaded]
    scalars: Mapping[str, float] = field(default_factory=dict)
    period: float | None = None
    notes: tuple[str, ...] = ()
    texts: tuple[Column, ...] = ()
    labels: Callable[[int], Labels] | None = None

    def described(self) -> str:
        """The columns for a message; those of one name with their numbers."""
        count = self._names()
        return within(
            [
                f"{column.number} {column}"
                if count[column.name.lower()] > 1 and column.number
                else str(column)
                for column in self.columns
            ]
        )

    def numbered(self) -> str:
        """The columns with their numbers, for a message."""
        return within([f"{column.number} {column}" for column in self.columns])

    def called(self, index: int) -> str:
        """What a person writes for a column of numbers: see `name_of`."""
        return self.name_of(self.columns[index])

    def name_of(self, column: Column) -> str:
        """What a person writes for a column: its name, or its number where that is too long or not its alone."""
        clear = self._names()[column.name.lower()] == 1 and len(column.name) <= LONGEST_NAME
        return column.name if clear or not column.number else str(column.number)

    def _names(self) -> Counter[str]:
        """How many columns have each name; small and capital letters are the same."""
        return Counter(column.name.lower() for column in (*self.columns, *self.texts))


def by_name(field: str, columns: Sequence[Column]) -> list[Column]:
    """The columns of that exact name, else with their unit, else without regard to case.

    A unit may stand in brackets, or at the end of the name as in the file's own header.
    """
    ways: tuple[Callable[[Column], bool], ...] = (
        lambda column: column.name == field,
        lambda column: f"{column.name} [{column.unit}]" == field,
        lambda column: f"{column.name} ({column.unit})" == field,
        lambda column: f"{column.name}_{column.unit}" == field,
        lambda column: column.name.lower() == field.lower(),
    )
    found = ([column for column in columns if fits(column)] for fits in ways)
    return next((hits for hits in found if hits), [])


def by_number(field: str, columns: Sequence[Column]) -> list[Column]:
    """The column with that number in the file, where it is one."""
    number = int(field) if re.fullmatch(r"[0-9]{1,6}", field) else 0
    return [column for column in columns if number and column.number == number]


def near(field: str, columns: Sequence[Column]) -> str:
    """For a message: a name like the one written, with the numbers of the columns where several bear it."""
    like = difflib.get_close_matches(field, [column.name for column in columns], 1, 0.5)
    if not like:
        return ""
    hits = [str(column.number) for column in columns if column.name == like[0]]
    which = f", columns {a_few(hits)}" if len(hits) > 1 else ""
    return f" (did you mean {short(like[0], 40)!r}{which}?)"


def usual_rows(columns: Sequence[Column]) -> int | None:
    """The most frequent length of the columns; of several the longest, None where they cannot differ."""
    lengths = Counter(column.rows for column in columns if column.rows is not None)
    return max(lengths, key=lambda rows: (lengths[rows], rows)) if lengths else None


def foreign_bytes(path: Path, count: int = 1 << 18) -> bytes:
    """The first bytes of a file.

    Raises:
        RecordingError: no such file, a folder, empty, or unreadable.
    """
    if not path.is_file():
        kind = "a folder, not a file" if path.is_dir() else "not there"
        raise RecordingError(f"{path} is {kind}; check the name")
    try:
        with path.open("rb") as file:
            start = file.read(count)
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror or error}") from error
    if not start.strip(b"\x00 \t\r\n"):
        raise RecordingError(f"{path} is empty; export the measurement again")
    return start


def seconds(column: Any) -> Floats:
    """An Arrow column of dates, times of day or durations in seconds; dates since the first row."""
    kind = column.type
    dated = pa.types.is_timestamp(kind) or pa.types.is_date(kind)
    wanted = (
        pa.timestamp("ns") if dated else pa.duration("ns") if pa.types.is_duration(kind) else pa.time64("ns")
    )
    ticks = column.cast(wanted).cast(pa.int64())
    missing = np.asarray(ticks.is_null().to_numpy())
    whole = np.asarray(ticks.fill_null(0).to_numpy())
    first = whole[int(np.argmin(missing))] if dated and len(whole) else 0
    elapsed = np.asarray((whole - first) * 1e-9, dtype=np.float64)
    elapsed[missing] = np.nan
    return elapsed


_EXPORT = "export the measurement as CSV"
_SIGNATURES = (
    (b"%PDF-", "a PDF document", _EXPORT),
    (b"\x89PNG", "a picture", _EXPORT),
    (b"\xff\xd8\xff", "a picture", _EXPORT),
    (b"GIF8", "a picture", _EXPORT),
    (b"<", "a web page or an XML file", _EXPORT),
    (b"{", "a JSON file", _EXPORT),
    (b"\xd0\xcf\x11\xe0", "a spreadsheet workbook", "save the sheet as CSV"),
    (b"MDF     ", "an MDF measurement file", _EXPORT),
    (b"TDSm", "a TDMS measurement file", _EXPORT),
    (b"SQLite format 3", "a database", _EXPORT),
    (b"\x7fELF", "a program", "check the name"),
    (b"BZh", "compressed by bzip2", "unpack it first"),
    (b"\xfd7zXZ", "compressed by xz", "unpack it first"),
    (b"7z\xbc\xaf", "a 7z archive", "unpack it first"),
    (b"PK\x03\x04", "a zip archive or a spreadsheet workbook", "unpack it, or save the sheet as CSV"),
    (b"\x1f\x8b", "compressed by gzip", "unpack it first"),
    (b"PAR1", "a Parquet file", "use --format parquet"),
    (b"MATLAB 5.0 MAT-file", "a MATLAB file", "use --format mat"),
    (
        b"MATLAB 7.3 MAT-file",
        "a MATLAB file of version 7.3",
        "in MATLAB, save it again with save(..., '-v7')",
    ),
    (b"\x89HDF", "an HDF5 file", "convert it to CSV or Parquet, or in MATLAB save with '-v7'"),
)


def refuse_other_format(path: Path, start: bytes, own: bytes = b"") -> None:
    """Raises RecordingError where the first bytes are those of another format than `own`."""
    for signature, what, remedy in _SIGNATURES:
        if start.startswith(signature) and signature != own:
            raise RecordingError(f"{path} is {what}; {remedy}")
