"""Text tables of any dialect, read by pyarrow in bounded memory: only the columns that are asked for."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np
import pyarrow as pa
import pyarrow.csv

from autotune.core.arrays import Floats
from autotune.core.errors import RecordingError
from autotune.recordings.importing.dialect import NULLS, WHITESPACE, Dialect, find_dialect, is_comment
from autotune.recordings.importing.source import Loaded, Source, foreign_bytes, refuse_other_format, seconds
from autotune.recordings.importing.texts import Coding, Labels

_BAD_LINES = 100
_T = TypeVar("_T")
_BLOCK = 1 << 22
_LEAST = 1 << 16
_TYPES = {"number": pa.float64(), "date": pa.timestamp("ns"), "clock": pa.time64("ns"), "": pa.string()}
_ASCII = bytes(code if code < 128 else ord("?") for code in range(256))


def read_csv(path: Path) -> Source:
    """Opens a CSV file of any dialect.

    Raises:
        RecordingError: missing, empty, not text, another format, or no table of numbers in it.
    """
    start = foreign_bytes(path)
    refuse_other_format(path, start)
    if re.match(rb"(#[^\n]*\n)*# (motion_unit|sample_period|schema):", start):
        raise RecordingError(f"{path} is a recording of this program already; use it as it is")
    return table_source(path, find_dialect(path, start, path.stat().st_size <= len(start)))


def table_source(
    path: Path, dialect: Dialect, period: float | None = None, notes: Sequence[str] = ()
) -> Source:
    """The number columns of a text table whose dialect is known."""
    every = tuple(replace(column, number=number) for number, column in enumerate(dialect.columns, 1))
    kept = [index for index, kind in enumerate(dialect.kinds) if kind]
    texts = tuple(column for column, kind in zip(every, dialect.kinds, strict=True) if not kind)

    def load(indices: Sequence[int]) -> Loaded:
        return load_columns(path, dialect, [kept[index] for index in indices])

    def labels(number: int) -> Labels:
        return load_labels(path, dialect, number - 1)

    columns = tuple(every[index] for index in kept)
    spoken = (dialect.spoken, *notes)
    return Source(path, columns, load, dialect.scalars, period, spoken, texts, labels)


def load_columns(path: Path, dialect: Dialect, indices: Sequence[int]) -> Loaded:
    """The columns, each of shape (n,), and what had to be left out.

    Raises:
        RecordingError: a field is no number (row and field are said), or too many rows of another width.
    """

    def load(normalise: bool) -> Loaded:
        bad: list[str] = []
        columns = [_Growing() for _ in indices]
        for parts in _rows(path, dialect, indices, normalise, bad):
            for column, part in zip(columns, parts, strict=True):
                column.add(part)
        if not any(column.rows for column in columns):
            raise RecordingError(f"{path} has no rows of numbers")
        return Loaded([column.whole() for column in columns], _skipped(bad))

    return _tried(path, dialect, load)


def load_labels(path: Path, dialect: Dialect, index: int) -> Labels:
    """A column of texts, each row's as the number of its label.

    Raises:
        RecordingError: too many rows of another width.
    """

    def load(normalise: bool) -> Labels:
        coding = Coding()
        for (part,) in _rows(path, dialect, [index], normalise, []):
            coding.add(part)
        return coding.whole()

    return _tried(path, dialect, load)


def _tried(path: Path, dialect: Dialect, load: Callable[[bool], _T]) -> _T:
    """The file as it is where that can be read, else line by line in a form of our own."""
    plain = dialect.delimiter != WHITESPACE and dialect.encoding in ("utf-8", "latin-1")
    try:
        return load(not plain)
    except (pa.ArrowException, UnicodeError) as first:
        if not plain:
            raise _sentence(path, first) from first
    try:
        return load(True)
    except (pa.ArrowException, UnicodeError) as error:
        raise _sentence(path, error) from error


def _rows(
    path: Path, dialect: Dialect, indices: Sequence[int], normalise: bool, bad: list[str]
) -> Iterator[list[Any]]:
    """The columns block by block; `bad` is told the lines that have another width."""
    names = [str(index) for index in range(len(dialect.columns))]
    wanted = [names[index] for index in indices]

    def bad_line(row: Any) -> str:
        bad.append(str(row.text)[:60])
        return "skip" if len(bad) <= _BAD_LINES else "error"

    delimiter = "\t" if dialect.delimiter == WHITESPACE else dialect.delimiter
    with path.open("rb") as raw:
        stream: BinaryIO = raw
        if normalise:
            stream = io.BufferedReader(_Normalised(raw, dialect), _BLOCK)
        batches = pyarrow.csv.open_csv(
            stream,
            read_options=pyarrow.csv.ReadOptions(
                column_names=names, skip_rows=dialect.skip, block_size=_BLOCK, use_threads=not normalise
            ),
            parse_options=pyarrow.csv.ParseOptions(
                delimiter=delimiter, invalid_row_handler=bad_line if normalise else None
            ),
            convert_options=pyarrow.csv.ConvertOptions(
                column_types=dict(zip(names, map(_TYPES.get, dialect.kinds), strict=True)),
                include_columns=list(dict.fromkeys(wanted)),
                null_values=list(NULLS),
                decimal_point=dialect.decimal,
            ),
        )
        for batch in batches:
            yield [batch.column(name) for name in wanted]


class _Growing:
    """One column, as it comes: what it was read from can go. Thousands of small parts would leave holes in memory."""

    def __init__(self) -> None:
        self.rows = 0
        self._values = np.empty(0)
        self._dates: list[Any] = []

    def add(self, part: Any) -> None:
        """The next rows, of Arrow; dates stay as they are until the first one is known."""
        if pa.types.is_temporal(part.type):
            self._dates.append(part)
            self.rows += len(part)
            return
        first, self.rows = self.rows, self.rows + len(part)
        if self.rows > len(self._values):
            self._values.resize(max(_LEAST, int(1.25 * self.rows)), refcheck=False)
        self._values[first : self.rows] = part.fill_null(float("nan")).to_numpy(zero_copy_only=False)

    def whole(self) -> Floats:
        """All rows; nothing can be added after that."""
        if self._dates:
            return seconds(pa.chunked_array(self._dates))
        self._values.resize(self.rows, refcheck=False)
        return self._values


def _skipped(bad: list[str]) -> list[str]:
    odd = [text for text in bad if text.strip() and not is_comment(text)]
    if not odd:
        return []
    return [f"{len(odd)} lines with another number of fields are left out, the first is {odd[0]!r}"]


def _sentence(path: Path, error: Exception) -> RecordingError:
    text = str(error).split("\n")[0].removeprefix("In CSV ")
    text = re.sub(r"'[^']{24,}'?", lambda value: f"{value[0][:24]}…'", text)[:100]
    return RecordingError(
        f"{path} is no regular table of numbers: {text}. Remove those lines, or export the measurement again"
    )


class _Normalised(io.RawIOBase):
    """The file as pyarrow likes it: one delimiter, no plus signs, no empty field at the end, ASCII only.

    Reads blocks of whole lines; nothing but one block is in memory.
    """

    def __init__(self, raw: BinaryIO, dialect: Dialect) -> None:
        self._raw: Any = io.TextIOWrapper(raw, "utf-16", newline="") if dialect.encoding == "utf-16" else raw
        self._spaces = dialect.delimiter == WHITESPACE
        self._delimiter = dialect.delimiter.encode()
        self._width = len(dialect.columns)
        self._skip = dialect.skip
        self._rest = b""
        self._ready = b""

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: Any) -> int:
        while not self._ready:
            block = self._raw.read(_BLOCK)
            block = block.encode() if isinstance(block, str) else block
            if not block:
                self._ready, self._rest = self._normal(self._rest), b""
                break
            block = self._rest + block
            cut = block.rfind(b"\n") + 1
            self._ready, self._rest = self._normal(block[:cut]), block[cut:]
        count = min(len(buffer), len(self._ready))
        buffer[:count] = self._ready[:count]
        self._ready = self._ready[count:]
        return count

    def _normal(self, block: bytes) -> bytes:
        lines = block.translate(_ASCII, b"+").split(b"\n")
        if self._spaces:
            return b"\n".join([b"\t".join(line.split()) for line in lines])
        end = self._delimiter
        return b"\n".join([self._trimmed(line, end) for line in lines])

    def _trimmed(self, line: bytes, end: bytes) -> bytes:
        """A line without the delimiters that end it, and without the commas that a spreadsheet pads it with."""
        bare = line.rstrip(b"\r") if end == b"," else line.rstrip(b",\r")
        surplus = bare.count(end) - self._width + 1
        while surplus > 0 and bare.endswith(end):
            bare, surplus = bare[: -len(end)], surplus - 1
        return bare
