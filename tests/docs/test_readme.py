"""Everything that the README shows is run, or at least taken at its word, here."""

from __future__ import annotations

import re
import shlex
import subprocess
from pathlib import Path

import pytest

from autotune.core.axis import Limits, read_axis
from tests.support.commands import called

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


def commands(tool: str) -> list[list[str]]:
    lines = [line.split("#")[0].strip() for block in blocks("sh") for line in block.splitlines()]
    return [shlex.split(line)[1:] for line in lines if line.startswith(f"{tool} ")]


def shown_axis(folder: Path, link: str) -> Path:
    """The README's axis file, its drive replaced by the simulated one."""
    text = re.sub(r'^link = "[^"]*"', f'link = "{link}"', blocks("toml")[0], flags=re.MULTILINE)
    path = folder / "my-axis.toml"
    path.write_text(text.replace("cycle = 0.002", "cycle = 0.001"), encoding="utf-8")
    return path


def test_the_axis_file_shown_is_valid_and_shows_every_limit(tmp_path: Path) -> None:
    path = tmp_path / "my-axis.toml"
    path.write_text(blocks("toml")[0], encoding="utf-8")
    read_axis(path)
    for name in Limits.model_fields:
        assert re.search(rf"^{name} = ", blocks("toml")[0], re.MULTILINE), name
        assert f"`{name}`" in README, name


@pytest.mark.parametrize("count", [1, pytest.param(3, marks=[pytest.mark.slow, pytest.mark.long])])
def test_the_commands_on_an_axis_work_as_shown(count: int, tmp_path: Path) -> None:
    """The first is the check alone; a whole run and its rollback are seen on a wire in every `make test`."""
    shown_axis(tmp_path, "sim://edm-vertical")
    mine = [arguments for arguments in commands("autotune") if "my-axis.toml" in arguments]
    assert [arguments[0] for arguments in mine] == ["run", "run", "rollback"]
    for arguments in mine[:count]:
        done = called(*arguments, folder=tmp_path)
        assert done.returncode == 0, (arguments, done.stderr)
    run = max(path for path in (tmp_path / "runs").glob("2*-my-axis") if (path / "report.html").exists())
    for name in ("model.toml", "run.rrd", "run.json", "recordings") if count > 1 else ("run.json",):
        assert (run / name).exists(), name


@pytest.mark.parametrize("target", [arguments[0] for arguments in commands("make")])
def test_the_make_targets_shown_exist(target: str) -> None:
    done = subprocess.run(["make", "-n", target], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_what_the_readme_points_to_is_there() -> None:
    for target in re.findall(r"\]\(([^)]+)\)", README):
        assert (ROOT / target).exists(), target


@pytest.mark.parametrize(
    ("command", "options"),
    [("run", ("--yes", "--view", "--only")), ("sim", ("--seed", "--effect", "--fault"))],
)
def test_the_options_named_are_those_of_the_program(command: str, options: tuple[str, ...]) -> None:
    known = called(command, "--help").stdout
    for option in options:
        assert option in known, option
        assert option in README, option
