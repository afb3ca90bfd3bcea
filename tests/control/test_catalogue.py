"""What the catalogue recommends, and that it says no more of it than was asked of the axes within the intervals."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from autotune.control.structures import catalogue
from autotune.control.structures.structure import DIAGNOSED, NONE


def entry(name: str, peak: float, effort: str) -> SimpleNamespace:
    structure = SimpleNamespace(name=name, effort=effort, in_host=False)
    return SimpleNamespace(structure=structure, sine_peak_error=peak, oscillates=False, robustness=1.0)


def test_how_much_closer_is_said_of_the_model_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """It was said of every axis within the intervals, where no more is asked than PID's own error."""
    monkeypatch.setattr(catalogue, "_swings", lambda *_: False)
    monkeypatch.setattr(catalogue, "_sine", lambda *_: None)
    monkeypatch.setattr(catalogue, "_peak", lambda *_: 0.9e-3)
    member = SimpleNamespace(timing=SimpleNamespace(resolution=1e-5))
    assert catalogue._robust(None, None, member, None, 1e-4, 1e-3)
    entries = [entry("PID", 1e-3, NONE), entry("diagnosed model's feedforward", 1e-4, DIAGNOSED)]
    name, why = catalogue.recommended(entries)
    assert name == "diagnosed model's feedforward"
    first, second, *_ = why.split(". ")
    assert first.endswith("10.0 times closer than PID on the benchmark's sine with the model as it is")
    assert "every axis within the intervals" in second
    assert "no more than PID" in second
