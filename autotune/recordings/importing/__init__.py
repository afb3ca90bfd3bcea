"""Recordings that others made: one reader a format, and the way from a reader to a `Recording`.

A new format is one more file with one more entry in `FORMATS`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

from autotune.recordings.importing.delimited import read_csv
from autotune.recordings.importing.epos import read_epos
from autotune.recordings.importing.matlab import read_matlab
from autotune.recordings.importing.parquet import read_parquet
from autotune.recordings.importing.source import Source

FORMATS: Mapping[str, Callable[[Path], Source]] = MappingProxyType(
    {"csv": read_csv, "mat": read_matlab, "epos": read_epos, "parquet": read_parquet}
)
