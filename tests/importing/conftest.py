"""A made-up axis that anybody might have recorded, and the import as one call."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from autotune.core.arrays import Floats
from autotune.recordings.importing.importing import Imported, import_files
from autotune.recordings.importing.options import Options, Wishes

Import = Callable[..., Imported]
SHARED = Path(__file__).resolve().parents[2] / "../shared/data"


def axis_signals(rows: int = 2000, period: float = 1e-3) -> dict[str, Floats]:
    """A sine with J = 0.01, F = 0.3, viscous 0.05, gravity 0.1: columns by name, SI."""
    time = period * np.arange(rows)
    omega = 2.0 * np.pi * 1.5
    position = 0.8 * np.sin(omega * time)
    velocity = 0.8 * omega * np.cos(omega * time)
    torque = -0.01 * omega**2 * position + 0.3 * np.tanh(velocity / 0.05) + 0.05 * velocity + 0.1
    return {"time": time, "position": position, "velocity": velocity, "torque": torque}


def write_table(
    path: Path,
    columns: dict[str, Floats],
    delimiter: str = ",",
    decimal: str = ".",
    head: str | None = None,
    digits: int = 9,
    encoding: str = "utf-8",
) -> Path:
    """Writes columns as text; `head` replaces the line of names."""
    lines = [delimiter.join(columns)] if head is None else head.splitlines()
    for row in zip(*columns.values(), strict=True):
        lines.append(delimiter.join(f"{value:.{digits}g}".replace(".", decimal) for value in row))
    path.write_text("\n".join(lines) + "\n", encoding=encoding)
    return path


def bring_in(*paths: Path, kind: str = "csv", columns: tuple[str, ...] = (), **options: object) -> Imported:
    """`import_files` with plain arguments."""
    wishes = {
        name: options.pop(name)
        for name in ("motion_unit", "torque_unit", "resolution", "period", "speed_curve")
        if name in options
    }
    return import_files(paths, Options(kind, columns, Wishes(**wishes), **options))  # type: ignore[arg-type]


@pytest.fixture
def signals() -> dict[str, Floats]:
    return axis_signals()


def shared(folder: str) -> Path:
    """A folder of measured data; the test is skipped, with the reason, where it is missing."""
    path = SHARED / folder
    if not path.exists():
        pytest.skip(f"measured data {folder} is not in ../shared/data")
    return path
