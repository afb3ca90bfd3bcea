"""What is handed in wrongly ends with a sentence and an exit code, and writes nothing."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from autotune.cli.main import main
from autotune.core.recording import Recording
from autotune.core.recording_files import write_recording
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.model_file import write_model
from bench.diagnosis import NOMINAL


def _run(capsys, *arguments: object) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ending:
        main([str(argument) for argument in arguments])
    captured = capsys.readouterr()
    return int(ending.value.code or 0), captured.out, captured.err


def _file(folder: Path, name: str, recording: Recording) -> Path:
    write_recording(recording, folder / name)
    return folder / name


@pytest.fixture
def model(tmp_path: Path, nominal: DriveModel) -> Path:
    write_model(nominal, tmp_path / "model.toml")
    return tmp_path / "model.toml"


@pytest.fixture
def plain(short: Recording) -> Recording:
    """Ten seconds of one trajectory, without a reference."""
    part = short.rows(slice(2000, 12_000))
    columns = {name: part[name] for name in ("time", "position", "torque")}
    return Recording.from_columns(columns, replace(part.metadata, controller=None), "sine")


@pytest.mark.parametrize("command", ["compare", "diagnose"])
def test_axes_of_two_kinds_are_not_mixed(capsys, tmp_path, plain, model, command: str) -> None:
    one = _file(tmp_path, "one.csv", plain)
    other = _file(tmp_path, "other.csv", plain.with_metadata(motion_unit="m"))
    code, out, err = _run(capsys, "model", command, one, other, "--model", model)
    assert (code, out) == (2, "")
    assert "recording is in m" in err


def test_recordings_of_two_axes_are_not_mixed(capsys, tmp_path, plain, model) -> None:
    one = _file(tmp_path, "one.csv", plain.with_metadata(axis="left", fingerprint="a1"))
    other = _file(tmp_path, "other.csv", plain.with_metadata(axis="right", fingerprint="b2"))
    code, out, err = _run(capsys, "model", "compare", one, other, "--model", model)
    assert (code, out) == (2, "")
    assert "left" in err
    assert "right" in err


def test_a_torque_of_something_else_fits_no_model(capsys, tmp_path, plain, model) -> None:
    random = np.random.default_rng(3)
    other = dict(plain.floats) | {"torque": random.normal(0.0, 0.1, len(plain))}
    path = _file(tmp_path, "other.csv", Recording.from_columns(other, plain.metadata, "sine"))
    code, out, err = _run(capsys, "model", "diagnose", path, "--model", model)
    assert (code, out) == (3, "")
    assert "explains only" in err


def test_an_effect_these_data_cannot_show_is_refused(capsys, tmp_path, plain) -> None:
    path = _file(tmp_path, "one.csv", plain.with_metadata(motion_unit="m"))
    linear, better = tmp_path / "linear.toml", tmp_path / "better.toml"
    write_model(base_model(NOMINAL, motion_unit="m"), linear)
    code, out, err = _run(
        capsys, "model", "add", "gravity_imbalance", path, "--model", linear, "--out", better
    )
    assert (code, out) == (3, "")
    assert "cannot say anything about gravity_imbalance" in err
    assert not better.exists()


def test_a_controller_that_is_none_is_said_and_the_rest_is_judged(capsys, tmp_path, plain, model) -> None:
    random = np.random.default_rng(5)
    reference = plain["position"] + random.normal(0.0, 1e-3, len(plain))
    columns = dict(plain.floats) | {"reference": reference}
    path = _file(tmp_path, "one.csv", Recording.from_columns(columns, plain.metadata, "sine"))
    code, out, err = _run(capsys, "model", "compare", path, "--model", model)
    assert code == 0
    assert "No twin" in err
    assert "noise floor unknown" in out
