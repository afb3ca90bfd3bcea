"""What `autotune gains` rests on: the last run's model and gains, and how late its diagnosis found the torque."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from autotune.control.gains.loop import Gains
from autotune.control.gains.propose import Proposal
from autotune.control.gains.requirements import Requirements
from autotune.core.axis import Axis, read_axis
from autotune.core.errors import ConfigurationError
from autotune.core.paths import config_directory
from autotune.models.model_file import write_model
from autotune.recordings.files import write_recording
from autotune.recordings.recording import Metadata, Recording
from autotune.tuning.catalogue import catalogue_of
from autotune.tuning.found_model import torque_late
from autotune.tuning.gains import judge_axis, known_of
from tests.control.gains_axis import vertical

DRIVE = {
    "controller.kp": 60.0,
    "controller.kd": 0.15,
    "controller.ki": 6000.0,
    "controller.derivative_filter": 1.0,
}
LATE = 2e-4


@pytest.fixture
def axis(tmp_path: Path) -> Axis:
    """With a run that left a model and a diagnosis."""
    text = (config_directory() / "axes" / "simulated.toml").read_text(encoding="utf-8")
    (tmp_path / "axis.toml").write_text(text, encoding="utf-8")
    found = read_axis(tmp_path / "axis.toml")
    run = tmp_path / "runs" / "20261121-040000-simulated"
    run.mkdir(parents=True)
    write_model(replace(vertical(), axis=found.name, fingerprint=found.fingerprint), run / "model.toml")
    told = {"diagnosis": {"disturbance": 0.004, "torque_late": LATE}}
    (run / "run.json").write_text(json.dumps(told), encoding="utf-8")
    return found


def test_what_the_run_found_is_known_and_gains_may_be_named(axis: Axis, tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    known = known_of(axis, runs, DRIVE)
    assert (known.gains.kp, known.gains_from) == (60.0, "drive")
    assert (known.disturbance, known.late) == (0.004, LATE)
    named = known_of(axis, runs, DRIVE, Gains(1.0, 2.0, 3.0))
    assert (named.gains.kd, named.gains_from) == (2.0, "command line")
    with pytest.raises(ConfigurationError, match="name them with --controller"):
        known_of(axis, runs, {})


def test_gains_that_the_recording_does_not_show_are_asked_for(axis: Axis, tmp_path: Path) -> None:
    """Position and torque alone: nothing can be said, and what to record is."""
    recordings = next(tmp_path.glob("runs/*")) / "recordings"
    recordings.mkdir()
    count = 2000
    columns = {"time": 1e-3 * np.arange(count), "position": np.sin(1e-2 * np.arange(count))}
    columns["torque"] = np.random.default_rng(1).normal(size=count)
    metadata = Metadata(sample_period=1e-3, position_resolution=axis.position_resolution)
    write_recording(Recording.from_columns(columns, metadata), recordings / "experiment.parquet")
    with pytest.raises(
        ConfigurationError, match=r"gains that nobody knows.*record motion under position control"
    ):
        known_of(axis, tmp_path / "runs", {})
    assert known_of(axis, tmp_path / "runs", {}, Gains(1.0, 2.0, 3.0)).gains.kp == 1.0


def test_a_late_torque_is_in_the_margins_and_said(
    axis: Axis, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[float] = []
    monkeypatch.setattr(
        "autotune.tuning.catalogue.catalogue", lambda kin, *_: seen.append(kin.nominal.timing.dead_time)
    )
    nothing = Proposal(None, Requirements(), "", 0.0)
    monkeypatch.setattr("autotune.tuning.gains.propose", lambda *_: nothing)
    monkeypatch.setattr("autotune.tuning.gains.judge", lambda *_: None)
    monkeypatch.setattr("autotune.tuning.catalogue.ceiling_on_twin", lambda *_: None)
    judged = judge_axis(axis, tmp_path / "runs", DRIVE, dead_time=1e-3)
    assert judged.kin.nominal.timing.dead_time == pytest.approx(1e-3 + LATE)
    assert any("comes 0.2 ms after its demand" in sentence for sentence in judged.words)
    catalogue_of(axis, tmp_path / "runs", DRIVE, 1e-3)
    assert seen == [pytest.approx(1e-3 + LATE)]


@pytest.mark.parametrize(
    ("exact", "shift", "late"),
    [(True, -0.4, LATE), (True, 0.3, 0.0), (False, -0.4, None)],
    ids=["late", "early", "recorded late itself"],
)
def test_only_a_torque_held_from_sample_to_sample_tells_how_late_it_acts(
    exact: bool, shift: float, late: float | None
) -> None:
    problem = SimpleNamespace(
        twin=True,
        controller=SimpleNamespace(exact=exact),
        data=SimpleNamespace(shift=shift, lag=0.0, period=1e-3),
    )
    assert torque_late(cast(Any, SimpleNamespace(problem=problem))) == (
        None if late is None else pytest.approx(late)
    )
    assert torque_late(cast(Any, SimpleNamespace(problem=None))) is None
