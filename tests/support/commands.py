"""Commands of `autotune` called in the tests' own process, where everything is imported already.

A start of the program costs one to two seconds of processor time. What is about the process itself (signals, kill -9,
the environment, two programs at a time) starts one; what is about the command's answer does not.
"""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import chdir, contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from subprocess import CompletedProcess

import pytest

from autotune.cli.main import main


def called(*arguments: str, folder: Path | None = None) -> CompletedProcess[str]:
    """A command typed in a folder (that of the tests): its exit code and what it prints."""
    printed, said = StringIO(), StringIO()
    with (
        chdir(folder or Path.cwd()),
        redirect_stdout(printed),
        redirect_stderr(said),
        _own_signals(),
        pytest.raises(SystemExit) as ending,
    ):
        main(arguments)
    return CompletedProcess(arguments, int(ending.value.code or 0), printed.getvalue(), said.getvalue())


@contextmanager
def _own_signals() -> Iterator[None]:
    """The program's answers to signals go with it."""
    usual = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGHUP)}
    try:
        yield
    finally:
        for number, answer in usual.items():
            signal.signal(number, answer)
