"""Recordings as files: Parquet with metadata, or CSV with leading `# key: value` lines."""

from __future__ import annotations

import io
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from autotune.core.errors import RecordingError
from autotune.core.recording import (
    COLUMNS,
    FLOAT_COLUMNS,
    MOTION_UNITS,
    REQUIRED_COLUMNS,
    SCHEMA_VERSION,
    Controller,
    Metadata,
    Recording,
)

_PREFIX = b"autotune."
_NUMBERS = ("sample_period", "position_resolution", "torque_limit")
_TEXTS = ("motion_unit", "controller", "axis", "fingerprint", "schema")


def read_recording(path: str | Path) -> Recording:
    """Reads a recording; the ending decides: `.parquet`, else CSV.

    Raises:
        RecordingError: no such file, not a recording, a newer schema, or values that cannot be.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordingError(f"there is no recording {path}; check the name")
    try:
        table, pairs = _read_parquet(path) if path.suffix == ".parquet" else _read_csv(path)
    except (pa.ArrowException, UnicodeDecodeError, OSError) as error:
        raise RecordingError(
            f"{path} cannot be read as a recording: {error}; import foreign files with 'autotune data import'"
        ) from error
    return _recording(path, table, pairs)


def write_recording(recording: Recording, path: str | Path) -> None:
    """Writes a recording, replacing the file in one step; the ending decides as in reading."""
    path = Path(path)
    temporary = path.with_name(path.name + ".part")
    if path.suffix == ".parquet":
        pa.parquet.write_table(_table(recording), temporary, compression="zstd")
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
    unit = pairs.get("motion_unit", "rad")
    if unit not in MOTION_UNITS:
        raise RecordingError(f"{where}: motion_unit is {unit!r}; allowed are {', '.join(MOTION_UNITS)}")
    numbers = {name: _positive(pairs[name], f"{where}: {name}") for name in _NUMBERS if name in pairs}
    schema = int(_positive(pairs.get("schema", str(SCHEMA_VERSION)), f"{where}: schema"))
    if schema > SCHEMA_VERSION:
        raise RecordingError(
            f"{where} has schema {schema}, this program knows up to {SCHEMA_VERSION}; update autotune"
        )
    controller = Controller.parse(pairs["controller"]) if "controller" in pairs else None
    known = {*_NUMBERS, *_TEXTS}
    return Metadata(
        motion_unit=unit,
        controller=controller,
        axis=pairs.get("axis", ""),
        fingerprint=pairs.get("fingerprint", ""),
        schema=schema,
        extra={name: value for name, value in pairs.items() if name not in known},
        **numbers,
    )


def _positive(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise RecordingError(f"{where} is {text!r}; it must be a number") from None
    if not np.isfinite(value) or value <= 0:
        raise RecordingError(f"{where} is {text}; it must be a finite number above 0")
    return value


def _read_parquet(path: Path) -> tuple[pa.Table, dict[str, str]]:
    table = pa.parquet.read_table(path)
    raw = table.schema.metadata or {}
    return table, {
        key.removeprefix(_PREFIX).decode(): value.decode()
        for key, value in raw.items()
        if key.startswith(_PREFIX)
    }


def _read_csv(path: Path) -> tuple[pa.Table, dict[str, str]]:
    pairs: dict[str, str] = {}
    with path.open("rb") as file:
        start = 0
        while (line := file.readline()).startswith(b"#"):
            key, _, value = line[1:].decode("utf-8").strip().partition(":")
            pairs[key.strip()] = value.strip()
            start = file.tell()
        file.seek(start)
        content = file.read()
    content.decode("utf-8")
    if not content.strip():
        raise RecordingError(f"{path} is empty; a recording needs {', '.join(REQUIRED_COLUMNS)}")
    types = {name: pa.float64() for name in FLOAT_COLUMNS}
    types |= {"experiment": pa.string(), "repeat": pa.int64(), "missed": pa.int64()}
    options = pyarrow.csv.ConvertOptions(column_types=types)
    return pyarrow.csv.read_csv(io.BytesIO(content), convert_options=options), pairs


def _recording(path: Path, table: pa.Table, pairs: dict[str, str]) -> Recording:
    names = set(table.column_names)
    if len(names) < table.num_columns:
        raise RecordingError(f"{path} names a column twice: {', '.join(table.column_names)}; rename one")
    missing = [name for name in REQUIRED_COLUMNS if name not in names]
    if missing:
        raise RecordingError(
            f"{path} has no column {', '.join(missing)}; it has {', '.join(table.column_names)}. "
            "Map foreign columns with 'autotune data import --column NAME=FIELD'"
        )
    floats = {name: _floats(table, name) for name in FLOAT_COLUMNS if name in names}
    if "sample_period" not in pairs and len(floats["time"]) > 1:
        pairs["sample_period"] = repr(float(np.median(np.diff(floats["time"]))))
    rows = table.num_rows
    experiment = _texts(table, "experiment") if "experiment" in names else np.full(rows, "")
    repeat = _integers(table, "repeat") if "repeat" in names else np.zeros(rows, dtype=np.int64)
    missed = _integers(table, "missed") if "missed" in names else np.zeros(rows, dtype=np.int64)
    return Recording.from_columns(floats, parse_metadata(pairs, str(path)), experiment, repeat, missed)


def _floats(table: pa.Table, name: str) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    column = table.column(name).combine_chunks()
    return np.asarray(column.cast(pa.float64()).fill_null(float("nan")).to_numpy(zero_copy_only=False))


def _integers(table: pa.Table, name: str) -> np.ndarray[tuple[int], np.dtype[np.int64]]:
    return np.asarray(table.column(name).cast(pa.int64()).fill_null(0).to_numpy())


def _texts(table: pa.Table, name: str) -> np.ndarray[tuple[int], np.dtype[np.str_]]:
    encoded = table.column(name).cast(pa.string()).fill_null("").combine_chunks().dictionary_encode()
    words: np.ndarray[tuple[int], np.dtype[np.str_]] = np.array(encoded.dictionary.to_pylist() or [""], str)
    indices: np.ndarray[tuple[int], np.dtype[np.int64]] = encoded.indices.to_numpy().astype(np.int64)
    return words[indices]


def _table(recording: Recording) -> pa.Table:
    arrays = {
        "experiment": _names(recording),
        "repeat": pa.array(recording.repeat),
        "missed": pa.array(recording.missed),
        **{name: pa.array(values) for name, values in recording.floats.items()},
    }
    table = pa.table({name: arrays[name] for name in COLUMNS if name in arrays})
    pairs = metadata_pairs(recording.metadata)
    return table.replace_schema_metadata({_PREFIX + k.encode(): v.encode() for k, v in pairs.items()})


def _names(recording: Recording) -> pa.ChunkedArray:
    """Names segment by segment: ten million rows must not become ten million Python texts."""
    runs = [pa.repeat(pa.scalar(s.experiment), s.stop - s.start) for s in recording.segments()]
    return pa.chunked_array(runs, pa.string())


def _csv_bytes(recording: Recording) -> bytes:
    head = "".join(f"# {key}: {value}\n" for key, value in metadata_pairs(recording.metadata).items())
    body = io.BytesIO()
    table = _table(recording).replace_schema_metadata(None)
    pyarrow.csv.write_csv(table, body, pyarrow.csv.WriteOptions(quoting_style="none"))
    return head.encode() + body.getvalue().replace(b'"', b"")
