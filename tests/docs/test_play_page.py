"""The page about playing beside a master: short, true to the program, and its commands do what they say."""

from __future__ import annotations

import re
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

from autotune.control.torque_offset import FADE_IN, FADE_OUT, SCALE, STEP
from autotune_drivers.canopen.sidecar import TIME_OUT
from autotune_drivers.profile import read_profile
from tests.support.commands import called
from tests.tuning.play_rig import axis_file

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs/play.md").read_text(encoding="utf-8")
UNIT = (ROOT / "config/systemd/autotune-play@.service").read_text(encoding="utf-8")
SCREEN = 50  # lines


def typed(folder: Path, line: str) -> subprocess.CompletedProcess[str]:
    program, *rest = shlex.split(line)
    assert program == "autotune"
    return called(*rest, folder=folder)


def test_the_page_is_a_screen_and_its_numbers_are_the_programs() -> None:
    assert PAGE.count("\n") <= SCREEN
    guard = read_profile("autotune-sim").offset_guard
    assert guard is not None
    assert f"ramp = {guard.ramp:g}" in PAGE
    for said in (
        f"time-out is {TIME_OUT * 1e3:g} ms", f"{1e2 * STEP:g} % of `limits.torque`", f"within {FADE_IN:g} s",
        f"fades out ({FADE_OUT:g} s)", f"{SCALE[0]:g} to {SCALE[1]:g}",
    ):  # fmt: skip
        assert said in PAGE


def test_its_commands_answer_without_a_bus(tmp_path: Path) -> None:
    axis_file(tmp_path).rename(tmp_path / "my-axis.toml")
    (block,) = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    told, *plays = [typed(tmp_path, line) for line in block.splitlines()]
    assert told.returncode == 0
    assert "AXIS.toml" in told.stdout
    for play in plays:  # no adapter is there
        assert play.returncode == 5, play.stderr
        assert "second.tty" in play.stderr


def test_the_bus_to_try_it_on_is_served(tmp_path: Path) -> None:
    (line,) = re.findall(r"`python (-m autotune_sim .*?)`", PAGE)
    ports = [tmp_path / word for word in line.split() if word.endswith(".tty")]
    served = subprocess.Popen([sys.executable, *shlex.split(line)], cwd=tmp_path)
    try:
        for _ in range(600):
            if all(port.exists() for port in ports):
                break
            time.sleep(0.1)
        assert [port for port in ports if not port.exists()] == []
        assert len(ports) == 2
    finally:
        served.send_signal(signal.SIGINT)
        assert served.wait(30.0) in (0, 130)


def test_the_unit_calls_the_command_as_it_is() -> None:
    (line,) = re.findall(r"^ExecStart=\S+/autotune (.*)$", UNIT, re.MULTILINE)
    words = shlex.split(line)
    assert words[0] == "play"
    assert {word for word in words if word.startswith("--")} == {"--runs", "--metrics"}
    assert "SuccessExitStatus=130" in UNIT
    assert "RestartPreventExitStatus=2" in UNIT
