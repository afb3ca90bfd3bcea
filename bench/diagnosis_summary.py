"""Figures of many runs of `bench.diagnosis`, beside what is asked for.

    python -m bench.diagnosis_summary FILE...

The files hold the lines that `bench.diagnosis` printed.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

Line = dict[str, Any]
UNSTEADY = ("thermal_drift", "reversal_memory")
"""Differ from repeat to repeat, so that repeatability says nothing about their size."""
CLASSES = (("at least 1", 1.0, np.inf), ("0.5 to 1", 0.5, 1.0), ("below 0.5", -np.inf, 0.5))


def summary(lines: Sequence[Line]) -> str:
    """The table as text; an empty text for no runs."""
    kinds: dict[str, list[Line]] = {}
    for line in lines:
        kinds.setdefault(_kind(line), []).append(line)
    parts = [text for kind, rows in kinds.items() for text in _TABLES[kind](rows)]
    seconds = [line["seconds"] for line in lines]
    if seconds:
        parts.append(
            f"a diagnosis: median {np.median(seconds):.1f} s of processor time, longest {max(seconds):.1f}"
        )
    return "\n".join(parts)


def _kind(line: Line) -> str:
    planted = line["planted"]
    if not planted:
        return "null"
    if planted[0].startswith("alien "):
        return "alien"
    if planted[0].startswith("-"):
        return "removed"
    return "single" if len(planted) == 1 else "pair"


def _share(rows: Sequence[Line], right: list[bool]) -> str:
    return f"{sum(right)} of {len(rows)} ({100 * np.mean(right):.1f} %)" if rows else "none"


def _named(line: Line) -> bool:
    return line["verdict"] == "named" and set(line["effects"]) == set(line["planted"])


def _wrong(line: Line) -> bool:
    return bool(set(line["effects"]) - set(line["planted"]))


def _singles(rows: list[Line]) -> list[str]:
    parts = []
    for words, low, high in CLASSES:
        own = [r for r in rows if low <= r["ratio"] < high and r["planted"][0] not in UNSTEADY]
        if own:
            parts.append(f"single effects, repeatable residual over noise {words}: {_of_class(own)}")
    own = [r for r in rows if r["planted"][0] in UNSTEADY]
    if own:
        parts.append(f"single effects that do not repeat (drift, memory): {_of_class(own)}")
    return parts + _after_adding(rows)


def _of_class(rows: list[Line]) -> str:
    first = _share(rows, [r["rank"] == 1 for r in rows])
    third = _share(rows, [1 <= r["rank"] <= 3 for r in rows])
    exact = _share(rows, [_named(r) for r in rows])
    return f"first {first}, in the first three {third}, verdict exact {exact}, wrong name {_count(rows)}"


def _count(rows: list[Line]) -> int:
    return sum(_wrong(r) for r in rows)


def _after_adding(rows: list[Line]) -> list[str]:
    over = [r["over_truth"] for r in rows if np.isfinite(r["over_truth"])]
    sizes = [abs(c) for r in rows for c in r["coefficients"] if np.isfinite(c)]
    parts = []
    if over:
        parts.append(
            f"error on the test trajectory over that of the true model: median {np.median(over):.2f}, "
            f"90th percentile {np.percentile(over, 90):.2f} ({len(over)} runs)"
        )
    if sizes:
        parts.append(f"planted coefficients: median error {np.median(sizes):.1f} % ({len(sizes)})")
    return parts


def _pairs(rows: list[Line]) -> list[str]:
    both = _share(rows, [set(r["planted"]) <= set(r["effects"]) for r in rows])
    exact = _share(rows, [_named(r) for r in rows])
    return [
        f"pairs: both named {both}, exact {exact}, with a wrong name {_count(rows)}",
        *_after_adding(rows),
    ]


def _nulls(rows: list[Line]) -> list[str]:
    none = _share(rows, [r["verdict"] == "none" for r in rows])
    return [f"nothing planted: 'none' {none}, with a name {sum(bool(r['effects']) for r in rows)}"]


def _strangers(what: str, rows: list[Line]) -> list[str]:
    unknown = _share(rows, [r["verdict"] == "unknown" for r in rows])
    named = _share(rows, [bool(r["effects"]) for r in rows])
    return [f"{what}: 'unknown' {unknown}, with a name {named}"]


_TABLES = {
    "single": _singles,
    "pair": _pairs,
    "null": _nulls,
    "alien": lambda rows: _strangers("an effect outside the library", rows),
    "removed": lambda rows: _strangers("the true effect removed from the library", rows),
}


def main(names: list[str]) -> int:
    lines = [json.loads(text) for name in names for text in Path(name).read_text().splitlines() if text]
    sys.stdout.write(summary(lines) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
