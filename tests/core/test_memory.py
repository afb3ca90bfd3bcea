"""A program that keeps the memory of large arrays is not given every page of them anew."""

from __future__ import annotations

import subprocess
import sys

import pytest

PAGE = 4096
FAULTS = """
import resource, sys
import numpy as np
from autotune.core.memory import large_arrays_kept
if sys.argv[1] == "kept":
    large_arrays_kept()
for _ in range(20):
    runs = [np.ones(120_000) for _ in range(64)]
    del runs
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt)
"""


def _faults(how: str) -> int:
    done = subprocess.run(
        [sys.executable, "-c", FAULTS, how], capture_output=True, text=True, check=True, timeout=60
    )
    return int(done.stdout)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="mallopt is of the C library of Linux")
def test_large_arrays_are_in_memory_that_was_there_before() -> None:
    pages = 20 * 64 * 120_000 * 8 // PAGE
    given, kept = _faults("given back"), _faults("kept")
    assert given > 0.8 * pages
    assert kept < 0.2 * pages
