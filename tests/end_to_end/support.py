"""A simulated drive in a process of its own, an axis file beside it, and the command line as a user has it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from autotune.core.axis import read_axis
from autotune_drivers import open_loop
from tests.support.commands import called
from tests.support.forked import AUTOTUNE, PIPE, Program

EXAMPLE = Path(__file__).resolve().parents[2] / "config" / "axes" / "edm-vertical.toml"
CLI = [sys.executable, "-m", "autotune.cli.main"]
AT_REST = "SWITCH_ON_DISABLED"
STOPPED_SECONDS = 10.0


@dataclass
class Bench:
    """One axis file, its simulated drive, and where its runs go."""

    folder: Path
    axis: Path
    drive: Program | None = None
    log: Path = field(init=False)

    def __post_init__(self) -> None:
        self.log = self.folder / "drive.log"

    @property
    def runs(self) -> Path:
        return self.folder / "runs"

    def change(self, old: str, new: str) -> None:
        text = self.axis.read_text()
        assert old in text
        self.axis.write_text(text.replace(old, new))

    def start(self, *options: str) -> None:
        """Starts `autotune sim` and waits until its port can be opened."""
        with self.log.open("w") as log:
            self.drive = Program(AUTOTUNE, "sim", str(self.axis), *options, stderr=log)
        assert self.drive.stdout is not None
        assert "is simulated at" in self.drive.stdout.readline()

    def call(self, *arguments: str, timeout: float = 280.0) -> subprocess.CompletedProcess[str]:
        """A command in a process of its own, as a user has it."""
        return subprocess.run(
            [*CLI, *arguments], capture_output=True, text=True, timeout=timeout, check=False
        )

    def whole_run(self, *options: str) -> tuple[str, ...]:
        """The arguments of a run that asks nobody."""
        return ("run", str(self.axis), "--yes", "--json", "--runs", str(self.runs), *options)

    def run(self, *options: str) -> subprocess.CompletedProcess[str]:
        """A run asked for in this process, where everything is imported already; the cyclic process is its own."""
        return called(*self.whole_run(*options))

    def popen(self, *options: str) -> Program:
        """A run in a process of its own, to be interrupted or killed."""
        return Program(AUTOTUNE, *self.whole_run(*options), stderr=PIPE)

    def wait_for(self, seen: Callable[[], bool], seconds: float = 120.0) -> None:
        end = time.monotonic() + seconds
        while not seen():
            assert time.monotonic() < end, (
                f"waited {seconds} s in vain; the drive's log:\n{self.log.read_text()}"
            )
            time.sleep(0.02)

    def newest(self) -> Path:
        """The folder of the last run."""
        return max(self.runs.glob("2*-edm-vertical"))

    def result(self) -> dict[str, Any]:
        return dict(json.loads((self.newest() / "run.json").read_text()))

    def last_state(self) -> str:
        """State that the drive's log names last."""
        states = [
            line.split("->")[1].split()[0] for line in self.log.read_text().splitlines() if " state " in line
        ]
        return states[-1]

    def ends_in(self, *states: str) -> bool:
        """Whether the drive comes to one of these states: it stops by itself, and the program may be gone before."""
        end = time.monotonic() + STOPPED_SECONDS
        while self.last_state() not in states and time.monotonic() < end:
            time.sleep(0.05)
        return self.last_state() in states

    def stop(self) -> None:
        if self.drive is not None and self.drive.poll() is None:
            self.drive.send_signal(signal.SIGINT)
            try:
                self.drive.wait(10)
            except subprocess.TimeoutExpired:
                self.drive.kill()
                self.drive.wait()
        if self.drive is not None and self.drive.stdout is not None:
            self.drive.stdout.close()


def read_drive(bench: Bench) -> dict[str, float]:
    """All parameters that the drive holds now, read by a master of its own."""
    with closing(open_loop(read_axis(bench.axis), bench.folder)) as loop:
        return dict(loop.read_parameters())


def kill_hard(process: Program) -> float:
    """kill -9; returns the monotonic time of it."""
    when = time.monotonic()
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    return when
