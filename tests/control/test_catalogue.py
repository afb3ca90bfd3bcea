"""What the catalogue recommends, and that it says no more of it than was asked of the axes within the intervals."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from autotune.control.gains.loop import Gains, cascade
from autotune.control.gains.twin import follow
from autotune.control.structures import catalogue
from autotune.control.structures.structure import (
    DIAGNOSED,
    NONE,
    STRUCTURES,
    Bench,
    bristle_of_all,
    run,
)
from tests.control.gains_axis import THESIS, TIMING, lugre


def entry(name: str, peak: float, effort: str) -> SimpleNamespace:
    structure = SimpleNamespace(name=name, effort=effort, in_host=False)
    return SimpleNamespace(structure=structure, sine_peak_error=peak, oscillates=False, robustness=1.0)


@pytest.mark.parametrize(
    ("gains", "bare"),
    [(THESIS, replace(THESIS, ki=0.0)), (cascade(40.0, 0.15, 3.0), cascade(40.0, 0.15, 0.0))],
    ids=["pid", "p_pi"],
)
def test_the_loops_of_the_axis_are_played_as_they_are(gains: Gains, bare: Gains) -> None:
    """Of a cascade, whose velocity loop is not told the reference's rate, PID errs by 59 mrad and was told with 35."""
    model = lugre().with_values({"offset": 0.0})
    bench = Bench(model, bristle_of_all(model), gains, TIMING, 1.0)
    time = np.arange(1500) * TIMING.period
    reference = 0.1 + 0.2 * np.sin(2.0 * np.pi * time)
    for name, loop in (("PID", gains), ("PD", bare)):
        structure = next(one for one in STRUCTURES if one.name == name)
        motion, _ = run(structure, bench, model, TIMING, reference)
        alone = follow(model, loop, TIMING, reference)
        assert motion.position == pytest.approx(alone.position, abs=2.0 * TIMING.resolution)
        assert np.ptp(alone.error) > 20.0 * TIMING.resolution


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
