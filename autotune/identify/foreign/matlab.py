"""MATLAB files up to version 7: arrays, structures flattened with dots, columns of matrices numbered.

`out.signals.values` with two columns becomes `out.signals.values.1` and `.2`. Single numbers can be used
in factors (`torque=vir*gtau`). Files of version 7.3 are HDF5 and are refused with the remedy.
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import io as matlab
from scipy.io.matlab import MatReadError

from autotune.core.errors import RecordingError
from autotune.identify.foreign.source import (
    Column,
    Floats,
    Loaded,
    Source,
    foreign_bytes,
    refuse_other_format,
)
from autotune.identify.foreign.units import split_unit

_DEEPEST = 8
_MOST_COLUMNS = 64
_BROKEN = (
    MatReadError, ValueError, TypeError, KeyError, IndexError, AttributeError, ArithmeticError, MemoryError,
    EOFError, OSError, NotImplementedError, zlib.error,
)  # fmt: skip


def read_matlab(path: Path) -> Source:
    """Opens a MATLAB file.

    Raises:
        RecordingError: missing, not a MATLAB file, version 7.3, damaged, or no columns of numbers.
    """
    start = foreign_bytes(path)
    refuse_other_format(path, start, b"MATLAB 5.0 MAT-file")
    try:
        content = matlab.loadmat(path, squeeze_me=False, struct_as_record=True, chars_as_strings=True)
    except _BROKEN as error:
        reason = str(error).split("\n")[0][:160] or type(error).__name__
        raise RecordingError(
            f"{path} cannot be read as a MATLAB file: {reason}; save it again with save(..., '-v7')"
        ) from error
    arrays: dict[str, Floats] = {}
    scalars: dict[str, float] = {}
    others: list[str] = []
    for name, value in content.items():
        if not name.startswith("__"):
            _flatten(name, value, arrays, scalars, others, 0)
    return _source(path, arrays, scalars, others)


def _source(path: Path, arrays: dict[str, Floats], scalars: dict[str, float], others: list[str]) -> Source:
    """The arrays of the most frequent length; the rest is said."""
    lengths = Counter(len(values) for values in arrays.values())
    if not lengths:
        raise RecordingError(
            f"{path} holds no vectors of numbers (found: {', '.join([*scalars, *others]) or 'nothing'}); save time, "
            "position and torque as vectors with save(..., '-v7'); objects such as timeseries must be taken apart"
        )
    rows = max(lengths, key=lambda length: (lengths[length], length))
    kept = {name: values for name, values in arrays.items() if len(values) == rows}
    left = [f"{name} ({len(values)})" for name, values in arrays.items() if len(values) != rows]
    notes = [f"vectors of another length than {rows} are left out: {', '.join(left)}"] if left else []
    notes += [f"not numbers, left out: {', '.join(others)}"] if others else []
    values = list(kept.values())

    def load(indices: Sequence[int]) -> Loaded:
        return Loaded([np.asarray(values[index], dtype=np.float64) for index in indices])

    columns = tuple(Column(*split_unit(name)) if "[" in name else Column(name) for name in kept)
    return Source(path, columns, load, scalars, notes=tuple(notes))


def _flatten(
    name: str, value: Any, arrays: dict[str, Floats], scalars: dict[str, float], others: list[str], depth: int
) -> None:
    """Adds the numbers in `value` to `arrays` and `scalars`, under dotted names."""
    array = np.asarray(value)
    if depth > _DEEPEST or type(value).__name__ == "MatlabOpaque":
        others.append(name)
    elif array.dtype.names:
        for label, item in _elements(name, array):
            for field in array.dtype.names:
                _flatten(f"{label}.{field}", item[field], arrays, scalars, others, depth + 1)
    elif array.dtype == object:
        for label, item in _elements(name, array):
            _flatten(label, item, arrays, scalars, others, depth + 1)
    elif array.dtype.kind in "iufb" and array.size:
        _numbers(name, array, arrays, scalars)
    elif array.size:
        others.append(name)


def _elements(name: str, array: Any) -> Iterator[tuple[str, Any]]:
    """Elements of a structure or cell array; numbered if there are several."""
    flat = array.reshape(-1)
    for number, item in enumerate(flat[:_MOST_COLUMNS], 1):
        yield (f"{name}.{number}" if len(flat) > 1 else name), item


def _numbers(name: str, array: Any, arrays: dict[str, Floats], scalars: dict[str, float]) -> None:
    if array.size == 1:
        scalars[name] = float(array.reshape(-1)[0])
        return
    squeezed = np.squeeze(array)
    if squeezed.ndim == 1:
        arrays[name] = squeezed
        return
    table = squeezed.reshape(squeezed.shape[0], -1)
    table = table if table.shape[0] >= table.shape[1] else table.T
    for number in range(min(table.shape[1], _MOST_COLUMNS)):
        arrays[f"{name}.{number + 1}"] = table[:, number]
