"""The table of a batch: what was asked for in the words of the issue, and what was seen; then by cause."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from autotune.diagnosis.evidence.torque_path import CYCLES
from autotune.estimation.alignment import CURRENT_LOOP

Line = dict[str, Any]
ALLOWED = {"bouc_wen": {"reversal_memory"}}
"""Names that an alien may be given: it is that, by another law."""


def lines_of(path: Path) -> list[Line]:
    """What was run already; a line that was cut off at the end is run again."""
    out = []
    for text in path.read_text().splitlines() if path.exists() else []:
        try:
            out.append(json.loads(text))
        except json.JSONDecodeError:
            continue
    return out


def named_first(line: Line) -> bool:
    """The planted effect stands first among the names; in a pair both are there."""
    effects = line.get("effects") or []
    if line["kind"] == "pair":
        return set(line["truth"]) <= set(effects)
    return line.get("verdict") in ("named", "ambiguous") and effects[:1] == line["truth"]


def wrong(line: Line) -> bool:
    """Something is named that is not there."""
    true = set(line["truth"]) if line["kind"] not in ("removed", "alien", "null") else set()
    true |= {name for alien in line["truth"] for name in ALLOWED.get(alien, ())}
    return bool(set(line.get("effects") or []) - true)


def doubted(line: Line) -> bool:
    """A wrong name that is said to be one of several, the true one among them."""
    rivals = {name for group in line.get("confusable") or [] for name in group}
    return line.get("verdict") == "ambiguous" and bool(rivals & set(line["truth"]))


def strange(line: Line) -> bool:
    """An alien is called unknown, or by a name that it may have."""
    return line.get("verdict") == "unknown" or (bool(line.get("effects")) and not wrong(line))


def _is(verdict: str) -> Callable[[Line], bool]:
    return lambda line: line.get("verdict") == verdict


def _confirmed_wrongly(line: Line) -> bool:
    return wrong(line) and line["confidence"] == "confirmed"


def _share(rows: Sequence[Line], test: Callable[[Line], bool]) -> str:
    count = sum(test(row) for row in rows)
    return f"{count} of {len(rows)} ({100 * count / len(rows):.1f} %)"


def _ratios(rows: Sequence[Line]) -> str:
    over = [row["over_truth"] for row in rows if row.get("over_truth") is not None]
    if not over:
        return "not known"
    return f"median {np.median(over):.2f}, 90th percentile {np.percentile(over, 90):.2f} ({len(over)})"


_ROWS: tuple[tuple[str, str, str, Callable[[Line], bool]], ...] = (
    ("single", "singles at 1 and above: named first", "95 %", named_first),
    ("single", "singles: a wrong name", "1 %", lambda r: wrong(r) and not doubted(r)),
    ("single", "singles: unknown", "", _is("unknown")),
    ("single", "singles: none", "", _is("none")),
    ("single", "singles: fit or diagnosis refused", "", lambda r: r.get("verdict") in ("refused", "crash")),
    ("half", "singles at 0.5 to 0.9: named first", "85 %", named_first),
    ("half", "the same: a wrong name", "1 %", lambda r: wrong(r) and not doubted(r)),
    ("null", "nulls: a name", "1 %", wrong),
    ("null", "nulls: unknown", "3 %", _is("unknown")),
    ("null", "nulls: refused", "", lambda r: r.get("verdict") in ("refused", "crash")),
    ("alien", "aliens: unknown", "95 %", strange),
    ("alien", "aliens: a name", "", wrong),
    ("pair", "pairs: both named", "90 %", named_first),
    ("pair", "pairs: a wrong third", "3 %", wrong),
    ("removed", "true effect removed: a name", "3 %", lambda r: wrong(r) and not doubted(r)),
    ("lone", "single recordings: a wrong name", "3 %", lambda r: wrong(r) and not doubted(r)),
    ("lone", "single recordings: named first", "", named_first),
    ("second", "second files: a wrong name confirmed", "0.5 %", _confirmed_wrongly),
    ("second", "second files: a wrong name", "", lambda r: wrong(r) and not doubted(r)),
    ("second", "second files: named first", "", named_first),
    ("disturbed", "disturbed second files: a wrong name confirmed", "0.5 %", _confirmed_wrongly),
    ("disturbed", "disturbed second files: a wrong name", "", lambda r: wrong(r) and not doubted(r)),
    ("disturbed", "disturbed second files: named first", "", named_first),
)  # fmt: skip


def table(lines: Sequence[Line], head: str = "") -> str:
    """Markdown."""
    kinds: dict[str, list[Line]] = {}
    for line in lines:
        kinds.setdefault(line["kind"], []).append(line)
    out = [head, "| what | asked | seen |", "|---|---|---|"]
    for kind, words, asked, test in _ROWS:
        rows = [line for line in kinds.get(kind, []) if line["truth"] or test is not named_first]
        if rows:
            out.append(f"| {words} | {asked} | {_share(rows, test)} |")
    for kind in ("single", "half", "null", "pair"):
        if kind in kinds:
            out.append(
                f"| {kind}: error on unseen data over the true model's | 1.05, 1.3 | {_ratios(kinds[kind])} |"
            )
    out += [*_lags(lines), *_speed(lines), "", *_by(lines, "single", "half")]
    return "\n".join(out) + "\n"


def any_drives(line: Line) -> bool:
    """Whether all that a torque path is late by is what any drive may have: whole cycles and a current loop."""
    behind = [line["late"] - count * line["cycle"] for count in (0, *CYCLES)]
    return any(0.0 <= rest <= CURRENT_LOOP for rest in behind)


def _told(line: Line) -> bool:
    """Whether a lag is among the names, or how late the torque comes was told to within a fifth of it."""
    told = line.get("late_told")
    known = told is not None and abs(told - line["late"]) <= 0.2 * line["late"]
    return "torque_lag" in (line.get("effects") or []) or known


def _lags(lines: Sequence[Line]) -> list[str]:
    """Lags that are longer than any drive's, and those that are not: these are no effect, but their length is told."""
    rows = [r for r in lines if "torque_lag" in r["truth"] and r.get("late") and r["kind"] != "removed"]
    usual, long = [r for r in rows if any_drives(r)], [r for r in rows if not any_drives(r)]
    out = []
    if long:
        named = _share(long, lambda r: "torque_lag" in (r.get("effects") or []))
        out.append(f"| lags longer than any drive's: named | | {named} |")
    if usual:
        out.append(f"| lags as any drive's: named, or told to within a fifth | | {_share(usual, _told)} |")
    return out


