"""`autotune record AXIS decide`: what is asked of the command line before anything moves, and the whole way once."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from autotune.cli.main import main
from autotune.recordings.files import read_recording
from tests.end_to_end.support import EXAMPLE

DOUBT = {"verdict": "ambiguous", "effects": ["spring"], "confusable": [["spring", "torque_ripple"]]}


def axis_in(folder: Path) -> Path:
    lines = EXAMPLE.read_text().splitlines()
    path = folder / "axis.toml"
    path.write_text(
        "\n".join('link = "sim://edm-vertical"' if one.startswith("link") else one for one in lines)
    )
    return path


def exit_code(*words: str) -> int:
    with pytest.raises(SystemExit) as ending:
        main(list(words))
    return int(ending.value.code or 0)


@pytest.mark.parametrize(
    ("programme", "doubt", "told"),
    [
        ("decide", None, "--from diagnosis.json"),
        ("dahl", DOUBT, "--from belongs to programme 'decide'"),
        ("decide", {"verdict": "none"}, "nothing is in doubt"),
        ("decide", {"outcome": "kept"}, "is no diagnosis"),
    ],
)
def test_a_question_that_is_none_is_refused_before_anything_moves(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], programme: str, doubt: object, told: str
) -> None:
    words = ["record", str(axis_in(tmp_path)), programme, "--out", str(tmp_path / "out.parquet"), "--yes"]
    if doubt is not None:
        (tmp_path / "d.json").write_text(json.dumps(doubt))
        words += ["--from", str(tmp_path / "d.json")]
    assert exit_code(*words, "--runs", str(tmp_path / "runs")) == 2
    assert told in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out.parquet").exists()


@pytest.mark.slow
def test_what_is_in_doubt_is_played_and_kept(tmp_path: Path) -> None:
    (tmp_path / "d.json").write_text(json.dumps(DOUBT))
    out = tmp_path / "decision.parquet"
    axis = str(axis_in(tmp_path))
    runs = ("--runs", str(tmp_path / "runs"))
    assert (
        exit_code(
            "record", axis, "decide", "--from", str(tmp_path / "d.json"), "--out", str(out), "--yes", *runs
        )
        == 0
    )
    found = read_recording(out)
    assert {"slow_scan", "scan", "veto"} <= set(found.experiment)
    assert len(found) * found.period < 65.0


def test_set_points_are_written_for_another_rig_and_nothing_moves(tmp_path: Path) -> None:
    (tmp_path / "d.json").write_text(json.dumps(DOUBT))
    out = tmp_path / "set_points.csv"
    words = ["record", str(axis_in(tmp_path)), "decide", "--from", str(tmp_path / "d.json"), "--set-points"]
    assert exit_code(*words, "--out", str(out), "--runs", str(tmp_path / "runs")) == 0
    assert not (tmp_path / "runs").exists()
    table = np.genfromtxt(out, delimiter=",", skip_header=2, names=True, dtype=None, encoding="utf-8")
    assert {"slow_scan", "scan", "veto"} <= set(table["experiment"])
    assert np.allclose(np.diff(table["time"]), 0.001)
    assert np.abs(np.diff(table["reference"])).max() < 0.02
    assert abs(table["reference"][-1]) < 1e-9
    first, second = (
        table["reference"][(table["experiment"] == "veto") & (table["repeat"] == k)] for k in (0, 1)
    )
    assert np.allclose(first, second, atol=1e-6)


def test_what_a_rig_played_by_set_points_is_a_recording(tmp_path: Path) -> None:
    (tmp_path / "d.json").write_text(json.dumps(DOUBT))
    out = tmp_path / "set_points.csv"
    words = ["record", str(axis_in(tmp_path)), "decide", "--from", str(tmp_path / "d.json"), "--set-points"]
    assert exit_code(*words, "--out", str(out)) == 0
    head, rows = out.read_text().split("reference\n")
    measured = [f"{row},{row.rsplit(',', 1)[1]},0.1" for row in rows.splitlines()]
    (tmp_path / "measured.csv").write_text(head + "reference,position,torque\n" + "\n".join(measured) + "\n")
    found = read_recording(tmp_path / "measured.csv")
    assert {"slow_scan", "scan", "veto"} <= set(found.experiment)
    assert {segment.repeat for segment in found.segments()} == {0, 1}


@pytest.mark.parametrize(("most", "told"), [(30, True), (600, False)])
def test_set_points_that_move_an_axis_for_longer_than_it_may_are_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], most: int, told: bool
) -> None:
    """Another rig plays them, and its time is not watched by this program."""
    (tmp_path / "d.json").write_text(json.dumps(DOUBT))
    axis = axis_in(tmp_path)
    axis.write_text(re.sub(r"machine_seconds = \S+", f"machine_seconds = {most}", axis.read_text()))
    words = ["record", str(axis), "decide", "--from", str(tmp_path / "d.json"), "--set-points"]
    assert exit_code(*words, "--out", str(tmp_path / "points.csv")) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert (f"limits.machine_seconds = {most} s" in said) == told


def test_set_points_that_depend_on_what_is_measured_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [
        "record",
        str(axis_in(tmp_path)),
        "presliding",
        "--set-points",
        "--out",
        str(tmp_path / "out.csv"),
    ]
    assert exit_code(*words) == 2
    assert "depends on what it measures" in " ".join(capsys.readouterr().err.split())
    assert not (tmp_path / "out.csv").exists()
