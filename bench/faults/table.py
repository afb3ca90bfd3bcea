"""Results of a campaign as a table for people, and as they were written."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bench.faults.pool import Result

_EXAMPLES = 3


def read_results(path: Path | None) -> list[Result]:
    """Results of a file of JSON lines; a line that was cut off is left out."""
    if path is None or not path.is_file():
        return []
    results = []
    for line in path.read_text(encoding="utf-8").splitlines():
        try:
            content = json.loads(line)
        except ValueError:
            continue
        results.append(Result(**{**content, "findings": tuple(content["findings"])}))
    return results


def table(results: Sequence[Result]) -> str:
    """By kind of case, by finding, and how long it all took, in Markdown."""
    return "\n\n".join([_by_kind(results), _by_finding(results), _times(results)])


def _by_kind(results: Sequence[Result]) -> str:
    lines = ["| kind | runs | with a fault that happened | sound | findings |", "|---|---|---|---|---|"]
    for kind in sorted({result.kind for result in results}):
        mine = [result for result in results if result.kind == kind]
        found = Counter(name for result in mine for name in _names(result))
        happened = sum(bool(result.faults) for result in mine)
        said = ", ".join(f"{name} {count}" for name, count in found.most_common()) or "none"
        lines.append(f"| {kind} | {len(mine)} | {happened} | {sum(not r.findings for r in mine)} | {said} |")
    sound = sum(not result.findings for result in results)
    lines.append(f"| all | {len(results)} | {sum(bool(r.faults) for r in results)} | {sound} | |")
    return "\n".join(lines)


def _by_finding(results: Sequence[Result]) -> str:
    lines = ["| finding | runs | faults | for example |", "|---|---|---|---|"]
    names = Counter(name for result in results for name in _names(result))
    for name, count in names.most_common():
        mine = [result for result in results if name in _names(result)]
        faults = Counter(fault for result in mine for fault in (result.faults or result.done).split())
        usual = ", ".join(f"{fault} {number}" for fault, number in faults.most_common(5))
        shown = "; ".join(f"{r.seed}: {_first(r, name)}" for r in mine[:_EXAMPLES]).replace("|", "/")
        lines.append(f"| {name} | {count} | {usual} | {shown} |")
    return "\n".join(lines)


def _times(results: Sequence[Result]) -> str:
    lines = ["| | median | 95 % | longest |", "|---|---|---|---|"]
    for name, values in (
        ("case [s]", [r.seconds for r in results]),
        ("fault to rest [s]", [r.to_rest for r in results if r.to_rest is not None]),
        ("fault to power off [s]", [r.to_power_off for r in results if r.to_power_off is not None]),
    ):
        if values:
            middle, most = np.percentile(np.array(values), [50, 95])
            lines.append(f"| {name} | {middle:.2f} | {most:.2f} | {max(values):.2f} |")
    return "\n".join(lines)


def _names(result: Result) -> list[str]:
    return list(dict.fromkeys(finding.partition(":")[0] for finding in result.findings))


def _first(result: Result, name: str) -> str:
    return next(finding for finding in result.findings if finding.startswith(name))[:160]
