"""What reading a recording's file asks of its parts: names, columns, size, checksum; one thing at a time."""

from __future__ import annotations

import codecs
import difflib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from numpy.typing import NDArray

from autotune.core.arrays import Floats
from autotune.core.errors import AutotuneError, RecordingError, a_few
from autotune.recordings.checksum import KEY as CHECKSUM
from autotune.recordings.limits import refuse_names
from autotune.recordings.recording import COLUMNS, FLOAT_COLUMNS, REQUIRED_COLUMNS

PREFIX = b"autotune."
PLAIN = ("motion_unit", "sample_period", "position_resolution", "torque_limit", "controller")
"""What a recording says of its axis: names of metadata that are known without the prefix too."""
CSV_TYPES = {name: pa.float64() for name in FLOAT_COLUMNS} | {
    "experiment": pa.string(), "repeat": pa.int64(), "missed": pa.int64()
}  # fmt: skip
MOST_BYTES = 2_000_000_000
"""Of a file; a day of one axis at 1 kHz has less."""
_AT_ONCE = 1 << 22
"""Bytes of a text that are looked at together."""


def pairs_of(schema: pa.Schema) -> dict[str, str]:
    """The metadata that a Parquet file carries, as texts; those of a recording also without the program's prefix.

    A CSV has them without, and what other programs write is not looked for under a name that nobody told them.
    """
    metadata = schema.metadata or {}
    plain = {name: metadata[name.encode()].decode() for name in PLAIN if name.encode() in metadata}
    own = {
        key.removeprefix(PREFIX).decode(): value.decode()
        for key, value in metadata.items()
        if key.startswith(PREFIX)
    }
    return plain | own


@dataclass(frozen=True, slots=True)
class CsvHead:
    """What stands before the table: `# key: value` lines, and at which byte the table begins."""

    pairs: Mapping[str, str]
    start: int


def csv_head(path: Path) -> CsvHead:
    """The lines before a CSV's table; the rest is looked at for being a text at all.

    Raises:
        RecordingError: it is no text, or empty.
        UnicodeDecodeError: it is not UTF-8.
    """
    pairs: dict[str, str] = {}
    with path.open("rb") as file:
        start = 0
        while (line := file.readline()).startswith(b"#"):
            key, _, value = line[1:].decode("utf-8").strip().partition(":")
            pairs[key.strip()] = value.strip()
            start = file.tell()
        file.seek(start)
        _refuse_no_text(path, file)
    if CHECKSUM not in pairs:  # else a changed file is refused; a spreadsheet pads each line with empty cells
        pairs = {key.rstrip(",;"): value.rstrip(",; \t") for key, value in pairs.items()}
    return CsvHead(pairs, start)


def _refuse_no_text(path: Path, file: BinaryIO) -> None:
    """All of it, megabytes at a time."""
    decoder, something, nul = codecs.getincrementaldecoder("utf-8")(), False, False
    while part := file.read(_AT_ONCE):
        decoder.decode(part)
        something = something or bool(part.strip())
        nul = nul or b"\0" in part
    decoder.decode(b"", final=True)
    if nul:
        raise RecordingError(f"{path} is not a text file; a CSV is: check the name")
    if not something:
        raise RecordingError(f"{path} is empty; a recording needs {', '.join(REQUIRED_COLUMNS)}")


def check_names(path: Path, names: Sequence[str]) -> None:
    """Raises RecordingError where a name stands twice, or a column that must be there is missing."""
    if len(set(names)) < len(names):
        raise RecordingError(f"{path} names a column twice: {a_few(names)}; rename one")
    missing = [name for name in REQUIRED_COLUMNS if name not in names]
    if missing:
        raise RecordingError(
            f"{path} has no column {', '.join(missing)}; it has {a_few(names)}. "
            "Map foreign columns with 'autotune data import --column NAME=FIELD'"
        )


def parquet_names(path: Path, file: pa.parquet.ParquetFile) -> list[str]:
    """Names of a Parquet file's columns. Raises RecordingError as `check_names`, and where one has parts of its own."""
    names = list(file.schema_arrow.names)
    check_names(path, names)
    nested = [name for name in names if name in COLUMNS and name not in file.schema.names]
    if nested:
        raise RecordingError(
            f"{path} has lists or structures in its column {nested[0]}, where a recording has one value a row: it is "
            "none, or it is damaged"
        )
    return names


