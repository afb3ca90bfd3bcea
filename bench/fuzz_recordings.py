"""Fuzzing recordings, own and foreign: what is accepted must be of an axis, and equal to a strict reading."""

from __future__ import annotations

import csv
import io
import math
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet

from autotune.recordings.files import read_recording
from autotune.recordings.importing.importing import import_files
from autotune.recordings.importing.options import Options, Wishes
from autotune.recordings.recording import FLOAT_COLUMNS, Recording
from bench.fuzz_judging import LONGEST_MESSAGE, refused, require
from bench.fuzz_mutation import NUMBERS, ODD, mutated


def _plausible(recording: Recording) -> None:
    """What every accepted recording must be, said anew."""
    unit = recording.metadata.motion_unit
    require(unit in ("rad", "m"), f"motion unit {unit!r}")
    require(1e-7 <= recording.period <= 1e3, f"period {recording.period}")
    for name in ("time", "position", "torque"):
        require(bool(np.all(np.isfinite(recording[name]))), f"{name} is not finite")
    for name in recording.floats:
        values = recording[name][~np.isnan(recording[name])]
        most = float(np.max(np.abs(values))) if len(values) else 0.0
        require(most <= 1e11, f"{name} is {most}")
    for _, part in recording.split():
        step = np.diff(part["time"])
        require(bool(np.all(step > 0)), "time does not rise")
        require(bool(np.all(np.abs(np.diff(part["position"])) <= 1e6 * step)), "position leaps")


def _strict_csv(data: bytes) -> dict[str, list[float]]:
    """Numbers of a recording's CSV by the standard library."""
    while data.startswith(b"#"):
        data = data.partition(b"\n")[2]
    lines = io.StringIO(data.decode("utf-8"), newline="").readlines()
    csv.field_size_limit(1_000_000)
    rows = [row for row in csv.reader(lines) if row]
    head = [name.strip("\ufeff") for name in rows[0]]
    table: dict[str, list[float]] = {}
    for name in set(head) & set(FLOAT_COLUMNS):
        at = head.index(name)
        table[name] = [_strict_number(row[at]) for row in rows[1:]]
    return table


def _strict_number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def read_recording_csv(data: bytes, folder: Path) -> bool:
    path = folder / "recording.csv"
    path.write_bytes(data)
    failed, recording = refused(lambda: read_recording(path))
    if failed:
        return False
    _plausible(recording)
    strict = _strict_csv(data)
    for name, values in recording.floats.items():
        require(
            np.array_equal(values, np.array(strict.get(name, [])), equal_nan=True),
            f"{name} is read otherwise",
        )
    return True


def read_recording_parquet(data: bytes, folder: Path) -> bool:
    path = folder / "recording.parquet"
    path.write_bytes(data)
    failed, recording = refused(lambda: read_recording(path))
    if failed:
        return False
    _plausible(recording)
    table = pa.parquet.ParquetFile(path).read(columns=list(recording.floats)).to_pydict()
    for name, values in recording.floats.items():
        strict = np.array([math.nan if one is None else float(one) for one in table[name]])
        require(np.array_equal(values, strict, equal_nan=True), f"{name} is read otherwise")
    return True


def make_parquet(chance: random.Random, seeds: list[bytes]) -> bytes:
    """A damaged file, or a sound one that holds nonsense."""
    if chance.random() < 0.6:
        return mutated(chance, seeds)
    table = pa.parquet.read_table(io.BytesIO(chance.choice(seeds)))
    pairs = dict(table.schema.metadata or {})
    columns = {name: list(table.column(name).to_pylist()) for name in table.column_names}
    for _ in range(chance.choice((1, 1, 2, 4))):
        _spoil(chance, columns, pairs)
    try:
        out = io.BytesIO()
        pa.parquet.write_table(pa.table(columns).replace_schema_metadata(pairs), out)
        return out.getvalue()
    except (pa.ArrowException, TypeError, OverflowError):
        return mutated(chance, seeds)


def _spoil(chance: random.Random, columns: dict[str, list[Any]], pairs: dict[bytes, bytes]) -> None:
    name = chance.choice(list(columns))
    kind = chance.randrange(7)
    if kind == 0:
        del columns[name]
        columns.setdefault("time", [0.0])
    elif kind == 1:
        columns[name][chance.randrange(len(columns[name]))] = chance.choice(
            (None, math.nan, math.inf, 1e300, -1e9)
        )
    elif kind == 2:
        columns[name] = [str(value) for value in columns[name]]
    elif kind == 3:
        columns[name] = [chance.choice(ODD)] * len(columns[name])
    elif kind == 4:
        columns[name] = [value * 1e6 if isinstance(value, (int, float)) else None for value in columns[name]]
    elif pairs:
        key = chance.choice(list(pairs))
        pairs[key] = chance.choice((*NUMBERS, "x", "\x1b[2J", "1" * 20_000)).encode()
        if kind == 6:
            pairs.pop(b"autotune.checksum", None)
            pairs[b"autotune.schema"] = b"1"


def importer(form: str, ending: str, *columns: str) -> Callable[[bytes, Path], bool]:
    def run(data: bytes, folder: Path) -> bool:
        path = folder / f"foreign.{ending}"
        path.write_bytes(data)
        failed, found = refused(lambda: import_files([path], Options(form, columns, Wishes())))
        if failed:
            return False
        require(len("\n".join(found.lines)) < LONGEST_MESSAGE * 10, "pages of remarks")
        require(all(line.isprintable() for line in found.lines), f"remarks with escapes: {found.lines}")
        _plausible(found.recording)
        return True

    return run
