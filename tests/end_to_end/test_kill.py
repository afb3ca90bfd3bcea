"""kill -9 at any stage: the drive stops by itself at once, and the next run puts right what was left."""

from __future__ import annotations

import json
import os
import re
import signal
from pathlib import Path

import pytest

from autotune.tuning.journal import Journal
from tests.drivers import bus
from tests.end_to_end.support import AT_REST, Bench, kill_hard, read_drive

WITHIN_SECONDS = 0.2


def quick_stops(bench: Bench) -> list[float]:
    """Monotonic times at which the drive began a quick stop."""
    return [
        float(m[1]) for m in re.finditer(r"^([\d.]+) quick stop begun", bench.log.read_text(), re.MULTILINE)
    ]


def stage_of(bench: Bench) -> str:
    try:
        return Journal.load(bench.newest()).state.stage
    except (ValueError, OSError):
        return ""


def powered(bench: Bench) -> bool:
    return bench.last_state() == "OPERATION_ENABLED"


@pytest.mark.slow(4)
@pytest.mark.parametrize(
    "stage",
    [
        "experiment",
        *(pytest.param(stage, marks=pytest.mark.long) for stage in ("diagnose", "adapt", "prove", "commit")),
    ],
)
def test_a_killed_run_is_stopped_by_the_drive_and_put_right_by_the_next(bench: Bench, stage: str) -> None:
    bench.start()
    before = read_drive(bench)
    process = bench.popen()
    bench.wait_for(lambda: stage_of(bench) == stage and powered(bench), 200.0)
    stops = len(quick_stops(bench))
    killed = kill_hard(process)
    for stream in (process.stdout, process.stderr):
        if stream is not None:
            stream.close()
    bench.wait_for(lambda: len(quick_stops(bench)) > stops, 10.0)
    assert quick_stops(bench)[stops] - killed < WITHIN_SECONDS
    bench.wait_for(lambda: bench.last_state() in (AT_REST, "FAULT"), 10.0)
    done = bench.run("--only", "check")
    assert done.returncode == 0, done.stderr
    assert stage in " ".join(json.loads(done.stdout)["notes"])
    assert read_drive(bench) == pytest.approx(before)


def kill_both(bench: Bench) -> dict[str, float]:
    """kill -9 of a run and of its cyclic process while it moves; the drive's settings before.

    The run is halted first: left alone for a moment, it would start another cyclic process.
    """
    before = bus.settings(bench.folder / "edm-vertical.tty")
    process = bench.popen()
    bench.wait_for(lambda: stage_of(bench) == "experiment" and powered(bench), 200.0)
    os.kill(process.pid, signal.SIGSTOP)
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    for child in map(int, children):
        os.kill(child, signal.SIGKILL)
    kill_hard(process)
    for stream in (process.stdout, process.stderr):
        if stream is not None:
            stream.close()
    bench.wait_for(lambda: bench.last_state() in (AT_REST, "FAULT"), 10.0)
    return before


@pytest.mark.slow
def test_where_both_processes_die_the_next_run_puts_back_what_the_session_had_changed(bench: Bench) -> None:
    """1016h, 1017h, 6007h, the mode, PDO types and mappings, and the limits: none may count as the drive's own."""
    bench.start()
    before = kill_both(bench)
    left = bus.settings(bench.folder / "edm-vertical.tty")
    for text in ("1016:01 u32", "1017:00 u16", "6007:00 i16", "1400:2"):
        assert left[text] != before[text], text
    done = bench.run("--only", "check")
    assert done.returncode == 0, done.stderr
    notes = " ".join(json.loads(done.stdout)["notes"])
    assert "1017h:00" in notes
    assert notes.count("put back") == 2  # the session's settings and the run's limits
    assert bus.settings(bench.folder / "edm-vertical.tty") == before


@pytest.mark.slow
def test_a_drive_in_the_place_of_the_one_that_was_left_is_not_written_to(bench: Bench) -> None:
    bench.start("--seed", "1")
    kill_both(bench)
    left = bench.newest()
    bench.stop()
    bench.start("--seed", "8")
    before = bus.settings(bench.folder / "edm-vertical.tty")
    done = bench.run("--only", "check")
    assert done.returncode == 0, done.stderr
    notes = " ".join(json.loads(done.stdout)["notes"])
    assert "The drive here is another one (serial is" in notes
    assert "another drive of this axis" in notes
    assert bus.settings(bench.folder / "edm-vertical.tty") == before
    assert not Journal.load(left).state.outcome
