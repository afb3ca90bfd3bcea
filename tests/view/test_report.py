"""The report: self-contained, escaped, complete, written in one step."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest

from autotune.view import figures
from autotune.view.report import Change, Picture, Report, Table, render, write_report
from autotune.view.report_tables import (
    Parameter,
    Written,
    limit_facts,
    parameter_table,
    proof_table,
    written_table,
)
from autotune.view.web_files import plotly_script

GLITCH = Change("Quadrant glitch", 2.04e-3, 0.497e-3, "rad", (-1.58e-3, -1.51e-3))


class Outline(HTMLParser):
    """Checks nesting, and collects what a page would load from elsewhere."""

    VOID = frozenset({"meta", "br", "img", "link", "input", "hr"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.loaded: list[str] = []
        self.seen: list[str] = []
        self.data: dict[str, str] = {}

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.seen.append(tag)
        self.loaded += [str(value) for name, value in attrs if name in ("src", "href") and value]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open, tag
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open:
            self.data[self.open[-1]] = self.data.get(self.open[-1], "") + data


def outline(text: str) -> Outline:
    parsed = Outline()
    parsed.feed(text)
    assert parsed.open == []
    return parsed


@pytest.fixture(scope="module")
def report(sampled) -> Report:
    pictures = [
        Picture("Before and after", "The glitch falls.", figures.before_after(sampled.before_after)),
        Picture("Steady state", "Friction over speed.", figures.steady_state(sampled.steady_state)),
        Picture("Presliding", "A spring.", figures.presliding(sampled.presliding)),
        Picture("Dahl's curve", "Hysteresis.", figures.dahl_curve(sampled.dahl)),
        Picture("Convergence", "They settle.", figures.convergence(sampled.traces)),
    ]
    tables = [
        parameter_table([Parameter("coulomb", 0.272, 0.003, "N m", "refined")]),
        written_table([Written("feedforward.coulomb", 0.0, 0.272, "N m")]),
        proof_table([GLITCH], 6),
    ]
    return Report(
        "edm-vertical",
        "kept",
        "The quadrant glitch is 4.1 times smaller.",
        "Tuned on 20 November 2026",
        [GLITCH],
        pictures,
        tables,
        {"Drive": "EPOS4 <rev 2>", "Link": "canopen+slcan:///dev/ttyACM0?bitrate=1&node=5"},
        limit_facts({"position_min": (-20.0, "rad")}),
        ["Sign below."],
        {"outcome": "kept", "note": "</pre><script>"},
    )


@pytest.fixture(scope="module")
def text(report: Report) -> str:
    return render(report)


def without_plotly(text: str) -> str:
    assert text.count(plotly_script()) == 1
    return text.replace(plotly_script(), "")


def test_page_is_well_formed_and_loads_nothing(text: str) -> None:
    parsed = outline(without_plotly(text))
    assert parsed.loaded == []
    assert parsed.seen.count("figure") == 5
    assert "@import" not in text.split("<script>")[0]


def test_page_is_small(text: str) -> None:
    assert len(text.encode()) <= 1_500_000


def test_the_script_is_the_one_that_the_figures_are_for() -> None:
    from plotly.offline import get_plotlyjs_version

    assert f"plotly.js (basic - minified) v{get_plotlyjs_version()}" in plotly_script()[:200]


def test_figures_need_no_more_than_the_basic_script_has(sampled) -> None:
    drawn = [
        figures.residual_over_coordinate(sampled.residual), figures.measured_and_model(sampled.comparison),
        figures.ranking(sampled.ranks), figures.staircase(sampled.steps), figures.before_after(sampled.before_after),
        figures.convergence(sampled.traces), figures.history(sampled.history), figures.dahl_curve(sampled.dahl),
    ]  # fmt: skip
    assert {trace.type for figure in drawn for trace in figure.data} <= {"scatter", "bar", "pie"}


def test_verdict_stands_before_figures_and_tables(text: str) -> None:
    order = [
        text.index(part)
        for part in ("4.1 times smaller", "<figure>", "<table>", "Limits in force", "Accepted")
    ]
    assert order == sorted(order)
    assert "Improved and kept" in text


def test_numbers_are_in_readable_units_with_their_interval(text: str) -> None:
    assert '<span class="value">2.04</span> <span class="unit">mrad</span>' in text
    assert '<span class="value">0.497</span>' in text
    assert "4.1 times smaller" in text
    assert "Difference −1.58 to −1.51 mrad with 99\u00a0% confidence" in text


def test_text_from_outside_is_escaped(text: str) -> None:
    assert "EPOS4 &lt;rev 2&gt;" in text
    assert "</pre><script>" not in text


def test_data_for_machines_can_be_read_back(text: str) -> None:
    assert json.loads(outline(without_plotly(text)).data["pre"])["note"] == "</pre><script>"


def test_tables_say_value_interval_and_meaning(text: str) -> None:
    assert "Coulomb friction" in text
    assert "272.0 ± 5.9 mN m" in text
    assert "272 mN m" in text
    assert "−1.58 … −1.51 mrad (99 %)" in text


@pytest.mark.parametrize(
    ("before", "after", "expected"),
    [
        (2.0, 0.5, "4 times smaller"),
        (2.0, 4.0, "2 times larger"),
        (2.0, 0.01, "200 times smaller"),
        (2.0, 2.0, "unchanged"),
        (0.0, 0.0, ""),
        (None, 1.0, ""),
    ],
)
def test_factor_in_words(before: float | None, after: float | None, expected: str) -> None:
    text = render(Report("a", "information", "b", changes=[Change("c", before, after, "rad")]))
    assert re.findall(r'class="factor">([^<]*)', text) == ([expected] if expected else [])


def test_each_cell_carries_its_columns_name_for_narrow_screens(text: str) -> None:
    assert 'data-column="Drive parameter"' in text
    assert "@media (max-width:640px)" in text


def test_what_is_in_the_drive_has_a_curve_of_its_own(sampled) -> None:
    halved = replace(sampled.before_after, committed=0.5 * sampled.before_after.before)
    names = [str(trace.name) for trace in figures.before_after(halved).data]
    assert any(name.startswith("the drive by itself: peak") for name in names)
    assert not any(
        "by itself" in str(trace.name) for trace in figures.before_after(sampled.before_after).data
    )


@pytest.mark.parametrize(
    "outcome",
    [
        "kept",
        "host_only",
        "rolled_back",
        "not_applied",
        "proved",
        "aborted",
        "checked",
        "stage",
        "information",
    ],
)
def test_report_without_anything_measured(outcome) -> None:
    text = render(Report("x", outcome, "Stopped by the guard.", sign_off=False))
    parsed = outline(text)
    assert "script" not in parsed.seen
    assert "figure" not in parsed.seen
    assert "Signature" not in text


def test_hostile_title() -> None:
    text = render(Report("</title><script>alert(1)</script>", "kept", "<img src=x>", "&"))
    parsed = outline(text)
    assert "script" not in parsed.seen
    assert "img" not in parsed.seen


def test_file_is_replaced_in_one_step(tmp_path: Path, report: Report) -> None:
    path = tmp_path / "report.html"
    write_report(path, report)
    first = path.read_text(encoding="utf-8")
    assert first.endswith("</html>\n")
    broken = Report("x", "kept", "y", tables=[Table("t", ("a", "b"), [("only one",)])])
    with pytest.raises(ValueError, match="zip"):
        write_report(path, broken)
    assert path.read_text(encoding="utf-8") == first
    assert [entry.name for entry in tmp_path.iterdir()] == ["report.html"]


def test_missing_folder_is_an_os_error(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="report"):
        write_report(tmp_path / "none" / "report.html", Report("x", "kept", "y"))


CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on this host to draw the report with")
def test_browser_draws_every_figure_without_a_network(tmp_path: Path, report: Report) -> None:
    path = tmp_path / "report.html"
    write_report(path, report)
    command = [
        str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
        "--disable-background-networking", "--disable-component-update", "--disable-sync",
        "--host-resolver-rules=MAP * ~NOTFOUND", f"--user-data-dir={tmp_path / 'profile'}",
        "--virtual-time-budget=8000", "--dump-dom", path.as_uri(),
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, timeout=120, check=False)
    page = done.stdout.decode(errors="replace")
    assert page.count('class="plotly-graph-div js-plotly-plot"') == 5
    assert page.count("before: peak 2.0") >= 1
    body = page.partition("<main>")[2]
    assert "Download plot" in body  # of the bar over a figure
    assert "Share chart" not in body
