"""`autotune model`: keys of the JSON, exit codes, and sentences for bad input."""

import json
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from autotune.cli.main import main
from autotune.models.drive_model import DriveModel, HistoryEntry
from autotune.models.model_file import write_model
from autotune.recordings.files import write_recording
from autotune.recordings.recording import Recording


def _run(capsys: pytest.CaptureFixture[str], *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ending:
        main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return int(ending.value.code or 0), captured.out, captured.err


@pytest.fixture
def files(tmp_path: Path, short, nominal: DriveModel) -> tuple[Path, Path]:
    recording, model = tmp_path / "axis.csv", tmp_path / "model.toml"
    write_recording(short, recording)
    write_model(nominal, model)
    return recording, model


def test_compare_prints_one_object_with_the_agreed_keys(files, capsys) -> None:
    recording, model = files
    code, out, _ = _run(capsys, "model", "compare", recording, "--model", model, "--json")
    found = json.loads(out)
    assert code == 0
    assert {"error_rms", "relative_error", "noise_floor_rms", "explained", "worst", "regimes"} <= set(found)
    assert set(found["worst"][0]) == {"coordinate", "range", "share"}
    assert set(found["regimes"]) == {"presliding", "reversal", "low_speed", "high_speed", "acceleration"}


def test_fit_writes_a_model_with_uncertainty(files, capsys, tmp_path) -> None:
    recording, _ = files
    out_file = tmp_path / "fitted.toml"
    code, out, _ = _run(capsys, "model", "fit", recording, "--out", out_file, "--json")
    found = json.loads(out)
    assert code == 0
    assert found["valid"] is True
    assert set(found["parameters"]["inertia"]) == {"value", "standard_error", "unit"}
    assert 0.0 < found["relative_error"] < 0.1
    assert out_file.is_file()


def test_without_a_model_the_base_is_fitted_and_diagnosed(files, capsys) -> None:
    """Where something missing hides the inertia a fit writes no model, and there was none to diagnose."""
    recording, _ = files
    code, out, err = _run(capsys, "model", "diagnose", recording, "--json")
    found = json.loads(out)
    assert code == 0
    assert {"verdict", "effects", "candidates"} <= set(found)
    assert "fit" in err


def test_what_no_fit_can_be_made_of_is_told_by_a_diagnosis_without_a_model(
    files, capsys, monkeypatch
) -> None:
    recording, _ = files
    nothing = SimpleNamespace(model=None, estimate=SimpleNamespace(reason="nothing moves; move the axis"))
    monkeypatch.setattr("autotune.fit", lambda *_, **__: nothing)
    code, _, err = _run(capsys, "model", "diagnose", recording)
    assert code == 3
    assert "nothing moves; move the axis" in err


def test_show_tells_the_story_as_stairs(capsys, tmp_path, nominal) -> None:
    model = nominal.with_history(HistoryEntry("2024-05-01", "fitted", "a.csv", None, 0.02, 0.003))
    model = model.with_history(HistoryEntry("2024-05-02", "+ spring", "a.csv", 0.02, 0.004, 0.003))
    path = tmp_path / "story.toml"
    write_model(model, path)
    code, out, _ = _run(capsys, "model", "show", path)
    assert code == 0
    assert "+ spring" in out
    assert "-80 %" in out
    assert out.count("█") > 40


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ("torque", "has no column torque"),
        ("effect", "did you mean 'spring'"),
        ("model", "there is no model"),
        ("ending", "must end in .toml"),
    ],
)
def test_bad_input_is_a_sentence_and_exit_code_2(files, capsys, tmp_path, change: str, says: str) -> None:
    recording, model = files
    effect, out_file = "spring", tmp_path / "new.toml"
    if change == "torque":
        text = recording.read_text(encoding="utf-8")
        recording.write_text(text.replace("torque_command,torque", "torque_command,tork"), encoding="utf-8")
        text = recording.read_text(encoding="utf-8")
        recording.write_text(text.replace(",torque,", ",tork,"), encoding="utf-8")
    elif change == "effect":
        effect = "sprung"
    elif change == "model":
        model = tmp_path / "nobody.toml"
    else:
        out_file = tmp_path / "new.txt"
    code, out, err = _run(capsys, "model", "add", effect, recording, "--model", model, "--out", out_file)
    assert code == 2
    assert out == ""
    assert says in err
    assert not out_file.exists()


def _words(page: Path) -> str:
    """What a page says, without the programs in it."""
    return re.sub(r"<script.*?</script>", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)


def _in_amperes(recording: Recording) -> Recording:
    """The recording as an import with --torque-unit A leaves it."""
    columns = {name: recording[name] for name in ("time", "position")}
    columns["torque"] = recording["torque"] / 0.12
    metadata = replace(recording.metadata, controller=None, torque_limit=None, extra={"torque_unit": "A"})
    return Recording.from_columns(columns, metadata, "moves")


def test_a_torque_in_amperes_is_told_in_amperes(capsys, tmp_path: Path, short: Recording) -> None:
    part = short.rows(np.flatnonzero(short.experiment == "points")[:6000])
    recording, model, page = (tmp_path / name for name in ("a.csv", "m.toml", "m.html"))
    write_recording(_in_amperes(part), recording)
    code, out, err = _run(capsys, "model", "fit", recording, "--out", model)
    assert code == 0, err
    assert "N m" not in out
    assert 'torque_unit = "A"' in model.read_text(encoding="utf-8")
    assert 'unit = "A s²/rad"' in model.read_text(encoding="utf-8")
    for arguments in (
        ("compare", recording, "--model", model),
        ("compare", recording, "--model", model, "--html", page),
        ("diagnose", recording, "--model", model),
        ("show", model),
    ):
        code, out, err = _run(capsys, "model", *arguments)
        assert code == 0, err
        assert "N m" not in out + err
    assert "N m" not in _words(page)
    code, out, _ = _run(capsys, "model", "compare", recording, "--model", model, "--json")
    assert json.loads(out)["torque_unit"] == "A"


def test_amperes_and_newton_metres_are_not_compared(
    capsys, tmp_path: Path, short: Recording, nominal
) -> None:
    write_model(nominal, tmp_path / "m.toml")
    write_recording(_in_amperes(short), tmp_path / "a.csv")
    code, out, err = _run(capsys, "model", "compare", tmp_path / "a.csv", "--model", tmp_path / "m.toml")
    assert (code, out) == (2, "")
    assert "for torque in N m, the recording is in A" in err


def test_the_same_bytes_give_the_same_numbers_whatever_they_are_called(files, capsys, tmp_path: Path) -> None:
    recording, _ = files
    (tmp_path / "elsewhere").mkdir()
    copy = tmp_path / "elsewhere" / "copy of it.csv"
    copy.write_bytes(recording.read_bytes())
    said = []
    for one in (recording, copy):
        out_file = one.with_suffix(".fitted.toml")
        code, out, _ = _run(capsys, "model", "fit", one, "--out", out_file, "--json")
        assert code == 0
        _, compared, _ = _run(capsys, "model", "compare", one, "--model", out_file, "--json")
        said.append((json.loads(out)["parameters"], json.loads(out)["error_rms"], json.loads(compared)))
    assert said[0] == said[1]
