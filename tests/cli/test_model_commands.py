"""`autotune model effects`, several effects in one `add`, and `diagnose --apply`: what is read from the words."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from autotune.cli.main import main
from autotune.cli.model import _effects_first
from autotune.core.errors import ConfigurationError
from autotune.models.table import EFFECTS


def test_every_effect_is_listed_with_what_people_read(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ending:
        main(["model", "effects", "--json"])
    assert not ending.value.code
    listed = json.loads(capsys.readouterr().out)["effects"]
    assert list(listed) == list(EFFECTS)
    assert all(
        set(words) == {"looks_like", "cause", "remedy"} and all(words.values()) for words in listed.values()
    )


def test_effects_come_first_then_recordings(tmp_path: Path) -> None:
    plain = tmp_path / "recording"
    plain.touch()
    assert _effects_first(["stribeck", "spring", "a.parquet", "b.csv"]) == (
        ["stribeck", "spring"],
        [Path("a.parquet"), Path("b.csv")],
    )
    assert _effects_first(["stribeck", str(plain)]) == (["stribeck"], [plain])
    assert _effects_first(["no.such.effect", "a.csv"]) == (["no.such.effect"], [Path("a.csv")])
    with pytest.raises(ConfigurationError, match="names no recording"):
        _effects_first(["stribeck", "spring"])
    with pytest.raises(ConfigurationError, match="twice"):
        _effects_first(["stribeck", "stribeck", "a.csv"])
