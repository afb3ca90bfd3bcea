"""A findings file that a disk or a hand has damaged is said to be damaged."""

from __future__ import annotations

import json
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest

from autotune.control.reduction import Reduction
from autotune.core.errors import ConfigurationError
from autotune.tuning.findings import FILE_NAME, PlannedValues, load_findings
from autotune.tuning.journal import Journal
from autotune.tuning.run_directory import make_run_directory
from tests.drivers.simulator import axis_of

NOW = datetime(2026, 11, 20, 4, 0, 0)
START = {
    "inertia": 1e-4, "viscous": 1e-3, "coulomb": 0.1, "stiffness": 18.0, "micro_damping": 0.05, "offset": 0.0,
    "break_away": 0.12, "stribeck_velocity": 0.5,
}  # fmt: skip
SOUND: dict[str, Any] = {
    "schema": 1, "better": True, "start": START, "stiffness_range": [10.0, 100.0], "proposed": START,
    "planned": {"values": {"feedforward.coulomb": 0.1}, "host": False}, "diagnosed": False, "law": "lugre",
}  # fmt: skip


def written(runs: Path, text: str) -> Path:
    axis = axis_of()
    directory = make_run_directory(runs, axis.name, NOW)
    Journal.begin(directory, axis.name, axis.fingerprint, NOW)
    (directory / FILE_NAME).write_text(text)
    return directory / FILE_NAME


def test_a_sound_file_is_read(tmp_path: Path) -> None:
    written(tmp_path, json.dumps(SOUND))
    found = load_findings(tmp_path, axis_of(), "commit")
    assert found.planned is not None
    assert found.need_start().parameters.stiffness == 18.0


def test_a_plan_keeps_what_the_drive_cannot_hold_and_what_that_is_predicted_to_cost(tmp_path: Path) -> None:
    """Without it a commit by itself would measure the drive's part against the proof of the whole, and take it back."""
    reduction = Reduction({"coulomb": 0.1}, (), 0.1e-3, 0.05e-3, 1.5e-3, 0.4e-3, 0.17, ("reversal_memory",))
    planned = PlannedValues({"feedforward.coulomb": 0.1}, reduction=reduction)
    written(tmp_path, json.dumps(SOUND | {"planned": planned.as_json()}))
    assert load_findings(tmp_path, axis_of(), "commit").planned == planned


@pytest.mark.parametrize(
    "change",
    [
        {"start": None}, {"start": {}}, {"start": START | {"magic": 1.0}}, {"start": START | {"coulomb": "x"}},
        {"start": START | {"coulomb": None}}, {"stiffness_range": 3}, {"stiffness_range": [1.0]}, {"proposed": []},
        {"stiffness_range": ["a", "b"]}, {"planned": 1}, {"planned": {"values": {"feedforward.coulomb": "x"}}},
        {"planned": {"values": {"feedforward.coulomb": True}, "host": False}},
        {"planned": {"values": {}, "reduction": 1}}, {"planned": {"values": {}, "reduction": {"values": {}}}},
    ],
)  # fmt: skip
def test_damage_is_named_with_the_file(tmp_path: Path, change: dict[str, Any]) -> None:
    path = written(tmp_path, json.dumps(SOUND | change))
    with pytest.raises(ConfigurationError) as caught:
        load_findings(tmp_path, axis_of(), "commit")
    assert f"{path} is damaged" in str(caught.value)


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"better": NaN}', "[" * 100_000, '{"better": ' + "9" * 6000 + "}"]
)
def test_what_is_no_json_is_named_with_the_file(tmp_path: Path, text: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(ConfigurationError) as caught:
        load_findings(tmp_path, axis_of(), "adapt")
    assert f"{path} is damaged" in str(caught.value)
