"""Every command of docs/live-view.md runs as it stands there."""

from __future__ import annotations

import os
import re
import shlex
import signal
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from tests.view.rerun_contents import empty_views

ROOT = Path(__file__).resolve().parents[2]
EXAMPLE = ROOT / "config" / "axes" / "edm-vertical.toml"
WIRE = "canopen+slcan:edm-vertical.tty?bitrate=1000000&node=5"
CLI = [sys.executable, "-m", "autotune.cli.main"]
COMMANDS = re.findall(r"^autotune (.*)$", (ROOT / "docs" / "live-view.md").read_text(), re.MULTILINE)
pytestmark = [pytest.mark.long, pytest.mark.slow]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An axis that is simulated in the process, and one behind a wire."""
    found = tmp_path_factory.mktemp("live-view")
    text = EXAMPLE.read_text()
    (found / "my-axis.toml").write_text(
        text.replace(WIRE, "sim://edm-vertical?memory=drive.json").replace(
            'name = "edm-vertical"', 'name = "my-axis"'
        )
    )
    (found / "wire.toml").write_text(text)
    return found


@pytest.fixture(scope="module")
def environment(folder: Path) -> dict[str, str]:
    screens = ("DISPLAY", "WAYLAND_DISPLAY")
    kept = {name: value for name, value in os.environ.items() if name not in screens}
    return kept | {"AUTOTUNE_LOCKS": str(folder / "locks")}


@pytest.mark.timeout(1200)
def test_every_command_of_the_page_runs(folder: Path, environment: dict[str, str]) -> None:
    assert len(COMMANDS) == 12
    for command in COMMANDS:
        words = shlex.split(command)
        if words[0] == "view":
            _viewed(words, folder, environment)
        elif words[0] == "sim":
            _simulated(words, folder, environment)
        else:
            _done(words, folder, environment)
    for path in folder.glob("*.rrd"):
        assert empty_views(path) == []


def _done(words: list[str], folder: Path, environment: dict[str, str]) -> None:
    if words[:2] == ["model", "compare"]:
        (newest,) = folder.glob("runs/*/model.toml")
        (folder / "model.toml").write_bytes(newest.read_bytes())
    done = subprocess.run(
        [*CLI, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode in (0, 3), (words, done.stderr)  # 3: done, and nothing kept
    assert "--view" not in words or "live view: http://127.0.0.1:" in done.stderr
    assert "Traceback" not in done.stderr
    assert "WARN" not in done.stdout + done.stderr


def _viewed(words: list[str], folder: Path, environment: dict[str, str]) -> None:
    if (
        words[1] == "my-axis.toml"
    ):  # no service has it here: `tests/service/test_live_view.py` attaches to one
        done = subprocess.run(
            [*CLI, *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 2
        assert "no service looks after axis my-axis" in done.stderr
        return
    given = next(folder.glob("runs/*/run.rrd")).parent if words[1].startswith("runs/") else words[1]
    with subprocess.Popen(
        [*CLI, "view", str(given)], cwd=folder, env=environment, stdout=subprocess.PIPE, text=True
    ) as shown:
        assert shown.stdout is not None
        address = shown.stdout.readline().strip()
        with urllib.request.urlopen(address, timeout=60.0) as page:
            assert page.status == 200
        shown.send_signal(signal.SIGTERM)
        shown.communicate(timeout=60.0)
    assert shown.returncode == 0


def _simulated(words: list[str], folder: Path, environment: dict[str, str]) -> None:
    command = [*CLI, *(word.replace("my-axis.toml", "wire.toml") for word in words)]
    with subprocess.Popen(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as drive:
        assert drive.stdout is not None
        assert "is simulated at" in drive.stdout.readline()
        drive.send_signal(signal.SIGTERM)
        _, errors = drive.communicate(timeout=60.0)
    assert "live view: http://127.0.0.1:" in errors
    assert drive.returncode == 0
