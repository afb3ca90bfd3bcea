"""A bus with a simulated drive, a foreign master and a sidecar, each a process of its own; for tests and the bench."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autotune.core.paths import config_directory
from tests.drivers.simulator import Simulator, simulator

HERE = Path(__file__).parent
RUN = "20260101-000000-edm-vertical"
WITHIN = 90.0  # s for whatever must happen at all

Columns = dict[str, NDArray[Any]]


def axis_file(directory: Path) -> Path:
    """The vertical axis at the second adapter, with the run that has proved its model."""
    text = (config_directory() / "axes" / "edm-vertical.toml").read_text()
    path = directory / "axis.toml"
    path.write_text(text.replace("edm-vertical.tty", "second.tty"))
    run = directory / "runs" / RUN
    run.mkdir(parents=True)
    shutil.copy(HERE / "play_model.toml", run / "feedforward.toml")
    (run / "journal.json").write_text('{"identity": {"vendor": 2147460865, "product": 1026, "serial": 1000}}')
    return path


class Process:
    """A child whose output is watched."""

    def __init__(self, log: Path, *arguments: str) -> None:
        self.log = log
        with log.open("w") as out:
            self.process = subprocess.Popen(
                [sys.executable, *arguments], stdout=out, stderr=subprocess.STDOUT, cwd=log.parent,
                env=os.environ | {"PYTHONUNBUFFERED": "1"},
            )  # fmt: skip

    @property
    def text(self) -> str:
        return self.log.read_text()

    def wait_for(self, text: str) -> None:
        end = time.monotonic() + WITHIN
        while text not in self.text:
            assert self.process.poll() is None or text in self.text, self.text
            assert time.monotonic() < end, f"never said {text!r}: {self.text}"
            time.sleep(0.02)

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()


class Rig:
    """The three processes."""

    def __init__(self, directory: Path, drive: Simulator, *options: str) -> None:
        self.directory, self.drive = directory, drive
        self.sidecars = 0
        self.master = Process(
            directory / "master.log", str(HERE / "foreign_master.py"), str(drive.port), "seen.npz",
            "--go", "go", "--until", "end", *options,
        )  # fmt: skip
        self.master.wait_for("enabled")

    def start(self) -> Process:
        """A sidecar that watches."""
        self.sidecars += 1
        log = self.directory / f"play-{self.sidecars}.log"
        sidecar = Process(log, "-m", "autotune.cli.main", "play", "axis.toml", "--metrics", "play.prom")
        sidecar.wait_for("watching")
        return sidecar

    def go(self) -> None:
        (self.directory / "go").touch()

    @property
    def cycles(self) -> int:
        """Of the master in motion, to the last hundred."""
        told = re.findall(r"at (\d+) ", self.master.text)
        return int(told[-1]) if told else 0

    @property
    def missed(self) -> int:
        """Cycles of the master in motion without a sidecar's frame."""
        told = re.findall(r"missed (\d+)", self.master.text)
        return int(told[-1]) if told else 0

    def pass_cycles(self, count: int) -> None:
        """Waits while the master plays so many."""
        end, until = time.monotonic() + WITHIN, self.cycles + count
        while self.cycles < until:
            assert time.monotonic() < end, self.master.text
            assert self.master.process.poll() is None, self.master.text
            time.sleep(0.01)

    def finish(self) -> Columns:
        """What the master has seen, a row a cycle."""
        (self.directory / "end").touch()
        self.master.wait_for("done")
        self.master.process.wait(WITHIN)
        with np.load(self.directory / "seen.npz") as seen:
            return dict(seen)


@contextmanager
def rig(directory: Path, *options: str) -> Iterator[Rig]:
    """Drive and master; sidecars as they are started."""
    axis_file(directory)
    with simulator(directory, "--also", str(directory / "second.tty")) as drive:
        running = Rig(directory, drive, *options)
        try:
            yield running
        finally:
            running.master.kill()


def stop(sidecar: Process) -> int:
    """Asks a sidecar to stop; its exit code."""
    sidecar.process.send_signal(signal.SIGTERM)
    return sidecar.process.wait(WITHIN)


def largest_step(seen: Columns) -> float:
    """Of the offset that acts, from one cycle to the next [N m]."""
    return float(np.abs(np.diff(seen["offset"])).max())


def peak_error(seen: Columns, start: int, periods: int) -> float:
    """Peak of the average of whole periods (1 s), as the benchmark has it [rad]."""
    error = (seen["demand"] - seen["position"])[start : start + 1000 * periods]
    return float(np.abs(error.reshape(periods, 1000).mean(axis=0)).max())


def longest_hold(seen: Columns) -> list[int]:
    """Cycles in which an offset stood, from each last frame of a sidecar until it was gone."""
    there = seen["accompanied"] > 0
    standing = np.abs(seen["offset"]) > 0.0
    holds, last = [], -1
    for k in range(len(there)):
        if there[k]:
            last = k
        elif last >= 0 and not standing[k]:
            holds.append(k - last)
            last = -1
    return holds
