"""What every format is read into: named columns that are loaded when they are asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from autotune.core.errors import RecordingError

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Column:
    """One column of a foreign file.

    Attributes:
        name: as the file has it, without a unit in brackets; its number, from 1, if it has none.
        unit: as the file has it; empty if it says nothing.
        example: what is in the first rows, for messages.
    """

    name: str
    unit: str = ""
    example: str = ""

    def __str__(self) -> str:
        return f"'{self.name}'" + (f" [{self.unit}]" if self.unit else "")


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
    """

    path: Path
    columns: tuple[Column, ...]
    load: Callable[[Sequence[int]], Loaded]
    scalars: Mapping[str, float] = field(default_factory=dict)
    period: float | None = None
    notes: tuple[str, ...] = ()

    def described(self) -> str:
        """The columns for a message, at most twenty."""
        shown = ", ".join(str(column) for column in self.columns[:20])
        more = len(self.columns) - 20
        return shown + (f" and {more} more" if more > 0 else "")


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


_SIGNATURES = (
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
