"""MATLAB files up to version 7: arrays, structures flattened with dots, columns of matrices numbered.

`out.signals.values` with two columns becomes `out.signals.values.1` and `.2`. Single numbers can be used
in factors (`torque=vir*gtau`). Signals that were saved one a file, all of one length, are taken together.
Files of version 7.3 are HDF5 and are refused with the remedy. Each is read by a process of its own (see
`matlab_child`), so that a damaged one ends in a sentence.
"""

from __future__ import annotations

import io
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from autotune.core.arrays import Floats
from autotune.core.errors import RecordingError, a_few
from autotune.recordings.importing.source import (
    Column,
    Loaded,
    Source,
    foreign_bytes,
    refuse_other_format,
    short,
    usual_rows,
    within,
)
from autotune.recordings.importing.units import split_unit

_SECONDS = 300.0
_VERSION_5 = b"MATLAB 5.0 MAT-file"
_VERSION_4 = frozenset(
    1000 * order + 10 * kind + form for order in (0, 1) for kind in range(6) for form in (0, 1)
)


@dataclass(frozen=True, slots=True)
class _Content:
    """What one file holds: vectors by name, single numbers, the names of what is neither."""

    path: Path
    vectors: dict[str, Floats]
    scalars: dict[str, float]
    others: list[str]


def read_matlab(paths: Sequence[Path]) -> Iterator[Source]:
    """Opens MATLAB files, one after the other; files with one vector each, all of one length, are one source.

    Raises:
        RecordingError: missing, not a MATLAB file, version 7.3, damaged, or no columns of numbers.
    """
    for number, path in enumerate(paths):
        content = _content(path)
        if number == 0 and len(paths) > 1 and len(content.vectors) == 1:
            yield _source(_together([content, *map(_content, paths[1:])]))
            return
        yield _source(content)


def _content(path: Path) -> _Content:
    start = foreign_bytes(path)
    refuse_other_format(path, start, _VERSION_5)
    first = {int.from_bytes(start[:4], order) for order in ("little", "big")}
    if not start.startswith(_VERSION_5) and not first & _VERSION_4:
        raise RecordingError(
            f"{path} is no MATLAB file (it does not begin with '{_VERSION_5.decode()}'); check --format"
        )
    head, arrays = _read_apart(path)
    return _Content(path, dict(zip(head["names"], arrays, strict=True)), head["scalars"], head["others"])


def _together(contents: Sequence[_Content]) -> _Content:
    """One vector of each file, side by side; vectors of one name are told apart by their files."""
    first = contents[0]
    vectors = [(content, *item) for content in contents for item in content.vectors.items()]
    lengths = {len(values) for _, _, values in vectors}
    if len(vectors) != len(contents) or len(lengths) > 1:
        return first
    alone = len({name for _, name, _ in vectors}) == len(vectors)
    names = [name if alone else f"{content.path.stem}.{name}" for content, name, _ in vectors]
    scalars = {name: value for content in contents for name, value in content.scalars.items()}
    values = [values for _, _, values in vectors]
    return _Content(first.path, dict(zip(names, values, strict=True)), scalars, first.others)


def _read_apart(path: Path) -> tuple[dict[str, Any], list[Floats]]:
    """What the reading process found."""
    command = [sys.executable, "-P", str(Path(__file__).with_name("matlab_child.py")), str(path)]
    try:
        done = subprocess.run(command, capture_output=True, timeout=_SECONDS, check=False)
    except subprocess.TimeoutExpired as error:
        raise _broken(path, f"not read within {_SECONDS:g} s") from error
    if done.returncode != 0:
        raise _broken(path, "its structure is damaged")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as archive:
        head = json.loads(str(archive["head"]))
        if head["error"]:
            raise _broken(path, head["error"])
        return head, [archive[f"v{number}"] for number in range(len(head["names"]))]


def _broken(path: Path, reason: str) -> RecordingError:
    return RecordingError(
        f"{path} cannot be read as a MATLAB file: {reason}; save it again with save(..., '-v7')"
    )


def _source(content: _Content) -> Source:
    """All vectors; those of one length go together."""
    path, arrays, scalars, others = content.path, content.vectors, content.scalars, content.others
    lengths = Counter(len(values) for values in arrays.values())
    if len(arrays) < 2:
        found = [short(name) for name in (*arrays, *scalars, *others)]
        raise RecordingError(
            f"{path} holds no two vectors of numbers (found: {a_few(found, 2) or 'nothing'}); save time, position and "
            "torque as vectors with save(..., '-v7'), no timeseries"
        )
    values = list(arrays.values())

    def load(indices: Sequence[int]) -> Loaded:
        return Loaded([np.asarray(values[index], dtype=np.float64) for index in indices])

    columns = tuple(_column(name, number, values) for number, (name, values) in enumerate(arrays.items(), 1))
    notes = [_lengths(columns)] if len(lengths) > 1 else []
    notes += [f"not numbers, left out: {within(others)}"] if others else []
    return Source(path, columns, load, scalars, notes=tuple(notes))


def _column(name: str, number: int, values: Floats) -> Column:
    bare, unit = split_unit(name) if "[" in name else (name, "")
    return Column(bare, unit, number=number, rows=len(values))


def _lengths(columns: Sequence[Column]) -> str:
    """Which vectors are not as long as most, and how to have them all the same."""
    usual = usual_rows(columns)
    others = [f"{column.name} ({column.rows})" for column in columns if column.rows != usual]
    return (
        f"vectors of another length than {usual} are left alone unless --column names them: {within(others)}"
    )
