"""An interrupted run is taken up where nothing has changed since, and told apart where something has."""

from __future__ import annotations

import json
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import pytest

from autotune.core.axis import Axis, read_axis
from autotune.core.errors import ConfigurationError, LinkTimeout
from autotune.core.loop import LocalLoop
from autotune.tuning.files import write_json
from autotune.tuning.findings import FILE_NAME
from autotune.tuning.progress import Silent
from autotune.tuning.request import Request as Asked
from autotune.tuning.resume import last_whole, stages_left
from autotune.tuning.run import Request, tune
from autotune_sim.inprocess import SimDrive
from autotune_sim.presets import preset
from tests.end_to_end.support import EXAMPLE

BEGUN = datetime(2026, 3, 1, 12, 0, 0)


class Said(Silent):
    """Keeps what a person would have read."""

    def __init__(self) -> None:
        self.sentences: list[str] = []

    def say(self, sentence: str) -> None:
        self.sentences.append(sentence)


def axis(**changes: Any) -> Axis:
    return read_axis(EXAMPLE).model_copy(update={"link": "sim://lugre", **changes})


def request(runs: Path, drive: SimDrive, now: datetime = BEGUN, **asked: Any) -> Request:
    given = {"axis": axis(), "reporter": Silent(), **asked}
    return Request(open_loop=lambda: LocalLoop(drive), runs=runs, clock=lambda: now, **given)


@pytest.fixture(scope="module")
def interrupted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs folder with one run whose link was lost right after the experiments."""
    runs = tmp_path_factory.mktemp("runs")
    said = Said()

    def lost(*_: object) -> None:
        raise LinkTimeout("nobody is there any more")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("autotune.tuning.stages.fit", lost)
        with pytest.raises(LinkTimeout):
            tune(request(runs, SimDrive(preset("lugre")), reporter=said))
    assert any(f"--resume {folder(runs).name}" in sentence for sentence in said.sentences)
    return runs


def folder(runs: Path) -> Path:
    return min(runs.glob("2*-edm-vertical"))


def test_what_is_left_after_a_stage() -> None:
    assert stages_left("experiment") == ("check", "fit", "diagnose", "adapt", "prove", "commit")
    assert stages_left("adapt") == ("check", "fit", "diagnose", "prove", "commit")


def test_only_and_resume_exclude_one_another(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="exclude"):
        tune(request(tmp_path, SimDrive(preset("lugre")), only="prove", resume="newest"))
    assert Asked is Request


def test_the_aborted_run_says_how_to_go_on(interrupted: Path) -> None:
    content = json.loads((folder(interrupted) / "run.json").read_text())
    assert content["outcome"] == "aborted"
    assert "--resume" in content["verdict"]
    assert last_whole(folder(interrupted)) == "experiment"


def test_where_nothing_is_whole_nothing_is_taken_up(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="run 'autotune run' without --resume"):
        tune(request(tmp_path, SimDrive(preset("lugre")), resume="newest"))


def test_an_unknown_run_is_answered_with_those_there_are(interrupted: Path) -> None:
    with pytest.raises(ConfigurationError, match=folder(interrupted).name):
        tune(request(interrupted, SimDrive(preset("lugre")), resume="20200101-000000-edm-vertical"))


def test_a_run_of_yesterday_is_too_old(interrupted: Path) -> None:
    late = BEGUN + timedelta(hours=25)
    with pytest.raises(ConfigurationError, match="friction follows temperature"):
        tune(request(interrupted, SimDrive(preset("lugre")), late, resume=folder(interrupted).name))


def test_another_drive_benchmark_or_limit_is_told(interrupted: Path) -> None:
    known = axis()
    slower = known.benchmark.model_copy(update={"amplitude": 0.1})
    tighter = known.limits.model_copy(update={"speed": 15.0})
    name = folder(interrupted).name
    for other, drive, word in (
        ({}, SimDrive(preset("lugre", 7)), "drive"),
        ({"benchmark": slower}, SimDrive(preset("lugre")), "benchmark"),
        ({"limits": tighter}, SimDrive(preset("lugre")), "limits"),
    ):
        with pytest.raises(ConfigurationError, match=f"another {word}"):
            tune(request(interrupted, drive, axis=axis(**other), resume=name))


def test_damaged_findings_are_no_traceback(interrupted: Path) -> None:
    path = folder(interrupted) / FILE_NAME
    sound = json.loads(path.read_text())
    try:
        write_json(path, {**sound, "baseline": {"nonsense": 1}})
        with pytest.raises(ConfigurationError, match="damaged"):
            tune(request(interrupted, SimDrive(preset("lugre")), resume=path.parent.name))
    finally:
        write_json(path, sound)


@pytest.mark.long
def test_a_resumed_run_ends_as_a_whole_one_and_does_not_measure_again(interrupted: Path) -> None:
    result = tune(
        request(interrupted, SimDrive(preset("lugre")), BEGUN + timedelta(hours=2), resume="newest")
    )
    assert result.outcome == "kept"
    assert "experiment" not in result.stages
    assert result.machine_seconds < 170.0
    assert any("2.0 h ago" in note for note in result.notes)
    assert result.committed is not None
    assert result.committed.peak_error < 0.25e-3
