"""`autotune gains`, `catalogue` and `model curves` as their pages show them, on a simulated axis with a model."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from autotune.cli.main import main
from autotune.control.gains import members, search
from autotune.control.gains.loop import Gains
from autotune.control.gains.members import Family
from autotune.control.structures.catalogue import Catalogue, Trials, catalogue
from autotune.core.axis import read_axis
from autotune.core.paths import config_directory
from autotune.models.model_file import write_model
from autotune.tuning import catalogue as tuning_catalogue
from autotune.tuning import ceiling
from tests.control.gains_axis import lugre, vertical

ROOT = Path(__file__).resolve().parents[2]
VERDICT = {
    "gains", "structure", "bandwidth_hz", "phase_margin_deg", "gain_margin_db", "hunts", "hunting_frequency_hz",
    "hunting_amplitude", "stick_slip_below", "settling_time",
}  # fmt: skip
ENTRY = {"name", "sine_peak_error", "step_settling", "robustness", "torque_noise", "effort"}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An axis file, a run with a model, two more models."""
    monkeypatch.chdir(tmp_path)
    for name in ("SHAPES", "POPULATION"):
        monkeypatch.setattr(search, name, 8)
    for name, value in {"GENERATIONS": 2, "POLISHED": 4, "VALLEYS": 1, "SOUGHT": (4, 31)}.items():
        monkeypatch.setattr(search, name, value)
    monkeypatch.setattr(members, "_GROUPS", (("inertia", ("inertia",)),))
    monkeypatch.setattr(tuning_catalogue, "catalogue", once)
    monkeypatch.setattr(ceiling, "TRIALS", 1)
    monkeypatch.setattr(ceiling, "UNSEEN", ceiling.UNSEEN[-1:])
    text = (config_directory() / "axes" / "simulated.toml").read_text(encoding="utf-8")
    (tmp_path / "axis.toml").write_text(text, encoding="utf-8")
    axis = read_axis(tmp_path / "axis.toml")
    run = tmp_path / "runs" / "20261120-040000-simulated"
    run.mkdir(parents=True)
    write_model(replace(vertical(), axis=axis.name, fingerprint=axis.fingerprint), run / "model.toml")
    write_model(lugre(0.3, 0.31), tmp_path / "before.toml")
    write_model(lugre(0.3, 0.5), tmp_path / "after.toml")
    return tmp_path


@cache
def _whole(key: str) -> Catalogue:
    """The catalogue of the only axis here, worked out once."""
    return catalogue(*_asked[key])


_asked: dict[str, tuple[Family, Gains, Trials]] = {}


def once(kin: Family, gains: Gains, trials: Trials) -> Catalogue:
    _asked["the axis"] = kin, gains, trials
    return _whole("the axis")


def called(arguments: Sequence[str]) -> int:
    with pytest.raises(SystemExit) as ending:
        main(list(arguments))
    return int(ending.value.code or 0)


