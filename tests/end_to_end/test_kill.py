"""kill -9 at any stage: the drive stops by itself at once, and the next run puts right what was left."""

from __future__ import annotations

import json
import re

import pytest

from autotune.service.journal import Journal
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


@pytest.mark.slow
@pytest.mark.parametrize(
    "stage",
    [
        "experiment",
        *(pytest.param(stage, marks=pytest.mark.long) for stage in ("diagnose", "adapt", "prove")),
        "commit",
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
