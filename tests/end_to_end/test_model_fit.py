"""`autotune model fit` on files alone: what it says, what it draws, and what it refuses."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from autotune.cli.main import main
from autotune.models import layout
from autotune.models.drive_model import base_model
from autotune.models.plant import simulate
from autotune.recordings.files import write_recording
from autotune.recordings.recording import Controller, Metadata, Recording

PERIOD = 1e-3
TRUTH = {
    "inertia": 7.1e-4,
    "viscous": 4.4e-3,
    "coulomb": 0.29,
    "stiffness": 55.0,
    "micro_damping": 0.09,
    "offset": 0.04,
}
Columns = dict[str, np.ndarray]
Call = Callable[..., tuple[int, str, str]]


def _reference() -> np.ndarray:
    """Sines of several sizes, slow loops and a multisine: 16 s."""
    time = PERIOD * np.arange(16_000)
    slow = 0.02 * np.sin(2 * np.pi * 0.7 * time) * (time < 5)
    wide = 2.5 * np.sin(2 * np.pi * 0.8 * time) * (time >= 5) * (time < 10)
    fast = sum(0.2 / f * np.sin(2 * np.pi * f * time + f) for f in (3.0, 7.0, 13.0, 21.0)) * (time >= 10)
    return np.asarray((slow + wide + fast) * np.minimum(1.0, np.minimum(time, 16.0 - time) / 0.3))


def _columns() -> Columns:
    reference = _reference()
    count = len(reference)
    packed = base_model(TRUTH).pack()
    position, torque = np.empty(count), np.empty(count)
    noise = np.random.default_rng(1).normal(0.0, 3e-3, count)
    zero, loop = np.zeros(count), np.array([PERIOD, 1.34, 2 * np.pi / 50_000, 0.0, 0.0, 0.0, 0.0])
    gains = np.array([60.0, 0.15, 6000.0, 0.5, 1.0])
    state = np.zeros(layout.STATES)
    simulate(
        packed.p, packed.on, state, gains, loop, True, 20, reference, zero, noise, zero, position, torque
    )
    time = PERIOD * np.arange(count)
    return {"time": time, "reference": reference, "position": position, "torque": torque}


@pytest.fixture(scope="module")
def columns() -> Columns:
    return _columns()


@pytest.fixture
def call(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> Call:
    """Fits columns through files: exit code, standard output and error."""

    def fitted(columns: Columns, *more: object, experiment: str = "motion") -> tuple[int, str, str]:
        path = tmp_path / "axis.csv"
        _write(path, columns, experiment)
        arguments = ["model", "fit", str(path), "--out", str(tmp_path / "model.toml"), *map(str, more)]
        with pytest.raises(SystemExit) as ending:
            main(arguments)
        caught = capsys.readouterr()
        return int(ending.value.code or 0), caught.out, caught.err

    return fitted


def _write(path: Path, columns: Columns, experiment: str) -> None:
    metadata = Metadata(
        sample_period=PERIOD,
        position_resolution=2 * np.pi / 50_000,
        controller=Controller(60.0, 0.15, 6000.0, 0.5),
    )
    count = len(columns["time"])
    recording = Recording.from_columns(columns, metadata, np.full(count, experiment), np.zeros(count, int))
    write_recording(recording, path)


def test_every_parameter_comes_back_with_its_interval(columns: Columns, call: Call, tmp_path: Path) -> None:
    """One draw of noise: four intervals of six is what even an unlucky draw holds; values within 5 %."""
    page, rerun = tmp_path / "fit.html", tmp_path / "fit.rrd"
    code, out, _ = call(columns, "--json", "--html", page, "--rrd", rerun)
    found = json.loads(out)
    assert code == 0
    assert found["valid"] is True
    assert found["method"] == "twin"
    inside = 0
    for name, value in TRUTH.items():
        assert found["parameters"][name]["value"] == pytest.approx(value, rel=0.05), name
        assert set(found["parameters"][name]) == {"value", "standard_error", "unit"}
        low, high = found["intervals"][name]
        assert 1e-4 < (high - low) / value < 0.5
        inside += low <= value <= high
    assert inside >= 4
    assert (tmp_path / "model.toml").is_file()
    assert "Measured and model over time" in page.read_text(encoding="utf-8")
    assert rerun.stat().st_size > 100_000


def test_it_says_in_words_whether_the_axis_needs_lugre(columns: Columns, call: Call) -> None:
    _, out, _ = call(columns, "--json", "--precision", 1e-4)
    fine = json.loads(out)["complexity"]
    assert fine["model"] == "lugre"
    assert fine["displacement"] == pytest.approx(TRUTH["coulomb"] / TRUTH["stiffness"], rel=0.05)
    assert fine["peak_difference"] == pytest.approx(2 * TRUTH["coulomb"], rel=0.05)
    _, text, _ = call(columns, "--precision", 0.5)
    assert "the kinetic model (friction as a function of velocity) will do" in text


def _short(c: Columns) -> Columns:
    return {name: values[:150] for name, values in c.items()}


def _still(c: Columns) -> Columns:
    return c | {"position": np.full_like(c["position"], 0.3)}


def _no_torque(c: Columns) -> Columns:
    return c | {"torque": np.zeros_like(c["torque"])}


def _hole(c: Columns) -> Columns:
    torque = c["torque"].copy()
    torque[700] = math.nan
    return c | {"torque": torque}


def _twice(c: Columns) -> Columns:
    time = c["time"].copy()
    time[900] = time[899]
    return c | {"time": time}


def _back(c: Columns) -> Columns:
    time = c["time"].copy()
    time[900:] -= 0.5
    return c | {"time": time}


def _clipped(c: Columns) -> Columns:
    most = 0.25
    return c | {"torque": np.clip(c["torque"], -most, most)}


def _two_axes(c: Columns) -> Columns:
    mixed = {name: np.repeat(values, 2) for name, values in c.items()}
    mixed["position"][1::2] = 3.0 - 2.0 * c["position"]
    return mixed


def _one_after_the_other(c: Columns) -> Columns:
    more = {"reference": c["reference"], "position": c["position"], "torque": 4.0 * c["torque"]}
    both = {name: np.concatenate([c[name], more[name]]) for name in more}
    return both | {"time": PERIOD * np.arange(2 * len(c["time"]))}


def _unrelated(c: Columns) -> Columns:
    return c | {"torque": np.random.default_rng(3).normal(0.0, 0.2, len(c["torque"]))}


@pytest.mark.parametrize(
    ("change", "code", "says"),
    [
        (_short, 3, "too short"),
        (_still, 3, "position is 0.3 in all"),
        (_no_torque, 3, "torque is 0 in all"),
        (_hole, 2, "torque has 1 values that are not numbers, the first in row 700"),
        (_twice, 2, "time"),
        (_back, 2, "time"),
        (_clipped, 3, "clipped at 0.25"),
        (_two_axes, 2, "two axes"),
        # that it is found, and found to be this: tests/identify/test_joint.py
        pytest.param(_one_after_the_other, 2, "mixes axes", marks=pytest.mark.long),
        (_unrelated, 3, ""),
    ],
)
def test_bad_input_gets_a_sentence_and_no_model(
    columns: Columns,
    call: Call,
    tmp_path: Path,
    change: Callable[[Columns], Columns],
    code: int,
    says: str,
) -> None:
    found, out, errors = call(change(columns), "--json")
    assert found == code, errors
    assert says in errors + out
    assert "Traceback" not in errors
    assert not (tmp_path / "model.toml").exists()


def test_one_direction_is_handled_and_said(call: Call) -> None:
    """Offset and Coulomb friction are one number then; inertia and viscous friction are not touched."""
    time = PERIOD * np.arange(12_000)
    velocity = 4.0 + 2.5 * np.sin(2 * np.pi * 0.8 * time)
    acceleration = 2.5 * 2 * np.pi * 0.8 * np.cos(2 * np.pi * 0.8 * time)
    position = np.round(np.cumsum(velocity) * PERIOD * 50_000 / (2 * np.pi)) * 2 * np.pi / 50_000
    torque = TRUTH["inertia"] * acceleration + TRUTH["viscous"] * velocity + 0.33
    torque = torque + np.random.default_rng(2).normal(0.0, 3e-3, len(time))
    code, out, _ = call({"time": time, "position": position, "torque": torque}, "--json")
    assert code in (0, 3)
    if code == 0:
        found = json.loads(out)
        assert "direction only" in found["reason"]
        assert found["parameters"]["coulomb"]["value"] == pytest.approx(0.33, rel=0.05)
        assert found["parameters"]["coulomb"]["standard_error"] is None
        assert found["not_identified"] == ["coulomb", "offset"]


@pytest.mark.parametrize(
    ("more", "says"),
    [
        (["--effects", "stribek"], "stribeck"),
        (["--effects", "stribeck,stribeck"], "named twice"),
        (["--precision", "-1"], "--precision is -1"),
        (["--html", "/nowhere/at/all.html"], "there is no folder"),
    ],
)
def test_wrong_options_are_usage_errors(columns: Columns, call: Call, more: list[str], says: str) -> None:
    code, _, errors = call(columns, *more)
    assert code == 2
    assert says in errors
