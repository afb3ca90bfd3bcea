"""The pages about contacts and composed machines: what they show runs, and prints what they say."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from autotune.cli.main import main
from autotune.core.axis import read_axis
from autotune.models.model_file import read_model

ROOT = Path(__file__).parents[2]
CONTACTS, MACHINES = (ROOT / "docs" / name for name in ("contacts.md", "composed-machines.md"))


def test_the_command_prints_what_the_page_says(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    first = re.findall(r"^autotune (tribology .*)$", CONTACTS.read_text(), re.MULTILINE)[0]
    with pytest.raises(SystemExit):
        main(shlex.split(first))
    said = capsys.readouterr().out
    assert "∝ load^0.96" in said
    assert "170 to 193 nm" in said
    assert "47 to 54 nm" in said
    assert "plasticity index 29.7" in said


def test_the_snippet_runs(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    code = re.findall(r"```python\n(.*?)```", CONTACTS.read_text(), re.DOTALL)[0]
    exec(code, {})
    assert capsys.readouterr().out.startswith("11 steps, then 20.00 µm")


IDENTIFIED = re.compile(r"^autotune ((?:data import|model fit|model diagnose) .*contact.*)$", re.MULTILINE)


def _contact_recorded(folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    """The page's second snippet has been run in `folder`; its commands."""
    monkeypatch.chdir(folder)
    (folder / "config").symlink_to(ROOT / "config")
    text = CONTACTS.read_text()
    exec(re.findall(r"```python\n(.*?)```", text, re.DOTALL)[1], {})
    return [shlex.split(command) for command in IDENTIFIED.findall(text)]


def _run(command: list[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(command)
    assert end.value.code == 0, command


@pytest.mark.long
def test_the_inertial_drive_is_identified_as_the_page_says(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Tolerances of the page; its figures are those of `python -m bench.inertial_drive`."""
    imported, fitted, diagnosed = _contact_recorded(tmp_path, monkeypatch)
    _run(imported)
    _run(fitted)
    model = read_model(tmp_path / "contact.toml")
    true = {"inertia": 0.0624, "coulomb": 10.0, "stiffness": 2e8}
    for name, tolerance in {"inertia": 0.03, "coulomb": 0.02, "stiffness": 0.03}.items():
        assert model[name] == pytest.approx(true[name], rel=tolerance), name
    capsys.readouterr()
    _run(diagnosed)
    assert "nothing is missing that these data could show" in capsys.readouterr().out


def test_the_axes_of_the_page_are_there() -> None:
    files = re.findall(r"^autotune run (\S+)$", MACHINES.read_text(), re.MULTILINE)
    assert len(files) == 2
    for file in files:
        assert read_axis(ROOT / file).link.endswith(".toml")


def test_every_key_of_the_page_is_one() -> None:
    from autotune_sim.composition import MachineFile

    known = str(MachineFile.model_json_schema())
    for key in re.findall(r"`([a-z_]+)`", MACHINES.read_text()):
        assert f"'{key}'" in known, key