def _speed(lines: Sequence[Line]) -> list[str]:
    """Processor time of the diagnosis, scaled to 140 s at 1 kHz where there are more rows."""
    spent = [r["cpu"] * min(1.0, 140e3 / r["rows"]) for r in lines if "cpu" in r and r.get("rows")]
    if not spent:
        return []
    seen = f"{np.median(spent):.1f}, {np.percentile(spent, 95):.1f}"
    return [f"| processor time for 140 000 rows [s]: median, 95th percentile | 7 | {seen} |"]


def _by(lines: Sequence[Line], *kinds: str) -> list[str]:
    """Named first, wrong, unknown by effect and by what surrounds it."""
    rows = [line for line in lines if line["kind"] in kinds]
    out: list[str] = []
    for what in ("effect", "colour", "stated", "loop", "columns", "cycle", "dead", "twin"):
        groups: dict[str, list[Line]] = {}
        for row in rows:
            groups.setdefault(str(row["truth"][0] if what == "effect" else row.get(what)), []).append(row)
        out += [f"| {what} | named first | wrong | verdicts |", "|---|---|---|---|"]
        for name, own in sorted(groups.items()):
            verdicts = ", ".join(
                f"{v} {n}" for v, n in Counter(str(r.get("verdict")) for r in own).most_common()
            )
            out.append(
                f"| {name} | {sum(map(named_first, own))} of {len(own)} | {sum(map(wrong, own))} | {verdicts} |"
            )
        out.append("")
    return out
