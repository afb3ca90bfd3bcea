"""Whole runs on axes that must not be tuned, or not even be powered: refused in words, early, with nothing written."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from autotune import __version__
from autotune.core.axis import Axis, read_axis
from autotune.core.drive import Command, Mode, Sample
from autotune.core.errors import GuardStop, LinkTimeout
from autotune.core.loop import LocalLoop, Loop
from autotune.monitoring.check import CheckRequest, check_axis
from autotune.tuning.findings import FILE_NAME as FINDINGS
from autotune.tuning.findings import latest_run
from autotune.tuning.link_check import check_link
from autotune.tuning.outcome import Outcome, RunResult
from autotune.tuning.progress import Silent
from autotune.tuning.recording_run import record_programme
from autotune.tuning.run import Request, tune
from autotune.tuning.run_directory import make_run_directory
from autotune_sim.inprocess import SimDrive
from autotune_sim.presets import Gains, Preset, preset
from tests.end_to_end.support import EXAMPLE

Load = Callable[[float], float]


class Watched(SimDrive):
    """Counts how often power came on; its plant may carry a load that changes in time [N m]."""

    def __init__(self, axis: Preset, load: Load | None = None) -> None:
        super().__init__(axis)
        self.powered = 0
        self._load, self._offset = load, axis.plant.offset

    def enable(self, mode: Mode) -> None:
        self.powered += 1
        super().enable(mode)

    def step(self, command: Command) -> Sample:
        if self._load is not None:
            self.servo._plant["offset"][0] = self._offset + self._load(self.servo.time)
        return super().step(command)


def axis(**limits: float) -> Axis:
    read = read_axis(EXAMPLE).model_copy(update={"link": "sim://edm-vertical"})
    return read.model_copy(update={"limits": read.limits.model_copy(update=limits)})


def run(drive: SimDrive, runs: Path, **asked: Any) -> RunResult:
    return tune(Request(axis(), lambda: LocalLoop(drive), runs, Silent(), datetime.now, **asked))


def test_a_load_that_swings_is_refused_after_seconds(tmp_path: Path) -> None:
    drive = Watched(preset("edm-vertical"), lambda time: 0.1 * math.sin(1.7 * time))
    before = drive.read_parameters()
    result = run(drive, tmp_path)
    assert (result.outcome, result.exit_code) == (Outcome.NOT_APPLIED, 3)
    assert "load changes" in result.verdict
    assert result.machine_seconds < 10.0
    assert drive.read_parameters() == before


@pytest.mark.parametrize("gains", [Gains(ki=24_000.0), Gains(kd=0.05)], ids=["integral", "damping"])
def test_a_loop_near_instability_is_refused_in_words(tmp_path: Path, gains: Gains) -> None:
    drive = Watched(replace(preset("edm-vertical"), gains=gains))
    result = run(drive, tmp_path)
    assert (result.outcome, result.exit_code) == (Outcome.NOT_APPLIED, 3)
    assert "oscillates by itself" in result.verdict
    assert result.machine_seconds < 10.0


def test_a_single_stage_that_is_refused_is_no_success(tmp_path: Path) -> None:
    drive = Watched(preset("edm-vertical"), lambda time: 0.1 * math.sin(1.7 * time))
    assert run(drive, tmp_path, only="experiment").exit_code == 3


def test_a_check_says_what_it_saw_and_never_powers(tmp_path: Path) -> None:
    drive = Watched(preset("edm-vertical"))
    result = run(drive, tmp_path, only="check")
    assert result.exit_code == 0
    assert drive.powered == 0
    assert result.machine_seconds == 0.0
    assert "stands at 0 rad" in result.verdict
    page = (result.run_directory / "report.html").read_text()
    assert "Nothing applied" not in page
    assert "Signature" not in page
    assert ">Checked<" in page
    assert f"autotune {__version__}" in page


def test_a_check_does_not_hide_what_an_earlier_run_has_found(tmp_path: Path) -> None:
    """Regression: a proved run could not be committed any more after it."""
    earlier = make_run_directory(tmp_path, axis().name, datetime.now())
    (earlier / FINDINGS).write_text("{}")
    assert run(Watched(preset("edm-vertical")), tmp_path, only="check").exit_code == 0
    assert latest_run(tmp_path, axis(), FINDINGS) == earlier


@pytest.mark.parametrize("only", ["check", None, "experiment"])
def test_an_axis_outside_its_travel_is_never_powered(tmp_path: Path, only: str | None) -> None:
    drive = Watched(preset("edm-vertical"))
    outside = axis(position_min=5.0)
    with pytest.raises(GuardStop, match=r"limits\.position_min allows 5"):
        tune(Request(outside, lambda: LocalLoop(drive), tmp_path, Silent(), datetime.now, only=only))
    assert drive.powered == 0
    content = json.loads(next(tmp_path.glob("2*/run.json")).read_text())
    assert content["outcome"] == "aborted"
    page = next(tmp_path.glob("2*/report.html")).read_text()
    assert "Signature" not in page


def unreachable() -> Loop:
    raise LinkTimeout("nobody is there")


@pytest.mark.parametrize("what", ["run", "check", "link", "record"])
def test_a_failed_connection_leaves_no_folder(tmp_path: Path, what: str) -> None:
    request = Request(axis(), unreachable, tmp_path, Silent(), datetime.now)
    doing: dict[str, Callable[[], object]] = {
        "run": lambda: tune(request),
        "check": lambda: check_axis(
            CheckRequest(axis(), unreachable, tmp_path, Silent(), lambda: datetime.now().astimezone())
        ),
        "link": lambda: check_link(request, None),
        "record": lambda: record_programme(request, "benchmark", tmp_path / "out.csv"),
    }
    with pytest.raises(LinkTimeout):
        doing[what]()
    assert [path.name for path in tmp_path.iterdir() if path.is_dir()] == []
