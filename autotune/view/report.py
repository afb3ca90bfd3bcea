"""The report that a commissioning engineer looks at, signs and files: one HTML file, no network.

Verdict first, then the numbers before and after, figures, tables, what to do next, and lines to sign.
The basic part of plotly's script (lines and bars) is embedded once, so the file opens on any machine, also years from
now, and has less than 1.5 MB.
"""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from autotune.view import report_page as page

if TYPE_CHECKING:
    import plotly.graph_objects as go

Outcome = Literal[
    "kept", "host_only", "rolled_back", "not_applied", "proved", "aborted", "checked", "stage", "information"
]


@dataclass(frozen=True, slots=True)
class Change:
    """One number before and after, shown large. SI; `unit` as in `autotune.view.scale.multiple`.

    Attributes:
        interval: confidence interval of the difference after − before, in `unit`; None if unknown.
        confidence: of that interval, 0…1.
        note: one short sentence, such as what the number means.
    """

    name: str
    before: float | None
    after: float | None
    unit: str
    interval: tuple[float, float] | None = None
    confidence: float = 0.99
    note: str = ""


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure with a title and a caption of one sentence that says what to see in it."""

    title: str
    caption: str
    figure: go.Figure


@dataclass(frozen=True, slots=True)
class Table:
    """A table of texts; columns whose index is in `numeric` are aligned to the right."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[str]]
    note: str = ""
    numeric: frozenset[int] = frozenset()


@dataclass(frozen=True, slots=True)
class Report:
    """All that a report says.

    Attributes:
        title: such as the axis's name.
        outcome: decides badge and colour.
        verdict: one to three sentences in plain words.
        subtitle: what was done and when, in words.
        changes: numbers before and after.
        identity: machine, drive and link, name → text.
        limits: limits that were used, name → text.
        next_steps: what the reader should do now.
        data: the same in machine-readable form, such as the content of run.json.
        sign_off: whether there are lines to sign.
    """

    title: str
    outcome: Outcome
    verdict: str
    subtitle: str = ""
    changes: Sequence[Change] = ()
    pictures: Sequence[Picture] = ()
    tables: Sequence[Table] = ()
    identity: Mapping[str, str] = field(default_factory=dict)
    limits: Mapping[str, str] = field(default_factory=dict)
    next_steps: Sequence[str] = ()
    data: Mapping[str, Any] | None = None
    sign_off: bool = True


def write_report(path: str | Path, report: Report) -> None:
    """Writes the report, replacing the file in one step.

    Raises:
        OSError: the file cannot be written; the one that was there before is untouched.
    """
    path = Path(path)
    temporary = path.with_name(path.name + ".part")
    try:
        temporary.write_text(render(report), encoding="utf-8")
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


def render(report: Report) -> str:
    """The report as HTML text."""
    parts = [
        page.head(report.title, report.subtitle),
        page.verdict(report.outcome, report.verdict),
        page.changes([_change(change) for change in report.changes]),
        page.steps(report.next_steps),
        *(_picture(number, picture) for number, picture in enumerate(report.pictures, 1)),
        *(page.table(t.title, t.columns, t.rows, t.note, t.numeric) for t in report.tables),
        page.facts("Machine and drive", report.identity),
        page.facts("Limits in force", report.limits),
        page.machine_readable(_json(report.data)) if report.data is not None else "",
        page.sign_off() if report.sign_off else "",
    ]
    return page.document(report.title, "\n".join(part for part in parts if part), _script(report))


def _script(report: Report) -> str:
    if not report.pictures:
        return ""
    from autotune.view.web_files import plotly_script

    return plotly_script()


def _picture(number: int, picture: Picture) -> str:
    import plotly.io

    name = f"figure-{number}"
    body = plotly.io.to_html(
        picture.figure,
        full_html=False,
        include_plotlyjs=False,
        div_id=name,
        default_width="100%",
        default_height=f"{int(picture.figure.layout.height or 400)}px",
        config={
            "displaylogo": False,
            "showSendToCloud": False,  # a report stays where it is
            "plotlyServerURL": "",
            "responsive": True,
            "displayModeBar": "hover",
            "modeBarButtonsToRemove": ["select2d", "lasso2d", "autoScale2d", "zoomIn2d", "zoomOut2d"],
            "toImageButtonOptions": {"format": "svg", "filename": name},
        },
    )
    return page.picture(number, picture.title, picture.caption, str(body))


def _change(change: Change) -> page.Shown:
    from autotune.view.scale import multiple, significant

    known = [abs(v) for v in (change.before, change.after) if v is not None]
    factor, unit = multiple(max(known, default=0.0), change.unit)
    before, after = (None if v is None else significant(v * factor) for v in (change.before, change.after))
    note = change.note
    if change.interval is not None:
        low, high = (significant(edge * factor) for edge in change.interval)
        level = f"{100 * change.confidence:g}\u00a0%"
        note = (
            f"Difference {low} to {high} {unit} with {level} confidence. {note[:1].upper()}{note[1:]}".strip()
        )
    return page.Shown(change.name, before, after, unit, _factor(change), note)


def _factor(change: Change) -> str:
    if not change.before or change.after is None or change.before < 0 or change.after <= 0:
        return ""
    ratio = change.before / change.after
    if ratio >= 1.005:
        return f"{ratio:.2g} times smaller" if ratio < 10 else f"{ratio:.0f} times smaller"
    if ratio <= 0.995:
        return f"{1 / ratio:.2g} times larger" if ratio > 0.1 else f"{1 / ratio:.0f} times larger"
    return "unchanged"


def _json(data: Mapping[str, Any]) -> str:
    return json.dumps(data, indent=2, ensure_ascii=False, default=str)
