"""Recordings that others made: one reader a format, and the way from a reader to a `Recording`.

A new format is one more file with one more entry in `FORMATS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from autotune.recordings.importing.delimited import read_csv
from autotune.recordings.importing.epos import read_epos
from autotune.recordings.importing.matlab import read_matlab
from autotune.recordings.importing.parquet import read_parquet
from autotune.recordings.importing.source import Source


def _each(read: Callable[[Path], Source]) -> Callable[[Sequence[Path]], Iterator[Source]]:
    """The reader of one file as one of several: each file is a source of its own."""
    return lambda paths: map(read, paths)


FORMATS: Mapping[str, Callable[[Sequence[Path]], Iterator[Source]]] = MappingProxyType(
    {"csv": _each(read_csv), "mat": read_matlab, "epos": _each(read_epos), "parquet": _each(read_parquet)}
)
"""By `--format`: what opens files of that kind, one after the other as they are asked for."""
