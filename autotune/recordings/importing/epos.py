"""The CSV that maxon's EPOS Studio writes from the drive's data recorder.

`Key:;value` lines (firmware, recorded objects, `Sampling period:;51.200` in ms, `Scale` — the axes of
the plot, not of the data), then a line `;name;name`, a line of units `ms;rpm;%`, then numbers. Fields
are cut by `;`; depending on the computer's language the decimal sign is a comma. A spreadsheet that saves
such a file ends each line with as many empty cells as its longest has (`Sampling period:;51.200,,`).
"""

from __future__ import annotations

import re
from pathlib import Path

from autotune.core.errors import RecordingError
from autotune.recordings.importing.delimited import table_source
from autotune.recordings.importing.dialect import Dialect, decode
from autotune.recordings.importing.source import Column, Source, foreign_bytes, refuse_other_format

_KEYS = ("Sampling period:", "Recorded samples:", "Max. samples:", "Index:", "Trigger:")
_PADDING = ",; \t"


def read_epos(path: Path) -> Source:
    """Opens a recording of EPOS Studio.

    Raises:
        RecordingError: missing, empty, or not such a file.
    """
    start = foreign_bytes(path)
    refuse_other_format(path, start)
    text, encoding = decode(path, start)
    lines = re.split(r"\r\n|\n|\r", text)
    keys = _keys(lines)
    head = next((i for i, line in enumerate(lines) if line.startswith(";") and line.strip("; \t")), None)
    if not keys or head is None or head + 2 >= len(lines):
        raise RecordingError(
            f"{path} is no recording of EPOS Studio: there is no line '{_KEYS[0]};…' or no line of names before the "
            "numbers; export it from the data recorder as CSV, or use --format csv"
        )
    names = _cells(lines[head], 2)
    units = _cells(lines[head + 1], len(names))
    if len(names) != len(units) or len(names) < 2:
        raise RecordingError(f"{path}: {len(names)} names but {len(units)} units; export the recording again")
    row = _cells(lines[head + 2], len(names))
    decimal = "," if any("," in value for value in row) else "."
    columns = tuple(
        Column(name or "time", unit, value) for name, unit, value in zip(names, units, row, strict=False)
    )
    if len(columns) != len(names):
        raise RecordingError(
            f"{path}: the first row has {len(row)} numbers for {len(names)} names; export again"
        )
    dialect = Dialect(encoding, ";", decimal, head + 2, columns, ("number",) * len(columns), True)
    return table_source(path, dialect, _period(path, keys), _notes(keys))


def _cells(line: str, least: int) -> list[str]:
    """Fields of a line; empty ones at its end beyond `least` are a spreadsheet's."""
    cells = [cell.strip().strip('"').strip() for cell in line.rstrip(", \t").split(";")]
    while len(cells) > least and not cells[-1]:
        cells.pop()
    return cells


def _keys(lines: list[str]) -> dict[str, list[str]]:
    """`Key:;a;b` lines by key."""
    found = {}
    for line in lines[:100]:
        key, separator, rest = line.rstrip(_PADDING).strip().strip('"').partition(":;")
        if separator and f"{key}:" in _KEYS:
            found[key] = rest.split(";")
    return found if "Sampling period" in found else {}


def _period(path: Path, keys: dict[str, list[str]]) -> float:
    text = keys["Sampling period"][0].replace(",", ".").strip()
    try:
        period = float(text) * 1e-3
    except ValueError:
        period = 0.0
    if not 0.0 < period < 1e4:
        raise RecordingError(f"{path}: the sampling period {text!r} must be a number of ms above 0")
    return period


def _notes(keys: dict[str, list[str]]) -> list[str]:
    return [f"sampling period {keys['Sampling period'][0].strip()} ms, as the recorder says"]
