"""A command looks for garbage seldom; who calls the command line from a program of his own keeps what he has set."""

from __future__ import annotations

import gc
import subprocess
import sys
from collections.abc import Iterator

import pytest

from autotune.cli.main import main
from autotune.core.garbage import THRESHOLDS

USUAL = (700, 10, 10)
COMMAND = """
import gc, sys
from autotune.cli.main import main
sys.argv = ["autotune", "--version"]
try:
    main()
finally:
    print(*gc.get_threshold())
"""


@pytest.fixture
def usual() -> Iterator[None]:
    before = gc.get_threshold()
    gc.set_threshold(*USUAL)
    yield
    gc.set_threshold(*before)


@pytest.mark.usefixtures("usual")
def test_a_caller_keeps_what_he_has_set() -> None:
    with pytest.raises(SystemExit):
        main(["--version"])
    assert gc.get_threshold() == USUAL


def test_a_command_looks_seldom() -> None:
    done = subprocess.run(
        [sys.executable, "-c", COMMAND], capture_output=True, text=True, check=True, timeout=60
    )
    assert tuple(map(int, done.stdout.splitlines()[-1].split())) == THRESHOLDS
