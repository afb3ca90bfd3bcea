"""A recording looked through column by column: all checks of `read_recording`, in the memory of three columns.

What is said of a file is the same as reading it whole says; which fault of several comes first may differ.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.core.errors import AutotuneError
from autotune.recordings.checksum import ContentDigest
from autotune.recordings.file_parts import (
    CSV_TYPES,
    check_names,
    csv_head,
    floats_of,
    integers_of,
    pairs_of,
    parquet_names,
    reading,
    refuse_huge,
    spacing,
    texts_of,
    verified,
)
from autotune.recordings.files import BATCH, MOST_ROWS, parse_metadata
from autotune.recordings.limits import refuse_column, refuse_missed, refuse_motion, refuse_names
from autotune.recordings.recording import FLOAT_COLUMNS, Metadata, Segment

CSV_BLOCK = 1 << 23
"""Bytes of a CSV that are parsed together."""
See = Callable[[str, Floats], None]


@dataclass(frozen=True, slots=True)
class Outline:
    """What is known of a recording beside its numbers; `columns` are in the order of `FLOAT_COLUMNS`."""

    metadata: Metadata
    rows: int
    columns: tuple[str, ...]
    segments: tuple[Segment, ...]


def walk_recording(path: Path, see: See) -> Outline:
    """Shows every column of numbers once, the time first; what was seen holds only if this returns.

    What is shown is valid while it is shown: the next column may stand in the same memory. A CSV goes through a
    temporary Parquet file, block by block.

    Raises:
        RecordingError: as `read_recording`.
    """
    with reading(path):
        if path.suffix == ".parquet":
            return _walked(_File(path, path), see)
        with NamedTemporaryFile(suffix=".parquet") as columns:
            pairs = _as_parquet(path, Path(columns.name))
            return _walked(_File(path, Path(columns.name), pairs), see)


def _as_parquet(path: Path, columns: Path) -> Mapping[str, str]:
    """The table of a CSV, so that its columns can be read one by one; its metadata."""
    head = csv_head(path)
    with path.open("rb") as file:
        file.seek(head.start)
        names = _csv_table(file, None).schema.names
        check_names(path, names)
        known = [name for name in names if name in CSV_TYPES]
        file.seek(head.start)
        table = _csv_table(file, known)
        with pa.parquet.ParquetWriter(
            columns, table.schema, compression="none", use_dictionary=["experiment"]
        ) as out:
            for batch in table:
                out.write_batch(batch)
    return head.pairs


def _csv_table(file: BinaryIO, names: Sequence[str] | None) -> pa.csv.CSVStreamingReader:
    options = pa.csv.ConvertOptions(column_types=CSV_TYPES, include_columns=names)
    blocks = pa.csv.ReadOptions(use_threads=False, block_size=CSV_BLOCK)
    return pa.csv.open_csv(pa.PythonFile(_Kept(file), "r"), convert_options=options, read_options=blocks)


class _Kept:
    """A file that stays open when its reader is done with it."""

    def __init__(self, file: BinaryIO) -> None:
        self.read, self.readable, self.closed = file.read, file.readable, False

    def close(self) -> None:
        return


class _File:
    """The columns of a recording `path`, of which one is decoded at a time."""

    def __init__(self, path: Path, columns: Path, pairs: Mapping[str, str] | None = None) -> None:
        first = pa.parquet.ParquetFile(columns)
        self.path, self.rows = path, int(first.metadata.num_rows)
        refuse_huge(path, self.rows, MOST_ROWS, "rows")
        self.names = tuple(parquet_names(path, first))
        self.pairs = pairs_of(first.schema_arrow) if pairs is None else pairs
        self.columns = tuple(name for name in FLOAT_COLUMNS if name in self.names)
        self._before: Floats | None = None
        coded = [name for name in self.names if name == "experiment"]
        self._file = pa.parquet.ParquetFile(
            columns, page_checksum_verification=True, read_dictionary=coded, pre_buffer=False
        )

    def batches(self, *names: str) -> Iterator[pa.Table]:
        """The rows of some columns, in their order."""
        for batch in self._file.iter_batches(BATCH, columns=list(names), use_threads=False):
            yield pa.Table.from_batches([batch])

    def column(self, name: str) -> Floats:
        """All of one column. Memory of the one before is used again, but for that of the time."""
        values, at = np.empty(self.rows) if self._before is None else self._before, 0
        self._before = None if name == "time" else values
        for table in self.batches(name):
            values[at : at + table.num_rows] = floats_of(table, name)
            at += table.num_rows
        return values

    def missed(self) -> Iterator[NDArray[np.int64]]:
        if "missed" in self.names:
            for table in self.batches("missed"):
                yield integers_of(table, "missed")
            return
        for start in range(0, self.rows, BATCH):
            yield np.zeros(min(BATCH, self.rows - start), np.int64)

    def segments(self) -> tuple[Segment, ...]:
        """Contiguous stretches of equal experiment and repeat."""
        named = [name for name in ("experiment", "repeat") if name in self.names]
        starts: list[tuple[str, int, int]] = []
        at = 0
        for table in self.batches(*named) if named else ():
            for row, key in _changes(table, at):
                if not starts or starts[-1][:2] != key:
                    starts.append((*key, row))
            at += table.num_rows
        if not starts and self.rows:
            starts = [("", 0, 0)]
        ends = [start for _, _, start in starts[1:]] + [self.rows] * bool(starts)
        return tuple(
            Segment(name, repeat, at, end) for (name, repeat, at), end in zip(starts, ends, strict=True)
        )


def _changes(table: pa.Table, at: int) -> Iterator[tuple[int, tuple[str, int]]]:
    """Row and (experiment, repeat) wherever they change within one batch, its first row included."""
    rows = table.num_rows
    if not rows:
        return
    texts, codes = (
        texts_of(table, "experiment")
        if "experiment" in table.column_names
        else ([""], np.zeros(rows, np.int64))
    )
    repeat = integers_of(table, "repeat") if "repeat" in table.column_names else np.zeros(rows, np.int64)
    for row in (0, *(np.flatnonzero((codes[1:] != codes[:-1]) | (repeat[1:] != repeat[:-1])) + 1).tolist()):
        yield at + row, (texts[codes[row]], int(repeat[row]))


def _walked(file: _File, see: See) -> Outline:
    segments = file.segments()
    check = _Checks(file, segments)
    digest = ContentDigest(file.pairs, segments, file.rows)
    with ThreadPoolExecutor(1) as beside:
        for name in file.columns:
            values = file.column(name)
            digested = beside.submit(digest.column, name, values)
            check.column(name, values)
            see(name, values)
            digested.result()
    checksum = digest.ended(check.missed(file.missed()))
    remarks = verified(file.path, file.pairs, lambda: checksum)
    metadata = replace(check.done(), remarks=remarks)
    return Outline(metadata, file.rows, file.columns, segments)


class _Checks:
    """What no axis can have, column by column; it is told after the checksum: damage comes first."""

    def __init__(self, file: _File, segments: tuple[Segment, ...]) -> None:
        self._file, self._segments, self._where = file, segments, str(file.path)
        self._metadata, self._time, self._wrong = Metadata(), np.empty(0), list[AutotuneError]()
        self._held(lambda: refuse_names([one.experiment for one in segments], self._where))

    def column(self, name: str, values: Floats) -> None:
        if name == "time":
            self._time = values
            self._held(self._read_metadata)
        self._held(lambda: refuse_column(name, values, self._metadata, self._where))
        if name == "position":
            self._held(lambda: refuse_motion(self._time, values, self._segments, self._metadata, self._where))
            self._time = np.empty(0)

    def missed(self, parts: Iterator[NDArray[np.int64]]) -> Iterator[NDArray[np.int64]]:
        """The same parts, looked at."""
        at = 0
        for part in parts:
            self._held(lambda part=part, at=at: refuse_missed(part, self._where, at))  # type: ignore[misc]
            at += len(part)
            yield part

    def done(self) -> Metadata:
        """Raises AutotuneError where something was wrong: the first thing."""
        if self._wrong:
            raise self._wrong[0]
        return self._metadata

    def _read_metadata(self) -> None:
        pairs: Mapping[str, str] = self._file.pairs
        if "sample_period" not in pairs and self._file.rows > 1:
            pairs = {**pairs, "sample_period": repr(spacing(self._file.path, self._time))}
        self._metadata = parse_metadata(pairs, self._where)

    def _held(self, check: Callable[[], None]) -> None:
        if not self._wrong:
            try:
                check()
            except AutotuneError as error:
                self._wrong.append(error)
