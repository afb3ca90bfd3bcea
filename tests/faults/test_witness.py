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


def outcome(tmp_path: Path, failures: int, stand_still: str) -> str:
    """The last line of pytest's output."""
    file = tmp_path / "test_of_a_wire.py"
    file.write_text(TESTS.format(failures=failures, stand_still=stand_still))
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
