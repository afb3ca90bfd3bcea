"""The table of commands says of each what the command says of itself."""

from __future__ import annotations

import inspect
import subprocess
import sys
from importlib import import_module

import pytest
import typer

import autotune
from autotune.cli.main import COMMANDS, main


def test_python_runs_the_package_as_the_command() -> None:
    """`python -m autotune`: where the command is not on the path."""
    command = [sys.executable, "-m", "autotune", "--version"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.split() == ["autotune", autotune.__version__]


@pytest.mark.parametrize("name", COMMANDS)
def test_the_line_of_a_command_is_the_first_of_its_own_help(name: str) -> None:
    command = getattr(import_module(f"autotune.cli.{name}"), name)
    own = command.info.help if isinstance(command, typer.Typer) else inspect.getdoc(command)
    assert own.split("\n")[0] == COMMANDS[name]


@pytest.mark.parametrize("arguments", [[], ["modle"], ["--", "model"]])
def test_without_a_command_the_answer_is_one_of_usage(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ending:
        main(arguments)
    assert ending.value.code == 2
    assert "Traceback" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["diagnose", "a.toml"], "autotune model diagnose …"),
        (["import", "a.csv"], "autotune data import …"),
        (["model", "fit", "a.csv"], "see 'autotune model fit --help'"),
        (["gains"], "see 'autotune gains --help'"),
    ],
)
def test_a_usage_error_names_the_command_whose_help_answers(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ending:
        main(arguments)
    assert ending.value.code == 2
    assert said in capsys.readouterr().err
