"""Completion, asked of the shells themselves."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import pytest

from autotune.cli.completion import SCRIPTS, Offer, kind_of, offers
from autotune.cli.main import main
from autotune.core.paths import config_directory
from autotune.models.table import EFFECTS

_ASK = 'source "$0"; COMP_WORDS=("$@"); COMP_CWORD=$(($#-1)); _autotune; printf "%s\\n" "${COMPREPLY[@]}"'


@pytest.fixture(scope="module")
def found() -> dict[str, Offer]:
    return offers()


@pytest.fixture(scope="module")
def folder(found: dict[str, Offer], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("completion")
    for shell, write in SCRIPTS.items():
        (folder / f".completion.{shell}").write_text(write(found))
    shutil.copy(config_directory() / "axes" / "edm-vertical.toml", folder / "press.toml")
    (folder / "model.toml").write_text("[inertia]\n")
    for name in ("day.parquet", "day.csv", "notes.txt"):
        (folder / name).touch()
    (folder / "runs").mkdir()
    return folder


def offered(folder: Path, *words: str) -> set[str]:
    """What bash would offer after `autotune` and these words."""
    command = ["bash", "--norc", "--noprofile", "-c", _ASK, ".completion.bash", "autotune", *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True)
    assert not done.stderr
    return {line.strip() for line in done.stdout.splitlines()} - {""}


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("com",), {"completion"}),
        (("model", ""), {"fit", "compare", "diagnose", "add", "effects", "show", "curves"}),
        (("run", ""), {"press.toml", "runs/"}),
        (("run", "press.toml", "--on"), {"--only"}),
        (("run", "--only", "e"), {"experiment"}),
        (("record", "press.toml", "hi"), {"high-speed"}),
        (("model", "compare", "day.csv", "--model", ""), {"model.toml", "runs/"}),
        (("model", "add", "gra"), {"gravity_imbalance"}),
        (("model", "add", "spring", "d"), {"day.csv", "day.parquet", "direction_asymmetry", "dwell_time_break_away"}),
        (("sim", "press.toml", "--effect", "back"), {"backlash"}),
        (("data", "import", "notes.txt", "--format", ""), {"csv", "mat", "epos", "parquet"}),
        (("export", "model.toml", "--to", "f"), {"fmu"}),
        (("nonsense", ""), set()),
    ],
)  # fmt: skip
def test_bash_offers(words: tuple[str, ...], expected: set[str], folder: Path) -> None:
    assert offered(folder, *words) == expected


def test_every_command_and_option_is_offered(found: dict[str, Offer], folder: Path) -> None:
    from autotune.cli.main import COMMANDS

    assert offered(folder, "") == {*COMMANDS, "--help", "--version"}
    assert offered(folder, "model", "fit", "-") == set(found["model fit"].options)


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_the_other_shells_understand_theirs(shell: str, folder: Path) -> None:
    program = shutil.which(shell)
    if program is None:
        pytest.skip(f"no {shell} here")
    subprocess.run([program, "-n", f".completion.{shell}"], cwd=folder, check=True)
    if shell == "fish":
        asked = "source .completion.fish; complete -C 'autotune model add spr'"
        done = subprocess.run(
            [program, "--no-config", "-c", asked], cwd=folder, capture_output=True, text=True
        )
        assert done.stdout.split() == ["spring"]


def test_what_can_stand_for_a_value() -> None:
    assert kind_of("format", "csv|mat") == "=csv,mat"
    assert kind_of("cycle", "SECONDS") == ""
    assert "spring" in EFFECTS


def test_another_shell_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ending:
        main(["completion", "tcsh"])
    assert ending.value.code == 2
    assert "bash, zsh, fish" in capsys.readouterr().err
