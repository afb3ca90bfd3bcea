"""`autotune model effects`, several effects in one `add`, and `diagnose --apply`: what is read from the words."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from autotune.cli import model as commands
from autotune.cli.main import main
from autotune.cli.model import _effects_first
from autotune.cli.model_text import parameter_lines
from autotune.core.errors import ConfigurationError
from autotune.models.drive_model import base_model
from autotune.models.table import EFFECTS
from tests.support.axes import NOMINAL


def test_every_effect_is_listed_with_what_people_read(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ending:
        main(["model", "effects", "--json"])
    assert not ending.value.code
    listed = json.loads(capsys.readouterr().out)["effects"]
    assert list(listed) == list(EFFECTS)
    assert all(
        set(words) == {"looks_like", "cause", "remedy"} and all(words.values()) for words in listed.values()
    )


def test_one_effect_is_shown_with_its_parameters(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ending:
        main(["model", "effects", "backlash"])
    assert not ending.value.code
    shown = capsys.readouterr().out
    assert shown.startswith("backlash\n")
    assert all(f"  {one.name} [" in shown for one in EFFECTS["backlash"].parameters)
    assert "stribeck" not in shown
    with pytest.raises(SystemExit) as ending:
        main(["model", "effects", "nonsense"])
    assert ending.value.code == 2


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


@pytest.mark.parametrize(
    ("effect", "values", "line"),
    [
        (
            "load_dependent_friction",
            {"factor": 0.1, "friction_share": 0.31},
            r"friction_share +0\.31 ± 0\.11$",
        ),
        ("spring", {"stiffness": 0.005}, r"spring\.stiffness +0\.005 ± 0\.11 N m/rad$"),
    ],
)
def test_a_value_its_error_and_its_unit_stand_apart(effect: str, values: dict[str, float], line: str) -> None:
    """What was seen: `friction_share1 ± 0.11 1`."""
    errors = dict.fromkeys(values, 0.11)
    model = base_model(NOMINAL).with_effect(EFFECTS[effect].make(values, errors))
    assert any(re.search(line, printed) for printed in parameter_lines(model))


@pytest.mark.parametrize(("fit_takes", "left"), [(40.0, 260.0), (200.0, 150.0)])
def test_a_fit_of_the_base_counts_to_half_of_the_time(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, fit_takes: float, left: float
) -> None:
    """What was seen: `--at-most 300` that took 450 s."""
    given: list[float] = []

    def diagnose(*_: object, at_most: float, **__: object) -> None:
        given.append(at_most)
        raise ConfigurationError("enough is known")

    clock = iter([0.0, fit_takes])
    monkeypatch.setattr(commands, "time", SimpleNamespace(monotonic=lambda: next(clock)))
    monkeypatch.setattr(commands, "_with_base", lambda _: (base_model(NOMINAL), []))
    monkeypatch.setattr("autotune.diagnose", diagnose)
    (tmp_path / "a.csv").touch()
    with pytest.raises(SystemExit) as ending:
        main(["model", "diagnose", str(tmp_path / "a.csv"), "--at-most", "300"])
    assert (ending.value.code, given) == (2, [left])


@pytest.mark.parametrize("seconds", ["-5", "0", "nan"])
def test_a_time_that_is_none_is_refused_before_anything_is_fitted(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, seconds: str
) -> None:
    (tmp_path / "a.csv").touch()
    with pytest.raises(SystemExit) as ending:
        main(["model", "diagnose", str(tmp_path / "a.csv"), "--at-most", seconds])
    assert ending.value.code == 2
    assert f"--at-most is {seconds}, and must be a time above 0 s" in capsys.readouterr().err


def test_warnings_of_libraries_never_reach_a_user() -> None:
    """Of Rerun, say, with the path of its source."""
    program = (
        "import sys, warnings; from autotune.cli import main; sys.argv = ['autotune'];"
        "main.application = lambda given: lambda **_: warnings.warn('RerunWarning') or 0; main.main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