def shown(page: str) -> list[str]:
    """Command lines in a page's code blocks."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    blocks = re.findall(r"```\n(.*?)```", text, flags=re.S)
    return [line for block in blocks for line in block.splitlines() if line.startswith("autotune ")]


@pytest.mark.parametrize(
    "line",
    [
        pytest.param(line, marks=pytest.mark.slow) if line.endswith(("--apply", "--ceiling")) else line
        for line in (*shown("gains.md"), *shown("catalogue.md"))
    ],
)
def test_every_command_of_the_pages(folder: Path, line: str, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = shlex.split(line)[1:]
    code = called(arguments)
    out = capsys.readouterr()
    assert code in ((0, 3) if "--apply" in arguments else (0,)), out.err
    assert "Traceback" not in out.err
    if "--json" in arguments:
        content = json.loads(out.out)
        if arguments[0] == "gains":
            assert set(content["current"]) >= VERDICT
            assert set(content["proposed"]) >= VERDICT
            assert content["applied"] is False
        else:
            assert all(set(entry) >= ENTRY for entry in content["structures"])
            assert content["recommended"]
            assert content["ceiling"]["twin"]["learnt"] <= content["ceiling"]["twin"]["fixed"]
    for name in re.findall(r"--html (\S+)", line):
        assert (folder / name).read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_the_catalogue_is_the_thesis_s(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """PD 7, PID 2, LuGre feedforward 1 mrad, within 25 %; kinetic laws oscillate or do worse."""
    assert called(["catalogue", "axis.toml", "--json"]) == 0
    entries = {one["name"]: one for one in json.loads(capsys.readouterr().out)["structures"]}
    for name, peak in (("PD", 7e-3), ("PID", 2e-3), ("LuGre feedforward", 1e-3)):
        assert entries[name]["sine_peak_error"] == pytest.approx(peak, rel=0.25)
    assert entries["kinetic feedforward"]["sine_peak_error"] > entries["PID"]["sine_peak_error"]
    assert entries["kinetic linearisation"]["oscillates"]
    assert not any(
        one["offered"] for name, one in entries.items() if "observer" in name or "linearisation" in name
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["gains", "axis.toml", "--bandwidth", "900"], "it can be"),
        (["gains", "axis.toml", "--dead-time", "1"], "--dead-time is 1 s"),
        (["gains", "axis.toml", "--html", "nowhere/page.html"], "there is no folder"),
        (["gains", "axis.toml", "--runs", "empty"], "run 'autotune run'"),
        (["catalogue", "axis.toml", "--runs", "empty"], "run 'autotune run'"),
        (["model", "curves", "nothing.toml"], "nothing.toml"),
        (["gains", "axis.toml", "--controller", "pi kp=3"], "is not understood"),
        (["gains", "axis.toml", "--controller", "pid kp=1 kd=1 ki=1", "--apply"], "leave --controller out"),
        (["gains", "before.toml"], "before.toml is a model"),
        (["catalogue", "runs"], "runs is a folder"),
        (["model", "curves", "axis.toml"], "axis.toml is an axis file"),
    ],
)
def test_what_cannot_be_answered_is_said_in_words(
    folder: Path, arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert called(arguments) == 2
    assert words in capsys.readouterr().err


def test_curves_tell_falling_friction_from_rising(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert called(["model", "curves", "before.toml", "after.toml", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)["curves"]
    assert [one["name"] for one in content] == ["before", "after"]
    assert content[1]["monotonic"] is False
    assert content[1]["least_velocity_gain"] > content[0]["least_velocity_gain"]
    assert content[1]["falls_between"][0] < content[1]["falls_between"][1]
    assert called(["model", "curves", "after.toml"]) == 0
    assert "motion there needs a velocity gain (kd) of at least" in capsys.readouterr().out
    run = next(folder.glob("runs/*/model.toml"))
    assert called(["model", "curves", str(run)]) == 0
    assert "the model has no term that falls" in capsys.readouterr().out


@pytest.mark.slow
def test_named_gains_are_judged_instead_of_the_drive_s(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The thesis's pair: ki 2000 hunts at 26 Hz, told before it is tried; a velocity loop is judged as one."""
    assert called(["gains", "axis.toml", "--controller", "pid kp=16.4 kd=0.02 ki=2000", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["gains_from"] == "command line"
    assert content["current"]["hunts"] is True
    assert content["current"]["hunting_frequency_hz"] == pytest.approx(26.5, rel=0.1)
    assert content["current"]["hunting_amplitude"] == pytest.approx(0.09, rel=0.25)
    loop = "pi_velocity velocity_gain=0.15 integral_gain=60"
    assert called(["gains", "axis.toml", "--controller", loop]) == 0
    out = capsys.readouterr().out
    assert "Proposed for PI velocity control" in out
    assert "The gains named: the axis does not hunt" in out
    assert "Enter these by hand" in out
