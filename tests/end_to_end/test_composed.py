"""Machines drawn from bodies, springs and contacts are tuned from end to end."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from autotune.cli.main import main

AXES = Path(__file__).parents[2] / "config" / "axes"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["two-carriages", "counterbalanced-column"])
@pytest.mark.long
def test_a_composed_machine_is_tuned_and_kept(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ending:
        main(["run", str(AXES / f"{name}.toml"), "--yes", "--json", "--runs", str(tmp_path / "runs")])
    result = json.loads(capsys.readouterr().out)
    assert (ending.value.code, result["outcome"]) == (0, "kept")
    assert result["committed"]["peak_error"] < 0.3 * result["before"]["peak_error"]
