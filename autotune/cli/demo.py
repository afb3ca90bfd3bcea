"""`make demo`: a simulated drive in a process of its own, then one `autotune run` over its wire."""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from autotune.cli.output import answer, complain, say
from autotune.core.axis import read_axis

START_SECONDS = 60.0


def main() -> None:
    """Simulates the axis, tunes it, says in plain words what came out and where it is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("axis", type=Path)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--runs", type=Path, default=Path("runs"))
    options = parser.parse_args()
    name = read_axis(options.axis).name
    say(f"demo: simulating the drive of {name} in a process of its own")
    with simulated(options.axis, options.seed):
        command = [sys.executable, "-m", "autotune.cli.main", "run", str(options.axis), "--yes", "--json"]
        tuned = subprocess.run(
            [*command, "--runs", str(options.runs)], stdout=subprocess.PIPE, text=True, check=False
        )
    sys.exit(_verdict(tuned.stdout, tuned.returncode))


@contextmanager
def simulated(axis: Path, seed: int = 0) -> Iterator[subprocess.Popen[str]]:
    """Runs `autotune sim` until the block ends; it is ready when it has announced its link."""
    command = [sys.executable, "-m", "autotune.cli.main", "sim", str(axis), "--seed", str(seed)]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True)
    try:
        _wait_until_announced(process)
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if process.stdout is not None:
            process.stdout.close()


def _wait_until_announced(process: subprocess.Popen[str]) -> None:
    end = time.monotonic() + START_SECONDS
    while process.stdout is not None and time.monotonic() < end:
        line = process.stdout.readline()
        if "is simulated at" in line or not line:
            break
    if process.poll() is not None:
        sys.exit(complain(f"the simulated drive ended with code {process.returncode}", 5))


def _verdict(output: str, code: int) -> int:
    try:
        result = json.loads(output)
    except ValueError:
        return complain("the run gave no result; see the messages above", code or 5)
    directory = Path(result["run_directory"])
    answer(result["verdict"])
    answer("")
    for name, what in (
        ("report.html", "the report: figures first; open it in a browser"),
        ("run.json", "everything as data"),
        ("model.toml", "the model of the axis, with the effects that were found"),
        ("feedforward.toml", "what the host has to play beyond the drive's own block"),
        ("run.rrd", "all traces for the Rerun viewer"),
        ("recordings", "what was measured (Parquet)"),
    ):
        if (directory / name).exists():
            answer(f"  {directory / name}: {what}")
    return code


if __name__ == "__main__":
    main()
