"""A simulated drive as a process of its own, for tests: started, ordered about, and its log watched."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from autotune.core.axis import Axis, read_axis
from autotune.core.paths import config_directory
from tests.support.forked import PIPE, SIMULATOR, STDOUT, Program

STARTS_WITHIN = 60.0


def axis_of(link: str = "canopen+slcan:edm.tty?bitrate=1000000&node=5", **changes: object) -> Axis:
    """The vertical axis with another link."""
    axis = read_axis(config_directory() / "axes" / "edm-vertical.toml")
    return axis.model_copy(update={"link": link, **changes})


@dataclass
class Simulator:
    """The process and what it has said."""

    process: Program
    directory: Path
    lines: list[str] = field(default_factory=list)

    @property
    def port(self) -> Path:
        return self.directory / "edm.tty"

    def order(self, text: str) -> None:
        """Puts a fault in, as `autotune_sim.faults` describes them."""
        stdin = self.process.stdin
        assert stdin is not None
        stdin.write(text + "\n")
        stdin.flush()

    def wait_for(self, text: str, after: int = 0, seconds: float = 20.0) -> str:
        """The first line from `after` on that contains `text`."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            for line in self.lines[after:]:
                if text in line:
                    return line
            time.sleep(0.005)
        raise AssertionError(f"the simulator never said {text!r}; it said:\n" + "\n".join(self.lines))

    @property
    def mark(self) -> int:
        """Number of lines so far."""
        return len(self.lines)

    def read(self, stream: IO[str]) -> None:
        for line in stream:
            self.lines.append(line.rstrip("\n"))


@contextmanager
def simulator(directory: Path, *arguments: str) -> Iterator[Simulator]:
    """Runs `python -m autotune_sim` with its port in `directory`."""
    port = str(directory / "edm.tty")
    process = Program(SIMULATOR, port, "--commands", *arguments, stdin=PIPE, stdout=PIPE, stderr=STDOUT)
    running = Simulator(process, directory)
    stdout = process.stdout
    assert stdout is not None
    reader = threading.Thread(target=running.read, args=(stdout,), daemon=True)
    reader.start()
    try:
        running.wait_for("boot-up", seconds=STARTS_WITHIN)
        yield running
    finally:
        process.kill()
        process.wait()
        reader.join()
        for stream in (process.stdin, stdout):
            if stream is not None:
                stream.close()
