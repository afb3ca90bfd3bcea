"""The ceiling on the simulated axis: learnt under the guard, compared in turn, nothing left in the drive."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

from autotune.control.model_feedforward import ModelFeedforward
from autotune.core.axis import Axis, read_axis
from autotune.core.errors import AutotuneError, ConfigurationError
from autotune.core.paths import config_directory
from autotune.experiments.path import Motion
from autotune.models.model_file import write_model
from autotune.tuning import ceiling
from autotune.tuning.ceiling_note import ceiling_note
from autotune.tuning.journal import unfinished
from autotune.tuning.links import open_link
from autotune.tuning.preparation import SessionRequest
from autotune.tuning.progress import Silent
from tests.control.gains_axis import vertical


def axis_in(folder: Path) -> Axis:
    text = (config_directory() / "axes" / "simulated.toml").read_text(encoding="utf-8")
    (folder / "axis.toml").write_text(text, encoding="utf-8")
    return read_axis(folder / "axis.toml")


def request(folder: Path, axis: Axis) -> SessionRequest:
    return SessionRequest(
        axis, lambda: open_link(axis, folder), folder / "runs", Silent(), lambda: datetime(2026, 11, 21, 3)
    )


def held(folder: Path, axis: Axis) -> dict[str, float]:
    loop = open_link(axis, folder)
    try:
        return loop.read_parameters()
    finally:
        loop.close()


@pytest.mark.long
def test_the_model_s_feedforward_is_near_the_ceiling_and_better_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ceiling, "TRIALS", 2)
    monkeypatch.setattr(ceiling, "UNSEEN", ceiling.UNSEEN[6:8])
    axis = axis_in(tmp_path)
    before = held(tmp_path, axis)
    found = ceiling.measure_ceiling(request(tmp_path, axis), ModelFeedforward(vertical(), axis.cycle))
    assert held(tmp_path, axis) == before
    assert not unfinished(tmp_path / "runs", axis.name)
    assert found.learnt < 0.2 * found.neither
    assert found.fixed < found.learnt + 2.0 * axis.position_resolution
    assert len(found.unseen) == 2
    assert all(one.neither > 3.0 * one.fixed for one in found.unseen)
    assert all(one.by_time > 3.0 * one.fixed_raw for one in found.unseen)
    assert "Ceiling, measured on the axis" in found.in_words("rad")
    note = ceiling_note(tmp_path / "runs", axis, found.fixed)
    assert f"to {1e3 * found.learnt:.3g} mrad (2026-11-21)" in note
    geared = axis.model_copy(update={"profile": "cia402"})
    assert geared.fingerprint != axis.fingerprint
    assert ceiling_note(tmp_path / "runs", geared, found.fixed) == ""


@pytest.mark.long
def test_what_the_guard_stops_leaves_the_drive_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    axis = axis_in(tmp_path)
    before = held(tmp_path, axis)
    wild = 3.0 * axis.limits.torque * np.sign(np.sin(np.arange(round(1.0 / axis.cycle)) * 0.3))
    monkeypatch.setattr(ceiling, "played_by", lambda law, motion: wild)
    with pytest.raises(AutotuneError):
        ceiling.measure_ceiling(request(tmp_path, axis), ModelFeedforward(vertical(), axis.cycle))
    assert held(tmp_path, axis) == before
    assert not unfinished(tmp_path / "runs", axis.name)


def test_a_run_s_report_is_silent_where_nothing_was_learnt_or_the_file_is_damaged(tmp_path: Path) -> None:
    axis = axis_in(tmp_path)
    run = tmp_path / "runs" / "20261120-040000-simulated"
    run.mkdir(parents=True)
    assert ceiling_note(tmp_path / "runs", axis, 1e-4) == ""
    for text in (
        "{",
        "[]",
        '{"fingerprint": "x", "learnt": 1e-4}',
        f'{{"fingerprint": "{axis.fingerprint}"}}',
    ):
        (run / "ceiling.json").write_text(text, encoding="utf-8")
        assert ceiling_note(tmp_path / "runs", axis, 1e-4) == ""


def test_the_plan_stays_within_the_benchmark_s_travel_and_the_machine_time(tmp_path: Path) -> None:
    axis = axis_in(tmp_path)
    plan, motion = ceiling.ceiling_plan(axis), Motion.of(axis)
    assert plan.seconds <= axis.limits.machine_seconds
    assert plan.high - plan.low < 2.5 * motion.amplitude
    fastest = max(a * f for a, f in ceiling.UNSEEN)
    assert fastest <= 1.0
    assert max(a * f * f for a, f in ceiling.UNSEEN) <= 1.0


def test_the_fixed_law_is_the_newest_run_s_model(tmp_path: Path) -> None:
    axis = axis_in(tmp_path)
    with pytest.raises(ConfigurationError, match="no earlier run"):
        ceiling.fixed_law(axis, tmp_path / "runs")
    run = tmp_path / "runs" / "20261120-040000-simulated"
    run.mkdir(parents=True)
    write_model(replace(vertical(), axis=axis.name, fingerprint=axis.fingerprint), run / "model.toml")
    assert isinstance(ceiling.fixed_law(axis, tmp_path / "runs"), ModelFeedforward)