def floats_of(table: pa.Table, name: str) -> Floats:
    """A column; what is not there is nan."""
    column = table.column(name).cast(pa.float64())
    if column.null_count:  # filling makes a copy
        column = column.fill_null(float("nan"))
    return np.asarray(column.to_numpy())


def integers_of(table: pa.Table, name: str) -> NDArray[np.int64]:
    """A column; what is not there is 0."""
    return np.asarray(table.column(name).cast(pa.int64()).fill_null(0).to_numpy())


def texts_of(table: pa.Table, name: str) -> tuple[list[str], NDArray[np.int64]]:
    """The different texts of a column, and which of them stands in each row."""
    column = table.column(name)
    if not pa.types.is_dictionary(column.type) or column.null_count:
        column = column.cast(pa.string()).fill_null("").dictionary_encode()
    encoded = column.unify_dictionaries().combine_chunks()
    texts = encoded.dictionary.cast(pa.string()).to_pylist()
    refuse_names(texts, name)  # before they become an array as wide as the longest
    return texts or [""], encoded.indices.to_numpy().astype(np.int64)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """The block reads a recording's file, which must be there and of a size that can be held.

    Raises:
        RecordingError: there is no such file, or it is too large; or whatever the libraries meet in the block.
    """
    if not path.is_file():
        raise RecordingError(f"there is no recording {path}; check the name")
    try:
        refuse_huge(path, path.stat().st_size, MOST_BYTES, "bytes")
        yield
    except AutotuneError:
        raise
    except (pa.ArrowException, OSError, ValueError, OverflowError, MemoryError) as error:
        raise RecordingError(
            f"{path} cannot be read as a recording: {_reason(error)}; import foreign files with 'autotune data "
            "import'"
        ) from error


def _reason(error: Exception) -> str:
    """The first line of what a library says; a damaged file may be quoted in it at any length."""
    text = next(iter(str(error).splitlines()), "") or type(error).__name__
    return "".join(letter if letter.isprintable() else "?" for letter in text[:200])


def refuse_huge(path: Path, size: int, most: int, what: str) -> None:
    """Raises RecordingError where a file has more than can be held."""
    if size > most:
        raise RecordingError(f"{path} has {size:.3g} {what}; a recording has at most {most:.3g}: split it")


def verified(path: Path, pairs: Mapping[str, str], checksum: Callable[[], str]) -> tuple[str, ...]:
    """Compares with the checksum of the content; a remark where an old or foreign Parquet file has none.

    Raises:
        RecordingError: it does not match, or a file that must have one lost it.
    """
    parquet = path.suffix == ".parquet"
    if CHECKSUM in pairs:
        if pairs[CHECKSUM] == checksum():
            return ()
        advice = "" if parquet else "; if you changed it on purpose, delete the line '# checksum:'"
        raise RecordingError(
            f"{path} does not match its checksum: it was damaged or changed after it was written. Take another "
            f"copy, or record again{advice}"
        )
    if not parquet:
        _refuse_damaged_line(path, pairs)
        return ()
    if pairs.get("schema", "1") != "1":
        raise RecordingError(
            f"{path} has schema {pairs['schema'][:40]} but no checksum, which every such file has: it is damaged. "
            "Take another copy, or record again"
        )
    return (
        f"{path} has no checksum (from an older version or another program): damage would not be noticed",
    )


def _refuse_damaged_line(path: Path, pairs: Mapping[str, str]) -> None:
    """A line that was once the checksum is worse than none: something else will be damaged as well."""
    near = difflib.get_close_matches(CHECKSUM, pairs, 1)
    if near or any(value.startswith("sha256:") for value in pairs.values()):
        raise RecordingError(
            f"{path} has a line '# {near[0] if near else '...'}:' that looks like a damaged '# {CHECKSUM}:'; take "
            "another copy, or remove the line if you wrote it"
        )


def spacing(path: Path, time: Floats) -> float:
    """Median step of the time [s], where nothing else says how far rows are apart.

    Raises:
        RecordingError: it does not rise.
    """
    spacing = float(np.median(np.diff(time), overwrite_input=True))
    if not spacing > 0.0:
        raise RecordingError(
            f"{path}: time does not rise (median step {spacing:g} s); sort the rows, or name the column of the time"
        )
    return spacing
