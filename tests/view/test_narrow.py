"""On a screen of 400 pixels nothing of a report is cut: no column, no legend, no name below a bar; on one of
1200 pixels an arrow stands before the number that it points at.
"""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from autotune.view import figures
from autotune.view.data import Step
from autotune.view.report import Change, Picture, Report, write_report
from autotune.view.report_tables import Parameter, Written, parameter_table, written_table
from tests.workbench.browser import browser, needs_browser

OUTSIDE = """
return [...document.querySelectorAll('main :not(svg):not(svg *), main svg text')].filter(one => {
  const box = one.getBoundingClientRect(), frame = one.closest('figure');
  const edge = frame ? Math.min(frame.getBoundingClientRect().right, innerWidth) : innerWidth;
  return box.width && (box.right > edge + 1 || box.left < -1);
}).map(one => one.tagName + ' ' + (one.textContent || '').slice(0, 60));
"""
SHOWN = "return [...document.querySelectorAll('.xtick text')].map(one => one.textContent);"
STEPS = [Step("as identified", 0.17), Step("+ reversal_memory", 0.0226), Step("+ torque_ripple", 0.0185),
         Step("reversal_memory resolved", 0.0135)]  # fmt: skip


@needs_browser
@pytest.mark.long
def test_at_400_pixels_nothing_is_cut(sampled, tmp_path: Path) -> None:
    drawn = {
        "Before and after": figures.before_after(sampled.before_after),
        "Steady state": figures.steady_state(sampled.steady_state),
        "Presliding": figures.presliding(sampled.presliding),
        "Dahl's curve": figures.dahl_curve(sampled.dahl),
        "Adaptation": figures.convergence(sampled.traces),
        "Candidates": figures.ranking(sampled.ranks),
        "Stairs": figures.staircase(STEPS, 0.0119),
    }
    tables = [
        parameter_table([Parameter("micro_damping", 0.115, 0.002, "N m s/rad", "refined")]),
        written_table([Written("feedforward.stribeck_velocity", 0.0, 0.272, "rad/s")]),
    ]
    report = Report(
        "edm-vertical", "kept", "The quadrant glitch is 4.1 times smaller.",
        changes=[Change("Quadrant glitch", 2.04e-3, 0.497e-3, "rad", (-1.58e-3, -1.51e-3))],
        pictures=[Picture(name, name, figure) for name, figure in drawn.items()], tables=tables,
    )  # fmt: skip
    write_report(tmp_path / "report.html", report)
    with browser(tmp_path, width=400, height=850) as driver:
        driver.set_window_size(400, 850)
        driver.get((tmp_path / "report.html").as_uri())
        time.sleep(3.0)
        driver.execute_script("window.dispatchEvent(new Event('resize'))")
        time.sleep(1.0)
        assert driver.execute_script("return document.documentElement.scrollWidth - innerWidth") <= 0

        assert driver.execute_script(OUTSIDE) == []
        names = driver.execute_script(SHOWN)
        assert [
            step.name for step in STEPS if not any(step.name.replace("_", " ") in one for one in names)
        ] == []


HANGING = """
return [...document.querySelectorAll('.arrow')].filter(arrow => {
  const box = arrow.getBoundingClientRect();
  const after = arrow.closest('.pair').querySelector('.after').getBoundingClientRect();
  return box.right > after.left || box.top > after.bottom || box.bottom < after.top;
}).length;
"""


@needs_browser
@pytest.mark.long
@pytest.mark.parametrize("width", [400, 768, 1200, 1600])
def test_an_arrow_stands_before_what_it_points_at(tmp_path: Path, width: int) -> None:
    names = ("Peak error, the drive by itself", "Rms error", "Largest single error")
    changes = [Change(name, 12.04e-3, 1.497e-3, "rad", (-1.58e-3, -1.51e-3)) for name in names]
    write_report(tmp_path / "report.html", Report("edm-vertical", "kept", "It is smaller.", changes=changes))
    with browser(tmp_path, width=width, height=850) as driver:
        driver.get((tmp_path / "report.html").as_uri())
        assert driver.execute_script("return document.querySelectorAll('.arrow').length") == 3
        assert driver.execute_script(HANGING) == 0
