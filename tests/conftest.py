"""One thread of linear algebra a process, as in every program of autotune.

Property tests see the same examples in every run; HYPOTHESIS_PROFILE=random looks for new ones. None is held to a time
of the wall clock: a loaded host would break it.

Half of the time of the tests that write journals went into waiting for the disk, and a seventh of all processor time
into looking for garbage among modules that stay: no test cuts the power of the host, so that nothing is gained by the
first, and what was imported before the tests is left out of the second.

A test that fails while its machine stands still is run again, twice at most; `support/witness.py` says why.
"""

from __future__ import annotations

import gc
import os
import signal
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from _pytest.runner import runtestprotocol
from _pytest.unraisableexception import unraisable_exceptions
from hypothesis import settings

from autotune.core.garbage import seldom_collected
from autotune.core.threads import one_thread
from tests.support.witness import STOOD_STILL, Witness

one_thread()
settings.register_profile("same", derandomize=True, deadline=None)
settings.register_profile("random", print_blob=True, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "same"))


gc.disable()  # until all is imported


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop() -> None:
    """What was loaded until now stays; this is called in the workers and in the process that hands out the tests."""
    gc.freeze()
    seldom_collected()
    gc.enable()


AGAIN = 2
RUN_AGAIN = "run again"
witness = cache(Witness)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> bool:
    """As pytest does, and once more with new fixtures where a test failed on a machine that stood still."""
    seen = witness()
    item.ihook.pytest_runtest_logstart(nodeid=item.nodeid, location=item.location)
    for left in range(AGAIN, -1, -1):
        began = time.monotonic()
        reports = runtestprotocol(item, nextitem=nextitem, log=False)
        failed = [report for report in reports if report.failed]
        stood = seen.longest_since(began) if failed and left else 0.0
        if stood < STOOD_STILL:
            break
        item.session._setupstate.teardown_exact(None)
        _swept(item.config)
        failed[0].outcome = RUN_AGAIN  # type: ignore[assignment]
        failed[0].user_properties.append((RUN_AGAIN, stood))
        item.ihook.pytest_runtest_logreport(report=failed[0])
    for report in reports:
        item.ihook.pytest_runtest_logreport(report=report)
    item.ihook.pytest_runtest_logfinish(nodeid=item.nodeid, location=item.location)
    return True


def _swept(config: pytest.Config) -> None:
    """What a try that is run again has left open goes with it: found later, it is told as another test's failure."""
    for name in ("last_type", "last_value", "last_traceback", "last_exc"):
        vars(sys).pop(name, None)
    gc.collect()
    config.stash[unraisable_exceptions].clear()


def pytest_report_teststatus(report: pytest.CollectReport | pytest.TestReport) -> tuple[str, str, str] | None:
    return (RUN_AGAIN, "R", RUN_AGAIN.upper()) if report.outcome == RUN_AGAIN else None


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    for report in terminalreporter.getreports(RUN_AGAIN):
        stood = dict(report.user_properties)[RUN_AGAIN]
        terminalreporter.write_line(
            f"run again, as this machine stood still for {stood:.2g} s: {report.nodeid}"
        )


@pytest.fixture(autouse=True, scope="session")
def without_waiting_for_the_disk() -> Iterator[None]:
    """Programs that a test starts do wait for it; a test of the order of what reaches the disk puts its own here."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(os, "fsync", lambda descriptor: None)
        yield


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Folders, and modules in them, by their slowest tests: no worker begins one when the others have nothing left.

    A folder's stay together, and a module's: what they share is made once, as long as one worker has them.
    """
    longest: defaultdict[Path, float] = defaultdict(float)
    for item in items:
        for marker in item.iter_markers("slow"):
            for place in (item.path, item.path.parent):
                longest[place] = max(longest[place], *(marker.args or (1.0,)))

    def place(item: pytest.Item) -> tuple[float, Path, float, Path]:
        folder = item.path.parent
        return -longest[folder], folder, -longest[item.path], item.path

    items.sort(key=place)


@pytest.fixture
def signals_are_heard() -> Iterator[None]:
    """Hangup and interrupt act here and in children, though whoever started the tests may ignore them.

    `nohup` ignores the one, a shell that starts something in the background the other.
    """
    usual = {signal.SIGHUP: signal.SIG_DFL, signal.SIGINT: signal.default_int_handler}
    ignored = [number for number in usual if signal.getsignal(number) is signal.SIG_IGN]
    for number in ignored:
        signal.signal(number, usual[number])
    yield
    for number in ignored:
        signal.signal(number, signal.SIG_IGN)
