"""`autotune export` as a person calls it: files, what is left out, wrong input."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from autotune.cli.main import main
from autotune.models.model_file import read_model, write_model

from .support import MODELS, with_effects

MODEL = str(MODELS / "seed-3.toml")


def called(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    """Exit code, standard output, standard error."""
    with pytest.raises(SystemExit) as ended:
        main(["export", *arguments])
    said = capsys.readouterr()
    return int(ended.value.code or 0), said.out, said.err


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """A run's folder as far as an export reads it."""
    folder = tmp_path / "20260301-120000-one"
    folder.mkdir()
    lugre = {
        "inertia": 6.5e-4, "viscous": 4e-3, "coulomb": 0.27, "stiffness": 41.0, "micro_damping": 0.08,
        "offset": 0.05, "break_away": 0.27, "stribeck_velocity": 1.0,
    }  # fmt: skip
    found: dict[str, Any] = {
        "schema": 1, "better": True, "law": "model", "proposed": lugre,
        "made_with": {
            "cycle": 1e-3,
            "limits": {"torque": 1.34, "speed": 20.0, "position_min": -20.0, "position_max": 20.0},
            "benchmark": {"amplitude": 0.2, "frequency": 1.0, "repeats": 6, "periods": 3},
        },
    }  # fmt: skip
    (folder / "findings.json").write_text(json.dumps(found))
    for name in ("feedforward.toml", "model.toml"):
        write_model(read_model(MODEL), folder / name)
    return folder


def changed(run: Path, **values: Any) -> Path:
    path = run / "findings.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | values))
    return run


def test_json_names_files_and_what_is_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_model(with_effects("thermal_drift", "spring"), tmp_path / "m.toml")
    out = tmp_path / "made"
    code, printed, said = called(capsys, str(tmp_path / "m.toml"), "--to", "c", "--out", str(out), "--json")
    told = json.loads(printed)
    assert code == 0
    assert told["target"] == "c"
    assert told["cycle"] == 1e-3
    assert told["left_out"][0]["effect"] == "thermal_drift"
    assert told["left_out"][0]["cost_rms"] > 0.0
    assert [Path(file).name for file in told["files"]] == ["autotune_ff.h", "autotune_ff.c"]
    assert all(Path(file).is_file() for file in told["files"])
    assert "left out: thermal_drift, because it depends on how warm the axis is" in said
    assert "no cycle is known: made for 1 ms" in said
    assert "no torque limit is known" in said


def test_a_run_gives_its_law_its_cycle_and_its_limit(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, printed, said = called(capsys, str(run), "--to", "c", "--out", str(tmp_path / "c"), "--json")
    assert (code, said) == (0, "")
    assert (json.loads(printed)["cycle"], json.loads(printed)["torque_limit"]) == (1e-3, 1.34)
    source = (tmp_path / "c" / "autotune_ff.c").read_text()
    assert "TORQUE_LIMIT = FF_R(1.34)" in source
    assert "REVERSAL_MEMORY_DISPLACEMENT_7" in source


def test_a_run_whose_lugre_law_was_proved_gives_that(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, _ = called(capsys, str(changed(run, law="lugre")), "--to", "c", "--out", str(tmp_path / "c"))
    source = (tmp_path / "c" / "autotune_ff.c").read_text()
    assert code == 0
    assert "STIFFNESS = FF_R(41.0)" in source
    assert "REVERSAL_MEMORY" not in source


def test_a_name_for_each_axis(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for target in ("c", "linuxcnc", "st"):
        code, _, _ = called(capsys, MODEL, "--to", target, "--name", "ff_x", "--out", str(tmp_path / target))
        assert code == 0
    made = {path.name: path.read_text() for path in tmp_path.glob("*/*")}
    assert {"ff_x.c", "ff_x.h", "ff_x.comp", "ff_x.hal", "ff_x.st"} <= set(made)
    assert not any("autotune_ff" in text or "AUTOTUNE_FF" in text for text in made.values())
    assert "setp ff-x.0.scale" in made["ff_x.hal"]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--to", "matlab"], "there is no target 'matlab'; known are c, linuxcnc"),
        (["--to", "c", "--cycle", "1"], "the cycle is 1 s; it must be between"),
        (["--to", "c", "--cycle", "nan"], "the cycle is nan s; it must be between"),
        (["--to", "c", "--torque-limit", "0"], "--torque-limit is 0; it must be above 0"),
        (["--to", "csv", "--speed", "inf"], "--speed is inf; it must be above 0"),
        (["--to", "c", "--name", "1; rm"], "--name is '1; rm'; it must be a small letter"),
        (["--to", "twincat-table"], "give it with --rated-torque"),
    ],
)
def test_wrong_input_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], told: str
) -> None:
    out = tmp_path / "made"
    code, printed, said = called(capsys, MODEL, *arguments, "--out", str(out))
    assert (code, printed) == (2, "")
    assert told in said
    assert not out.exists()


def test_another_cycle_than_the_runs_is_refused(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, said = called(capsys, str(run), "--to", "c", "--cycle", "0.002", "--out", str(tmp_path / "c"))
    assert code == 2
    assert "has proved its feedforward at a cycle of 1 ms, not at 2 ms" in said


@pytest.mark.parametrize(
    ("values", "told"),
    [
        ({"better": False}, "has proved nothing"),
        ({"made_with": {}}, "is damaged"),
        ({"law": "lugre", "proposed": {"coulomb": "much"}}, "is damaged"),
    ],
)
def test_a_run_that_gives_nothing_is_refused(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], values: dict[str, Any], told: str
) -> None:
    code, _, said = called(capsys, str(changed(run, **values)), "--to", "c", "--out", str(tmp_path / "c"))
    assert code == 2
    assert told in said


def test_a_law_of_which_the_drive_holds_a_part_says_so(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (run / "run.json").write_text(json.dumps({"outcome": "kept"}))
    code, printed, said = called(capsys, str(run), "--to", "c", "--out", str(tmp_path / "c"), "--json")
    assert code == 0
    assert "switch the drive's own off, or the same torque is added twice" in said
    assert "added twice" in json.loads(printed)["notes"][0]
    assert "Note: that run has put a feedforward into the drive" in (tmp_path / "c/autotune_ff.c").read_text()


def test_a_limit_beyond_the_runs_is_refused(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, said = called(capsys, str(run), "--to", "c", "--torque-limit", "2", "--out", str(tmp_path / "c"))
    assert code == 2
    assert "was held to 1.34" in said


def test_a_folder_that_is_no_run_and_a_file_in_the_way_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code, _, said = called(capsys, str(tmp_path), "--to", "c", "--out", str(tmp_path / "c"))
    assert code == 2
    assert "there is no findings file" in said
    (tmp_path / "file").write_text("")
    code, _, said = called(capsys, MODEL, "--to", "c", "--out", str(tmp_path / "file"))
    assert code == 2
    assert "cannot be written" in said
