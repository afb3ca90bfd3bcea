"""Reads one MATLAB file in a process of its own: `python -P matlab_child.py FILE`.

A damaged file can bring scipy's compiled reader down with a segmentation fault; that must not take the
program with it. The answer on standard output is a numpy archive: the vectors, and a JSON text `head`. It is started
by its path and imports nothing of autotune, whose own imports would cost as much again as scipy's reader.
"""

from __future__ import annotations

import json
import sys
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy import io as matlab
from scipy.io.matlab import MatReadError

if TYPE_CHECKING:
    from autotune.core.arrays import Floats

_DEEPEST = 8
_MOST_COLUMNS = 64
_BROKEN = (
    MatReadError, ValueError, TypeError, KeyError, IndexError, AttributeError, ArithmeticError, MemoryError,
    EOFError, OSError, NotImplementedError, zlib.error,
)  # fmt: skip
"""What scipy's reader raises for broken files, and NotImplementedError for those of MATLAB 7.3, which are HDF5."""


def main(path: Path) -> None:
    """Writes vectors, single numbers and the names of what is neither; or the reason why not."""
    arrays: dict[str, Floats] = {}
    scalars: dict[str, float] = {}
    others: list[str] = []
    error = ""
    try:
        content = matlab.loadmat(path, squeeze_me=False, struct_as_record=True, chars_as_strings=True)
        for name, value in content.items():
            if not name.startswith("__"):
                _flatten(name, value, arrays, scalars, others, 0)
    except _BROKEN as reason:
        error = str(reason).split("\n")[0][:90] or type(reason).__name__
    head = {"names": list(arrays), "scalars": scalars, "others": others, "error": error}
    vectors = {f"v{number}": values for number, values in enumerate(arrays.values())}
    np.savez(sys.stdout.buffer, head=np.array(json.dumps(head)), **vectors)  # type: ignore[arg-type]


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


if __name__ == "__main__":
    main(Path(sys.argv[1]))
