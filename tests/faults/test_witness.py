"""A test that fails while its machine stands still is run again, with new fixtures; on a machine that ran it is not."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.forked import ROOT

TESTS = """
import os, signal, time
import pytest
from tests.conftest import witness

made = []

@pytest.fixture(scope="module")
def times():
    made.append(1)
    return len(made)

def test_of_a_wire(times):
    if times <= {failures}:
        {stand_still}
        raise ValueError("the drive's guard")
"""
STAND_STILL = (
    "pid = witness().process.pid; os.kill(pid, signal.SIGSTOP); time.sleep(0.2); os.kill(pid, signal.SIGCONT)"
)


LEFT_OPEN = """
import gc

class Wire:
    def __del__(self):
        raise OSError("not properly shut down")

def test_that_leaves_a_wire_open(times):
    if times == 1:
        wire = Wire()
        wire.reader = wire
        {stand_still}
        raise ValueError("the drive's guard")

def test_of_something_else():
    gc.collect()
"""


def outcome(tmp_path: Path, failures: int, stand_still: str, more: str = "") -> str:
    """The last line of pytest's output."""
    file = tmp_path / "test_of_a_wire.py"
    file.write_text(TESTS.format(failures=failures, stand_still=stand_still) + more)
    command = [sys.executable, "-m", "pytest", "-p", "tests.conftest", "-c", "pyproject.toml", str(file)]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False).stdout
    return told.splitlines()[-1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("failures", "stand_still", "told"),
    [
        (1, STAND_STILL, "1 passed, 1 run again"),
        (2, STAND_STILL, "1 passed, 2 run again"),
        (3, STAND_STILL, "1 failed, 2 run again"),
        (1, "pass", "1 failed in"),
    ],
)
def test_only_what_stood_still_is_run_again(
    tmp_path: Path, failures: int, stand_still: str, told: str
) -> None:
    assert outcome(tmp_path, failures, stand_still).startswith(told)


@pytest.mark.slow
def test_what_such_a_test_left_open_is_no_other_tests_failure(tmp_path: Path) -> None:
    """A bus whose test was run again was collected in the next one, and failed that."""
    more = LEFT_OPEN.format(stand_still=STAND_STILL)
    assert outcome(tmp_path, 0, "pass", more).startswith("3 passed, 1 run again")
