"""Every command in docs/importing-data.md runs."""

from __future__ import annotations

import glob
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import io as matlab
from typer.testing import CliRunner

from autotune.cli.data import data
from autotune.cli.main import main
from autotune.core.errors import AutotuneError
from autotune.recordings.files import read_recording

from .conftest import axis_signals, shared, write_table

PAGE = Path(__file__).resolve().parents[2] / "docs/importing-data.md"
COMMANDS = re.findall(r"```sh\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
FOLDERS = {"DATA_EMPS": "emps", "acc_current": "bldc_cogging", "steady_state": "lead_screw"}


def files_of_the_page(folder: Path) -> None:
    """The small files that the page speaks of."""
    signals = axis_signals(1500)
    milliseconds, position, torque = 1e3 * signals["time"], signals["position"], signals["torque"]
    degrees = {"a": milliseconds, "b": np.degrees(position), "c": 1e3 * torque}
    head = re.search(r"```csv\n(.*?)\n", PAGE.read_text(encoding="utf-8"))
    assert head is not None
    write_table(folder / "axis.csv", degrees, ";", ",", head[1])
    counts = {"a": milliseconds, "b": np.round(position * 4096 / (2 * np.pi)), "c": torque / 0.12}
    write_table(folder / "plain.txt", counts, " ", head="")
    phases = np.repeat(["slow", "fast", "fast"], 500)
    rows = zip(milliseconds, phases, np.repeat([0, 0, 1], 500), position, torque, strict=True)
    lines = ["t [ms],Phase,Run,Position [rad],Torque [Nm]"]
    lines += [f"{t:.3f},{phase},{run},{q:.9g},{tau:.9g}" for t, phase, run, q, tau in rows]
    matlab.savemat(folder / "uval_multisine.mat", {"uval_multisine": torque[None, :]})
    matlab.savemat(folder / "yval_multisine.mat", {"yval_multisine": position[None, :]})
    (folder / "programme.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")


@pytest.mark.parametrize("command", COMMANDS, ids=[command.split()[3] for command in COMMANDS])
def test_a_command_of_the_page_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    files_of_the_page(tmp_path)
    for word, folder in FOLDERS.items():
        if word in command:
            for entry in shared(folder).iterdir():
                (tmp_path / entry.name).symlink_to(entry.resolve())
    monkeypatch.chdir(tmp_path)
    arguments = [name for word in shlex.split(command) for name in (sorted(glob.glob(word)) or [word])]
    with pytest.raises(SystemExit) as ending:
        main(arguments[1:])
    said = capsys.readouterr()
    assert ending.value.code == 0, said.err
    recording = read_recording(tmp_path / command.split("--out ")[1].split()[0])
    assert len(recording) >= 1500
    assert len(said.out.splitlines()) == 1


def test_the_page_has_all_formats_that_need_words() -> None:
    assert {re.search(r"--format (\w+)", command)[1] for command in COMMANDS} == {"csv", "mat", "epos"}  # type: ignore[index]


@pytest.mark.slow
def test_exit_code_and_sentence_of_a_refusal(tmp_path: Path) -> None:
    signals = axis_signals(500)
    signals["torque"] *= -1
    write_table(tmp_path / "t.csv", signals)
    result = subprocess.run(
        [sys.executable, "-m", "autotune.cli.main", "data", "import", "t.csv", "--format", "csv", "--out", "t.parquet"],
        cwd=tmp_path, capture_output=True, text=True,
    )  # fmt: skip
    assert result.returncode == 2
    assert result.stderr.startswith("autotune: t.csv: the torque acts against the motion")
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "t.parquet").exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--out", "t.txt"], "must end in .parquet or .csv"),
        (["--out", "t.csv"], "one of the files to import"),
        (["--out", "no/t.parquet"], "no folder"),
        (["--out", "o.csv", "--unit", "deg"], "allowed are rad, m"),
        (["--out", "o.csv", "--torque-unit", "lbf"], "allowed are Nm"),
        (["--out", "o.csv", "--period", "-1"], "above 0"),
        (["--out", "o.csv", "--experiment", "a,b"], "without commas"),
        (["--out", "o.csv", "--controller", "pi"], "not understood"),
        (["--out", "o.csv", "--format", "xls"], "known are csv"),
    ],
)
def test_wrong_options_are_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    write_table(tmp_path / "t.csv", axis_signals(300))
    form = [] if "--format" in arguments else ["--format", "csv"]
    with pytest.raises(AutotuneError, match=message):
        CliRunner().invoke(data, ["import", "t.csv", *form, *arguments], catch_exceptions=False)


def test_options_reach_the_metadata(tmp_path: Path) -> None:
    write_table(tmp_path / "t.csv", axis_signals(300))
    arguments = ["--torque-limit", "1.5", "--resolution", "1e-4", "--controller", "pid kp=60 kd=0.1 ki=0"]
    out = tmp_path / "o.csv"
    CliRunner().invoke(
        data,
        ["import", str(tmp_path / "t.csv"), "--format", "csv", "--out", str(out), *arguments],
        catch_exceptions=False,
    )
    metadata = read_recording(out).metadata
    assert metadata.torque_limit == 1.5
    assert metadata.position_resolution == 1e-4
    assert metadata.controller is not None
    assert metadata.controller.kp == 60
    assert metadata.extra["imported_from"] == "t.csv"
