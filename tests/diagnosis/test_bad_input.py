"""What is handed in wrongly ends with a sentence and an exit code, and writes nothing."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from autotune.cli.main import main
from autotune.diagnosis.verdict import diagnose
from autotune.models.drive_model import DriveModel, base_model
from autotune.models.model_file import write_model
from autotune.models.start_values import StartContext, StartValues, Vary
from autotune.models.table import EFFECTS
from autotune.recordings.files import write_recording
from autotune.recordings.recording import Recording
from tests.support.axes import NOMINAL, plain_axis
from tests.support.recorded_once import DRESSES, played


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


def _changed(recording: Recording, **columns: np.ndarray) -> Recording:
    return Recording.from_columns(dict(recording.floats) | columns, recording.metadata, "sine")


def _hole(recording: Recording) -> Recording:
    torque = recording["torque"].copy()
    torque[500] = np.nan
    return _changed(recording, torque=torque)


def _still(recording: Recording) -> Recording:
    return _changed(recording, position=np.full(len(recording), 0.3))


def _of_another_axis(recording: Recording) -> Recording:
    return recording.with_metadata(axis="left", fingerprint="a1")


@pytest.mark.parametrize("command", ["compare", "diagnose", "add"])
@pytest.mark.parametrize(
    ("change", "expected", "says"),
    [
        (_hole, 2, "not numbers, the first in row 500"),
        (_still, 3, "position is 0.3 in all"),
        (lambda r: r.rows(slice(0, 150)), 3, "too short: 150 rows"),
        (_of_another_axis, 2, "the model is of axis right, the recording of left"),
    ],
)
def test_what_cannot_be_judged_ends_with_one_sentence(
    capsys, tmp_path, plain, nominal, command: str, change, expected: int, says: str
) -> None:
    path = _file(tmp_path, "one.csv", change(plain))
    write_model(replace(nominal, axis="right", fingerprint="b2"), tmp_path / "m.toml")
    more = ["spring", path, "--out", tmp_path / "o.toml"] if command == "add" else [path]
    code, out, err = _run(capsys, "model", command, *more, "--model", tmp_path / "m.toml")
    assert (code, out) == (expected, "")
    assert says in err.strip().splitlines()[-1]
    assert not (tmp_path / "o.toml").exists()


def test_a_recording_without_torque_names_what_it_has(capsys, tmp_path, plain, model) -> None:
    path = _file(tmp_path, "one.csv", plain)
    lines = path.read_text(encoding="utf-8").splitlines()
    head = next(i for i, line in enumerate(lines) if not line.startswith("#"))
    at = lines[head].split(",").index("torque")
    kept = [",".join(part for i, part in enumerate(line.split(",")) if i != at) for line in lines[head:]]
    path.write_text("\n".join([*lines[:head], *kept]) + "\n", encoding="utf-8")
    code, out, err = _run(capsys, "model", "diagnose", path, "--model", model)
    assert (code, out) == (2, "")
    assert "has no column torque; it has time" in err


def test_a_torque_of_the_wrong_sign_is_asked_for(capsys, tmp_path, plain, model) -> None:
    path = _file(tmp_path, "one.csv", _changed(plain, torque=-plain["torque"]))
    code, _, err = _run(capsys, "model", "fit", path, "--out", tmp_path / "o.toml")
    assert code == 2
    assert "wrong sign" in err
    code, out, err = _run(capsys, "model", "diagnose", path, "--model", model)
    assert (code, out) == (3, "")
    assert "% of the torque even after refitting; is the sign" in err


def _diverging(context: StartContext) -> Iterator[StartValues]:
    """Starts that no fit survives: no number, and a spring that throws the twin out."""
    for stiffness in (np.nan, -1e9):
        yield StartValues({"stiffness": stiffness}, {"stiffness": Vary(1.0)})


def test_a_candidate_that_diverges_leaves_the_others_to_be_judged(nominal: DriveModel) -> None:
    axis = plain_axis(31_337, {"gravity_imbalance": 0.02})
    recording = played(axis, DRESSES[0], "waves", 31_337, 12.0)
    spring = replace(EFFECTS["spring"], starts=_diverging)
    others = [kind for name, kind in EFFECTS.items() if name != "spring"]
    found = diagnose([recording], nominal, candidates=[*others, spring])
    judged = {candidate.effect for candidate in found.candidates}
    assert {"gravity_imbalance", "stribeck", "direction_asymmetry"} <= judged
    assert all(np.isfinite(candidate.gain) for candidate in found.candidates)
    assert found.effects == ("gravity_imbalance",)


def test_an_unstable_twin_is_done_without(capsys, tmp_path, nominal: DriveModel) -> None:
    axis = plain_axis(31_337, {"spring": 0.006})
    path = _file(tmp_path, "one.csv", played(axis, DRESSES[0], "waves", 31_337, 12.0))
    heavy = nominal.with_values({"inertia": 1.0, "coulomb": 50.0})
    write_model(heavy, tmp_path / "m.toml")
    code, out, err = _run(capsys, "model", "compare", path, "--model", tmp_path / "m.toml")
    assert code == 0
    assert "a simulation of the model with this controller is unstable" in err
    assert out.startswith("error ")
