"""Parquet files of anybody: flat number columns, units from the fields' metadata, dates as time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from autotune.core.arrays import Floats
from autotune.core.errors import RecordingError
from autotune.recordings.importing.source import Column, Loaded, Source, foreign_bytes, seconds, short, within
from autotune.recordings.importing.texts import Coding, Labels
from autotune.recordings.importing.units import split_unit

_UNIT_KEYS = (b"unit", b"units", b"Unit", b"unit_string")


def read_parquet(path: Path) -> Source:
    """Opens a Parquet file.

    Raises:
        RecordingError: missing, not Parquet, damaged, or without number columns.
    """
    if not foreign_bytes(path).startswith(b"PAR1"):
        raise RecordingError(f"{path} is no Parquet file (it does not begin with PAR1); check --format")
    try:
        schema = pyarrow.parquet.read_schema(path)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise _damaged(path, error) from error
    if any(key.startswith(b"autotune.") for key in schema.metadata or {}):
        raise RecordingError(f"{path} is a recording of this program already; use it as it is")
    every = [(field, _column(field, number)) for number, field in enumerate(schema, 1)]
    kept = [field for field, _ in every if _numeric(field.type)]
    if len(kept) < 2:
        found = within([short(name) for name in schema.names]) if schema.names else "none"
        raise RecordingError(
            f"{path} has no two columns of numbers; it has {found}. Write time, position and torque as numbers"
        )

    def load(indices: Sequence[int]) -> Loaded:
        return Loaded([_values(path, kept[index]) for index in indices])

    columns = tuple(column for field, column in every if _numeric(field.type))
    texts = tuple(column for field, column in every if not _numeric(field.type))

    def labels(number: int) -> Labels:
        coding = Coding()
        try:
            for chunk in (
                pyarrow.parquet.read_table(path, columns=[schema.names[number - 1]]).column(0).chunks
            ):
                coding.add(chunk)
        except (pa.ArrowException, OSError, ValueError) as error:
            raise _damaged(path, error) from error
        return coding.whole()

    return Source(path, columns, load, texts=texts, labels=labels)


def _numeric(kind: Any) -> bool:
    types = pa.types
    return bool(
        types.is_floating(kind) or types.is_integer(kind) or types.is_decimal(kind) or types.is_temporal(kind)
    )


def _column(field: Any, number: int) -> Column:
    metadata = field.metadata or {}
    name, unit = split_unit(field.name)
    told = next((metadata[key].decode("utf-8", "replace") for key in _UNIT_KEYS if key in metadata), unit)
    return Column(name, "s" if pa.types.is_temporal(field.type) else told, number=number)


def _values(path: Path, field: Any) -> Floats:
    """One column as float64; dates and durations in seconds, dates since the first row."""
    try:
        column = pyarrow.parquet.read_table(path, columns=[field.name]).column(0)
        if pa.types.is_temporal(field.type):
            return seconds(column)
        column = column.cast(pa.float64(), safe=False)
    except (pa.ArrowException, OSError, ValueError) as error:
        raise _damaged(path, error) from error
    values = np.empty(len(column))
    start = 0
    for chunk in column.chunks:
        part = chunk.fill_null(float("nan")).to_numpy(zero_copy_only=False)
        values[start : start + len(part)] = part
        start += len(part)
    return values


def _damaged(path: Path, error: Exception) -> RecordingError:
    reason = str(error).split("\n")[0][:90]
    return RecordingError(f"{path} cannot be read as Parquet: {reason}; write the file again")
