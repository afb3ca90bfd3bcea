"""`autotune tribology` as a person calls it: figures, JSON, an axis beside it, and wrong files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from autotune.cli.main import main
from autotune.core.configuration import read_toml

PRESET = Path(__file__).parents[2] / "config" / "surfaces" / "v-bearing.toml"
AXIS = (
    'schema = 1\nmotion_unit = "m"\n[inertia]\nvalue = 1.0\n[coulomb]\nvalue = 90.0\n[viscous]\nvalue = 10.0\n'
    "[offset]\nvalue = 0.0\n[micro_damping]\nvalue = 100.0\n[stiffness]\nvalue = {stiffness}\n"
)


def call(*arguments: str | Path) -> int:
    with pytest.raises(SystemExit) as ending:
        main([str(argument) for argument in arguments])
    return int(ending.value.code or 0)


def test_the_thesis_bearing(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    page = tmp_path / "contact.html"
    assert call("tribology", PRESET, "--json", "--html", page) == 0
    said = json.loads(capsys.readouterr().out)
    dry, oiled = (said["interfaces"][name] for name in ("dry", "oiled"))
    assert dry["break_away_displacement"] == pytest.approx(180e-9, rel=0.01)
    assert oiled["break_away_displacement"] == pytest.approx(50e-9, rel=0.01)
    assert dry["break_away"] / oiled["break_away"] == pytest.approx(3.6, rel=0.01)
    assert 0.92 <= said["stiffness_load_exponent"] <= 0.97
    assert any("beyond elastic contact" in note and "plasticity index" in note for note in said["notes"])
    assert said["axis"] is None
    assert "Stiffness at rest" in page.read_text()


@pytest.mark.parametrize(
    ("stiffness", "verdict", "word"),
    [(4.6e8, "contact", "can be this"), (1e7, "elsewhere", "coupling"), (2e9, "too_soft", "too soft")],
)
def test_beside_an_axis(
    stiffness: float, verdict: str, word: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = tmp_path / "axis.toml"
    model.write_text(AXIS.format(stiffness=stiffness))
    assert call("tribology", PRESET, "--axis", model, "--json") == 0
    axis = json.loads(capsys.readouterr().out)["axis"]
    assert axis["verdict"] == verdict
    assert word in axis["sentence"]
    if verdict == "elsewhere":  # springs in series
        together = 1.0 / (1.0 / axis["contact_stiffness"] + 1.0 / axis["remaining_stiffness"])
        assert together == pytest.approx(stiffness, rel=1e-9)


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ("curvature_deviation = 3.4260e6", "curvature_deviation = 3.4260e5", "no Gaussian surface"),
        ("curvature_deviation = 3.4260e6", 'profiles = ["a.csv"]', "not both"),
        ("load = 100.0 ", "load = 1e7 ", "must rise"),
        ("load = 100.0 # N, normal\nload_min = 10.0\nload_max = 1000.0", "load = 1e8", "check load and area"),
        ("poisson_ratio = 0.3", "poisson_ratio = 0.7", "less than 0.5"),
        ("break_away_displacement = 180e-9", "", "either shear_strength or"),
        ("[place]", "[plcae]", "did you mean 'place'"),
    ],
)
def test_files_that_are_wrong(
    before: str, after: str, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = PRESET.read_text()
    assert before in text
    wrong = tmp_path / "wrong.toml"
    wrong.write_text(text.replace(before, after))
    assert call("tribology", wrong) == 2
    said = capsys.readouterr()
    assert told in said.err
    assert "Traceback" not in said.err
    assert not said.out


def test_a_profile_with_a_hole(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = [f"{k * 1e-7},{1e-7 * (k % 7)}" for k in range(300) if k != 150]
    (tmp_path / "a.csv").write_text("position,height\n" + "\n".join(lines))
    wrong = tmp_path / "surface.toml"
    text = PRESET.read_text()
    start, end = text.index("height_deviation"), text.index("[material]")
    wrong.write_text(text[:start] + 'profiles = ["a.csv"]\n' + text[end:])
    assert call("tribology", wrong) == 2
    assert "from point 150 to 151" in capsys.readouterr().err


def test_the_preset_is_what_the_thesis_tells() -> None:
    surface = read_toml(PRESET, "surface file")["surface"]
    assert surface == {
        "height_deviation": 4.7185e-7,
        "slope_deviation": 0.5703,
        "curvature_deviation": 3.4260e6,
    }
