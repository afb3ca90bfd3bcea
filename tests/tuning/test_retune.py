"""A worn axis is tuned again: what the drive can hold is taken where it helps, and drift accepted where it does not."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path

import pytest

from autotune.core.axis import Axis
from autotune.core.loop import LocalLoop
from autotune.monitoring.check import CheckRequest, check_axis
from autotune.monitoring.drift import Drift
from autotune.tuning.outcome import Outcome, RunResult
from autotune.tuning.progress import Silent
from autotune.tuning.run import Request, tune
from autotune_sim.effects import scale_friction
from autotune_sim.inprocess import SimDrive
from autotune_sim.presets import preset
from tests.drivers.simulator import axis_of


class Wearing:
    """An axis with one drive memory; `friction`: relative to new."""

    def __init__(self, folder: Path, axis: Axis) -> None:
        self.axis = axis.model_copy(update={"link": "sim://edm-vertical?memory=kept"})
        self.folder, self.friction, self.opened = folder, 1.0, 0
        self.now = datetime(2026, 3, 1, 3).astimezone()

    def clock(self) -> datetime:
        self.now += timedelta(minutes=10)
        return self.now

    def open(self) -> LocalLoop:
        self.opened += 1
        nominal = preset("edm-vertical")
        plant = scale_friction(nominal.plant, self.friction)
        plant = replace(plant, viscous=plant.viscous * self.friction)
        return LocalLoop(SimDrive(replace(nominal, plant=plant), self.opened, self.folder / "memory.json"))

    def tuned(self, gain: float | None) -> RunResult:
        return tune(Request(self.axis, self.open, self.folder / "runs", Silent(), self.clock, gain=gain))

    def checked(self) -> tuple[Drift, str]:
        verdict = check_axis(
            CheckRequest(self.axis, self.open, self.folder / "runs", Silent(), self.clock)
        ).verdict
        return verdict.drift, verdict.sentence


@pytest.fixture
def wearing(tmp_path: Path) -> Callable[[], Wearing]:
    return lambda: Wearing(tmp_path, axis_of())


@pytest.mark.slow
@pytest.mark.long
def test_a_worn_axis_is_never_worse_and_not_told_as_drifted_for_ever(wearing: Callable[[], Wearing]) -> None:
    here = wearing()
    assert here.tuned(None).outcome is Outcome.KEPT
    here.friction = 1.2
    assert here.checked()[0] is Drift.SUSPECTED
    first = here.tuned(0.0)
    assert first.outcome in (Outcome.KEPT, Outcome.NOT_APPLIED)
    assert here.checked()[0] is Drift.NONE

    asked_too_much = here.tuned(0.9)
    assert asked_too_much.outcome is Outcome.NOT_APPLIED
    assert "checks compare with what this run has found" in asked_too_much.verdict
    accepted = json.loads((asked_too_much.run_directory / "accepted.json").read_text())
    assert accepted["peak_error"] == pytest.approx(asked_too_much.before.peak_error)
    assert asked_too_much.run_directory.name in here.checked()[1]
    here.friction = 1.5
    assert here.checked()[0] is Drift.SUSPECTED, "what moves further is told"
