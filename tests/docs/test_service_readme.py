"""The README's section "Run it every night", followed: its commands are run, in folders of the test's own.

Not run are only what needs rights over the machine (a user, systemctl) and the installation itself, which is
replaced by the one that the test runs in. systemd's part is played by the test: it starts what the installed
unit names, with its environment, and listens on the socket that a `Type=notify` service reports to.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import signal
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
SECTION = README.split("\n## Run it every night\n")[1].split("\n## ")[0]
BLOCKS = [
    [line.split("#")[0].strip() for line in block.splitlines()]
    for block in re.findall(r"```sh\n(.*?)```", SECTION, re.DOTALL)
]
TRY, OTHER_TERMINAL, SYSTEMD, SUPERVISED = BLOCKS
RIGHTS = ("useradd", "systemctl", "python3 -m venv", "/opt/autotune/bin/pip", "curl")
PATIENCE = 120.0  # s; a loaded host is slow, a broken service never comes


@dataclass
class Machine:
    """Folders that stand for /etc, /opt and /var/lib, and what was started."""

    root: Path
    started: list[subprocess.Popen[str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        for name in ("opt/autotune/bin", "etc/systemd/system", "var/lib/autotune", "var/cache/autotune"):
            (self.root / name).mkdir(parents=True)
        program = self.root / "opt/autotune/bin/autotune"
        program.write_text(f'#!/bin/sh\nexec {sys.executable} -m autotune.cli.main "$@"\n')
        program.chmod(0o755)

    def here(self, line: str) -> str:
        """The command with the machine's folders replaced by the test's."""
        return re.sub(r"(?<![\w.])/(etc|opt|var)/", rf"{self.root}/\1/", line)

    def run(self, line: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            ["bash", "-c", self.here(line)], cwd=ROOT, env=self.environment, capture_output=True, text=True,
            timeout=PATIENCE, check=False,
        )  # fmt: skip

    @property
    def environment(self) -> dict[str, str]:
        path = f"{self.root / 'opt/autotune/bin'}:{os.environ['PATH']}"
        return {**os.environ, "PATH": path, "AUTOTUNE_LOCKS": str(self.root / "locks")}

    def start(self, arguments: list[str], **more: str) -> subprocess.Popen[str]:
        with (self.root / "log").open("a") as log:
            process = subprocess.Popen(
                arguments, cwd=self.root / "var/lib/autotune", env=self.environment | more, text=True,
                stdout=subprocess.PIPE, stderr=log,
            )  # fmt: skip
        self.started.append(process)
        return process

    def address_of(self, process: subprocess.Popen[str]) -> str:
        assert process.stdout is not None
        address = process.stdout.readline().strip()
        assert re.fullmatch(r"http://127\.0\.0\.1:\d+", address), (self.root / "log").read_text()
        return address

    def any_port(self) -> None:
        """The example's port may be in use here."""
        file = self.root / "etc/autotune/service.toml"
        file.write_text(file.read_text().replace("port = 8765", "port = 0"))


@pytest.fixture
def machine(tmp_path: Path) -> Iterator[Machine]:
    made = Machine(tmp_path)
    yield made
    for process in made.started:
        if process.poll() is None:
            process.kill()
        process.communicate()


def healthy(address: str) -> bool:
    with urllib.request.urlopen(f"{address}/healthz", timeout=30.0) as answer:
        return bool(json.loads(answer.read())["status"] == "ok")


def install(machine: Machine) -> None:
    """The installation, line by line."""
    for line in SYSTEMD:
        if not line.startswith((*RIGHTS, "systemd-analyze")):
            done = machine.run(line)
            assert done.returncode == 0, (line, done.stderr)


def unit(machine: Machine) -> dict[str, str]:
    """The installed unit's settings (the last of each name), with the test's folders."""
    text = (machine.root / "etc/systemd/system/autotune.service").read_text()
    pairs = re.findall(r"^(\w+)=(.*)$", text, re.MULTILINE)
    return {name: machine.here(value) for name, value in pairs}


def test_what_is_tried_first_works_as_shown(machine: Machine) -> None:
    assert TRY == ["autotune serve --check", "autotune serve"]
    done = machine.run(TRY[0])
    assert done.returncode == 0, done.stderr
    assert "simulated" in done.stdout
    for line in OTHER_TERMINAL[1:]:
        _, command, axis = shlex.split(line)
        assert command in ("check", "history")
        assert (ROOT / axis).is_file()


def test_systemd_gets_a_service_that_is_ready_alive_and_ends_politely(machine: Machine) -> None:
    install(machine)
    machine.any_port()
    settings = unit(machine)
    assert settings["Type"] == "notify"
    assert settings["WorkingDirectory"] == f"{machine.root}/var/lib/autotune"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as channel:
        channel.settimeout(PATIENCE)
        channel.bind(str(machine.root / "notify"))
        variables = dict(pair.split("=", 1) for pair in shlex.split(settings["Environment"]))
        process = machine.start(
            shlex.split(settings["ExecStart"]), NOTIFY_SOCKET=str(machine.root / "notify"), JOURNAL_STREAM="8:1",
            **variables,
        )  # fmt: skip
        address = machine.address_of(process)
        heard = [channel.recv(4096).decode() for _ in range(3)]
        assert heard[0].startswith("READY=1")
        assert "WATCHDOG=1" in heard
        assert healthy(address)
        reload = settings["ExecReload"].replace("$MAINPID", str(process.pid))
        assert subprocess.run(shlex.split(reload), check=False).returncode == 0
        wait_for(lambda: "RELOADING=1" in channel.recv(4096).decode())
        wait_for(lambda: "READY=1" in channel.recv(4096).decode())
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE) == 0
        channel.settimeout(1.0)
        wait_for(lambda: "STOPPING=1" in channel.recv(4096).decode())
    assert "<6>axes: simulated" in (machine.root / "log").read_text()
    assert (machine.root / "var/lib/autotune/runs/.service/history.sqlite").is_file()


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_systemd_finds_nothing_wrong_with_the_installed_unit(machine: Machine) -> None:
    install(machine)
    installed = machine.root / "etc/systemd/system/autotune.service"
    installed.write_text(machine.here(installed.read_text()))
    (line,) = [line for line in SYSTEMD if line.startswith("systemd-analyze")]
    done = machine.run(line)
    assert done.returncode == 0, done.stderr
    assert "autotune.service" not in done.stderr


def test_without_systemd_the_shell_starts_a_killed_service_again(machine: Machine) -> None:
    install(machine)
    machine.any_port()
    (line,) = SUPERVISED
    loop = machine.start(
        ["bash", "-c", line.replace("config/service.toml", str(machine.root / "etc/autotune/service.toml"))]
    )
    assert healthy(machine.address_of(loop))
    child(loop.pid, signal.SIGKILL)
    assert healthy(machine.address_of(loop))
    child(loop.pid, signal.SIGTERM)
    assert loop.wait(PATIENCE) == 0


def child(process: int, number: signal.Signals) -> None:
    """Sends a signal to the one child of a process."""
    (only,) = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    os.kill(int(only), number)


def wait_for(seen: Callable[[], Any]) -> None:
    for _ in range(2000):
        if seen():
            return
    pytest.fail("it never came")
