"""MATLAB files up to version 7: arrays, structures flattened with dots, columns of matrices numbered.

`out.signals.values` with two columns becomes `out.signals.values.1` and `.2`. Single numbers can be used
in factors (`torque=vir*gtau`). Files of version 7.3 are HDF5 and are refused with the remedy. The file is
read by a process of its own (see `matlab_child`), so that a damaged one ends in a sentence.
"""

from __future__ import annotations

import io
import json
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
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


def read_matlab(path: Path) -> Source:
    """Opens a MATLAB file.

    Raises:
        RecordingError: missing, not a MATLAB file, version 7.3, damaged, or no columns of numbers.
    """
    start = foreign_bytes(path)
    refuse_other_format(path, start, _VERSION_5)
    first = {int.from_bytes(start[:4], order) for order in ("little", "big")}
    if not start.startswith(_VERSION_5) and not first & _VERSION_4:
        raise RecordingError(
            f"{path} is no MATLAB file (it does not begin with '{_VERSION_5.decode()}'); check --format"
        )
    head, arrays = _read_apart(path)
    return _source(path, dict(zip(head["names"], arrays, strict=True)), head["scalars"], head["others"])


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


def _source(path: Path, arrays: dict[str, Floats], scalars: dict[str, float], others: list[str]) -> Source:
    """All vectors; those of one length go together."""
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
