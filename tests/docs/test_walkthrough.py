"""The walk-through is typed again, command by command, and must end at the noise floor."""

from __future__ import annotations

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TEXT = (ROOT / "docs/walkthrough.md").read_text(encoding="utf-8")


def _blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", TEXT, re.DOTALL)


def _autotune(folder: Path, *arguments: str) -> str:
    done = subprocess.run(
        [sys.executable, "-m", "autotune.cli.main", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_walk_through_runs_as_written(tmp_path: Path) -> None:
    (tmp_path / "axis.toml").write_text(_blocks("toml")[0], encoding="utf-8")
    printed = {}
    for line in "".join(_blocks("sh")).splitlines():
        arguments = shlex.split(line)
        assert arguments[0] == "autotune"
        printed[" ".join(arguments[1:3])] = _autotune(tmp_path, *arguments[1:])
    assert printed["model diagnose"].startswith("missing: stribeck, spring (confirmed)")
    for page in ("compare.html", "diagnosis.html", "story.html"):
        assert (tmp_path / page).stat().st_size > 10_000
    shown = json.loads(_autotune(tmp_path, "model", "show", "best.toml", "--json"))
    errors = [entry["error_after"] for entry in shown["history"]]
    assert [entry["action"] for entry in shown["history"]] == ["fitted", "+ stribeck", "+ spring"]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 1.2 * shown["history"][-1]["noise_floor"]
    assert 0.0049 < shown["parameters"]["spring.stiffness"]["value"] < 0.0051
