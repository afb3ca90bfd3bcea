"""Recordings as files: Parquet with metadata, or CSV with leading `# key: value` lines.

What is written carries a checksum of its content (`recording_checksum`), Parquet pages one of their own.
Both are verified on reading, and what no axis can do (`recording_limits`) is refused, with or without a
checksum. A CSV may be written by hand: it needs none.
"""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from autotune.core.errors import RecordingError
from autotune.recordings.checksum import KEY as CHECKSUM
from autotune.recordings.checksum import content_checksum
from autotune.recordings.file_parts import (
    CSV_TYPES,
    PREFIX,
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
from autotune.recordings.limits import refuse_impossible
from autotune.recordings.recording import (
    COLUMNS,
    FLOAT_COLUMNS,
    MOTION_UNITS,
    SCHEMA_VERSION,
    Controller,
    Metadata,
    Recording,
)

MOST_ROWS = 50_000_000
"""14 hours at 1 kHz, 4 GB in memory."""
BATCH = 1 << 19
"""Rows of a Parquet file in memory beside the columns that they go into."""
FIRST_WITH_CHECKSUM = 2
_RANGES = {"sample_period": (1e-7, 1e3), "position_resolution": (1e-15, 1e3), "torque_limit": (1e-12, 1e9)}
"""From a hundred times faster than a current loop to a row every quarter of an hour; an atom; a press."""
_LONGEST_PAIR = 10_000
_NUMBERS = ("sample_period", "position_resolution", "torque_limit")
_TEXTS = ("motion_unit", "controller", "axis", "fingerprint", "schema", CHECKSUM)


def read_recording(path: str | Path) -> Recording:
    """Reads a recording; the ending decides: `.parquet`, else CSV.

    Raises:
        RecordingError: no such file, not a recording, a newer schema, a checksum that does not match, or
            values that cannot be.
    """
    path = Path(path)
    with reading(path):
        columns, pairs = _read_parquet(path) if path.suffix == ".parquet" else _read_csv(path)
        recording = _recording(path, columns, pairs)
    refuse_impossible(recording, str(path))
    return recording


def write_recording(recording: Recording, path: str | Path) -> None:
    """Writes a recording, replacing the file in one step; the ending decides as in reading."""
    path = Path(path)
    temporary = path.with_name(path.name + ".part")
    if path.suffix == ".parquet":
        table = _table(recording)
        pa.parquet.write_table(table, temporary, compression="zstd", write_page_checksum=True)
    else:
        temporary.write_bytes(_csv_bytes(recording))
    os.replace(temporary, path)


def metadata_pairs(metadata: Metadata) -> dict[str, str]:
    """Metadata as `key: value` texts; what is unknown is left out."""
    pairs = {"schema": str(metadata.schema), "motion_unit": metadata.motion_unit}
    pairs |= {name: repr(float(v)) for name in _NUMBERS if (v := getattr(metadata, name)) is not None}
    if metadata.controller is not None:
        pairs["controller"] = str(metadata.controller)
    pairs |= {name: getattr(metadata, name) for name in ("axis", "fingerprint") if getattr(metadata, name)}
    return pairs | dict(metadata.extra)


def parse_metadata(pairs: Mapping[str, str], where: str) -> Metadata:
    """Metadata from `key: value` texts.

    Raises:
        RecordingError: a value is not a number where one is needed, or out of range.
    """
    strange = [k for k, v in pairs.items() if not (k + v).isprintable() or len(k + v) > _LONGEST_PAIR]
    if strange:
        raise RecordingError(
            f"{where}: the metadata {strange[0][:40]!r} are longer than {_LONGEST_PAIR} characters, or hold some that "
            "cannot be printed; correct or remove that line"
        )
    unit = pairs.get("motion_unit", "rad")
    if unit not in MOTION_UNITS:
        raise RecordingError(f"{where}: motion_unit is {unit!r}; allowed are {', '.join(MOTION_UNITS)}")
    numbers: dict[str, Any] = {
        name: _number(pairs[name], f"{where}: {name}", *_RANGES[name]) for name in _NUMBERS if name in pairs
    }
    schema = _number(pairs.get("schema", str(SCHEMA_VERSION)), f"{where}: schema", 1, np.inf)
    if schema > SCHEMA_VERSION:
        raise RecordingError(
            f"{where} has schema {schema:g}, this program knows up to {SCHEMA_VERSION}; update autotune"
        )
    controller = Controller.parse(pairs["controller"]) if "controller" in pairs else None
    known = {*_NUMBERS, *_TEXTS}
    return Metadata(
        motion_unit=unit,
        controller=controller,
        axis=pairs.get("axis", ""),
        fingerprint=pairs.get("fingerprint", ""),
        schema=int(schema),
        extra={name: value for name, value in pairs.items() if name not in known},
        sample_period=numbers.get("sample_period", 1e-3),
        position_resolution=numbers.get("position_resolution"),
        torque_limit=numbers.get("torque_limit"),
    )


def _number(text: str, where: str, low: float, high: float) -> float:
    try:
        value = float(text)
    except ValueError:
        raise RecordingError(f"{where} is {text[:40]!r}; it must be a number") from None
    if not np.isfinite(value) or value <= 0:
        raise RecordingError(f"{where} is {text}; it must be a finite number above 0")
    if not low <= value <= high:
        raise RecordingError(f"{where} is {value:g}; it must be from {low:g} to {high:g}")
    return value


def _read_parquet(path: Path) -> tuple[_Columns, dict[str, str]]:
    """Batch by batch, so that beside the columns themselves only one batch is in memory."""
    file = pa.parquet.ParquetFile(path)
    schema = file.schema_arrow
    rows = file.metadata.num_rows
    refuse_huge(path, rows, MOST_ROWS, "rows")
    names = parquet_names(path, file)
    coded = [name for name in names if name == "experiment"]
    file = pa.parquet.ParquetFile(
        path, page_checksum_verification=True, read_dictionary=coded, pre_buffer=False
    )
    columns = _Columns([name for name in names if name in COLUMNS], rows)
    for batch in file.iter_batches(BATCH, columns=columns.names, use_threads=False):
        columns.append(pa.Table.from_batches([batch]))
    return columns, pairs_of(schema)


def _read_csv(path: Path) -> tuple[_Columns, dict[str, str]]:
    head = csv_head(path)
    with path.open("rb") as file:
        file.seek(head.start)
        content = file.read()
    options = pyarrow.csv.ConvertOptions(column_types=CSV_TYPES)
    table = pyarrow.csv.read_csv(io.BytesIO(content), convert_options=options)
    check_names(path, table.column_names)
    columns = _Columns([name for name in table.column_names if name in COLUMNS], table.num_rows)
    columns.append(table)
    return columns, dict(head.pairs)


class _Columns:
    """Columns that are filled batch by batch; whole numbers that are all the same take no memory."""

    def __init__(self, names: list[str], rows: int) -> None:
        self.names, self._at = names, 0
        self.floats = {name: np.empty(rows) for name in FLOAT_COLUMNS if name in names}
        self._integers: dict[str, np.ndarray[tuple[int], np.dtype[np.int64]]] = {
            name: np.empty(rows, np.int64) for name in ("repeat", "missed") if name in names
        }
        self._codes: dict[str, int] = {}
        self._coded = np.zeros(rows if "experiment" in names else 0, np.int32)

    def append(self, table: pa.Table) -> None:
        rows = slice(self._at, self._at + table.num_rows)
        for name, column in self.floats.items():
            column[rows] = floats_of(table, name)
        for name, whole in self._integers.items():
            whole[rows] = integers_of(table, name)
        if len(self._coded):
            texts, codes = texts_of(table, "experiment")
            known = np.array([self._codes.setdefault(text, len(self._codes)) for text in texts], np.int32)
            self._coded[rows] = known[codes]
        self._at = rows.stop

    def integers(self, name: str) -> np.ndarray[tuple[int], np.dtype[np.int64]] | int:
        values = self._integers.get(name)
        if values is None or not len(values):
            return 0
        return int(values[0]) if (values == values[0]).all() else values

    def experiment(self) -> np.ndarray[tuple[int], np.dtype[np.str_]] | str:
        if len(self._codes) < 2:
            return next(iter(self._codes), "")
        return np.array(list(self._codes), str)[self._coded]


def _recording(path: Path, columns: _Columns, pairs: dict[str, str]) -> Recording:
    floats, rows = columns.floats, len(columns.floats["time"])
    experiment, repeat, missed = columns.experiment(), columns.integers("repeat"), columns.integers("missed")
    recording = Recording.from_columns(floats, Metadata(), experiment, repeat, missed)
    remarks = verified(path, pairs, lambda: content_checksum(recording, pairs))
    if "sample_period" not in pairs and rows > 1:
        pairs = pairs | {"sample_period": repr(spacing(path, floats["time"]))}
    metadata = parse_metadata(pairs, str(path))
    return replace(recording, metadata=replace(metadata, remarks=remarks))


def _sealed_pairs(recording: Recording) -> dict[str, str]:
    """The metadata of a file of this version, the checksum first."""
    pairs = metadata_pairs(replace(recording.metadata, schema=SCHEMA_VERSION))
    return {CHECKSUM: content_checksum(recording, pairs), **pairs}


def _table(recording: Recording) -> pa.Table:
    arrays = {
        "experiment": _names(recording),
        "repeat": pa.array(recording.repeat),
        "missed": pa.array(recording.missed),
        **{name: pa.array(values) for name, values in recording.floats.items()},
    }
    table = pa.table({name: arrays[name] for name in COLUMNS if name in arrays})
    pairs = _sealed_pairs(recording)
    return table.replace_schema_metadata({PREFIX + k.encode(): v.encode() for k, v in pairs.items()})


def _names(recording: Recording) -> pa.ChunkedArray:
    """Names segment by segment: ten million rows must not become ten million Python texts."""
    runs = [pa.repeat(pa.scalar(s.experiment), s.stop - s.start) for s in recording.segments()]
    return pa.chunked_array(runs, pa.string())


def _csv_bytes(recording: Recording) -> bytes:
    for segment in recording.segments():
        if set(segment.experiment) & set('",\r\n'):
            raise RecordingError(
                f"the experiment {segment.experiment!r} has a comma, a quotation mark or a line break in its name; "
                "write a .parquet file, or name it otherwise"
            )
    head = "".join(f"# {key}: {value}\n" for key, value in _sealed_pairs(recording).items())
    body = io.BytesIO()
    table = _table(recording).replace_schema_metadata(None)
    pyarrow.csv.write_csv(table, body, pyarrow.csv.WriteOptions(quoting_style="none"))
    return head.encode() + body.getvalue().replace(b'"', b"")
