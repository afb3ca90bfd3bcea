"""MATLAB files up to version 7: arrays, structures flattened with dots, columns of matrices numbered.

`out.signals.values` with two columns becomes `out.signals.values.1` and `.2`. Single numbers can be used
in factors (`torque=vir*gtau`). Files of version 7.3 are HDF5 and are refused with the remedy. The file is
read by a process of its own (see `matlab_child`), so that a damaged one ends in a sentence.
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import autotune
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
    places = os.pathsep.join([str(Path(autotune.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    command = [sys.executable, "-m", "autotune.identify.foreign.matlab_child", str(path)]
    try:
        done = subprocess.run(
            command,
            capture_output=True,
            timeout=_SECONDS,
            env={**os.environ, "PYTHONPATH": places},
            check=False,
        )
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
