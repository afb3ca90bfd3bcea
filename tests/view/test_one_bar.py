"""The bar of the model commands."""

from __future__ import annotations

import pytest

from autotune.cli.model import FIT_STEPS
from autotune.cli.one_bar import one_bar
from autotune.view.console import ConsoleProgress


def test_many_steps_are_one_bar(capsys: pytest.CaptureFixture[str]) -> None:
    """Off a terminal at most a line a tenth, whatever the number of steps; none names a step."""
    with one_bar("diagnose", 40) as step:
        for number in range(60):
            step(f"candidate {number}")
    err = capsys.readouterr().err
    assert err.count("\n") <= 12
    assert "candidate" not in err
    assert "✓ diagnose" in err


def test_what_is_left_goes_by_the_rows_and_by_long_steps(capsys: pytest.CaptureFixture[str]) -> None:
    """Two masses take most of a slow diagnosis: as they begin the bar is not near its end."""
    with one_bar("diagnose", 15, rows=140_000) as step:
        for number in range(36):
            step(f"candidate {number}")
        for number in range(7):
            step(f"refit inside the twin: {number}")
        step("motor and load fitted from elsewhere")
    err = capsys.readouterr().err
    assert "about 43 s in total" in err
    assert "70 %" not in err


def test_only_more_steps_than_foreseen_are_longer_than_usual(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a fit the two are known; what may always be to come is no sign that more does."""
    beyond: list[str] = []
    monkeypatch.setattr(ConsoleProgress, "beyond", lambda _, what: beyond.append(what))
    with one_bar("fit", FIT_STEPS) as step:
        for what in ("fit of all motion together", "fit of the model as it is", "another fit"):
            step(what)
    assert beyond == ["another fit"]
